// SPDX-License-Identifier: BSD-3-Clause
// Poison in one frame of an orbit through the whole SVGF loop, as it is shipped: each array of the frame in turn, in
// several places. In that frame nothing beyond what the stages declare to read may change; a hundred frames later no
// pixel of any node is other than finite, and the history is that of a run without poison.
#include "../AllStages.h"
#include "quellPipelineExecutor.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkObject.h"
#include "vtkObjectFactory.h"
#include "vtkPointData.h"
#include "vtkQuellStage.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <map>
#include <stdexcept>

namespace
{
constexpr int W = 72, H = 52;
constexpr int PoisonTick = 6, LastTick = PoisonTick + 100;

/// Where poison lies: inside of a surface, a cluster on the ball's silhouette, the corner, the border, the background.
bool Spoilt(int x, int y)
{
  return (x == 20 && y == 12) || (x >= 41 && x < 46 && y >= 26 && y < 30) || (x == 0 && y == 0) ||
         (x == W - 1 && y == 20) || (x == 30 && y == H - 3);
}
int DistanceToSpoilt(int x, int y)
{
  int least = W + H;
  for (int v = 0; v < H; ++v)
    for (int u = 0; u < W; ++u)
      if (Spoilt(u, v))
        least = std::min(least, std::max(std::abs(u - x), std::abs(v - y)));
  return least;
}

float Noise(std::uint32_t x, std::uint32_t y, std::uint32_t t, std::uint32_t c)
{
  std::uint32_t h = x * 0x9e3779b9u ^ y * 0x85ebca6bu ^ t * 0xc2b2ae35u ^ c * 0x27d4eb2fu;
  h ^= h >> 16;
  h *= 0x7feb352du;
  h ^= h >> 15;
  h *= 0x846ca68bu;
  h ^= h >> 16;
  return float(h >> 8) * 0x1p-24f;
}

/// A ball on a floor, under a sky, seen by a camera that goes around it; noisy light.
class vtkQuellOrbit : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellOrbit);
  static std::string Array; ///< the poisoned one; empty: none
  static float Value;

  /// The camera of a tick.
  struct View
  {
    quell::Vec3d Eye, Right, Up, Back;
    explicit View(int tick)
    {
      const double a = 0.03 * tick;
      this->Eye = { 4 * std::sin(a), 1.4, 4 * std::cos(a) };
      this->Back = quell::Normalized(this->Eye - quell::Vec3d(0, 0.4, 0));
      this->Right = quell::Normalized(quell::Cross({ 0, 1, 0 }, this->Back));
      this->Up = quell::Cross(this->Back, this->Right);
    }
    quell::Mat4 ToCamera() const
    {
      quell::Mat4 m;
      const quell::Vec3d rows[3] = { this->Right, this->Up, this->Back };
      for (int r = 0; r < 3; ++r)
      {
        const double v[3] = { rows[r].x, rows[r].y, rows[r].z };
        std::copy(v, v + 3, m.m[r]);
        m.m[r][3] = -quell::Dot(rows[r], this->Eye);
      }
      return m;
    }
    /// ndc and depth.
    quell::Vec3d Project(const quell::Vec3d& p) const
    {
      const quell::Vec3d d = p - this->Eye;
      const double z = -quell::Dot(d, this->Back);
      return { Focal * quell::Dot(d, this->Right) / z, Focal * W / H * quell::Dot(d, this->Up) / z, z };
    }
  };
  static constexpr double Focal = 1.6;

