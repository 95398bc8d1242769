// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellCamera_h
#define quellCamera_h

#include "quellScene.h"
#include "quellVector.h"
#include "vtkQuellRayTracingModule.h"

#include <string>

namespace quell
{
/// A perspective or orthographic camera over a W x H frame, row 0 at the bottom; positions relative to the recentred
/// origin. Its lens is a pinhole unless LensRadius is set; it stands still while the shutter is open unless
/// MoveInShutter says otherwise. Depth, Project and the matrices are those of the pinhole at the middle of the lens and
/// at the frame's own time.
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
  /// False where the matrix shows in no direction: its z axis is 0 or not finite, or y is along it.
  static bool HasDirection(const Mat4& worldFromCamera);

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
  /// The same through a point of the lens and at a moment of the open shutter, for rays that paint. `lens` in [0, 1)^2
  /// covers the lens evenly, (1/2, 1/2) is its middle; everything at the depth FocusDistance is sharp (Cook, Porter and
  /// Carpenter 1984). `time` in [0, 1] from opening to closing.
  void Ray(double px, double py, const Vec2f& lens, double time, Vec3d& start, Vec3d& direction) const noexcept;
  bool HasLens() const { return this->LensRadius > 0; }

  /// The camera when the shutter opens and closes; in between its position, axes and opening are interpolated. Of the
  /// same kind and frame as this one.
  void MoveInShutter(const Camera& open, const Camera& close);
  bool MovesInShutter() const { return this->Moving; }

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
  double LensRadius = 0;    ///< scene units; 0: a pinhole
  double FocusDistance = 1; ///< depth of what is sharp, scene units, above 0
  int LensBlades = 0;       ///< corners of the opening, the first one up; below 3: round

private:
  struct Pose
  {
    Vec3d Position, Right, Up, Forward;
    double HalfX = 1, HalfY = 1;
  };
  Pose Here() const { return { this->Position, this->Right, this->Up, this->Forward, this->HalfX, this->HalfY }; }
  Vec2<double> OnLens(const Vec2f& u) const noexcept;
  void Finish();
  Mat4 ToCamera, ToNdc;
  bool Moving = false;
  Pose Open, Close;
};
}

#endif
