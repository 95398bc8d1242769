// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellImageReader
 * @brief   named arrays from an image file or a sequence of files
 *
 * OpenEXR with any number of layers, and the usual picture formats; see quellImageFile.h and Documentation/aov.md for
 * which channel becomes which array. Only the arrays that are asked for are read, over the region that is asked for.
 *
 * The frame is the file's display window; pixels outside its data window hold the array's background. Values are handed
 * on as they are, non-finite ones included. Errors (missing, cut-off, deep or sub-sampled files, another size than the
 * first frame's, an array that is not there) name the file and leave the output empty.
 */
#ifndef vtkQuellImageReader_h
#define vtkQuellImageReader_h

#include "vtkQuellIOModule.h"
#include "quellCountedRows.h"
#include "vtkQuellStage.h"

#include <map>
#include <string>

class VTKQUELLIO_EXPORT vtkQuellImageReader : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellImageReader);

  ///@{ The file; a run of # in its name stands for the frame's tick, padded with zeros. Without # every frame reads the
  /// same file.
  void SetFile(const std::string& file);
  const std::string& GetFile() const { return this->File; }
  ///@}
  ///@{ The array that plain R G B (or Y) channels make. Default: radiance.
  void SetPlainArray(const std::string& name);
  const std::string& GetPlainArray() const { return this->PlainArray; }
  ///@}
  ///@{ How pixels become linear: Automatic (integers of PNG, JPEG ... are sRGB-encoded, floats are linear), Linear,
  /// Srgb.
  vtkSetClampMacro(Transfer, int, 0, 2);
  vtkGetMacro(Transfer, int);
  ///@}

  std::vector<quell::OutputArray> ListDynamicOutputs() override;
  std::vector<std::string> ListSequenceFiles(int tick) const override;
  double ScratchBytes(const quell::Rect& region, const quell::Rect& whole, const quell::ArraySet& asked) override;

protected:
  vtkQuellImageReader();
  ~vtkQuellImageReader() override;
  void DescribeSource(int& width, int& height) override;
  void Execute(quell::StageFrame& frame) override;

private:
  void CountNonFinite(const std::string& name, const quell::ImageIn& view, const quell::Rect& rows);

  std::string File;
  std::string PlainArray = "radiance";
  int Transfer = 0;
  struct Bad
  {
    long long Pixels = 0;
    int FirstX = 0, FirstY = 0;
  };
  std::map<std::string, Bad> NonFinite; ///< by array, of the frame so far
  quell::CountedRows Counted;

  vtkQuellImageReader(const vtkQuellImageReader&) = delete;
  void operator=(const vtkQuellImageReader&) = delete;
};

#endif