protected:
  vtkQuellOrbit() { this->InitializePorts(); }
  void DescribeSource(int& w, int& h) override
  {
    w = W;
    h = H;
  }
  void Execute(quell::StageFrame& frame) override
  {
    const int t = frame.Tick();
    const View now(t), then(t - 1);
    quell::FrameFacts& facts = frame.OutputFacts;
    facts.HasCamera = true;
    facts.WorldToCamera = now.ToCamera();
    quell::Mat4 lens;
    lens.m[0][0] = Focal, lens.m[1][1] = Focal * W / H;
    lens.m[2][2] = lens.m[2][3] = -1, lens.m[3][2] = -1, lens.m[3][3] = 0;
    facts.WorldToNdc = lens * facts.WorldToCamera;
    const quell::Rect r = frame.Region();
    for (int y = r.y0; y < r.y1; ++y)
      for (int x = r.x0; x < r.x1; ++x)
      {
        const double nx = 2 * (x + 0.5) / W - 1, ny = 2 * (y + 0.5) / H - 1;
        const quell::Vec3d d = now.Right * (nx / Focal) + now.Up * (ny * H / W / Focal) - now.Back;
        // A ball of radius 0.8 around (0, 0.8, 0), then the floor.
        const quell::Vec3d o = now.Eye - quell::Vec3d(0, 0.8, 0);
        const double a = quell::Dot(d, d), b = quell::Dot(o, d), c = quell::Dot(o, o) - 0.64, q = b * b - a * c;
        const bool ball = q > 0, floor = !ball && d.y < -0.05;
        const double along = ball ? (-b - std::sqrt(std::max(q, 0.))) / a : -now.Eye.y / d.y;
        const quell::Vec3d p = now.Eye + d * along;
        const quell::Vec3d n = ball ? quell::Normalized(p - quell::Vec3d(0, 0.8, 0)) : quell::Vec3d(0, 1, 0);
        const bool hit = ball || floor, check = (int(std::floor(2 * p.x)) + int(std::floor(2 * p.z))) & 1;
        const double light = hit ? std::max(0.1, quell::Dot(n, quell::Normalized(quell::Vec3d(1, 2, 1)))) : 0;
        const quell::Vec3d before = then.Project(p);
        const float albedo[3] = { ball ? 0.8f : check ? 0.7f : 0.2f, ball ? 0.3f : 0.5f, 0.4f };
        float value[3];
        for (const std::string& name : frame.WantedArrays())
        {
          const quell::ImageOut out = frame.Output(name);
          for (int k = 0; k < 3; ++k)
            value[k] = name == "radiance" ? float(albedo[k] * light * 8 * std::pow(Noise(x, y, t, k), 3))
                       : name == "albedo" ? hit ? albedo[k] : 1.f
                       : name == "normal" ? !hit ? 0.f
                                                 : float(k == 0   ? n.x
                                                         : k == 1 ? n.y
                                                                  : n.z)
                       : name == "depth"  ? hit ? float(along) : std::numeric_limits<float>::infinity()
                        : name == "id" ? ball    ? 2.f
                                         : floor ? 1.f
                                                 : 0.f
                       : !hit             ? 0.f
                                          : float(k == 0 ? 0.5 * W * (before.x - nx) : 0.5 * H * (before.y - ny));
          if (name == Array && t == PoisonTick && Spoilt(x, y))
            std::fill_n(value, 3, x % 2 ? -Value : Value);
          std::copy_n(value, out.components, out.at(x, y));
        }
      }
  }
};
std::string vtkQuellOrbit::Array;
float vtkQuellOrbit::Value;
vtkStandardNewMacro(vtkQuellOrbit);
QUELL_STAGE_DESCRIPTION(vtkQuellOrbit)
void vtkQuellOrbit::Describe(quell::StageDescription& d)
{
  using quell::ArrayKind;
  d.Category = "Test";
  d.Output("radiance", ArrayKind::Color, "light");
  d.Output("albedo", ArrayKind::Albedo, "colour");
  d.Output("normal", ArrayKind::Normal, "normal");
  d.Output("depth", ArrayKind::Depth, "depth");
  d.Output("motion", ArrayKind::Motion, "motion");
  d.Output("id", ArrayKind::Id, "object");
}

const char* const arrays[] = { "radiance", "albedo", "normal", "depth", "motion", "id" };

/// Node -> array -> values.
using Everything = std::map<std::string, std::map<std::string, std::vector<float>>>;

class PoisonLoop : public testing::Test
{
protected:
  void SetUp() override
  {
    vtkObject::SetGlobalWarningDisplay(0);
    this->Types = Registry();
    this->Types.Add<vtkQuellOrbit>();
    std::string ports;
    for (const char* name : arrays)
      ports += std::string("<input port=\"") + name + "\" from=\"src:" + name + "\"/>";
    const std::string file = testing::TempDir() + "quell-poison-loop.xml";
    std::ofstream(file) << "<pipeline version=\"1\"><include file=\"" QUELL_SOURCE_DIR "/Data/Pipelines/library.xml\"/>"
                        << "<time first=\"0\" count=\"" << LastTick + 1 << "\"/><node id=\"src\" type=\"Orbit\"/>"
                        << "<variable name=\"passes\" type=\"int\" default=\"5\" doc=\"of the filter\"/>"
                        << "<instance id=\"s\" template=\"svgf\"><parameter name=\"iterations\" value=\"$(passes)\"/>"
                        << ports
                        << "</instance><node id=\"taa\" type=\"TemporalAntialias\"><input port=\"radiance\" "
                           "from=\"s:out\"/><input port=\"motion\" from=\"src:motion\"/><input port=\"depth\" "
                           "from=\"src:depth\"/><input port=\"history\" from=\"taa:radiance\" delay=\"1\"/></node>"
                        << "</pipeline>";
  }
  void Load(int passes)
  {
    quell::Diagnostics messages;
    quell::GraphOptions options;
    options.Defines = { { "passes", std::to_string(passes) } };
    this->Plan = quell::LoadPipeline(testing::TempDir() + "quell-poison-loop.xml", this->Types, options, messages);
    if (!this->Plan)
      throw std::runtime_error(messages.ToText());
  }
  void TearDown() override
  {
    vtkQuellOrbit::Array.clear();
    vtkObject::SetGlobalWarningDisplay(1);
  }

