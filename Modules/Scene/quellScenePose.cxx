// SPDX-License-Identifier: BSD-3-Clause
// Skins and morph targets at a time: glTF 2.0, 3.7.2.2 (morph targets) and 3.7.3 (skins).
#include "quellSceneFiles.h"

#include <algorithm>
#include <cmath>

namespace quell
{
namespace
{
const Mesh* MeshOf(const Scene& scene, const Instance& instance)
{
  return instance.Mesh >= 0 && std::size_t(instance.Mesh) < scene.Meshes.size()
           ? &scene.Meshes[std::size_t(instance.Mesh)]
           : nullptr;
}

const Node* NodeOf(const Scene& scene, const Instance& instance)
{
  return instance.Node >= 0 && std::size_t(instance.Node) < scene.Nodes.size()
           ? &scene.Nodes[std::size_t(instance.Node)]
           : nullptr;
}

/// The skin that moves the instance, or null.
const Skin* SkinOf(const Scene& scene, const Instance& instance)
{
  const Mesh* mesh = MeshOf(scene, instance);
  const Node* node = NodeOf(scene, instance);
  if (!mesh || !node || node->Skin < 0 || std::size_t(node->Skin) >= scene.Skins.size() || mesh->Influences < 1)
    return nullptr;
  const std::size_t count = mesh->Positions.size() * std::size_t(mesh->Influences);
  const Skin& skin = scene.Skins[std::size_t(node->Skin)];
  return mesh->Joints.size() == count && mesh->JointWeights.size() == count && !skin.Joints.empty() ? &skin : nullptr;
}

bool Morphs(const Mesh& mesh)
{
  return std::any_of(mesh.Targets.begin(), mesh.Targets.end(),
    [](const MorphTarget& t) { return !t.Positions.empty() || !t.Normals.empty() || !t.Tangents.empty(); });
}

Mat4 NodeMatrix(const ScenePose& pose, int node)
{
  return node >= 0 && std::size_t(node) < pose.World.size() ? pose.World[std::size_t(node)] : Mat4();
}

std::vector<Mat4> JointMatrices(const Skin& skin, const ScenePose& pose)
{
  std::vector<Mat4> joints(skin.Joints.size());
  for (std::size_t j = 0; j < joints.size(); ++j)
  {
    const Mat4 world = NodeMatrix(pose, skin.Joints[j]);
    joints[j] = j < skin.InverseBind.size() ? world * skin.InverseBind[j] : world;
  }
  return joints;
}

/// The matrix of one vertex. The sum of the weights is divided out in double: a sum that is wrong in the seventh digit
/// would move a vertex that is 1e6 from the origin.
bool Blend(const Mesh& mesh, std::size_t vertex, const std::vector<Mat4>& joints, Mat4& out)
{
  const std::size_t n = std::size_t(mesh.Influences), first = vertex * n;
  double sum = 0;
  for (std::size_t k = first; k < first + n; ++k)
    if (mesh.Joints[k] < joints.size() && mesh.JointWeights[k] > 0)
      sum += double(mesh.JointWeights[k]);
  if (!(sum > 0) || !std::isfinite(sum))
    return false;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 4; ++c)
      out.m[r][c] = 0;
  for (std::size_t k = first; k < first + n; ++k)
  {
    if (!(mesh.Joints[k] < joints.size() && mesh.JointWeights[k] > 0))
      continue;
    const double w = double(mesh.JointWeights[k]) / sum;
    const Mat4& joint = joints[mesh.Joints[k]];
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 4; ++c)
        out.m[r][c] += w * joint.m[r][c];
  }
  return true;
}

/// Unit vector, or `otherwise` where there is no direction left.
Vec3d UnitOr(const Vec3d& v, const Vec3d& otherwise)
{
  const Vec3d unit = Normalized(v);
  return Dot(unit, unit) > 0.5 ? unit : otherwise;
}

