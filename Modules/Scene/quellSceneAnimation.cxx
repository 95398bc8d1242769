// SPDX-License-Identifier: BSD-3-Clause
#include "quellSceneFiles.h"

#include <algorithm>
#include <cmath>

namespace quell
{
namespace
{
struct Quaternion
{
  double v[4];
};

Quaternion Unit(const Quaternion& q)
{
  const double l = std::sqrt(q.v[0] * q.v[0] + q.v[1] * q.v[1] + q.v[2] * q.v[2] + q.v[3] * q.v[3]);
  if (!(l > 0) || !std::isfinite(l))
    return { { 0, 0, 0, 1 } };
  return { { q.v[0] / l, q.v[1] / l, q.v[2] / l, q.v[3] / l } };
}

/// Along the shorter arc; straight where the two are so near that sin(angle) has no digits left.
Quaternion Slerp(Quaternion a, Quaternion b, double t)
{
  a = Unit(a);
  b = Unit(b);
  double d = 0;
  for (int i = 0; i < 4; ++i)
    d += a.v[i] * b.v[i];
  const double sign = d < 0 ? -1 : 1;
  d = std::fabs(d);
  double wa = 1 - t, wb = t;
  if (d < 1 - 1e-9)
  {
    const double angle = std::acos(d), s = std::sin(angle);
    wa = std::sin((1 - t) * angle) / s;
    wb = std::sin(t * angle) / s;
  }
  Quaternion q;
  for (int i = 0; i < 4; ++i)
    q.v[i] = wa * a.v[i] + sign * wb * b.v[i];
  return Unit(q);
}

/// The channel's value at `time`, channel.Width() numbers. glTF 2.0, appendix C; times before the first and after the
/// last key hold the end values.
void Evaluate(const AnimationChannel& channel, double time, std::vector<double>& out)
{
  const std::size_t n = channel.Width();
  const bool cubic = channel.Mode == Interpolation::CubicSpline;
  const std::size_t stride = cubic ? 3 * n : n;
  const bool rotation = channel.Path == AnimatedPath::Rotation;
  out.resize(n);
  const std::vector<float>& times = channel.Times;
  const auto value = [&](std::size_t key, std::size_t part)
  { return channel.Values.data() + key * stride + (cubic ? part * n : 0); };
  const auto copy = [&](std::size_t key)
  {
    for (std::size_t i = 0; i < n; ++i)
      out[i] = value(key, 1)[i];
  };
  if (!(time > times.front()))
    copy(0);
  else if (time >= times.back())
    copy(times.size() - 1);
  else
  {
    // Compared in double: t lies in [times[k], times[k + 1]), so that the interval is never empty.
    const std::size_t k = std::size_t(std::upper_bound(times.begin(), times.end(), time,
                                        [](double t, float key) { return t < double(key); }) -
                                      times.begin()) -
                          1;
    const double span = double(times[k + 1]) - double(times[k]);
    const double t = (time - double(times[k])) / span;
    if (channel.Mode == Interpolation::Step)
      copy(k);
    else if (channel.Mode == Interpolation::Linear && rotation)
    {
      Quaternion a, b;
      for (std::size_t i = 0; i < 4; ++i)
      {
        a.v[i] = value(k, 0)[i];
        b.v[i] = value(k + 1, 0)[i];
      }
      const Quaternion q = Slerp(a, b, t);
      std::copy(q.v, q.v + 4, out.begin());
    }
    else if (channel.Mode == Interpolation::Linear)
      for (std::size_t i = 0; i < n; ++i)
        out[i] = (1 - t) * value(k, 0)[i] + t * value(k + 1, 0)[i];
    else
    {
      const double t2 = t * t, t3 = t2 * t;
      for (std::size_t i = 0; i < n; ++i)
        out[i] = (2 * t3 - 3 * t2 + 1) * value(k, 1)[i] + span * (t3 - 2 * t2 + t) * value(k, 2)[i] +
                 (3 * t2 - 2 * t3) * value(k + 1, 1)[i] + span * (t3 - t2) * value(k + 1, 0)[i];
    }
  }
  if (rotation)
  {
    const Quaternion q = Unit({ { out[0], out[1], out[2], out[3] } });
    std::copy(q.v, q.v + 4, out.begin());
  }
}

/// T R S as one matrix.
Mat4 Compose(const Vec3d& t, const Quaternion& rotation, const Vec3d& s)
{
  const Quaternion q = Unit(rotation);
  const double x = q.v[0], y = q.v[1], z = q.v[2], w = q.v[3];
  const double r[3][3] = { { 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w) },
    { 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w) },
    { 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y) } };
  Mat4 m;
  for (int i = 0; i < 3; ++i)
  {
    for (int j = 0; j < 3; ++j)
      m.m[i][j] = r[i][j] * s[j];
    m.m[i][3] = t[i];
  }
  return m;
}
}

