// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellSceneFiles_h
#define quellSceneFiles_h

#include "quellScene.h"

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

// Private to the module: files, URIs, images and the wording of errors, shared by the readers.
namespace quell
{
namespace detail
{
using Bytes = std::vector<std::uint8_t>;

/// Counts what one scene's vertices, textures and instances take while it is read on this thread, so that a few bytes
/// of file that name the same data again and again do not fill the memory. Nested ones count with the outermost.
class SceneMemory
{
public:
  explicit SceneMemory(const std::string& file);
  ~SceneMemory();
  SceneMemory(const SceneMemory&) = delete;
  void operator=(const SceneMemory&) = delete;
  /// Before `bytes` are asked for: throws SceneError beyond SceneMemoryLimit().
  static void Take(std::uint64_t bytes);

private:
  SceneMemory* Outer = nullptr;
  std::string File;
  std::uint64_t Taken = 0;
};

/// "file: where: what; remedy". `where` may be empty.
std::string Message(
  const std::string& file, const std::string& where, const std::string& what, const std::string& remedy);
[[noreturn]] void Fail(
  const std::string& file, const std::string& where, const std::string& what, const std::string& remedy);
/// Adds a warning once, however often it comes.
void Warn(Scene& scene, const std::string& where, const std::string& what, const std::string& remedy);

/// FNV-1a, 64 bit.
class ContentHash
{
public:
  void Add(const void* data, std::size_t size) noexcept;
  std::string Hexadecimal() const;

private:
  std::uint64_t State = 14695981039346656037ull;
};

/// Whole content of a regular file; false with a reason otherwise.
bool ReadFile(const std::string& file, Bytes& content, std::string& reason);
/// `name` beside `file`, or `name` itself when it is absolute.
std::string Beside(const std::string& file, const std::string& name);

bool IsDataUri(const std::string& uri);
/// Payload of "data:[type][;base64],..."; false with a reason where it is malformed.
bool DecodeDataUri(const std::string& uri, Bytes& content, std::string& reason);
/// %20 and the like; a '%' that no two hexadecimal digits follow stays as it is.
std::string DecodePercent(const std::string& text);
/// True for "http://..." and other schemes that are not files.
bool IsRemoteUri(const std::string& uri);

/// Decodes a PNG, JPEG or WebP (told by its first bytes) from memory into RGBA: 8 bit as Bytes, 16 bit as Floats. Colour
/// is not multiplied by alpha. False with a reason otherwise; SceneError where the scene becomes too large.
bool DecodeImage(const Bytes& content, Texture& texture, std::string& reason);
/// The same for a file, which may also be OpenEXR, HDR or PNM; SRGB says whether it holds integers: floats are linear.
bool LoadImage(const std::string& file, Texture& texture, std::string& reason);

/// Latitude-longitude image -> `texture` in the orientation of quell::Environment; what is not finite or negative
/// becomes 0, what is above 1e37 becomes that, and `repairs` says how many values did.
bool LoadSky(const std::string& file, Texture& texture, std::string& repairs, std::string& reason);

/// All nodes that a root reaches, parents before children.
std::vector<int> ParentsFirst(const std::vector<Node>& nodes);

/// Nearest float; beyond the range of float its largest number; 0 for NaN.
inline float ToFloat(double v) noexcept
{
  constexpr double largest = std::numeric_limits<float>::max();
  return v > largest ? float(largest) : v < -largest ? -float(largest) : v == v ? float(v) : 0.f;
}

void ReadGltf(Scene& scene, const Bytes& content, ContentHash& hash, const std::string& animation);
void ReadObj(Scene& scene, const Bytes& content, ContentHash& hash);

/// "a, b, c and 5 more".
std::string Names(const std::vector<std::string>& list);

/// Faults that many meshes of a file tend to share, for one warning each.
struct MeshFaults
{
  struct Kind
  {
    std::size_t Count = 0;
    std::vector<std::string> Meshes;
  };
  Kind Flat, Repeated;
  void Warn(Scene& scene) const;
};

/// Makes what is in a mesh safe to render: drops what `Mesh` says is dropped and the vertices that nothing uses any
/// more; replaces unusable normals by those of the surrounding triangles. Warns with the counts or adds to `faults`.
/// `material` is what the mesh will have.
void CleanMesh(Scene& scene, Mesh& mesh, const std::string& where, const Material& material, MeshFaults& faults);

/// Warns of what no image can show properly: emission beyond half precision, lamps whose nodes leave them no area.
void CheckLights(Scene& scene);
}
}

#endif
