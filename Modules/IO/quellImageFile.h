// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellImageFile_h
#define quellImageFile_h

#include "quellFrameFacts.h"
#include "quellImageView.h"
#include "quellStageDescription.h"
#include "vtkQuellIOModule.h"
#include "vtkSmartPointer.h"
#include "vtkQuellStage.h"

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

class vtkImageData;

/// Image files as images with named arrays. OpenEXR (several layers and parts, scanlines or tiles, half, float and
/// integer channels), Radiance HDR, PNG, JPEG, PNM; TIFF, BMP and Targa are written only. Rows are flipped here and
/// nowhere else: row 0 of an image is its bottom row, of a file its top row. Which channel is which array:
/// Documentation/aov.md. Every failure is a StageError with the file's name, the cause and what to do about it.
namespace quell
{
/// One array of a file.
struct FileArray
{
  std::string Name;
  ArrayKind Kind = ArrayKind::Any;
  std::vector<std::string> Channels; ///< the file's channel names, one per component
  std::string Type;                  ///< "half", "float", "uint", "uint8" ...
};

/// How integer pixels of formats other than EXR become linear values.
enum class FileTransfer
{
  Automatic, ///< integers are sRGB-encoded, floats are linear
  Linear,
  Srgb
};

/// What a header says, and after reading what happened.
struct ReadReport
{
  std::string Format;        ///< "openexr", "png", ...
  int Width = 0, Height = 0; ///< of the whole frame, the display window
  Rect DataWindow;           ///< pixels the file holds, row 0 at the bottom; may reach outside
  std::vector<FileArray> Arrays;
  FrameFacts Facts;
  std::map<std::string, std::string> Metadata;   ///< entries under `quell:`, without that prefix
  std::map<std::string, std::string> Attributes; ///< all other attributes, as text
  std::vector<std::string> Warnings;
};

struct ReadOptions
{
  ArraySet Arrays;                     ///< empty: all
  Rect Region;                         ///< empty: the whole frame
  std::string PlainArray = "radiance"; ///< the array that plain R G B (or Y) channels make
  FileTransfer Transfer = FileTransfer::Automatic;
  std::int64_t MaximumBytes = std::int64_t(4) << 30; ///< of the arrays to be made; more is refused
  /// Where an asked array's values go, over the region, instead of into memory of its own; at least as many floats as
  /// it has there.
  std::map<std::string, float*> Into;
  std::function<bool()> Cancelled; ///< asked every few rows; true ends with StageError("cancelled")
};

/// The arrays of a file, without reading pixels.
VTKQUELLIO_EXPORT ReadReport ReadImageHeader(const std::string& path, const ReadOptions& options = {});

/// Reads the asked arrays over the asked region (extent = region, in frame coordinates). Pixels outside the file's data
/// window get the array's background. Frame facts are in the field data.
VTKQUELLIO_EXPORT vtkSmartPointer<vtkImageData> ReadImageFile(
  const std::string& path, ReadReport* report = nullptr, const ReadOptions& options = {});

/// One array to be written.
struct LayerSpec
{
  std::string Array;
  std::string Layer;               ///< EXR layer; empty: the standard one, the first colour being plain R G B
  ArrayKind Kind = ArrayKind::Any; ///< Any: from the array's name, else from its components
  vtkImageData* Image = nullptr;   ///< nullptr: the function's image
};

enum class FileCompression
{
  None,
  Rle,
  Zips,
  Zip,
  Piz,
  Pxr24,
  Dwaa,
  Dwab
};

struct WriteOptions
{
  std::map<std::string, std::string> Metadata; ///< string attributes under `quell:`
  int Width = 0, Height = 0;                   ///< display window; 0: from row 0 and column 0 to the image's end
  Rect Region;                                 ///< data window; empty: the image's extent
  FileCompression Compression = FileCompression::Zip;
  bool Half = false;               ///< colours and scalars as half; ids, depth, position, motion stay float
  std::function<bool()> Cancelled; ///< asked every few rows; true ends with StageError("cancelled")
};

struct WriteReport
{
  std::int64_t Clamped = 0; ///< finite values beyond 65504 that were clamped for half, or outside [0, 1.69e38] for .hdr
  std::int64_t NonFinite = 0; ///< non-finite values written as 0 into a file that is no EXR
  std::vector<std::string> Warnings;
};

/// One file, written in bands of rows from the top down, so that its pixels need not be there at once: the same bytes
/// as in one go. It has a temporary name in the same directory until Finish renames it, so that a reader sees the old
/// file or the whole new one; without Finish nothing is left. Makes directories. Formats other than EXR hold one colour
/// and an alpha: 8 bit, arrays of kind Display as they are, others clamped and sRGB-encoded; .hdr: linear.
class VTKQUELLIO_EXPORT ImageFileWriter
{
public:
  /// `options` must say Width, Height and Region, which is all that the bands will make.
  ImageFileWriter(const std::string& path, const FrameFacts& facts, const WriteOptions& options);
  ~ImageFileWriter();
  ImageFileWriter(const ImageFileWriter&) = delete;
  void operator=(const ImageFileWriter&) = delete;

  /// The next rows, of the region's full width; `layers` (empty: every array of `image`, radiance first) the same ones
  /// in every band, covering it at least.
  void Write(const Rect& band, vtkImageData* image, const std::vector<LayerSpec>& layers = {});
  WriteReport Finish();

private:
  struct Internals;
  std::unique_ptr<Internals> Internal;
};

///@{
/// Bytes of buffers, ours and the library's, while a frame of that size and number of channels is read or written.
VTKQUELLIO_EXPORT double ReadBufferBytes(int width, int height, double channels);
VTKQUELLIO_EXPORT double WriteBufferBytes(int width, int height, double channels);
///@}

/// What writing would refuse `path` for before it has pixels: a format that nobody writes, a place where no file
/// can be made. Throws quell::StageError; makes nothing.
VTKQUELLIO_EXPORT void CheckWritable(const std::string& path);

/// ImageFileWriter with one band. Sizes and region that `options` do not say are the image's.
VTKQUELLIO_EXPORT void WriteImageFile(const std::string& path, vtkImageData* image,
  const std::vector<LayerSpec>& layers = {}, const WriteOptions& options = {}, WriteReport* report = nullptr);

/// Replaces the last run of `#` in the file name by the tick, padded with zeros to at least that many digits.
VTKQUELLIO_EXPORT std::string SequencePath(const std::string& pattern, int tick);

/// The numbers of the files of a sequence, in order; empty for a name without `#`.
VTKQUELLIO_EXPORT std::vector<int> SequenceNumbers(const std::string& pattern);

/// The file of `tick`; StageError with the frames that there are where it is missing.
VTKQUELLIO_EXPORT std::string SequenceFile(const std::string& pattern, int tick);

/// The file of `tick`, or where it does not exist the file of the sequence with the lowest number, if there is any.
VTKQUELLIO_EXPORT std::string SequenceSample(const std::string& pattern, int tick);
}

#endif
