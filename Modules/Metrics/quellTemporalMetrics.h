// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellTemporalMetrics_h
#define quellTemporalMetrics_h

#include "quellImageView.h"
#include "vtkQuellMetricsModule.h"

#include <string>
#include <utility>
#include <vector>

namespace quell
{
/// What only a sequence shows. Frames t_n, references r_n of the same frames (converged), e_n = t_n - r_n; means are
/// over pixels, channels and frames, in double, the same bits for any number of threads.
///
///   flicker   sqrt(mean over n >= 1 of (e_n - e_(n-1))^2 / 2): what changes from frame to frame and should not. White
///             noise of variance s^2 gives s; averaged exponentially with weight a it gives s a / sqrt(2 - a). Without
///             a reference e = t: right for a view that stands still.
///   warp      sqrt(mean over n >= 1 of (t_n(p) - t_(n-1)(p + m_n(p)))^2):
///             the reprojected frame difference, bilinear, of the pixels whose four taps lie inside and, where ids are
///             given, show the same id. Motion m = previous - current in pixels. It also sees shading that rightly
///             changes: compare it with `warp of the reference`.
///   lag       frames' worth of the largest step of the reference that is missing afterwards, summed:
///             with s the frame of the step, sum over n >= s of <e_n, d_n> / <d_n, d_n>, d_n = r_(s-1) - r_n.
///             An exponential average with weight a gives (1 - a) / a, until the sequence ends. Only where the
///             reference changes.
///   ghost     share of pixels where what was there before is still seen: for some k in 1 ... 8 with d = r_(n-k) - r_n
///             larger than a tenth (|d|^2 > 0.01 (|r_n|^2 + 0.01 C)), <e_n, d> >= 0.1 |d|^2 and the rest of the error
///             is less than half of it (|e_n - g d|^2 <= 0.25 |e_n|^2). Only where the reference changes; noise that
///             happens to point the same way counts too.
///
/// Sources: flicker and warp are the usual temporal error terms (e.g. Lai et al. 2018, eq. 5, without its occlusion
/// mask); lag is the integral of the step response.
class VTKQUELLMETRICS_EXPORT TemporalMetrics
{
public:
  /// What the names mean, in this order.
  static const std::vector<std::string>& Names();

  /// The next frame. Absent views: no reference, motion or id; a view that was there has to stay. Throws StageError:
  /// another size or number of channels, pixels that are not finite.
  void Add(const ImageIn& test, const ImageIn& reference, const ImageIn& motion, const ImageIn& id);

  int Frames() const { return this->Count; }
  /// What is defined for these frames; `warp of the reference` follows warp.
  std::vector<std::pair<std::string, double>> Values() const;
  /// Frame of the largest step, counted from the first one added; -1: none.
  int StepFrame() const;

private:
  using Pixels = std::vector<float>;
  void Keep(const ImageIn& view, std::vector<Pixels>& list, std::size_t kept);

  int Width = 0, Height = 0, Channels = 0, Count = 0;
  bool HasReference = false, HasMotion = false, HasId = false;
  std::vector<Pixels> Tests, References, Ids; ///< newest last
  double Flicker = 0, Warp = 0, WarpReference = 0, WarpPixels = 0, Ghost = 0;
  int GhostFrames = 0;
  Pixels Before; ///< the reference before the largest step
  double Step = 0, Lag = 0;
  int StepAt = -1;
};
}

#endif
