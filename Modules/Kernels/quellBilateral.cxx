// SPDX-License-Identifier: BSD-3-Clause
#include "quellBilateral.h"

#include "quellGuards.h"
#include "quellPlanes.h"

#include <cmath>
#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "quellBilateral.cxx"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"
#include "quellLanes.hxx"

#ifndef quellBilateral_once
#define quellBilateral_once
namespace quell
{
namespace
{
constexpr double NoTerm = 1e30;
constexpr int MostTerms = BilateralInputs::MostGuides + 5; ///< the range and the four named guides
constexpr int MostPlain = 3 * MostTerms, MostChannels = 3 + BilateralInputs::MostCarriedComponents;

/// A tile in planes. A plain feature is scaled so that its exponent (base 2) is the squared difference itself.
struct BilateralTile
{
  PlaneLayout layout;
  int channels = 3;
  float* channel[MostChannels]; ///< colour, then what is carried
  float* penalty;               ///< added to a tap's exponent: 0, or +inf for a tap that does not count
  float* plain[MostPlain];
  int plains = 0;
  struct Noisy
  {
    float* value[3];
    int components;
    float *variance, *scale; ///< summed; log2(e) / (2 max(s^2, V))
  } noisy[MostTerms];
  int noisies = 0;
  struct Plane
  {
    float *normal[3], *position[3], *scale;
  } plane[MostTerms];
  int planes = 0;
  bool careful = false;        ///< some feature value is not a number, or differences of colours may overflow
  float* result[MostChannels]; ///< one row
  bool Shares() const noexcept { return this->noisies == 0 && this->planes == 0; }
};

/// The weights of pairs (p, p + offset), for the half of the offsets that are positive: rows y - radius ... y of them,
/// a row beginning with column tile.x0 - radius.
struct SharedWeights
{
  int radius = 0, offsets = 0;
  std::ptrdiff_t stride = 0; ///< floats of a row of one offset
  const float* spatial = nullptr;
  float* memory = nullptr;

  /// Offsets in the order (1, 0) ... (r, 0), (-r, 1) ... (r, 1), ... (r, r).
  float* row(int offset, int y) const noexcept
  {
    const int slots = this->radius + 1;
    const int slot = ((y % slots) + slots) % slots;
    return this->memory + (std::ptrdiff_t(slot) * this->offsets + offset) * this->stride;
  }
};
constexpr int SharedOffsets(int radius) noexcept
{
  return radius + radius * (2 * radius + 1);
}

bool IsUsed(const BilateralGuide& g) noexcept
{
  return g.value && (g.sigma < NoTerm || g.distance == GuideDistance::Id);
}
bool IsNoisy(const BilateralGuide& g) noexcept
{
  return g.variance && (g.distance == GuideDistance::Euclidean || g.distance == GuideDistance::Color ||
                         g.distance == GuideDistance::Normal);
}

/// All terms of the exponent as guides, the range first.
struct Terms
{
  BilateralGuide guide[MostTerms];
  int count = 0;