  Everything Read(quell::PipelineExecutor& executor) const
  {
    Everything all;
    for (const quell::GraphNode& node : this->Plan->Nodes)
      if (vtkImageData* image = node.Type == "Orbit" ? nullptr : executor.GetImage(node.Path))
        for (const quell::OutputArray& o : node.Description().Outputs)
          if (auto array = vtkFloatArray::SafeDownCast(image->GetPointData()->GetArray(o.Name.c_str())))
            if (array->GetNumberOfTuples() == W * H)
              all[node.Path][o.Name].assign(array->GetPointer(0), array->GetPointer(0) + array->GetNumberOfValues());
    return all;
  }

  /// From the first frame to the last; keeps what every node had on the poisoned tick and on the last one.
  struct Run
  {
    Everything Then, Last;
    std::map<std::string, std::int64_t> Counted; ///< by node, in the poisoned frame
    std::vector<std::string> Warnings;
  };
  Run Play(const std::string& array, float value)
  {
    vtkQuellOrbit::Array = array;
    vtkQuellOrbit::Value = value;
    quell::PipelineExecutor executor(this->Plan, this->Types);
    executor.SetWriteOutputs(false);
    executor.Request("taa", { "radiance" });
    Run run;
    for (int t = 0; t <= LastTick; ++t)
    {
      std::map<std::string, std::int64_t> before;
      for (const quell::NodeCounters& c : executor.Counters())
        before[c.Path] = c.Counters.NonFinite;
      const quell::TickResult result = executor.RunTick(t);
      EXPECT_TRUE(result.Ok) << result.Error;
      if (!result.Ok)
        return run;
      if (t < PoisonTick)
        continue;
      Everything now = this->Read(executor);
      for (const auto& node : now)
        for (const auto& entry : node.second)
          EXPECT_TRUE(std::all_of(entry.second.begin(), entry.second.end(), [](float v) { return std::isfinite(v); }))
            << node.first << ":" << entry.first << " in frame " << t;
      if (testing::Test::HasFailure())
        return run;
      if (t == PoisonTick)
      {
        run.Then = std::move(now);
        run.Warnings = result.Warnings;
        for (const quell::NodeCounters& c : executor.Counters())
          if (c.Counters.NonFinite > before[c.Path])
            run.Counted[c.Path] = c.Counters.NonFinite - before[c.Path];
      }
      else if (t == LastTick)
        run.Last = std::move(now);
    }
    return run;
  }

  /// How far a node's pixels may differ, by the regions that the stages ask for; -1: not at all.
  std::map<std::string, int> Reaches(const std::string& array) const
  {
    std::map<std::string, int> reach;
    for (const int i : this->Plan->Order)
    {
      const quell::GraphNode& node = this->Plan->Nodes[std::size_t(i)];
      int most = -1;
      for (const quell::GraphEdge& e : node.Inputs)
      {
        const quell::GraphNode& producer = this->Plan->Nodes[std::size_t(e.Producer)];
        const int there = producer.Type == "Orbit" ? (e.Array == array ? 0 : -1) : reach[producer.Path];
        if (!e.Delayed && there >= 0)
          most = std::max(most, there + node.Stage->HaloFor(e.Port));
      }
      reach[node.Path] = most;
    }
    return reach;
  }

  quell::StageRegistry Types;
  std::shared_ptr<quell::Graph> Plan;
};
}

