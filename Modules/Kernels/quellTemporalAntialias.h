// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellTemporalAntialias_h
#define quellTemporalAntialias_h

#include "quellImageView.h"
#include "quellKernelsModule.h"

#include <cstdint>

namespace quell
{
/// `radiance`, `motion` and `depth` need one pixel of halo; `history` is the stage's own output of the previous frame,
/// whole. All but `radiance` may be absent.
struct AntialiasInputs
{
  ImageIn radiance, motion, depth, history;
  Rect frame; ///< the whole frame
};

struct AntialiasParameters
{
  double alpha = 0.1; ///< weight of the new frame
  double gamma = 1;   ///< half width of the accepted range in standard deviations
};

/// Temporal anti-aliasing of linear radiance. All mixing happens to (c w, w) with w = 1 / (1 + max c): c w is the
/// compressed colour c / (1 + max c), and carrying w along makes the way back, (c w) / w, exact at any brightness.
///   q     = x + motion at the 3 x 3 pixel with the smallest depth (x itself without depth);
///   h     = Catmull-Rom (4 x 4, edge pixels repeated) of the history at q, clamped to the range of the central 2 x 2;
///   h     is moved towards the mean of the new frame's 3 x 3 until it is within gamma standard deviations of it in
///   each of Y, Co, Cg; out   = h + alpha (c - h).
/// Without history, or where q is outside of the frame, the new frame is returned bit for bit. A non-finite pixel of
/// the new frame is left out of mean and deviation and replaced by the history, else by the mean of its finite
/// neighbours, else by 0; non-finite history taps are left out (bilinear then). Nothing non-finite is ever stored.
/// Returns how many pixels of `tile` were not finite.
/// Sources: Karis 2014 (weights), Salvi 2016 (variance clipping).
///
/// Computed in float vectors as differences to the pixel's own colour, within 1e-5 of the scalar code in double; a
/// pixel with a tap that is not finite or beyond 1e12 is done by the scalar code. (1e-5 up to edges of 1 : 1e5.) The
/// bits do not depend on the tile.
QUELLKERNELS_EXPORT std::int64_t TemporalAntialias(
  const AntialiasInputs& in, const AntialiasParameters& parameters, const ImageOut& out, const Rect& tile) noexcept;
QUELLKERNELS_EXPORT std::int64_t TemporalAntialiasScalar(const AntialiasInputs& in,
  const AntialiasParameters& parameters, const ImageOut& out, const Rect& tile) noexcept; ///< reference, for tests
}

#endif
