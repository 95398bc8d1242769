// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellImageWriter
 * @brief   writes named arrays as layers of one image file per frame
 *
 * OpenEXR: each connection of `layer` is a layer under the array's standard name (Documentation/aov.md) or under the
 * name given to it; the first colour becomes plain R G B. Data window = the region that was computed, display window =
 * the whole frame; camera matrices, tick, time, seed and sample count are attributes. Other formats (by extension): one
 * colour, 8 bit, display-encoded arrays as they are, others clamped to [0, 1] and sRGB-encoded.
 *
 * A file appears whole or not at all: it is written under a temporary name in its directory and renamed. Arrays asked
 * of the writer pass through from its first connection. Non-finite values are written as they are to EXR and as 0
 * (counted) to 8-bit files.
 */
#ifndef vtkQuellImageWriter_h
#define vtkQuellImageWriter_h

#include "vtkQuellIOModule.h"
#include "vtkQuellStage.h"

#include <map>
#include <memory>

namespace quell
{
class ImageFileWriter;
struct WriteReport;
}

class VTKQUELLIO_EXPORT vtkQuellImageWriter : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellImageWriter);

  ///@{ The file; a run of # in its name stands for the frame's tick, padded with zeros. Directories are made.
  void SetFile(const std::string& file);
  const std::string& GetFile() const { return this->File; }
  ///@}
  ///@{ EXR compression, in the order None, Rle, Zips, Zip, Piz, Pxr24, Dwaa, Dwab; the last three lose precision.
  /// Default
  /// Zip.
  vtkSetClampMacro(Compression, int, 0, 7);
  vtkGetMacro(Compression, int);
  ///@}
  ///@{ EXR colours, albedo, normals and scalars as half (values beyond 65504 are clamped and counted); everything else
  /// stays float. Default off.
  vtkSetMacro(Half, bool);
  vtkGetMacro(Half, bool);
  ///@}

  /// `name`: the EXR layer of this connection.
  bool SetInputAttribute(
    int port, int connection, const std::string& name, const std::string& value, std::string& error) override;
  /// Kept as string attributes `quell:<key>`. Takes effect when the next file is written.
  void SetMetadata(const std::map<std::string, std::string>& entries) override;
  void SetMetadataSource(const MetadataSource& source) override;
  void CheckSettings() override;
  std::vector<std::string> GetFilesWritten() const override { return this->Files; }

  double ScratchBytes(const quell::Rect& region, const quell::Rect& whole, const quell::ArraySet& asked) override;

  bool TakesBands() const override { return true; }
  void BeginBands(const quell::Rect& region) override;
  void EndBands() override;
  void DropBands() override;

protected:
  vtkQuellImageWriter();
  ~vtkQuellImageWriter() override;
  void Execute(quell::StageFrame& frame) override;

private:
  quell::ArrayKind KindOf(int connection, const std::string& array);
  void Written(const std::string& path, const quell::WriteReport& report);

  std::string File;
  int Compression = 3;
  bool Half = false;
  std::map<int, std::string> LayerNames;
  std::map<std::string, std::string> Metadata;
  MetadataSource MoreMetadata;
  std::vector<std::string> Files;
  quell::Rect BandRegion;                           ///< empty: every execution is a whole file
  std::unique_ptr<quell::ImageFileWriter> BandFile; ///< null before the first band
  std::string BandPath;

  vtkQuellImageWriter(const vtkQuellImageWriter&) = delete;
  void operator=(const vtkQuellImageWriter&) = delete;
};

#endif
