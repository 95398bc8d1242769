// SPDX-License-Identifier: BSD-3-Clause
#include "quellLightTree.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#ifdef __SSE2__
#include <emmintrin.h>
#endif

namespace quell
{
double LightConeMeasure(double spread, double extent) noexcept
{
  const double w = std::min(spread + extent, M_PI), s = std::sin(spread), c = std::cos(spread);
  return 2 * M_PI * (1 - c) + M_PI / 2 * (2 * w * s - std::cos(spread - 2 * w) - 2 * spread * s + c);
}

namespace
{
/// The measure above for an extent of 90 degrees, over the mean resultant length of the normals. A cap of half angle
/// t has the length (1 + cos t) / 2, which needs no angles to add up: the bins of a split estimate their cones by it.
/// (A bound, which the stored nodes have, would cost an inverse cosine per light and level, and one stray normal would
/// decide.)
struct MeasureTable
{
  static constexpr int Size = 128;
  float Values[Size + 1];

  MeasureTable()
  {
    for (int i = 0; i <= Size; ++i)
      Values[i] = float(LightConeMeasure(std::acos(2. * i / Size - 1), M_PI / 2));
  }
  float operator()(float resultant) const
  {
    const float x = std::min(1.f, std::max(0.f, resultant)) * Size;
    const int i = std::min(Size - 1, int(x));
    return Values[i] + (Values[i + 1] - Values[i]) * (x - float(i));
  }
};

/// A cone of normals in double; spread > pi: all directions.
struct Cone
{
  Vec3d Axis{ 0, 0, 1 };
  double Spread = 0, Extent = 0;
  bool TwoSided = false;
};

Cone Join(const Cone& a, const Cone& b)
{
  Cone big = a, small = b;
  if (big.Spread < small.Spread)
    std::swap(big, small);
  Cone out = big;
  out.TwoSided = a.TwoSided || b.TwoSided;
  out.Extent = std::max(a.Extent, b.Extent);
  // What shines both ways may be turned around.
  Vec3d axis = small.Axis;
  if (out.TwoSided && Dot(big.Axis, axis) < 0)
    axis = -axis;
  const Vec3d across = Cross(big.Axis, axis);
  const double sine = Length(across), between = std::atan2(sine, Dot(big.Axis, axis));
  if (std::min(between + small.Spread, M_PI) <= big.Spread)
    return out;
  out.Spread = (big.Spread + between + small.Spread) / 2;
  if (out.Spread >= M_PI || !(sine > 0))
  {
    out.Spread = M_PI;
    return out;
  }
  // turn the axis towards the other one
  const double turn = out.Spread - big.Spread;
  const Vec3d side = Cross(across * (1 / sine), big.Axis);
  out.Axis = Normalized(big.Axis * std::cos(turn) + side * std::sin(turn));
  return out;
}

/// Four numbers at once, by the compilers' vector types: SSE2, which every x86-64 has, where Highway starts later.
using Floats = float __attribute__((vector_size(16)));
using Ints = std::int32_t __attribute__((vector_size(16)));

inline Floats Load(const float* p) noexcept
{
  Floats v;
  std::memcpy(&v, p, sizeof v);
  return v;
}
inline void Store(Floats v, float* p) noexcept
{
  std::memcpy(p, &v, sizeof v);
}
inline Floats All(float v) noexcept
{
  return Floats{ v, v, v, v };
}
/// b where either is NaN.
inline Floats Min(Floats a, Floats b) noexcept
{
#ifdef __SSE2__
  return _mm_min_ps(a, b);
#else
  return a < b ? a : b;
#endif
}
inline Floats Max(Floats a, Floats b) noexcept
{
#ifdef __SSE2__
  return _mm_max_ps(a, b);
#else
  return a > b ? a : b;
#endif
}
inline Floats Sqrt(Floats a) noexcept
{
#ifdef __SSE2__
  return _mm_sqrt_ps(a);
#else
  return Floats{ std::sqrt(a[0]), std::sqrt(a[1]), std::sqrt(a[2]), std::sqrt(a[3]) };
#endif
}
inline Ints Truncated(Floats a) noexcept
{
  return __builtin_convertvector(a, Ints);
}
inline Floats Abs(Floats a) noexcept
{
  return Max(a, -a);
}

/// cos(max(0, a - b)) and sin of the same, from the sines and cosines of the two angles in [0, pi].
inline Floats CosDifference(Floats sinA, Floats cosA, Floats sinB, Floats cosB) noexcept
{
  return cosA > cosB ? All(1) : cosA * cosB + sinA * sinB;
}
inline Floats SinDifference(Floats sinA, Floats cosA, Floats sinB, Floats cosB) noexcept
{
  return cosA > cosB ? All(0) : sinA * cosB - cosA * sinB;
}
inline Floats Sine(Floats cosine) noexcept
{
  return Sqrt(Max(All(0), All(1) - cosine * cosine));
}
}

struct LightTree::Builder
{
  static constexpr int Bins = 12;
  static constexpr std::uint32_t Leaf = 0xffffffffu;

