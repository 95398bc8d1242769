// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellPresenter_h
#define quellPresenter_h

#include "quellDisplayMapping.h"
#include "vtkQuellViewModule.h"
#include "vtkSmartPointer.h"

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

class vtkImageData;

namespace quell
{
/// An array of an image that nobody writes to any more.
struct Picture
{
  vtkSmartPointer<vtkImageData> Image;
  std::string Array;
  ArrayKind Kind = ArrayKind::Any;

  explicit operator bool() const { return this->Image != nullptr; }
  bool operator==(const Picture& o) const
  {
    return this->Image == o.Image && this->Array == o.Array && this->Kind == o.Kind;
  }
};

enum class CompareMap
{
  None,
  Difference,       ///< |A - B| times a gain, as colour
  SignedDifference, ///< luminance of A - B, blue below, red above
  RelativeError,    ///< relMSE of each pixel
  Flip              ///< the FLIP map of both, as the view shows them
};

/// Counts per channel of equally wide bins over [Low, High]; finite values only.
struct Histogram
{
  static constexpr int Bins = 128;
  int Channels = 0;
  double Low = 0, High = 1;
  bool Logarithmic = false; ///< bins are equal in log10, and so are Low and High
  std::array<std::array<int, Bins>, 3> Counts{};
  std::array<double, 3> Mean{}, Minimum{}, Maximum{};
  std::int64_t Below = 0, Above = 0, NonFinite = 0, Pixels = 0;
};
/// Low and High leave 0.2 % of the values out on either side. Logarithmic: they span all values above 0, at most six
/// decades below the largest.
VTKQUELLVIEW_EXPORT Histogram HistogramOf(const Picture& picture, bool logarithmic);

/// How far two pictures of one size and number of channels are from each other, over all channels.
struct DifferenceFigures
{
  bool Known = false;
  double Largest = 0, Mean = 0;   ///< of |A - B|
  int LargestX = 0, LargestY = 0; ///< from the bottom left
  std::int64_t OnlyOneFinite = 0; ///< pixels in which one of them has a number and the other has none
};
VTKQUELLVIEW_EXPORT DifferenceFigures DifferenceOf(const Picture& a, const Picture& b);

/// A map of how two pictures differ; empty with a sentence where they cannot be compared.
VTKQUELLVIEW_EXPORT Picture Compare(
  const Picture& a, const Picture& b, CompareMap map, double gain, std::string& error);

struct PresentWish
{
  Picture A, B;
  DisplaySettings Display;
  CompareMap Map = CompareMap::None;
  double Gain = 8;
  bool WantHistogram = false, LogHistogram = false;
  std::vector<std::string> Metrics; ///< of A against Reference
  Picture Reference;

  bool operator==(const PresentWish& o) const;
};

struct Presentation
{
  std::uint64_t Serial = 0;
  PresentWish Wish;
  DisplayImage A, B, Map;
  std::string MapError;
  DifferenceFigures Difference; ///< where a map is wished for
  Histogram Bars;
  std::vector<std::pair<std::string, double>> Errors;
  std::string ErrorsText; ///< why there are none
  bool Complete = false;  ///< nothing more will come
};

/// Makes pictures, maps and figures on a thread of its own. All functions from any thread.
class VTKQUELLVIEW_EXPORT Presenter
{
public:
  Presenter();
  ~Presenter();
  Presenter(const Presenter&) = delete;
  void operator=(const Presenter&) = delete;

  std::uint64_t Wish(const PresentWish& wish);
  std::shared_ptr<const Presentation> Latest() const;
  bool Idle() const;
  bool WaitIdle(double seconds) const;
  void SetNotify(std::function<void()> notify);

private:
  struct Internals;
  std::unique_ptr<Internals> Internal;
};
}

#endif
