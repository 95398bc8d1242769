// SPDX-License-Identifier: BSD-3-Clause
#ifndef SceneBuilder_h
#define SceneBuilder_h

#include "quellScene.h"

#include <memory>
#include <vector>

/// Small scenes in memory, for tests with closed forms.
struct SceneBuilder
{
  std::shared_ptr<quell::Scene> Scene = std::make_shared<quell::Scene>();

  static quell::Material Lambert(float albedo, float emission = 0)
  {
    quell::Material m;
    m.BaseColor = quell::Vec3f(albedo);
    m.Metallic = 0;
    m.Specular = 0;
    m.Emission = quell::Vec3f(emission);
    m.DoubleSided = true;
    return m;
  }
  static quell::Material Metal(float reflectance, float roughness)
  {
    quell::Material m;
    m.BaseColor = quell::Vec3f(reflectance);
    m.Metallic = 1;
    m.Roughness = roughness;
    return m;
  }
  int Add(const quell::Material& m)
  {
    Scene->Materials.push_back(m);
    return int(Scene->Materials.size()) - 1;
  }
  quell::Mesh& AddMesh(int material, std::vector<quell::Vec3f> positions, std::vector<std::uint32_t> indices)
  {
    quell::Mesh mesh;
    mesh.Material = material;
    mesh.Positions = std::move(positions);
    mesh.Indices = std::move(indices);
    Scene->Meshes.push_back(mesh);
    quell::Node node;
    Scene->Nodes.push_back(node);
    quell::Instance instance;
    instance.Mesh = int(Scene->Meshes.size()) - 1;
    instance.Node = int(Scene->Nodes.size()) - 1;
    instance.Id = int(Scene->Instances.size()) + 1;
    Scene->Instances.push_back(instance);
    return Scene->Meshes.back();
  }
  /// Parallelogram a, a + e1, a + e1 + e2, a + e2; its front looks along e1 x e2.
  void Quad(int material, quell::Vec3f a, quell::Vec3f e1, quell::Vec3f e2)
  {
    AddMesh(material, { a, a + e1, a + e1 + e2, a + e2 }, { 0, 1, 2, 0, 2, 3 });
  }
  /// Axis-aligned box, fronts outside.
  void Box(int material, quell::Vec3f lo, quell::Vec3f hi)
  {
    std::vector<quell::Vec3f> p;
    for (int i = 0; i < 8; ++i)
      p.push_back({ i & 1 ? hi.x : lo.x, i & 2 ? hi.y : lo.y, i & 4 ? hi.z : lo.z });
    AddMesh(material, p,
      { 0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4, 2, 6, 7, 2, 7, 3, 0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5 });
  }
  void Sphere(int material, quell::Vec3f c, float r, int rings = 64)
  {
    std::vector<quell::Vec3f> p, n;
    std::vector<std::uint32_t> t;
    const int segments = 2 * rings;
    for (int i = 0; i <= rings; ++i)
      for (int j = 0; j <= segments; ++j)
      {
        const double a = 3.14159265358979 * i / rings, b = 6.28318530717959 * j / segments;
        const quell::Vec3f d{ float(std::sin(a) * std::cos(b)), float(std::cos(a)), float(std::sin(a) * std::sin(b)) };
        p.push_back(c + d * r);
        n.push_back(d);
      }
    const auto at = [&](int i, int j) { return std::uint32_t(i * (segments + 1) + j); };
    for (int i = 0; i < rings; ++i)
      for (int j = 0; j < segments; ++j)
      {
        t.insert(t.end(), { at(i, j), at(i, j + 1), at(i + 1, j) });
        t.insert(t.end(), { at(i + 1, j), at(i, j + 1), at(i + 1, j + 1) });
      }
    AddMesh(material, p, t).Normals = n;
  }
  /// Looks from `at` along -z turned by `down` radians about x (positive: downwards).
  void Camera(quell::Vec3d at, double yfov, double down = 0)
  {
    quell::CameraModel c;
    c.YFov = yfov;
    const double s = std::sin(down), k = std::cos(down);
    c.WorldFromCamera.m[1][1] = k;
    c.WorldFromCamera.m[1][2] = s;
    c.WorldFromCamera.m[2][1] = -s;
    c.WorldFromCamera.m[2][2] = k;
    for (int i = 0; i < 3; ++i)
      c.WorldFromCamera.m[i][3] = at[i];
    Scene->Cameras.push_back(c);
  }
  void Sky(float radiance)
  {
    Scene->Sky.Present = true;
    Scene->Sky.Color = quell::Vec3f(radiance);
  }
};

#endif