  struct alignas(16) Item
  {
    float Lo[4], Hi[4]; ///< the fourth ones: nothing
    float Sum[4];       ///< axis, power
    std::uint32_t Light;
  };
  struct alignas(16) Bin
  {
    float Lo[4], Hi[4], Sum[4];
    std::uint32_t Count;

    void Clear()
    {
      Store(All(std::numeric_limits<float>::max()), Lo);
      Store(All(-std::numeric_limits<float>::max()), Hi);
      Store(All(0), Sum);
      Count = 0;
    }
    template <class T>
    void Add(const T& o, std::uint32_t count)
    {
      Store(Min(Load(Lo), Load(o.Lo)), Lo);
      Store(Max(Load(Hi), Load(o.Hi)), Hi);
      Store(Load(Sum) + Load(o.Sum), Sum);
      Count += count;
    }
  };
  struct Binary
  {
    Vec3f Lower, Upper;
    Cone Normals;
    double Intensity = 0;
    double Reach = 0; ///< from the centre of the box
    std::uint32_t Left = Leaf, Right = 0, Light = 0;
  };

  LightTree& Tree;
  const std::vector<LightBounds>& Lights;
  std::vector<Item> Items;
  std::vector<Binary> Nodes;
  static const MeasureTable& Measure()
  {
    static const MeasureTable table;
    return table;
  }

  /// Power x cone measure x surface area. Sides have a least length, so that lights on a line or plane compare.
  static float Cost(const Bin& b, float least)
  {
    const float x = std::max(least, b.Hi[0] - b.Lo[0]), y = std::max(least, b.Hi[1] - b.Lo[1]),
                z = std::max(least, b.Hi[2] - b.Lo[2]);
    const float length = std::sqrt(b.Sum[0] * b.Sum[0] + b.Sum[1] * b.Sum[1] + b.Sum[2] * b.Sum[2]);
    return b.Sum[3] * Measure()(length / float(b.Count)) * (x * y + y * z + z * x);
  }