std::vector<int> detail::ParentsFirst(const std::vector<Node>& nodes)
{
  std::vector<int> order; // without recursion: depth is the file's choice
  order.reserve(nodes.size());
  for (std::size_t i = 0; i < nodes.size(); ++i)
    if (nodes[i].Parent < 0)
      order.push_back(int(i));
  for (std::size_t k = 0; k < order.size(); ++k)
    for (const int child : nodes[std::size_t(order[k])].Children)
      order.push_back(child);
  return order;
}

ScenePose Scene::PoseAt(double time) const
{
  struct Local
  {
    Vec3d Translation, Scale;
    Quaternion Rotation;
  };
  const std::size_t count = this->Nodes.size();
  ScenePose pose;
  pose.Weights.resize(count);
  std::vector<Local> local(count);
  for (std::size_t i = 0; i < count; ++i)
  {
    const Node& node = this->Nodes[i];
    local[i] = { node.Translation, node.Scale,
      { { node.Rotation[0], node.Rotation[1], node.Rotation[2], node.Rotation[3] } } };
    pose.Weights[i] = node.Weights;
  }
  std::vector<double> v;
  for (const AnimationChannel& channel : this->Animation)
  {
    const std::size_t width = channel.Width(), expected = channel.Path == AnimatedPath::Rotation ? 4
                                                          : channel.Path == AnimatedPath::Weights
                                                            ? std::max<std::size_t>(width, 1)
                                                            : 3;
    if (channel.Node < 0 || std::size_t(channel.Node) >= count || width != expected)
      continue;
    const std::size_t i = std::size_t(channel.Node);
    Evaluate(channel, std::isnan(time) ? 0 : time, v);
    switch (channel.Path)
    {
      case AnimatedPath::Translation:
        local[i].Translation = { v[0], v[1], v[2] };
        break;
      case AnimatedPath::Rotation:
        std::copy(v.begin(), v.end(), local[i].Rotation.v);
        break;
      case AnimatedPath::Scale:
        local[i].Scale = { v[0], v[1], v[2] };
        break;
      case AnimatedPath::Weights:
        pose.Weights[i].resize(width);
        for (std::size_t k = 0; k < width; ++k)
          pose.Weights[i][k] = detail::ToFloat(v[k]);
        break;
    }
  }
  pose.World.resize(count);
  for (const int k : detail::ParentsFirst(this->Nodes))
  {
    const std::size_t i = std::size_t(k);
    const Node& node = this->Nodes[i];
    const Mat4 m = node.HasMatrix ? node.Matrix : Compose(local[i].Translation, local[i].Rotation, local[i].Scale);
    pose.World[i] = node.Parent < 0 ? m : pose.World[std::size_t(node.Parent)] * m;
  }
  return pose;
}

std::vector<Mat4> Scene::WorldMatrices(double time) const
{
  return this->PoseAt(time).World;
}

bool AnimationChannel::Changes() const
{
  const std::size_t n = this->Width(), keys = this->Times.size();
  const bool cubic = this->Mode == Interpolation::CubicSpline;
  const std::size_t parts = cubic ? 3 : 1;
  if (keys < 2)
    return false;
  for (std::size_t k = 0; k < keys; ++k)
    for (std::size_t part = 0; part < parts; ++part)
      for (std::size_t i = 0; i < n; ++i)
      {
        const float v = this->Values[(k * parts + part) * n + i];
        if (v != (cubic && part != 1 ? 0.f : this->Values[(cubic ? n : 0) + i]))
          return true;
      }
  return false;
}

double Scene::Duration() const
{
  double last = 0;
  for (const AnimationChannel& channel : this->Animation)
    if (!channel.Times.empty())
      last = std::max(last, double(channel.Times.back()));
  return last;
}
}
