// SPDX-License-Identifier: BSD-3-Clause
#include "quellCamera.h"

#include <algorithm>
#include <charconv>
#include <stdexcept>

namespace quell
{
Camera::Camera(const CameraModel& model, const Mat4& worldFromCamera, const Vec3d& origin, int width, int height)
  : Orthographic(model.Orthographic)
  , Width(std::max(1, width))
  , Height(std::max(1, height))
{
  const Vec3d at{ worldFromCamera.m[0][3], worldFromCamera.m[1][3], worldFromCamera.m[2][3] };
  this->Position = IsFinite(at) ? at - origin : Vec3d();
  Vec3d back = Normalized(worldFromCamera.Direction({ 0, 0, 1 }));
  if (!IsFinite(back) || back == Vec3d())
    back = { 0, 0, 1 };
  Vec3d up = worldFromCamera.Direction({ 0, 1, 0 });
  Vec3d right = Normalized(Cross(up, back));
  if (!IsFinite(right) || Length(right) < 0.5)
    right = Normalized(Cross(std::fabs(back.y) < 0.9 ? Vec3d(0, 1, 0) : Vec3d(1, 0, 0), back));
  // a mirroring matrix shows a mirrored picture
  const bool mirrored = worldFromCamera.Determinant3() < 0;
  this->Up = Normalized(Cross(back, right));
  this->Right = mirrored ? -right : right;
  this->Forward = -back;

  const double aspect = double(this->Width) / this->Height;
  if (this->Orthographic)
    this->HalfY = std::isfinite(model.YMag) && std::fabs(model.YMag) > 0 ? std::fabs(model.YMag) : 1.;
  else
  {
    const double fov = std::isfinite(model.YFov) ? model.YFov : 0.7853981633974483;
    this->HalfY = std::tan(std::min(3.1, std::max(1e-4, fov)) / 2);
  }
  this->HalfX = this->HalfY * aspect;
  this->Finish();
}

void Camera::Finish()
{
  const Vec3d rows[3] = { this->Right, this->Up, -this->Forward };
  Mat4 view;
  for (int i = 0; i < 3; ++i)
  {
    for (int j = 0; j < 3; ++j)
      view.m[i][j] = rows[i][j];
    view.m[i][3] = -Dot(rows[i], this->Position);
  }
  Mat4 p;
  p.m[0][0] = 1 / this->HalfX;
  p.m[1][1] = 1 / this->HalfY;
  if (!this->Orthographic)
  {
    // reversed depth with the far plane at infinity: z/w = 1 / depth
    p.m[2][2] = 0;
    p.m[2][3] = 1;
    p.m[3][2] = -1;
    p.m[3][3] = 0;
  }
  this->ToCamera = view;
  this->ToNdc = p * view;
}

Camera Camera::Framing(const Vec3d& lower, const Vec3d& upper, const Vec3d& origin, int width, int height)
{
  Vec3d centre = (lower + upper) * 0.5;
  double radius = Length(upper - lower) / 2;
  if (!IsFinite(centre))
    centre = Vec3d();
  if (!(radius > 0) || !std::isfinite(radius))
    radius = 1;
  CameraModel model;
  const double aspect = double(std::max(1, width)) / std::max(1, height);
  const Vec3d back = Normalized(Vec3d(0.4, 0.3, 1));
  const Vec3d right = Normalized(Cross(Vec3d(0, 1, 0), back)), up = Cross(back, right);
  // The nearest place from which all corners are inside the middle 92 % of the frame.
  const double tanY = 0.92 * std::tan(model.YFov / 2), tanX = tanY * aspect;
  double distance = 1e-3 * radius;
  for (int corner = 0; corner < 8; ++corner)
  {
    const Vec3d at(corner & 1 ? upper.x : lower.x, corner & 2 ? upper.y : lower.y, corner & 4 ? upper.z : lower.z);
    const Vec3d c = at - centre;
    if (!IsFinite(c))
      distance = radius / std::sin(std::atan(std::min(tanX, tanY)));
    else
      distance =
        std::max(distance, Dot(c, back) + std::max(std::fabs(Dot(c, right)) / tanX, std::fabs(Dot(c, up)) / tanY));
  }
  const Vec3d eye = centre + back * distance;
  Mat4 m;
  for (int i = 0; i < 3; ++i)
  {
    m.m[i][0] = right[i];
    m.m[i][1] = up[i];
    m.m[i][2] = back[i];
    m.m[i][3] = eye[i];
  }
  return Camera(model, m, origin, width, height);
}

int Camera::Find(const Scene& scene, const std::string& name)
{
  const int count = int(scene.Cameras.size());
  if (name.empty())
    return count > 0 ? 0 : -1;
  for (int i = 0; i < count; ++i)
    if (scene.Cameras[i].Name == name)
      return i;
  int index = -1;
  const auto end = name.data() + name.size();
  const auto parsed = std::from_chars(name.data(), end, index);
  if (parsed.ec == std::errc() && parsed.ptr == end && index >= 0 && index < count)
    return index;
  std::string known;
  for (int i = 0; i < count; ++i)
    known +=
      (i ? ", " : "") + std::to_string(i) + (scene.Cameras[i].Name.empty() ? "" : " \"" + scene.Cameras[i].Name + "\"");
  throw std::invalid_argument(
    "no camera \"" + name + "\"; " +
    (count ? "the scene has " + known
           : std::string("the scene has no cameras (leave Camera empty to frame everything)")));
}

bool Camera::Project(const Vec3d& p, double w, Vec2<double>& pixel) const noexcept
{
  double c[4];
  for (int i : { 0, 1, 3 })
    c[i] = this->ToNdc.m[i][0] * p.x + this->ToNdc.m[i][1] * p.y + this->ToNdc.m[i][2] * p.z + this->ToNdc.m[i][3] * w;
  if (!(c[3] > 0))
    return false;
  pixel = { (c[0] / c[3] + 1) / 2 * this->Width, (c[1] / c[3] + 1) / 2 * this->Height };
  return std::isfinite(pixel.x) && std::isfinite(pixel.y);
}

bool Camera::operator==(const Camera& o) const
{
  return this->Position == o.Position && this->Right == o.Right && this->Up == o.Up && this->Forward == o.Forward &&
         this->HalfX == o.HalfX && this->HalfY == o.HalfY && this->Orthographic == o.Orthographic &&
         this->Width == o.Width && this->Height == o.Height;
}
}