  /// Where to cut [begin, end); reorders the items.
  std::size_t Split(std::size_t begin, std::size_t end, int level)
  {
    const std::size_t n = end - begin, half = begin + n / 2;
    if (n == 2)
      return half;
    const Floats two = All(0.5f);
    Floats least4 = All(std::numeric_limits<float>::max()), most4 = -(least4);
    Floats boxLeast = least4, boxMost = most4;
    for (std::size_t i = begin; i < end; ++i)
    {
      const Floats a = Load(this->Items[i].Lo), b = Load(this->Items[i].Hi), c = (a + b) * two;
      least4 = Min(least4, c);
      most4 = Max(most4, c);
      boxLeast = Min(boxLeast, a);
      boxMost = Max(boxMost, b);
    }
    alignas(16) float lo[4], size[4], box[4];
    Store(least4, lo);
    Store(most4 - least4, size);
    Store(boxMost - boxLeast, box);
    const int widest = size[0] >= size[1] && size[0] >= size[2] ? 0 : size[1] >= size[2] ? 1 : 2;
    if (!(size[widest] > 0))
      return half; // all in one place
    const auto median = [&](int axis)
    {
      const auto at = [this](std::size_t i) { return this->Items.begin() + std::ptrdiff_t(i); };
      std::nth_element(at(begin), at(half), at(end),
        [axis](const Item& a, const Item& b)
        {
          const float x = a.Lo[axis] + a.Hi[axis], y = b.Lo[axis] + b.Hi[axis];
          return x != y ? x < y : a.Light < b.Light;
        });
      return half;
    };
    // A stored node holds four lights however they are split. The last levels are kept for halving, so that the depth
    // has a limit.
    if (n <= 4 || level >= DeepestBinary - 32)
      return median(widest);

    const float longest = std::max({ box[0], box[1], box[2] }), least = 1e-3f * longest;
    Bin bin[3][Bins];
    alignas(16) float scale[4] = {};
    for (int a = 0; a < 3; ++a)
    {
      scale[a] = size[a] > 0 ? float(Bins) * 0.9999f / size[a] : 0.f;
      for (Bin& b : bin[a])
        b.Clear();
    }
    const auto binsOf = [&](const Item& item, std::int32_t* out)
    {
      const Floats c = (Load(item.Lo) + Load(item.Hi)) * two;
      const Floats x = Min((c - least4) * Load(scale), All(float(Bins - 1)));
      const Ints bins = Truncated(x);
      std::memcpy(out, &bins, sizeof bins);
    };
    alignas(16) std::int32_t which[4];
    for (std::size_t i = begin; i < end; ++i)
    {
      const Item& item = this->Items[i];
      binsOf(item, which);
      for (int a = 0; a < 3; ++a)
        bin[a][which[a]].Add(item, 1);
    }
    float best = std::numeric_limits<float>::infinity();
    int bestAxis = -1, bestBin = 0;
    for (int a = 0; a < 3; ++a)
    {
      if (!(scale[a] > 0))
        continue;
      float right[Bins];
      Bin sum;
      sum.Clear();
      for (int b = Bins - 1; b > 0; --b)
      {
        if (bin[a][b].Count > 0)
          sum.Add(bin[a][b], bin[a][b].Count);
        right[b] = sum.Count > 0 ? Cost(sum, least) : -1.f;
      }
      const float kr = longest / std::max(least, box[a]);
      sum.Clear();
      for (int b = 0; b + 1 < Bins; ++b)
      {
        if (bin[a][b].Count == 0)
          continue; // the same cut as before
        sum.Add(bin[a][b], bin[a][b].Count);
        if (right[b + 1] < 0)
          continue;
        const float cost = kr * (Cost(sum, least) + right[b + 1]);
        if (cost < best)
        {
          best = cost;
          bestAxis = a;
          bestBin = b;
        }
      }
    }
    if (bestAxis < 0)
      return median(widest);
    const auto middle =
      std::partition(this->Items.begin() + std::ptrdiff_t(begin), this->Items.begin() + std::ptrdiff_t(end),
        [&](const Item& i)
        {
          alignas(16) std::int32_t w[4];
          binsOf(i, w);
          return w[bestAxis] <= bestBin;
        });
    return std::size_t(middle - this->Items.begin());
  }