TEST_F(PoisonLoop, OneFrameOfAnOrbitThroughTheShippedTemplate)
{
  std::int64_t spoilt = 0;
  std::vector<int> distance(std::size_t(W) * H);
  for (int y = 0; y < H; ++y)
    for (int x = 0; x < W; ++x)
    {
      spoilt += Spoilt(x, y);
      distance[std::size_t(y * W + x)] = DistanceToSpoilt(x, y);
    }
  const float inf = std::numeric_limits<float>::infinity();
  // As shipped with five passes of the filter; and with two, when most of the frame lies beyond its reach.
  for (const int passes : { 5, 2 })
  {
    this->Load(passes);
    const Run clean = this->Play("", 0);
    ASSERT_FALSE(this->HasFailure());
    ASSERT_GE(clean.Last.size(), 8u) << "every stage of the template is live";
    // Most pixels have a history to lose.
    const std::vector<float>& frames = clean.Then.at("s/accumulate").at("history");
    ASSERT_GT(std::count_if(frames.begin(), frames.end(), [](float h) { return h > 3; }), W * H / 3);
    std::vector<std::pair<const char*, float>> poisons; // of both signs
    for (const char* array : arrays)
      poisons.emplace_back(array, passes == 2 ? std::nanf("") : inf);
    // What is finite, and no light that anybody has.
    if (passes == 5)
      poisons.insert(poisons.end(), { { "radiance", FLT_MAX }, { "albedo", FLT_MAX } });
    for (const auto& poison : poisons)
    {
      const char* const array = poison.first;
      const float value = poison.second;
      const std::map<std::string, int> reaches = this->Reaches(array);
      int beyond = 0, farthest = -1;
      double worst = 0, worstMoment = 0;
      {
        SCOPED_TRACE(std::string(array) + " = " + std::to_string(value) + ", passes " + std::to_string(passes));
        const Run run = this->Play(array, value);
        ASSERT_FALSE(this->HasFailure());
        for (const auto& node : run.Then)
          for (const auto& entry : node.second)
          {
            const std::vector<float>&a = clean.Then.at(node.first).at(entry.first), &b = entry.second;
            ASSERT_EQ(a.size(), b.size());
            const int reach = reaches.at(node.first), n = int(b.size() / distance.size());
            for (std::size_t i = 0; i < b.size(); ++i)
            {
              const int d = distance[i / std::size_t(n)];
              beyond += d > reach;
              if (std::memcmp(&a[i], &b[i], sizeof(float)) == 0)
                continue;
              ASSERT_LE(d, reach) << node.first << ":" << entry.first << " changed at pixel " << i / std::size_t(n);
              farthest = std::max(farthest, d);
            }
          }
        // A colour that is not finite is counted by the stage that meets it, pixel by pixel, and told.
        const bool light = std::isfinite(value);
        if (light && array == std::string("radiance"))
        {
          EXPECT_TRUE(std::any_of(run.Warnings.begin(), run.Warnings.end(),
            [](const std::string& w) { return w.find("larger than Largest (65504)") != std::string::npos; }));
        }
        if (array == std::string("radiance") && !light)
        {
          ASSERT_EQ(run.Counted.count("s/demodulate"), 1u);
          EXPECT_EQ(run.Counted.at("s/demodulate"), spoilt);
          EXPECT_FALSE(run.Warnings.empty());
        }
        // A hundred frames later: what an average with weight 0.2 keeps of it is nothing; rounding may differ.
        for (const auto& node : run.Last)
          for (const auto& entry : node.second)
          {
            const std::vector<float>&a = clean.Last.at(node.first).at(entry.first), &b = entry.second;
            double largest = 0;
            for (const float v : a)
              largest = std::max(largest, std::fabs(double(v)));
            // The template lets 65504 of it in; the variance has the square of that to forget, and steers the filter.
            const bool square = light && (entry.first == "moments" || entry.first == "variance");
            const double allowed = square ? 0.05 : light ? 0.02 : 1e-5;
            for (std::size_t i = 0; i < b.size(); ++i)
            {
              const double e = std::fabs(double(b[i]) - a[i]);
              double& most = square ? worstMoment : worst;
              most = std::max(most, e / (largest > 0 ? largest : 1));
              ASSERT_LE(e, allowed * largest)
                << node.first << ":" << entry.first << " at value " << i << " of " << b.size();
            }
          }
      }
      std::printf(
        "  %d passes, %-9s farthest change %d pixels away, difference after 100 frames %.1e, of variance %.1e\n",
        passes, array, farthest, worst, worstMoment);
      EXPECT_GE(farthest, 0) << "the poison does nothing";
      if (passes == 2)
      {
        EXPECT_GT(beyond, W * H) << "everything is within reach";
      }
    }
  }
}
