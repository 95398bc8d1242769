// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellCamera_h
#define quellCamera_h

#include "quellScene.h"
#include "quellVector.h"
#include "vtkQuellRayTracingModule.h"

#include <string>

namespace quell
{
/// A pinhole or orthographic camera over a W x H frame, row 0 at the bottom; positions relative to the recentred
/// origin.
class VTKQUELLRAYTRACING_EXPORT Camera
{
public:
  Camera() = default;
  /// `worldFromCamera` in scene units, absolute; scales in it are taken out; a singular one or an impossible opening
  /// angle is replaced by a usable one.
  Camera(const CameraModel& model, const Mat4& worldFromCamera, const Vec3d& origin, int width, int height);

  /// Sees the whole box, as large as the frame allows, from the front (+z), a little from the right and above.
  static Camera Framing(const Vec3d& lower, const Vec3d& upper, const Vec3d& origin, int width, int height);

  /// Index of the camera called `name` (a name, else a number; empty: the first); -1 when the scene has none and
  /// `name` is empty. Throws std::invalid_argument with the names to choose from.
  static int Find(const Scene& scene, const std::string& name);

  /// Through the point (px, py) in pixels of the whole frame; `direction` is unit length.
  void Ray(double px, double py, Vec3d& start, Vec3d& direction) const noexcept
  {
    const double x = (2 * px / this->Width - 1) * this->HalfX, y = (2 * py / this->Height - 1) * this->HalfY;
    if (this->Orthographic)
    {
      start = this->Position + this->Right * x + this->Up * y;
      direction = this->Forward;
      return;
    }
    start = this->Position;
    direction = Normalized(this->Forward + this->Right * x + this->Up * y);
  }
  /// Distance along the view axis.
  double Depth(const Vec3d& p) const noexcept { return Dot(p - this->Position, this->Forward); }
  /// Pixel coordinates of a point (w = 1) or of a direction at infinity (w = 0); false when it is behind the camera.
  bool Project(const Vec3d& p, double w, Vec2<double>& pixel) const noexcept;

  const Mat4& WorldToCamera() const { return this->ToCamera; }
  const Mat4& WorldToNdc() const { return this->ToNdc; }
  bool operator==(const Camera& o) const;

  Vec3d Position, Right{ 1, 0, 0 }, Up{ 0, 1, 0 }, Forward{ 0, 0, -1 };
  double HalfX = 1, HalfY = 1; ///< half extents: tangents, or scene units when orthographic
  bool Orthographic = false;
  int Width = 1, Height = 1;

private:
  void Finish();
  Mat4 ToCamera, ToNdc;
};
}

#endif