  std::uint32_t MakeBinary(std::size_t begin, std::size_t end, int level)
  {
    const std::uint32_t self = std::uint32_t(this->Nodes.size());
    this->Nodes.emplace_back();
    if (end - begin == 1)
    {
      const std::uint32_t index = this->Items[begin].Light;
      const LightBounds& l = this->Lights[index];
      Binary& n = this->Nodes[self];
      n.Light = index;
      n.Lower = l.Lower;
      n.Upper = l.Upper;
      n.Intensity = l.Intensity;
      n.Normals.Axis = Vec3d(l.Axis);
      n.Normals.Spread = l.CosSpread == 1 ? 0 : std::acos(std::max(-1.f, std::min(1.f, l.CosSpread)));
      n.Normals.Extent = l.CosExtent == 0 ? M_PI / 2 : std::acos(std::max(-1.f, std::min(1.f, l.CosExtent)));
      n.Normals.TwoSided = l.TwoSided;
      n.Reach = double(l.Reach) + Length(Vec3d(l.Upper) - Vec3d(l.Lower)) / 2;
      return self;
    }
    const std::size_t middle = this->Split(begin, end, level);
    const std::uint32_t left = this->MakeBinary(begin, middle, level + 1);
    const std::uint32_t right = this->MakeBinary(middle, end, level + 1);
    Binary& n = this->Nodes[self];
    const Binary &a = this->Nodes[left], &b = this->Nodes[right];
    n.Left = left;
    n.Right = right;
    for (int c = 0; c < 3; ++c)
    {
      n.Lower[c] = std::min(a.Lower[c], b.Lower[c]);
      n.Upper[c] = std::max(a.Upper[c], b.Upper[c]);
    }
    n.Normals = Join(a.Normals, b.Normals);
    n.Intensity = a.Intensity + b.Intensity;
    const Vec3d centre = Vec3d(n.Lower) + Vec3d(n.Upper);
    n.Reach = std::max(a.Reach + Length(Vec3d(a.Lower) + Vec3d(a.Upper) - centre) / 2,
      b.Reach + Length(Vec3d(b.Lower) + Vec3d(b.Upper) - centre) / 2);
    return self;
  }

  void Fill(LightTree::Node& out, int slot, std::uint32_t index, double total) const
  {
    const Binary& n = this->Nodes[index];
    const Vec3d centre =
      ((Vec3d(n.Lower) + Vec3d(n.Upper)) * 0.5 - Vec3d(this->Tree.Centre)) * double(this->Tree.Scale);
    const Vec3d half = (Vec3d(n.Upper) - Vec3d(n.Lower)) * (0.5 * double(this->Tree.Scale));
    out.X[slot] = float(centre.x);
    out.Y[slot] = float(centre.y);
    out.Z[slot] = float(centre.z);
    // A little more than the box: rounding of what is measured from the centre stays inside.
    out.Radius[slot] = float(Length(half) * (1 + 1e-5));
    out.AxisX[slot] = float(n.Normals.Axis.x);
    out.AxisY[slot] = float(n.Normals.Axis.y);
    out.AxisZ[slot] = float(n.Normals.Axis.z);
    const double spread = std::min(M_PI, n.Normals.Spread);
    out.CosSpread[slot] = float(std::cos(spread));
    out.SinSpread[slot] = float(std::max(0., std::sin(spread)));
    out.CosExtent[slot] = float(std::cos(n.Normals.Extent));
    out.TwoSided[slot] = n.Normals.TwoSided ? 1.f : 0.f;
    const double reach = n.Reach * double(this->Tree.Scale) * (1 + 1e-5);
    out.Reach2[slot] = float(reach * reach);
    out.Intensity[slot] = float(n.Intensity / total);
  }