  Terms(const BilateralInputs& in, const BilateralParameters& p) noexcept
  {
    const auto add = [this](const ImageIn& value, GuideDistance distance, double sigma)
    {
      BilateralGuide g;
      g.value = value, g.distance = distance, g.sigma = sigma;
      if (IsUsed(g))
        this->guide[this->count++] = g;
    };
    add(in.radiance, GuideDistance::Color, p.sigmaRange);
    if (in.normal)
      add(in.normal, GuideDistance::Euclidean, p.sigmaNormal);
    if (in.albedo)
      add(in.albedo, GuideDistance::Euclidean, p.sigmaAlbedo);
    if (in.depth)
    {
      const bool plane = in.position && in.normal;
      add(plane ? in.position : in.depth, plane ? GuideDistance::Plane : GuideDistance::LogDepth, p.sigmaDepth);
    }
    if (in.id)
      add(in.id, GuideDistance::Id, 0);
    for (int k = 0; k < in.guideCount; ++k)
      if (IsUsed(in.guides[k]))
        this->guide[this->count++] = in.guides[k];
  }
  std::size_t planes() const noexcept
  {
    std::size_t n = 0;
    for (int k = 0; k < this->count; ++k)
      n += this->guide[k].distance == GuideDistance::Plane
             ? 7
             : std::size_t(this->guide[k].value.components) + (IsNoisy(this->guide[k]) ? 2 : 0);
    return n;
  }
  bool share() const noexcept
  {
    for (int k = 0; k < this->count; ++k)
      if (this->guide[k].distance == GuideDistance::Plane || IsNoisy(this->guide[k]))
        return false;
    return true;
  }
};

int EffectiveRadius(const BilateralParameters& p) noexcept
{
  return p.sigmaSpatial > 0 && p.radius > 0 ? p.radius : 0;
}

int CarriedComponents(const BilateralInputs& in) noexcept
{
  int n = 0;
  for (int k = 0; k < in.carriedCount; ++k)
    n += in.carried[k].components;
  return n;
}

PlaneLayout TileLayout(const BilateralInputs& in, const BilateralParameters& p, const Rect& tile) noexcept
{
  const int r = EffectiveRadius(p);
  return PlaneLayout(tile.grown(r).clipped(in.radiance.extent), 2 * r);
}

/// Differences of colours beyond this count as this: 129 x 129 of them do not overflow a float.
constexpr float LargestStep = 1e34f;

/// sqrt(log2(e) / 2) / sigma; 0 turns into 2^60: exact, so that only equal values have a difference of 0.
double FeatureScale(double sigma) noexcept
{
  return sigma > 1e-17 ? std::sqrt(0.5 * 1.4426950408889634) / sigma : 1152921504606846976.;
}

float Scaled(double v, double scale) noexcept
{
  v *= scale;
  return float(v > 1e38 ? 1e38 : v < -1e38 ? -1e38 : v); // NaN stays
}

/// The same in float, for rows of pixels; `scale` is finite.
inline float ScaledRow(float v, float scale) noexcept
{
  const float s = v * scale;
  return s > 1e38f ? 1e38f : s < -1e38f ? -1e38f : s;
}

/// What is compared: `n` values, NaN for "no data".
void GuideValue(const BilateralGuide& g, RangeSpace space, double white, int x, int y, double* out) noexcept
{
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const float* v = g.value.at(x, y);
  const int n = g.value.components;
  switch (g.distance)
  {
    case GuideDistance::Color:
    {
      const bool good = Finite3(v);
      const double l = 0.2126 * v[0] + 0.7152 * v[1] + 0.0722 * v[2];
      for (int k = 0; k < 3; ++k)
        out[k] = !good                             ? nan
                 : space == RangeSpace::Linear     ? v[k] / white
                 : space == RangeSpace::ToneMapped ? v[k] / (white + (l > 0 ? l : 0))
                                                   : std::log1p(v[k] > 0 ? v[k] / white : 0.);
      return;
    }
    case GuideDistance::Normal:
    {
      const double length = std::sqrt(double(v[0]) * v[0] + double(v[1]) * v[1] + double(v[2]) * v[2]);
      for (int k = 0; k < 3; ++k)
        out[k] = !Finite3(v) ? nan : length > 0 ? v[k] / length : 0.;
      return;
    }
    case GuideDistance::LogDepth:
      // "Only equal" is asked of the depths themselves: different ones may share a logarithm in float.
      *out = std::isnan(*v)   ? nan
             : std::isinf(*v) ? 1e6
             : g.sigma > 0    ? std::log(*v > 1e-30f ? double(*v) : 1e-30)
                              : double(*v);
      return;
    default:
      for (int k = 0; k < n; ++k)
        out[k] = Finite(v[k]) ? double(v[k]) : nan;
  }
}

}
}
#endif