/// Nodes whose world matrix changes over time.
std::vector<char> MovingNodes(const Scene& scene)
{
  std::vector<char> moving(scene.Nodes.size(), 0);
  for (const AnimationChannel& channel : scene.Animation)
    if (channel.Path != AnimatedPath::Weights && channel.Node >= 0 && std::size_t(channel.Node) < moving.size() &&
        !moving[std::size_t(channel.Node)] && channel.Changes())
      moving[std::size_t(channel.Node)] = 1;
  for (const int i : detail::ParentsFirst(scene.Nodes))
  {
    const int parent = scene.Nodes[std::size_t(i)].Parent;
    if (parent >= 0 && moving[std::size_t(parent)])
      moving[std::size_t(i)] = 1;
  }
  return moving;
}

std::vector<char> MorphingNodes(const Scene& scene)
{
  std::vector<char> morphing(scene.Nodes.size(), 0);
  for (const AnimationChannel& channel : scene.Animation)
    if (channel.Path == AnimatedPath::Weights && channel.Node >= 0 && std::size_t(channel.Node) < morphing.size() &&
        channel.Changes())
      morphing[std::size_t(channel.Node)] = 1;
  return morphing;
}

bool InstanceMoves(
  const Scene& scene, const Instance& instance, const std::vector<char>& moving, const std::vector<char>& morphing)
{
  const Mesh* mesh = MeshOf(scene, instance);
  if (!mesh || !NodeOf(scene, instance))
    return false;
  if (morphing[std::size_t(instance.Node)] && Morphs(*mesh))
    return true;
  const Skin* skin = SkinOf(scene, instance);
  if (!skin)
    return moving[std::size_t(instance.Node)] != 0;
  return std::any_of(skin->Joints.begin(), skin->Joints.end(),
    [&](int node) { return node >= 0 && std::size_t(node) < moving.size() && moving[std::size_t(node)]; });
}
}

bool Scene::Deforms(const Instance& instance) const
{
  const Mesh* mesh = MeshOf(*this, instance);
  return mesh && (SkinOf(*this, instance) || Morphs(*mesh));
}

bool Scene::Moves(const Instance& instance) const
{
  return this->Animated() && InstanceMoves(*this, instance, MovingNodes(*this), MorphingNodes(*this));
}

std::vector<char> Scene::MovingInstances() const
{
  std::vector<char> out(this->Instances.size(), 0);
  if (!this->Animated())
    return out;
  const std::vector<char> moving = MovingNodes(*this), morphing = MorphingNodes(*this);
  for (std::size_t i = 0; i < out.size(); ++i)
    out[i] = InstanceMoves(*this, this->Instances[i], moving, morphing);
  return out;
}

