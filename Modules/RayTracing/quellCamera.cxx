// SPDX-License-Identifier: BSD-3-Clause
#include "quellCamera.h"

#include <algorithm>
#include <charconv>
#include <cmath>
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

bool Camera::HasDirection(const Mat4& worldFromCamera)
{
  const Vec3d back = Normalized(worldFromCamera.Direction({ 0, 0, 1 }));
  const Vec3d right = Normalized(Cross(Normalized(worldFromCamera.Direction({ 0, 1, 0 })), back));
  return IsFinite(back) && IsFinite(right) && Length(back) > 0.5 && Length(right) > 0.5;
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

void Camera::MoveInShutter(const Camera& open, const Camera& close)
{
  this->Open = open.Here();
  this->Close = close.Here();
  this->Moving = !(open == close);
}

Vec2<double> Camera::OnLens(const Vec2f& u) const noexcept
{
  constexpr double pi = 3.14159265358979323846;
  if (this->LensBlades < 3)
  {
    // Shirley and Chiu's concentric map: neighbours stay neighbours.
    const double a = 2 * double(u.x) - 1, b = 2 * double(u.y) - 1;
    if (a == 0 && b == 0)
      return { 0, 0 };
    const bool wide = std::fabs(a) > std::fabs(b);
    const double r = wide ? a : b, phi = wide ? pi / 4 * (b / a) : pi / 2 - pi / 4 * (a / b);
    return { r * std::cos(phi), r * std::sin(phi) };
  }
  // One triangle from the middle to a side per 1 / blades of the first number.
  const double scaled = double(u.x) * this->LensBlades, side = std::min(std::floor(scaled), this->LensBlades - 1.);
  const double step = 2 * pi / this->LensBlades, from = pi / 2 + side * step;
  const double out = std::sqrt(scaled - side), along = double(u.y);
  return { out * (std::cos(from) * (1 - along) + std::cos(from + step) * along),
    out * (std::sin(from) * (1 - along) + std::sin(from + step) * along) };
}

void Camera::Ray(double px, double py, const Vec2f& lens, double time, Vec3d& start, Vec3d& direction) const noexcept
{
  Pose pose = this->Here();
  if (this->Moving)
  {
    const auto mix = [time](const auto& a, const auto& b) { return a * (1 - time) + b * time; };
    pose.Position = mix(this->Open.Position, this->Close.Position);
    pose.HalfX = mix(this->Open.HalfX, this->Close.HalfX);
    pose.HalfY = mix(this->Open.HalfY, this->Close.HalfY);
    const Vec3d forward = mix(this->Open.Forward, this->Close.Forward),
                right = mix(this->Open.Right, this->Close.Right);
    // A camera that turns around while the shutter is open passes through no direction at all; it keeps its own.
    if (Length(forward) > 0.1 && Length(right) > 0.1 && Length(Cross(forward, right)) > 0.01)
    {
      pose.Forward = Normalized(forward);
      const Vec3d up = Normalized(Cross(right, pose.Forward));
      pose.Right = Normalized(Cross(pose.Forward, up));
      pose.Up = Dot(Cross(this->Right, this->Forward), this->Up) < 0 ? -up : up;
    }
  }
  const double x = (2 * px / this->Width - 1) * pose.HalfX, y = (2 * py / this->Height - 1) * pose.HalfY;
  // `through` is on the plane of depth 1 (or the direction) of the ray through the middle of the lens
  Vec3d through = pose.Forward + pose.Right * x + pose.Up * y;
  start = pose.Position;
  if (this->Orthographic)
  {
    start += pose.Right * x + pose.Up * y;
    through = pose.Forward;
  }
  if (this->LensRadius > 0)
  {
    const Vec2<double> on = this->OnLens(lens);
    const Vec3d offset = (pose.Right * on.x + pose.Up * on.y) * this->LensRadius;
    start += offset;
    through = through * this->FocusDistance - offset;
  }
  direction = Normalized(through);
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
