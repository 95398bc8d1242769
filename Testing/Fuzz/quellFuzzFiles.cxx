// SPDX-License-Identifier: BSD-3-Clause
// quell-fuzz-files [options, see quellFuzzWatch.h] [FILE|DIRECTORY...]
//
// Reads mutated images (OpenEXR, PNG, JPEG, HDR, PNM; WebP, Targa, BMP in scenes) and scenes (glTF, GLB, OBJ with MTL)
// through the doors that a pipeline opens them by. Seeds are made at the start (quellFuzzFileSeeds.cxx); files named
// are further ones, such as findings of earlier runs. Promises:
// - reading ends with data or with an error: one line of readable text, with the file's name, not too long;
// - an image has what its report says; of a good one a part has the pixels of the whole;
// - a scene's numbers lead nowhere outside of it, it can be posed and deformed at any time, and traced.
#include "quellFuzzFiles.h"
#include "quellFuzzTools.h"
#include "quellImageFile.h"
#include "quellMemoryLimits.h"
#include "quellScene.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkObject.h"
#include "vtkPointData.h"
#include "vtkQuellPathTraceSource.h"

#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <memory>

namespace fs = std::filesystem;
using namespace quell;

namespace
{
class Files : public FuzzTarget
{
public:
  Files(const fs::path& place, std::vector<FuzzCase> seeds, std::uint64_t seed)
    : Place(place)
    , Bombs(FuzzFileBombs())
    , Mutator(std::move(seeds), seed)
  {
  }

  std::uint64_t Fixed() const override { return this->Bombs.size() + this->Mutator.All().size(); }

  FuzzCase Make(std::uint64_t n) override
  {
    if (n < this->Bombs.size())
      return { this->Bombs[n].Name, this->Bombs[n].Text };
    n -= this->Bombs.size();
    return n < this->Mutator.All().size() ? this->Mutator.All()[n] : this->Mutator.Make(n);
  }

  void Begin() override
  {
    vtkObject::GlobalWarningDisplayOff();
    OIIO::attribute("threads", 1);
    OIIO::attribute("exr_threads", -1);
    SetSceneMemoryLimit(512000000);
    SetPixelMemoryLimit(512000000);
  }