void Scene::Deform(const Instance& instance, const ScenePose& pose, const Vec3d& origin, std::vector<Vec3f>& positions,
  std::vector<Vec3f>* normals, std::vector<Vec4f>* tangents) const
{
  const Mesh* found = MeshOf(*this, instance);
  const std::size_t n = found ? found->Positions.size() : 0;
  const bool wantNormals = normals && found && found->Normals.size() == n,
             wantTangents = tangents && found && found->Tangents.size() == n;
  positions.resize(n);
  if (normals)
    normals->resize(wantNormals ? n : 0);
  if (tangents)
    tangents->resize(wantTangents ? n : 0);
  if (n == 0)
    return;
  const Mesh& mesh = *found;

  struct Active
  {
    const MorphTarget* Target;
    double Weight;
  };
  std::vector<Active> active;
  if (!mesh.Targets.empty() && instance.Node >= 0 && std::size_t(instance.Node) < pose.Weights.size())
  {
    const std::vector<float>& weights = pose.Weights[std::size_t(instance.Node)];
    for (std::size_t t = 0; t < mesh.Targets.size() && t < weights.size(); ++t)
      if (weights[t] != 0 && std::isfinite(weights[t]))
        active.push_back({ &mesh.Targets[t], double(weights[t]) });
  }
  const auto morphed = [&](Vec3d v, std::size_t i, std::vector<Vec3f> MorphTarget::*list)
  {
    for (const Active& a : active)
    {
      const std::vector<Vec3f>& delta = a.Target->*list;
      if (i < delta.size())
        v += Vec3d(delta[i]) * a.Weight;
    }
    return v;
  };

  const Skin* skin = SkinOf(*this, instance);
  const std::vector<Mat4> joints = skin ? JointMatrices(*skin, pose) : std::vector<Mat4>();
  const Mat4 node = skin ? joints.front() : NodeMatrix(pose, instance.Node);
  Mat4 blended;
  double side = node.Determinant3() < 0 ? -1 : 1;
  for (std::size_t i = 0; i < n; ++i)
  {
    const Mat4* m = &node;
    if (skin && Blend(mesh, i, joints, blended))
      m = &blended;
    const Vec3d p = m->Point(morphed(Vec3d(mesh.Positions[i]), i, &MorphTarget::Positions)) - origin;
    positions[i] = { detail::ToFloat(p.x), detail::ToFloat(p.y), detail::ToFloat(p.z) };
    if (wantNormals)
    {
      const Vec3d rest(mesh.Normals[i]);
      const Vec3d unit = UnitOr(m->Normal(morphed(rest, i, &MorphTarget::Normals)), UnitOr(rest, Vec3d(0, 1, 0)));
      (*normals)[i] = Vec3f(unit);
    }
    if (wantTangents)
    {
      const Vec3d rest(mesh.Tangents[i].xyz());
      const Vec3f unit(UnitOr(m->Direction(morphed(rest, i, &MorphTarget::Tangents)), UnitOr(rest, Vec3d(1, 0, 0))));
      if (skin)
        side = m->Determinant3() < 0 ? -1 : 1;
      (*tangents)[i] = { unit.x, unit.y, unit.z, float(side) * mesh.Tangents[i].w };
    }
  }
}

bool Scene::Mirrors(const Instance& instance, const ScenePose& pose) const
{
  const Skin* skin = SkinOf(*this, instance);
  if (!skin)
    return NodeMatrix(pose, instance.Node).Determinant3() < 0;
  std::size_t mirrored = 0;
  for (const Mat4& m : JointMatrices(*skin, pose))
    mirrored += m.Determinant3() < 0;
  return 2 * mirrored > skin->Joints.size();
}

bool Scene::Bounds(const ScenePose& pose, Vec3d& low, Vec3d& high) const
{
  bool any = false;
  std::vector<Vec3f> positions;
  std::vector<char> used;
  const auto add = [&](const Vec3d& p)
  {
    if (!IsFinite(p))
      return;
    if (!any)
      low = high = p;
    any = true;
    for (int c = 0; c < 3; ++c)
    {
      low[c] = std::min(low[c], p[c]);
      high[c] = std::max(high[c], p[c]);
    }
  };
  for (const Instance& instance : this->Instances)
  {
    const Mesh* mesh = MeshOf(*this, instance);
    if (!mesh)
      continue;
    used.assign(mesh->Positions.size(), 0);
    for (const std::uint32_t v : mesh->Indices)
      if (v < used.size())
        used[v] = 1;
    const Mat4 world = NodeMatrix(pose, instance.Node);
    if (this->Deforms(instance))
    {
      // Relative to a place on the object, so that float has digits left.
      const Skin* skin = SkinOf(*this, instance);
      const Vec3d origin = (skin ? NodeMatrix(pose, skin->Joints.front()) : world).Point(Vec3d());
      this->Deform(instance, pose, origin, positions, nullptr, nullptr);
      for (std::size_t i = 0; i < used.size(); ++i)
        if (used[i])
          add(Vec3d(positions[i]) + origin);
    }
    else
      for (std::size_t i = 0; i < used.size(); ++i)
        if (used[i])
          add(world.Point(Vec3d(mesh->Positions[i])));
  }
  return any;
}
}