HWY_BEFORE_NAMESPACE();
namespace quell
{
namespace HWY_NAMESPACE
{
using D = hn::ScalableTag<float>;
using V = hn::Vec<D>;

/// e + delta^2; a gap (NaN) is left out.
template <bool Careful>
HWY_INLINE V AddSquare(V delta, V e)
{
  if (Careful)
    delta = hn::IfThenElseZero(hn::Eq(delta, delta), delta);
  return hn::MulAdd(delta, delta, e);
}

template <bool Careful>
HWY_INLINE V Difference(V a, V b)
{
  const D d;
  const V delta = hn::Sub(a, b);
  return Careful ? hn::Min(hn::Max(delta, hn::Set(d, -LargestStep)), hn::Set(d, LargestStep)) : delta;
}

HWY_INLINE void StoreMeans(const BilateralTile& t, std::ptrdiff_t p, int i, V sw, const V* sums)
{
  const D d;
  const V one = hn::Set(d, 1.f);
  const auto some = hn::Gt(sw, hn::Set(d, 1e-30f));
  const V inv = hn::Div(one, hn::IfThenElse(some, sw, one));
  for (int c = 0; c < t.channels; ++c)
  {
    const V centre = hn::LoadU(d, t.channel[c] + p);
    hn::StoreU(hn::IfThenElse(some, hn::MulAdd(sums[c], inv, centre), centre), d, t.result[c] + i);
  }
}

/// Every tap's weight where it is needed: for all guides and radii.
template <bool Careful>
void BilateralRow(const BilateralTile& t, const float* spatial, int radius, int y, int x0, int x1, int i0)
{
  const D d;
  const int lanes = int(hn::Lanes(d)), side = 2 * radius + 1;
  const V zero = hn::Zero(d);
  const auto first = t.layout.at(x0, y);
  for (int i = 0; i < x1 - x0; i += lanes)
  {
    const auto p = first + i;
    V f[MostPlain], centre[MostChannels], sums[MostChannels];
    for (int k = 0; k < t.plains; ++k)
      f[k] = hn::LoadU(d, t.plain[k] + p);
    for (int c = 0; c < t.channels; ++c)
    {
      centre[c] = hn::LoadU(d, t.channel[c] + p);
      sums[c] = zero;
    }
    V sw = zero;
    for (int dy = -radius; dy <= radius; ++dy)
    {
      if (y + dy < t.layout.extent.y0 || y + dy >= t.layout.extent.y1)
        continue;
      for (int dx = -radius; dx <= radius; ++dx)
      {
        const auto q = p + dy * t.layout.stride + dx;
        V e = hn::Add(hn::Set(d, spatial[(dy + radius) * side + dx + radius]), hn::LoadU(d, t.penalty + q));
        for (int k = 0; k < t.plains; ++k)
          e = AddSquare<Careful>(hn::Sub(hn::LoadU(d, t.plain[k] + q), f[k]), e);
        for (int k = 0; k < t.noisies; ++k)
        {
          const BilateralTile::Noisy& n = t.noisy[k];
          V square = zero;
          for (int c = 0; c < n.components; ++c)
            square = AddSquare<Careful>(hn::Sub(hn::LoadU(d, n.value[c] + q), hn::LoadU(d, n.value[c] + p)), square);
          const V v = hn::LoadU(d, n.variance + p);
          const V excess = hn::Sub(square, hn::Add(v, hn::Min(v, hn::LoadU(d, n.variance + q))));
          e = hn::MulAdd(hn::Max(excess, zero), hn::LoadU(d, n.scale + p), e);
        }
        for (int k = 0; k < t.planes; ++k)
        {
          const BilateralTile::Plane& s = t.plane[k];
          V delta = zero;
          for (int c = 0; c < 3; ++c)
            delta = hn::MulAdd(hn::LoadU(d, s.normal[c] + p),
              hn::Sub(hn::LoadU(d, s.position[c] + q), hn::LoadU(d, s.position[c] + p)), delta);
          e = AddSquare<Careful>(hn::Mul(delta, hn::LoadU(d, s.scale + p)), e);
        }
        const V w = NegExp2(d, e);
        sw = hn::Add(sw, w);
        for (int c = 0; c < t.channels; ++c)
          sums[c] = hn::MulAdd(w, Difference<Careful>(hn::LoadU(d, t.channel[c] + q), centre[c]), sums[c]);
      }
    }
    StoreMeans(t, p, i0 + i, sw, sums);
  }
}

/// Pixels of three components to three rows.
void SplitRowImpl(const float* in, int width, float* a, float* b, float* c)
{
  const D d;
  const int lanes = int(hn::Lanes(d));
  int i = 0;
  for (; i + lanes <= width; i += lanes)
  {
    V x, y, z;
    hn::LoadInterleaved3(d, in + 3 * i, x, y, z);
    hn::StoreU(x, d, a + i);
    hn::StoreU(y, d, b + i);
    hn::StoreU(z, d, c + i);
  }
  for (; i < width; ++i) // copies: the last ones need no vectors
  {
    a[i] = in[3 * i];
    b[i] = in[3 * i + 1];
    c[i] = in[3 * i + 2];
  }
}

void BilateralRowImpl(const BilateralTile& t, const float* spatial, int radius, int y, int x0, int x1, int i0)
{
  if (t.careful)
    BilateralRow<true>(t, spatial, radius, y, x0, x1, i0);
  else
    BilateralRow<false>(t, spatial, radius, y, x0, x1, i0);
}

/// Weights of row y with all pixels above and right of them; columns [x0, x1). Both pixels' penalties are in them.
template <bool Careful, int Plains>
void SharedRow(const BilateralTile& t, const SharedWeights& s, int y, int firstRow, int x0, int x1)
{
  const D d;
  const int lanes = int(hn::Lanes(d));
  const int plains = Plains ? Plains : t.plains;
  const auto first = t.layout.at(x0, y);
  float* const out = s.row(0, y);
  const int low = std::max(0, firstRow - y), high = std::min(s.radius, t.layout.extent.y1 - 1 - y);
  for (int i = 0; i < x1 - x0; i += lanes)
  {
    const auto p = first + i;
    V f[Plains ? Plains : MostPlain];
    for (int k = 0; k < plains; ++k)
      f[k] = hn::LoadU(d, t.plain[k] + p);
    const V penalty = hn::LoadU(d, t.penalty + p);
    for (int dy = low; dy <= high; ++dy)
    {
      int o = dy ? s.radius + (dy - 1) * (2 * s.radius + 1) : 0;
      for (int dx = dy ? -s.radius : 1; dx <= s.radius; ++dx, ++o)
      {
        const auto q = p + dy * t.layout.stride + dx;
        V e = hn::Add(hn::Set(d, s.spatial[o]), hn::Add(penalty, hn::LoadU(d, t.penalty + q)));
        for (int k = 0; k < plains; ++k)
          e = AddSquare<Careful>(hn::Sub(hn::LoadU(d, t.plain[k] + q), f[k]), e);
        hn::StoreU(NegExp2(d, e), d, out + o * s.stride + i);
      }
    }
  }
}

/// Row y from the weights of rows y - radius ... y.
template <bool Careful, bool Carries>
void SharedSums(const BilateralTile& t, const SharedWeights& s, int y, int x0, int x1)
{
  const D d;
  const int lanes = int(hn::Lanes(d));
  const int channels = Carries ? t.channels : 3;
  const auto first = t.layout.at(x0, y);
  for (int i = 0; i < x1 - x0; i += lanes)
  {
    const auto p = first + i;
    V centre[Carries ? MostChannels : 3], sums[Carries ? MostChannels : 3];
    for (int c = 0; c < channels; ++c)
    {
      centre[c] = hn::LoadU(d, t.channel[c] + p);
      sums[c] = hn::Zero(d);
    }
    V sw = hn::Set(d, 1.f); // the pixel itself
    const auto tap = [&](V w, std::ptrdiff_t q) HWY_ATTR
    {
      sw = hn::Add(sw, w);
      for (int c = 0; c < channels; ++c)
        sums[c] = hn::MulAdd(w, Difference<Careful>(hn::LoadU(d, t.channel[c] + q), centre[c]), sums[c]);
    };
    for (int dy = 0; dy <= s.radius; ++dy)
    {
      const bool above = y + dy < t.layout.extent.y1, below = y - dy >= t.layout.extent.y0;
      int o = dy ? s.radius + (dy - 1) * (2 * s.radius + 1) : 0;
      const float* up = s.row(0, y) + s.radius + i;
      const float* down = s.row(0, y - dy) + s.radius + i;
      for (int dx = dy ? -s.radius : 1; dx <= s.radius; ++dx, ++o)
      {
        const auto step = dy * t.layout.stride + dx;
        if (above)
          tap(hn::LoadU(d, up + o * s.stride), p + step);
        if (below)
          tap(hn::LoadU(d, down + o * s.stride - dx), p - step);
      }
    }
    StoreMeans(t, p, i, sw, sums);
  }
}

void SharedRowImpl(const BilateralTile& t, const SharedWeights& s, int y, int firstRow, int x0, int x1)
{
  if (t.careful)
    return SharedRow<true, 0>(t, s, y, firstRow, x0, x1);
  switch (t.plains)
  {
    case 3:
      return SharedRow<false, 3>(t, s, y, firstRow, x0, x1);
    case 6:
      return SharedRow<false, 6>(t, s, y, firstRow, x0, x1);
    case 7:
      return SharedRow<false, 7>(t, s, y, firstRow, x0, x1);
    case 9:
      return SharedRow<false, 9>(t, s, y, firstRow, x0, x1);
    case 10:
      return SharedRow<false, 10>(t, s, y, firstRow, x0, x1);
    case 11:
      return SharedRow<false, 11>(t, s, y, firstRow, x0, x1);
    default:
      return SharedRow<false, 0>(t, s, y, firstRow, x0, x1);
  }
}

void SharedSumsImpl(const BilateralTile& t, const SharedWeights& s, int y, int x0, int x1)
{
  if (t.channels > 3)
    t.careful ? SharedSums<true, true>(t, s, y, x0, x1) : SharedSums<false, true>(t, s, y, x0, x1);
  else
    t.careful ? SharedSums<true, false>(t, s, y, x0, x1) : SharedSums<false, false>(t, s, y, x0, x1);
}
}
}
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace quell
{
HWY_EXPORT(SplitRowImpl);
HWY_EXPORT(BilateralRowImpl);
HWY_EXPORT(SharedRowImpl);
HWY_EXPORT(SharedSumsImpl);

namespace
{
/// Row y of a guide in planes (value[c] + row is pixel (x0, y)), as GuideValue and Scaled give it to float rounding.
/// Returns whether all of it are numbers.
bool FillGuideRow(const BilateralGuide& g, RangeSpace space, double white, double scale, int x0, int y, int width,
  float* const* value, std::ptrdiff_t row) noexcept
{
  const float nan = std::numeric_limits<float>::quiet_NaN(), s = float(scale), w = float(white);
  const float* in = g.value.at(x0, y);
  const int n = g.value.components;
  int gaps = 0;
  if (g.distance == GuideDistance::Color && space != RangeSpace::Log)
  {
    const bool toned = space == RangeSpace::ToneMapped;
    float *a = value[0] + row, *b = value[1] + row, *c = value[2] + row;
    HWY_DYNAMIC_DISPATCH(SplitRowImpl)(in, width, a, b, c);
    for (int i = 0; i < width; ++i)
    {
      const float cr = a[i], cg = b[i], cb = c[i];
      const bool good = Finite(cr) & Finite(cg) & Finite(cb);
      const float l = 0.2126f * cr + (0.7152f * cg + 0.0722f * cb);
      const float f = 1 / (toned ? w + (l > 0 ? l : 0.f) : w);
      a[i] = good ? ScaledRow(cr * f, s) : nan;
      b[i] = good ? ScaledRow(cg * f, s) : nan;
      c[i] = good ? ScaledRow(cb * f, s) : nan;
      gaps += !good;
    }
  }
  else if (n == 3 && (g.distance == GuideDistance::Euclidean || g.distance == GuideDistance::Id))
  {
    HWY_DYNAMIC_DISPATCH(SplitRowImpl)(in, width, value[0] + row, value[1] + row, value[2] + row);
    for (int k = 0; k < 3; ++k)
    {
      float* out = value[k] + row;
      for (int i = 0; i < width; ++i)
      {
        const float v = out[i];
        const bool good = Finite(v);
        out[i] = good ? ScaledRow(v, s) : nan;
        gaps += !good;
      }
    }
  }
  else
    for (int i = 0; i < width; ++i)
    {
      double v[3];
      GuideValue(g, space, white, x0 + i, y, v);
      for (int k = 0; k < n; ++k)
      {
        value[k][row + i] = Scaled(v[k], scale);
        gaps += value[k][row + i] != value[k][row + i];
      }
    }
  return gaps == 0;
}

/// Of a noisy guide, summed over its components.
double GuideVariance(const BilateralGuide& g, int x, int y) noexcept
{
  const float* v = g.variance.at(x, y);
  double sum = 0;
  for (int k = 0; k < g.variance.components; ++k)
    sum += Finite(v[k]) && v[k] > 0 ? double(v[k]) : 0.;
  return g.variance.components == 1 ? sum * g.value.components : sum;
}

std::ptrdiff_t SharedStride(const Rect& tile, int radius) noexcept
{
  // Columns [x0 - radius, x1 + radius), written and read in whole vectors.
  return tile.width() + 2 * radius + 2 * PlaneLayout::Lanes;
}
}

std::size_t BilateralScratch(
  const BilateralInputs& in, const BilateralParameters& parameters, const Rect& tile) noexcept
{
  const PlaneLayout layout = TileLayout(in, parameters, tile);
  const Terms terms(in, parameters);
  const int radius = EffectiveRadius(parameters);
  const std::size_t side = 2 * std::size_t(radius) + 1, channels = 3 + std::size_t(CarriedComponents(in));
  std::size_t size = layout.size() * (channels + 1 + terms.planes()) + channels * layout.stride + side * side;
  if (terms.share() && radius <= BilateralParameters::MostSharedRadius)
    size += std::size_t(SharedOffsets(radius)) * (1 + std::size_t(radius + 1) * SharedStride(tile, radius));
  return size;
}

std::int64_t Bilateral(const BilateralInputs& in, const BilateralParameters& parameters, const BilateralOutputs& out,
  const Rect& tile, float* scratch) noexcept
{
  const int radius = EffectiveRadius(parameters), side = 2 * radius + 1;
  const Terms terms(in, parameters);
  BilateralTile t;
  t.layout = TileLayout(in, parameters, tile);
  t.channels = 3 + CarriedComponents(in);
  const Rect& e = t.layout.extent;
  const std::size_t size = t.layout.size();
  // Lanes right of the last pixel and taps beyond the frame read padding: no weight, and numbers.
  const int reach = 2 * radius;
  const auto next = [&](float value)
  {
    float* plane = scratch;
    scratch += size;
    for (int y = e.y0; y < e.y1; ++y)
    {
      float* const row = plane + t.layout.at(e.x0, y);
      std::fill(row - reach, row, value);
      std::fill_n(row + e.width(), reach + PlaneLayout::Lanes, value);
    }
    return plane;
  };
  for (int c = 0; c < t.channels; ++c)
    t.channel[c] = next(0.f);
  t.penalty = next(std::numeric_limits<float>::infinity());

  const auto forEach = [&](auto&& body)
  {
    for (int y = e.y0; y < e.y1; ++y)
    {
      const auto row = t.layout.at(e.x0, y);
      for (int x = e.x0; x < e.x1; ++x)
        body(x, y, row + (x - e.x0));
    }
  };
  std::int64_t bad = 0;
  bool holes = false;
  for (int y = e.y0; y < e.y1; ++y)
  {
    const auto row = t.layout.at(e.x0, y);
    const float inf = std::numeric_limits<float>::infinity();
    const float *color = in.radiance.at(e.x0, y), *depth = in.depth ? in.depth.at(e.x0, y) : nullptr;
    float *r = t.channel[0] + row, *g = t.channel[1] + row, *b = t.channel[2] + row, *penalty = t.penalty + row;
    HWY_DYNAMIC_DISPATCH(SplitRowImpl)(color, e.width(), r, g, b);
    int unfit = 0, large = 0;
    for (int i = 0; i < e.width(); ++i)
    {
      const float cr = r[i], cg = g[i], cb = b[i];
      const float most = std::max(std::max(std::fabs(cr), std::fabs(cg)), std::fabs(cb));
      const bool good = Finite(cr) & Finite(cg) & Finite(cb);
      penalty[i] = good ? 0.f : inf;
      unfit += !good;
      large += !(most < 0.1f * LargestStep);
    }
    t.careful |= large + unfit > 0;
    holes |= unfit > 0;
    if (unfit)
      for (int i = 0; i < e.width(); ++i)
        if (penalty[i] > 0)
        {
          float c[3];
          ReadFilled(in.radiance, e.x0 + i, y, c);
          r[i] = c[0], g[i] = c[1], b[i] = c[2];
          bad += tile.contains(e.x0 + i, y);
        }
    if (depth)
      for (int i = 0; i < e.width(); ++i)
        penalty[i] = Finite(depth[i]) ? penalty[i] : inf;
  }
  int channel = 3;
  for (int k = 0; k < in.carriedCount; ++k)
  {
    const ImageIn& image = in.carried[k];
    const int n = image.components;
    forEach(
      [&](int x, int y, std::ptrdiff_t i)
      {
        const auto good = [&image, n](int qx, int qy, float* v)
        {
          bool finite = true;
          for (int c = 0; c < BilateralInputs::MostCarriedComponents; ++c)
          {
            v[c] = c < n ? image.at(qx, qy)[c] : 0.f;
            finite = finite && Finite(v[c]);
          }
          return finite;
        };
        float v[BilateralInputs::MostCarriedComponents];
        if (!good(x, y, v))
          FillFromNeighbours<BilateralInputs::MostCarriedComponents>(image.extent, x, y, v, good);
        for (int c = 0; c < n; ++c)
        {
          t.channel[channel + c][i] = v[c];
          t.careful |= !(std::fabs(v[c]) < 0.1f * LargestStep);
        }
      });
    channel += n;
  }

  for (int g = 0; g < terms.count; ++g)
  {
    const BilateralGuide& guide = terms.guide[g];
    const int n = guide.value.components;
    if (guide.distance == GuideDistance::Plane)
    {
      BilateralTile::Plane& plane = t.plane[t.planes++];
      for (float*& p : plane.normal)
        p = next(0.f);
      for (float*& p : plane.position)
        p = next(0.f);
      plane.scale = next(0.f);
      const double scale = FeatureScale(guide.sigma);
      forEach(
        [&](int x, int y, std::ptrdiff_t i)
        {
          const float* normal = in.normal ? in.normal.at(x, y) : nullptr;
          for (int k = 0; k < 3; ++k)
          {
            plane.normal[k][i] = normal ? normal[k] : 0.f;
            plane.position[k][i] = guide.value.at(x, y)[k];
          }
          const float z = in.depth ? *in.depth.at(x, y) : 1.f;
          plane.scale[i] = Finite(z) ? Scaled(1 / (z > 1e-30f ? double(z) : 1e-30), scale) : 0.f;
          t.careful |= (normal && !Finite3(normal)) || !Finite3(guide.value.at(x, y));
        });
      continue;
    }
    const bool noisy = IsNoisy(guide);
    float* value[3];
    for (int k = 0; k < n; ++k)
      value[k] = next(0.f);
    const double scale = noisy ? 1 : FeatureScale(guide.distance == GuideDistance::Id ? 0 : guide.sigma);
    for (int y = e.y0; y < e.y1; ++y)
      if (!FillGuideRow(
            guide, parameters.range, parameters.white, scale, e.x0, y, e.width(), value, t.layout.at(e.x0, y)))
        t.careful = true;
    if (!noisy)
    {
      for (int k = 0; k < n; ++k)
        t.plain[t.plains++] = value[k];
      continue;
    }
    BilateralTile::Noisy& plane = t.noisy[t.noisies++];
    plane.components = n;
    for (int k = 0; k < n; ++k)
      plane.value[k] = value[k];
    plane.variance = next(0.f);
    plane.scale = next(0.f);
    const double least = std::max(guide.sigma * guide.sigma, 1e-34);
    forEach(
      [&](int x, int y, std::ptrdiff_t i)
      {
        const double v = GuideVariance(guide, x, y);
        plane.variance[i] = Scaled(v, 1);
        plane.scale[i] = Scaled(0.5 * 1.4426950408889634 / std::max(least, v), 1);
      });
  }

  for (int c = 0; c < t.channels; ++c)
  {
    t.result[c] = scratch;
    scratch += t.layout.stride;
  }
  const float* const spatial = scratch;
  const double perPixel = parameters.sigmaSpatial < NoTerm
                            ? 0.5 * 1.4426950408889634 / (parameters.sigmaSpatial * parameters.sigmaSpatial)
                            : 0;
  for (int dy = -radius; dy <= radius; ++dy)
    for (int dx = -radius; dx <= radius; ++dx)
      *scratch++ = radius ? Scaled((dx * dx + dy * dy) * perPixel, 1) : 0.f;

  const bool shares = terms.share() && radius > 0 && radius <= BilateralParameters::MostSharedRadius;
  SharedWeights s;
  if (shares)
  {
    s.radius = radius;
    s.offsets = SharedOffsets(radius);
    s.stride = SharedStride(tile, radius);
    s.spatial = scratch;
    // (1, 0) ... in reading order: what follows the centre.
    std::copy_n(spatial + side * side / 2 + 1, s.offsets, scratch);
    scratch += s.offsets;
    s.memory = scratch;
    for (int y = std::max(e.y0, tile.y0 - radius); y < tile.y0; ++y)
      HWY_DYNAMIC_DISPATCH(SharedRowImpl)(t, s, y, tile.y0, tile.x0 - radius, tile.x1 + radius);
  }
  for (int y = tile.y0; y < tile.y1; ++y)
  {
    if (shares)
    {
      HWY_DYNAMIC_DISPATCH(SharedRowImpl)(t, s, y, tile.y0, tile.x0 - radius, tile.x1 + radius);
      HWY_DYNAMIC_DISPATCH(SharedSumsImpl)(t, s, y, tile.x0, tile.x1);
      if (holes) // a pixel that is no tap of others has taps itself
        for (int x = tile.x0; x < tile.x1; ++x)
          if (!Finite3(in.radiance.at(x, y)))
          {
            // Whole vectors are written: into the padding right of the row.
            const int aside = int(t.layout.stride) - PlaneLayout::Lanes;
            HWY_DYNAMIC_DISPATCH(BilateralRowImpl)(t, spatial, radius, y, x, x + 1, aside);
            for (int c = 0; c < t.channels; ++c)
              t.result[c][x - tile.x0] = t.result[c][aside];
          }
    }
    else
      HWY_DYNAMIC_DISPATCH(BilateralRowImpl)(t, spatial, radius, y, tile.x0, tile.x1, 0);
    if (in.depth) // background passes through
      for (int x = tile.x0; x < tile.x1; ++x)
        if (!Finite(*in.depth.at(x, y)))
          for (int c = 0; c < t.channels; ++c)
            t.result[c][x - tile.x0] = t.channel[c][t.layout.at(x, y)];
    const auto store = [&](const ImageOut& image, int from)
    {
      if (!image)
        return;
      const int n = image.components;
      float* o = image.at(tile.x0, y);
      for (int i = 0; i < tile.width(); ++i)
        for (int c = 0; c < n; ++c)
          *o++ = t.result[from + c][i];
    };
    store(out.radiance, 0);
    int from = 3;
    for (int k = 0; k < in.carriedCount; from += in.carried[k++].components)
      store(out.carried[k], from);
  }
  return bad;
}

void BilateralScalar(
  const BilateralInputs& in, const BilateralParameters& p, const BilateralOutputs& out, const Rect& tile) noexcept
{
  const Terms terms(in, p);
  const int radius = EffectiveRadius(p);
  // |delta|^2 / 2 sigma^2 of `n` components; a component without data is left out.
  const auto term = [](const double* a, const double* b, int n, double sigma)
  {
    double e = 0;
    for (int k = 0; k < n; ++k)
      if (std::isfinite(a[k]) && std::isfinite(b[k]) && a[k] != b[k])
        e += sigma > 1e-17 ? (a[k] - b[k]) * (a[k] - b[k]) / (2 * sigma * sigma) : 1e300;
    return e;
  };
  const auto exponent = [&](const BilateralGuide& g, int x, int y, int qx, int qy)
  {
    if (g.distance == GuideDistance::Plane)
    {
      const double zero = 0;
      double a = 0;
      for (int k = 0; k < 3; ++k)
        a += in.normal ? double(in.normal.at(x, y)[k]) * (double(g.value.at(qx, qy)[k]) - g.value.at(x, y)[k]) : 0;
      const float z = in.depth ? *in.depth.at(x, y) : 1.f;
      a /= std::max(1e-30, double(z));
      return term(&a, &zero, 1, g.sigma);
    }
    double a[3], b[3];
    GuideValue(g, p.range, p.white, x, y, a);
    GuideValue(g, p.range, p.white, qx, qy, b);
    if (!IsNoisy(g))
      return term(a, b, g.value.components, g.distance == GuideDistance::Id ? 0 : g.sigma);
    const double v = GuideVariance(g, x, y), w = GuideVariance(g, qx, qy);
    const double square = term(a, b, g.value.components, std::sqrt(0.5));
    return std::max(0., square - (v + std::min(v, w))) / (2 * std::max({ g.sigma * g.sigma, 1e-34, v }));
  };
  const auto carried = [&](int k, int x, int y, float* v)
  {
    const ImageIn& image = in.carried[k];
    const auto good = [&image](int qx, int qy, float* o)
    {
      bool finite = true;
      for (int c = 0; c < BilateralInputs::MostCarriedComponents; ++c)
      {
        o[c] = c < image.components ? image.at(qx, qy)[c] : 0.f;
        finite = finite && Finite(o[c]);
      }
      return finite;
    };
    if (!good(x, y, v))
      FillFromNeighbours<BilateralInputs::MostCarriedComponents>(image.extent, x, y, v, good);
  };
  const auto read = [&](int x, int y, float* v)
  {
    bool good = ReadFilled(in.radiance, x, y, v);
    int c = 3;
    for (int k = 0; k < in.carriedCount; c += in.carried[k++].components)
    {
      float w[BilateralInputs::MostCarriedComponents];
      carried(k, x, y, w);
      std::copy_n(w, in.carried[k].components, v + c);
    }
    return good;
  };
  const int channels = 3 + CarriedComponents(in);
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x)
    {
      float c[MostChannels];
      double result[MostChannels];
      read(x, y, c);
      std::copy_n(c, channels, result);
      double sw = 0, sums[MostChannels] = {};
      const bool hit = !in.depth || Finite(*in.depth.at(x, y));
      for (int qy = y - radius; hit && qy <= y + radius; ++qy)
        for (int qx = x - radius; qx <= x + radius; ++qx)
        {
          if (!in.radiance.inside(qx, qy) || !Finite3(in.radiance.at(qx, qy)))
            continue;
          if (in.depth && !Finite(*in.depth.at(qx, qy)))
            continue;
          float q[MostChannels];
          read(qx, qy, q);
          double e = 0;
          if (p.sigmaSpatial < NoTerm && radius)
            e += ((qx - x) * (qx - x) + (qy - y) * (qy - y)) / (2 * p.sigmaSpatial * p.sigmaSpatial);
          for (int g = 0; g < terms.count; ++g)
            e += exponent(terms.guide[g], x, y, qx, qy);
          const double w = e <= 80 ? std::exp(-e) : 0;
          sw += w;
          for (int k = 0; k < channels; ++k)
            sums[k] += w * (double(q[k]) - c[k]);
        }
      for (int k = 0; k < channels; ++k)
        result[k] += sw > 0 ? sums[k] / sw : 0;
      if (out.radiance)
        for (int k = 0; k < 3; ++k)
          out.radiance.at(x, y)[k] = float(result[k]);
      int channel = 3;
      for (int k = 0; k < in.carriedCount; ++k)
        for (int j = 0; j < in.carried[k].components; ++j, ++channel)
          if (out.carried[k])
            out.carried[k].at(x, y)[j] = float(result[channel]);
    }
}
}
#endif