  /// The stored node of binary node `index`, which has children.
  std::uint32_t Collapse(std::uint32_t index, int level, std::uint64_t trail, double total)
  {
    this->Tree.Levels = std::max(this->Tree.Levels, level + 1);
    const std::uint32_t self = std::uint32_t(this->Tree.Nodes.size());
    this->Tree.Nodes.emplace_back();
    std::uint32_t children[Width];
    int count = 0;
    const Binary& n = this->Nodes[index];
    for (std::uint32_t c : { n.Left, n.Right })
    {
      if (this->Nodes[c].Left == Leaf)
        children[count++] = c;
      else
      {
        children[count++] = this->Nodes[c].Left;
        children[count++] = this->Nodes[c].Right;
      }
    }
    for (int s = 0; s < count; ++s)
    {
      const std::uint64_t below = trail | std::uint64_t(s) << (2 * level);
      this->Fill(this->Tree.Nodes[self], s, children[s], total);
      const Binary& c = this->Nodes[children[s]];
      if (c.Left == Leaf)
      {
        this->Tree.Nodes[self].Child[s] = c.Light | LeafBit;
        this->Tree.Trails[c.Light] = below;
      }
      else
      {
        const std::uint32_t child = this->Collapse(children[s], level + 1, below, total);
        this->Tree.Nodes[self].Child[s] = child;
      }
    }
    return self;
  }
};

void LightTree::Build(const std::vector<LightBounds>& lights)
{
  this->Nodes.clear();
  this->Trails.assign(lights.size(), Absent);
  this->Levels = 0;
  this->Centre = Vec3f();
  this->Scale = 1;

  Builder builder{ *this, lights, {}, {} };
  builder.Items.reserve(lights.size());
  double intensity = 0, power = 0;
  Vec3d lower(1e300), upper(-1e300);
  const auto usable = [](const LightBounds& l)
  {
    return l.Intensity > 0 && std::isfinite(l.Intensity) && l.Power > 0 && std::isfinite(l.Power) &&
           IsFinite(l.Lower) && IsFinite(l.Upper) && IsFinite(l.Axis);
  };
  for (const LightBounds& l : lights)
    if (usable(l))
    {
      intensity += l.Intensity;
      power += l.Power;
      for (int c = 0; c < 3; ++c)
      {
        lower[c] = std::min(lower[c], double(l.Lower[c]));
        upper[c] = std::max(upper[c], double(l.Upper[c]));
      }
    }
  if (!(intensity > 0) || lights.size() >= LeafBit)
    return;
  // In units of all lights' extent nothing over- or underflows, whatever the scene is measured in.
  const double extent = Length(upper - lower);
  this->Centre = Vec3f((lower + upper) * 0.5);
  this->Scale = extent > 1e-30 && extent < 1e30 ? float(1 / extent) : 1.f;
  for (std::size_t i = 0; i < lights.size(); ++i)
  {
    const LightBounds& l = lights[i];
    if (!usable(l))
      continue;
    Builder::Item item;
    for (int c = 0; c < 3; ++c)
    {
      item.Lo[c] = (l.Lower[c] - this->Centre[c]) * this->Scale;
      item.Hi[c] = (l.Upper[c] - this->Centre[c]) * this->Scale;
      // lights of all directions have no normal to add up
      item.Sum[c] = l.CosSpread > -0.999f ? l.Axis[c] : 0.f;
    }
    item.Lo[3] = item.Hi[3] = 0;
    item.Sum[3] = float(double(l.Power) / power);
    item.Light = std::uint32_t(i);
    builder.Items.push_back(item);
  }
  builder.Nodes.reserve(2 * builder.Items.size());
  const std::uint32_t root = builder.MakeBinary(0, builder.Items.size(), 0);
  this->Nodes.reserve(builder.Items.size() / 2 + 1);
  if (builder.Nodes[root].Left == Builder::Leaf)
  {
    const std::uint32_t light = builder.Nodes[root].Light;
    this->Nodes.emplace_back();
    builder.Fill(this->Nodes[0], 0, root, intensity);
    this->Nodes[0].Child[0] = light | LeafBit;
    this->Trails[light] = 0;
    this->Levels = 1;
  }
  else
    builder.Collapse(root, 0, 0, intensity);
  this->Nodes.shrink_to_fit();
}

std::size_t LightTree::Bytes() const noexcept
{
  return this->Nodes.size() * sizeof(Node) + this->Trails.size() * sizeof(std::uint64_t);
}

bool LightTree::Enter(const Receiver& at, Local& local) const noexcept
{
  if (this->Nodes.empty())
    return false;
  local.X = (at.Position.x - this->Centre.x) * this->Scale;
  local.Y = (at.Position.y - this->Centre.y) * this->Scale;
  local.Z = (at.Position.z - this->Centre.z) * this->Scale;
  local.Nx = at.Normal.x;
  local.Ny = at.Normal.y;
  local.Nz = at.Normal.z;
  local.BothSides = at.BothSides;
  local.AnyDirection = at.Normal == Vec3f();
  return true;
}

void LightTree::Weigh(const Node& node, const Local& at, float* importance) noexcept
{
  const Floats zero = All(0), one = All(1.f), less = All(-1.f);
  const Floats dx = Load(node.X) - All(at.X), dy = Load(node.Y) - All(at.Y), dz = Load(node.Z) - All(at.Z);
  const Floats raw2 = dx * dx + dy * dy + dz * dz;
  const Floats inverse = one / Sqrt(Max(raw2, All(1e-24f)));
  const Floats radius = Load(node.Radius);
  const auto inside = raw2 <= radius * radius;
  const Floats sinB = Min(one, radius * inverse), cosB = Sine(sinB);
  // at the light
  const Floats along = -((Load(node.AxisX) * dx + Load(node.AxisY) * dy + Load(node.AxisZ) * dz) * inverse);
  const Floats cosW = Max(less, Min(one, Load(node.TwoSided) > zero ? Abs(along) : along));
  const Floats sinW = Sine(cosW), sinS = Load(node.SinSpread), cosS = Load(node.CosSpread);
  const Floats cosX = CosDifference(sinW, cosW, sinS, cosS), sinX = SinDifference(sinW, cosW, sinS, cosS);
  const Floats cosT = CosDifference(sinX, cosX, sinB, cosB);
  Floats weight = cosT > Load(node.CosExtent) ? Max(zero, cosT) : zero;
  // at the receiver
  if (!at.AnyDirection)
  {
    Floats facing = (All(at.Nx) * dx + All(at.Ny) * dy + All(at.Nz) * dz) * inverse;
    if (at.BothSides)
      facing = Abs(facing);
    const Floats cosI = Max(less, Min(one, facing));
    weight = weight * Max(zero, CosDifference(Sine(cosI), cosI, sinB, cosB));
  }
  weight = (inside ? one : weight) * Load(node.Intensity);
  const Floats reciprocal = Min(inverse, one / Max(radius, All(1e-12f)));
  weight = weight * reciprocal * reciprocal;
  // the comparison is false for NaN, too
  Store(raw2 <= Load(node.Reach2) ? weight : zero, importance);
}

/// What counts in a node. Where a cluster seemed to matter but none of its parts does, they count by intensity: the
/// chances of all lights sum to 1 wherever anything may be seen.
bool LightTree::Weights(const Node& node, const Local& at, bool root, float* w, float& sum) noexcept
{
  Weigh(node, at, w);
  sum = (w[0] + w[1]) + (w[2] + w[3]);
  if (sum == 0 && !root)
  {
    std::copy_n(node.Intensity, Width, w);
    sum = (w[0] + w[1]) + (w[2] + w[3]);
  }
  return sum > 0 && std::isfinite(sum);
}

bool LightTree::Pick(const Receiver& at, double u, std::uint32_t& light, float& chance) const noexcept
{
  Local local;
  if (!this->Enter(at, local))
    return false;
  chance = 1;
  std::uint32_t index = 0;
  for (;;)
  {
    const Node& node = this->Nodes[index];
    alignas(16) float w[Width];
    float sum;
    if (!Weights(node, local, index == 0, w, sum))
      return false;
    const double c0 = w[0], c1 = c0 + w[1], c2 = c1 + w[2], c3 = c2 + w[3];
    const double x = u * c3;
    int slot = int(x >= c0) + int(x >= c1) + int(x >= c2);
    while (slot > 0 && !(w[slot] > 0))
      --slot;
    const double before[Width] = { 0, c0, c1, c2 };
    u = std::min(0x1.fffffffffffffp-1, std::max(0., (x - before[slot]) / double(w[slot])));
    chance *= w[slot] / sum;
    index = node.Child[slot];
    if (index & LeafBit)
      break;
  }
  light = index & ~LeafBit;
  return chance > 0;
}

float LightTree::Chance(const Receiver& at, std::uint32_t light) const noexcept
{
  Local local;
  if (light >= this->Trails.size() || this->Trails[light] == Absent || !this->Enter(at, local))
    return 0;
  float chance = 1;
  std::uint32_t index = 0;
  for (std::uint64_t trail = this->Trails[light];; trail >>= 2)
  {
    const Node& node = this->Nodes[index];
    alignas(16) float w[Width];
    float sum;
    if (!Weights(node, local, index == 0, w, sum))
      return 0;
    const unsigned slot = unsigned(trail & 3u);
    chance *= w[slot] / sum;
    index = node.Child[slot];
    if (index & LeafBit)
      return chance;
  }
}
}