  bool Check(const FuzzCase& document, std::uint64_t n) override
  {
    const fs::path name(document.Name);
    const std::string extension = name.extension().string();
    // Beside the seeds, so that what it refers to is found.
    const fs::path file = this->Place / ("case" + extension);
    const std::size_t split = extension == ".obj" ? document.Text.find(FuzzSplit) : std::string::npos;
    Save(file, document.Text.substr(0, split));
    Save(this->Place / "model.mtl",
      split == std::string::npos ? std::string() : document.Text.substr(split + std::strlen(FuzzSplit)));
    const std::string wanted = n < this->Bombs.size() ? this->Bombs[n].Message : std::string();
    std::string error;
    bool good = false;
    if (extension == ".gltf" || extension == ".glb" || extension == ".obj")
      good = this->CheckScene(file.string(), n, error);
    else if (extension == ".tga" || extension == ".bmp") // of scenes alone
      good = this->CheckSky(file.string(), error);
    else
    {
      good = this->CheckImage(file.string(), n, error);
      // Scenes read pictures on a way of their own, and WebP only there.
      std::string skyError;
      if (n % 2 == 0)
        this->CheckSky(file.string(), skyError);
    }
    Promise(wanted.empty() || (!good && (wanted == "!" || error.find(wanted) != std::string::npos)),
      "no error \"" + wanted + "\" but \"" + error + "\"");
    return good;
  }

private:
  bool CheckImage(const std::string& file, std::uint64_t n, std::string& error)
  {
    ReadOptions options;
    options.MaximumBytes = 200 << 20;
    try
    {
      const ReadReport header = ReadImageHeader(file, options);
      for (const std::string& warning : header.Warnings)
        CheckMessage(warning, file);
      Promise(header.Width > 0 && header.Height > 0 && !header.Arrays.empty(), "a header without pixels or arrays");
      ReadReport report;
      const auto image = ReadImageFile(file, &report, options);
      Promise(
        report.Width == header.Width && report.Height == header.Height && report.Arrays.size() == header.Arrays.size(),
        "the header alone says something else than the file");
      int dimensions[3];
      image->GetDimensions(dimensions);
      Promise(dimensions[0] == report.Width && dimensions[1] == report.Height, "another size than the header's");
      for (const FileArray& array : report.Arrays)
      {
        auto values = vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray(array.Name.c_str()));
        Promise(values && values->GetNumberOfComponents() == int(array.Channels.size()) &&
                  values->GetNumberOfTuples() == image->GetNumberOfPoints(),
          "the array " + array.Name + " is not there as declared");
      }
      // OpenEXR takes blocks that unpack to less than their pixels, and leaves the rest as the memory was.
      if (n < this->Fixed() && report.Width > 2 && report.Height > 2)
      {
        ReadOptions part = options;
        part.Region = { 1, 1, report.Width - 1, report.Height - 1 };
        part.Arrays = { report.Arrays[0].Name };
        const auto inner = ReadImageFile(file, nullptr, part);
        auto all = vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray(report.Arrays[0].Name.c_str()));
        auto some = vtkFloatArray::SafeDownCast(inner->GetPointData()->GetArray(report.Arrays[0].Name.c_str()));
        const std::size_t c = std::size_t(all->GetNumberOfComponents());
        for (int y = 1; y < report.Height - 1; ++y)
          Promise(std::memcmp(all->GetPointer(0) + (std::size_t(y) * std::size_t(report.Width) + 1) * c,
                    some->GetPointer(0) + std::size_t(y - 1) * std::size_t(report.Width - 2) * c,
                    std::size_t(report.Width - 2) * c * sizeof(float)) == 0,
            "a region has other pixels than the whole, row " + std::to_string(y));
      }
      return true;
    }
    catch (const StageError& e)
    {
      error = e.what();
      CheckMessage(error, file);
      return false;
    }
  }

  bool CheckSky(const std::string& file, std::string& error)
  {
    try
    {
      Scene scene;
      LoadEnvironment(scene, file);
      const Texture& t = scene.Textures.at(std::size_t(scene.Sky.Texture));
      Promise(t.Width > 0 && t.Height > 0 &&
                std::max(t.Bytes.size(), t.Floats.size()) == std::size_t(t.Width) * std::size_t(t.Height) * 4,
        "a sky of another size than it says");
      for (float v : t.Floats)
        Promise(v >= 0 && std::isfinite(v), "a sky with pixels that are no light");
      return true;
    }
    catch (const SceneError& e)
    {
      error = e.what();
      CheckMessage(error, file);
      return false;
    }
  }

  bool CheckScene(const std::string& file, std::uint64_t n, std::string& error)
  {
    std::shared_ptr<const Scene> scene;
    try
    {
      scene = LoadScene(file);
    }
    catch (const SceneError& e)
    {
      error = e.what();
      CheckMessage(error, file);
      return false;
    }
    for (const std::string& warning : scene->Warnings)
      CheckMessage(warning, file);
    const auto inside = [](std::int64_t i, std::size_t size) { return i >= 0 && std::size_t(i) < size; };
    for (const Node& node : scene->Nodes)
    {
      Promise(node.Parent < 0 || inside(node.Parent, scene->Nodes.size()), "a parent that is not there");
      for (int child : node.Children)
        Promise(inside(child, scene->Nodes.size()), "a child that is not there");
    }
    for (const Mesh& mesh : scene->Meshes)
    {
      Promise(mesh.Indices.size() % 3 == 0 && inside(mesh.Material, scene->Materials.size()),
        "half a triangle, or a material that is not there");
      for (std::uint32_t i : mesh.Indices)
        Promise(i < mesh.Positions.size(), "a corner that is not there");
      for (const Vec3f& p : mesh.Positions)
        Promise(IsFinite(p), "a vertex at no place");
      for (const auto* list : { &mesh.TexCoords[0], &mesh.TexCoords[1] })
        Promise(list->empty() || list->size() == mesh.Positions.size(), "texture coordinates of some vertices");
      Promise(mesh.Normals.empty() || mesh.Normals.size() == mesh.Positions.size(), "normals of some vertices");
    }
    for (const Material& m : scene->Materials)
    {
      for (const TextureUse* use : { &m.BaseColorTexture, &m.MetallicRoughnessTexture, &m.NormalTexture,
             &m.EmissiveTexture, &m.TransmissionTexture, &m.SpecularTexture, &m.ClearcoatNormalTexture })
        Promise(use->Texture < int(scene->Textures.size()), "a texture that is not there");
      Promise(std::isfinite(m.Roughness) && std::isfinite(m.Metallic) && std::isfinite(MaxComponent(m.Emission)),
        "a material of values that are not finite");
    }
    for (const Instance& i : scene->Instances)
      Promise(inside(i.Mesh, scene->Meshes.size()) && inside(i.Node, scene->Nodes.size()), "an instance of nothing");
    if (scene->Instances.size() < 20000)
      for (double time : { 0., 0.5 * scene->Duration(), 1e9 })
      {
        const ScenePose pose = scene->PoseAt(time);
        std::vector<Vec3f> positions, normals;
        for (const Instance& i : scene->Instances)
          if (scene->Deforms(i))
          {
            scene->Deform(i, pose, Vec3d(), positions, &normals, nullptr);
            for (const Vec3f& p : positions)
              Promise(p.x == p.x && p.y == p.y && p.z == p.z, "a deformed vertex at no place");
          }
      }
    if (n % 4 == 0)
    {
      vtkNew<vtkQuellPathTraceSource> source;
      source->SetScene(file);
      source->SetWidth(6);
      source->SetHeight(4);
      source->SetSamplesPerPixel(1);
      source->Update();
      auto radiance = vtkFloatArray::SafeDownCast(source->GetOutput()->GetPointData()->GetArray("radiance"));
      if (!radiance)
        CheckMessage(source->GetErrorText(), file); // a scene without a camera, too large to trace ...
      for (vtkIdType i = 0; radiance && i < radiance->GetNumberOfValues(); ++i)
        Promise(std::isfinite(radiance->GetValue(i)) && radiance->GetValue(i) >= 0, "a pixel that is no light");
    }
    return true;
  }

  fs::path Place;
  std::vector<FuzzFileBomb> Bombs;
  FileMutator Mutator;
};
}

int main(int argc, char** argv)
{
  return RunFuzz(
    argc, argv, "quell-fuzz-files", [](const fs::path& directory) { WriteFuzzSeeds(directory.string()); },
    [](const fs::path& directory, std::vector<FuzzCase> seeds, std::uint64_t seed)
    { return std::make_unique<Files>(directory, std::move(seeds), seed); });
}
