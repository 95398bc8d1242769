// SPDX-License-Identifier: BSD-3-Clause
// Small stages with exactly known behaviour, and stand-ins for the writer and the display transform that outputs are
// compiled into: this module knows no real stage.
#ifndef PipelineTestStages_h
#define PipelineTestStages_h

#include "quellPipelineExecutor.h"
#include "quellPipelineReader.h"
#include "quellStageRegistry.h"
#include "vtkDataArray.h"
#include "vtkImageData.h"
#include "vtkObjectFactory.h"
#include "vtkPointData.h"
#include "vtkQuellStage.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>
#include <map>
#include <vector>

namespace pipelinetest
{
/// Things the stages see and tests look at.
struct Log
{
  struct File
  {
    std::string Name;
    quell::Rect Region;
    std::map<std::string, std::vector<float>> Layers; ///< layer -> pixels of Region, row by row
  };
  std::vector<File> Files;
  std::vector<std::pair<int, quell::ArraySet>> SourceRuns; ///< tick, arrays wanted
  int FailAtTick = -1;
  int CancelAtTick = -1;
  int PartialAtTick = -1;                  ///< the source says that its frame was finished early
  std::map<std::string, std::string> Work; ///< seed of a source -> what LoadWork gave it
  std::shared_ptr<quell::CancelToken> Token;
};
inline Log& TheLog()
{
  static Log log;
  return log;
}

/// A different number for every (tick, array, seed, pixel, component).
inline float SourceValue(int tick, const std::string& array, int seed, int x, int y, int c)
{
  std::uint32_t h = std::uint32_t(tick) * 2654435761u + std::uint32_t(seed) * 40503u + std::uint32_t(array[0]) * 977u +
                    std::uint32_t(x) * 73856093u + std::uint32_t(y) * 19349663u + std::uint32_t(c) * 83492791u;
  h ^= h >> 15;
  h *= 2246822519u;
  h ^= h >> 13;
  return float(h % 1000u) / 1000.f;
}

class vtkQuellTestSource : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellTestSource);
  vtkSetClampMacro(Width, int, 1, 4096);
  vtkGetMacro(Width, int);
  vtkSetClampMacro(Height, int, 1, 4096);
  vtkGetMacro(Height, int);
  vtkSetClampMacro(Seed, int, 0, 1000000);
  vtkGetMacro(Seed, int);
  const std::string& GetScene() const { return this->Scene; }
  void SetScene(const std::string& s)
  {
    this->Scene = s;
    this->Modified();
  }
  std::string SaveWork() const override
  {
    return TheLog().PartialAtTick >= 0 ? "sums of seed " + std::to_string(this->Seed) : std::string();
  }
  bool LoadWork(const std::string& bytes, std::string& error) override
  {
    error = "these are no sums";
    TheLog().Work[std::to_string(this->Seed)] = bytes;
    return bytes.compare(0, 4, "sums") == 0;
  }

protected:
  vtkQuellTestSource() { this->InitializePorts(); }
  void DescribeSource(int& w, int& h) override
  {
    w = this->Width;
    h = this->Height;
  }
  void Execute(quell::StageFrame& frame) override
  {
    Log& log = TheLog();
    log.SourceRuns.emplace_back(frame.Tick(), frame.WantedArrays());
    const quell::Rect r = frame.Region();
    for (const std::string& name : frame.WantedArrays())
    {
      const quell::ImageOut out = frame.Output(name);
      for (int y = r.y0; out && y < r.y1; ++y)
        for (int x = r.x0; x < r.x1; ++x)
          for (int c = 0; c < out.components; ++c)
            out.at(x, y)[c] = SourceValue(frame.Tick(), name, this->Seed, x, y, c);
    }
    if (log.PartialAtTick == frame.Tick())
      frame.OutputFacts.Partial = "3 of 8 samples";
    if (log.FailAtTick == frame.Tick())
      throw quell::StageError("the source broke");
    if (log.CancelAtTick == frame.Tick() && log.Token)
      log.Token->Cancel();
  }

private:
  int Width = 40, Height = 24, Seed = 1;
  std::string Scene;
};

/// Mean over (2 Radius + 1)^2; `normal` is read only when mask is asked.
class vtkQuellTestBox : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellTestBox);
  vtkSetClampMacro(Radius, int, 0, 16);
  vtkGetMacro(Radius, int);
  vtkSetClampMacro(Gain, double, 0., 1.);
  vtkGetMacro(Gain, double);
  vtkSetMacro(Mode, int);
  vtkGetMacro(Mode, int);
  vtkSetMacro(Quiet, bool);
  vtkGetMacro(Quiet, bool);
  int HaloFor(int port) const override { return port == 0 ? this->Radius : 0; }
  bool NeedsInput(int port, const quell::ArraySet& asked) const override
  {
    return port == 0 || asked.count("mask") != 0;
  }

protected:
  vtkQuellTestBox() { this->InitializePorts(); }
  void ExecuteTile(const quell::StageFrame& frame, const quell::Rect& tile) const override
  {
    const quell::ImageIn in = frame.Input(0), normal = frame.Input(1);
    const quell::ImageOut out = frame.Output("radiance"), mask = frame.Output("mask");
    for (int y = tile.y0; y < tile.y1; ++y)
      for (int x = tile.x0; x < tile.x1; ++x)
      {
        for (int c = 0; c < 3 && out; ++c)
        {
          double sum = 0;
          int n = 0;
          for (int j = -this->Radius; j <= this->Radius; ++j)
            for (int i = -this->Radius; i <= this->Radius; ++i)
              if (frame.Whole().contains(x + i, y + j))
              {
                sum += in.at(x + i, y + j)[c];
                ++n;
              }
          out.at(x, y)[c] = float(this->Gain * sum / n);
        }
        if (mask)
          mask.at(x, y)[0] = normal ? normal.at(x, y)[2] : -1.f;
      }
  }

private:
  int Radius = 1;
  double Gain = 1;
  int Mode = 0;
  bool Quiet = false;
};

/// radiance + history(x + 1) / 2, where history is what somebody had on the previous frame.
class vtkQuellTestAccumulate : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellTestAccumulate);

protected:
  vtkQuellTestAccumulate() { this->InitializePorts(); }
  void ExecuteTile(const quell::StageFrame& frame, const quell::Rect& tile) const override
  {
    const quell::ImageIn in = frame.Input(0), history = frame.Input(1);
    const quell::ImageOut out = frame.Output("radiance"), age = frame.Output("history");
    for (int y = tile.y0; y < tile.y1; ++y)
      for (int x = tile.x0; x < tile.x1; ++x)
      {
        for (int c = 0; c < 3 && out; ++c)
          out.at(x, y)[c] =
            in.at(x, y)[c] + (history && history.inside(x + 1, y) ? 0.5f * history.at(x + 1, y)[c] : 0.f);
        if (age)
          age.at(x, y)[0] = history ? 1.f : 0.f;
      }
  }
};

/// history + Alpha (radiance - history), in place.
class vtkQuellTestMix : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellTestMix);
  vtkSetClampMacro(Alpha, double, 0., 1.);
  vtkGetMacro(Alpha, double);
  double HistoryWeight(int port) const override { return port == 1 ? 1 - this->Alpha : 1; }

protected:
  vtkQuellTestMix() { this->InitializePorts(); }
  void ExecuteTile(const quell::StageFrame& frame, const quell::Rect& tile) const override
  {
    const quell::ImageIn in = frame.Input(0), history = frame.Input(1);
    const quell::ImageOut out = frame.Output("radiance");
    for (int y = tile.y0; y < tile.y1; ++y)
      for (int x = tile.x0; x < tile.x1; ++x)
        for (int c = 0; c < 3; ++c)
        {
          const double old = history ? history.at(x, y)[c] : in.at(x, y)[c];
          out.at(x, y)[c] = float(old + this->Alpha * (in.at(x, y)[c] - old));
        }
  }

private:
  double Alpha = 0.5;
};

class vtkQuellTestSum : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellTestSum);

protected:
  vtkQuellTestSum() { this->InitializePorts(); }
  void ExecuteTile(const quell::StageFrame& frame, const quell::Rect& tile) const override
  {
    const quell::ImageOut out = frame.Output("radiance");
    for (int k = 0; k < frame.Connections(0); ++k)
    {
      const quell::ImageIn in = frame.Input(0, k);
      for (int y = tile.y0; y < tile.y1; ++y)
        for (int x = tile.x0; x < tile.x1; ++x)
          for (int c = 0; c < 3; ++c)
            out.at(x, y)[c] += in.at(x, y)[c];
    }
  }
};

/// Takes any number of guides with names; objects to those called "bad", and to a frame without "weight".
class vtkQuellTestGuided : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellTestGuided);
  bool SetInputAttribute(
    int port, int connection, const std::string& name, const std::string& value, std::string& error) override
  {
    if (name != "name")
      return this->vtkQuellStage::SetInputAttribute(port, connection, name, value, error);
    this->Names[connection] = value;
    return true;
  }
  void CheckConnections(quell::ConnectionCheck& check) const override
  {
    for (int c = 0; c < check.Count(1); ++c)
    {
      const auto named = this->Names.find(c);
      if (named != this->Names.end() && named->second == "bad")
        check.Error(1, c,
          "guide " + std::to_string(c) + " (" + check.At(1, c).Array + ", " + std::to_string(check.At(1, c).Components) +
            ") is bad",
          "be good");
    }
    std::vector<quell::OutputArray> arrays;
    bool weight = !check.At(0, 0).Holds(arrays);
    for (const quell::OutputArray& a : arrays)
      weight = weight || a.Name == "weight";
    if (!weight)
      check.Warn(-1, 0, "there is no weight");
  }

protected:
  vtkQuellTestGuided() { this->InitializePorts(); }

private:
  std::map<int, std::string> Names;
};

/// A reader: its arrays are known only from its file's name ("missing" fails).
class vtkQuellTestReader : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellTestReader);
  const std::string& GetFile() const { return this->File; }
  void SetFile(const std::string& s)
  {
    this->File = s;
    this->Modified();
  }
  std::vector<quell::OutputArray> ListDynamicOutputs() override
  {
    if (this->File.empty())
      throw quell::StageError("File is not set");
    return { { "radiance", quell::ArrayKind::Color, 3, "" }, { "foreign", quell::ArrayKind::Any, 3, "" },
      { "weight", quell::ArrayKind::Any, 1, "" } };
  }

protected:
  vtkQuellTestReader() { this->InitializePorts(); }
  void DescribeSource(int& w, int& h) override { w = h = 8; }
  void Execute(quell::StageFrame& frame) override
  {
    for (const std::string& name : frame.WantedArrays())
      frame.AddOutput(name, name == "weight" ? 1 : 3);
  }

private:
  std::string File;
};

/// Keeps what it would write.
class vtkQuellImageWriter : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellImageWriter);
  const std::string& GetFile() const { return this->File; }
  void SetFile(const std::string& s)
  {
    this->File = s;
    this->Modified();
  }
  std::vector<std::string> GetFilesWritten() const override { return { this->Written }; }
  bool SetInputAttribute(
    int port, int connection, const std::string& name, const std::string& value, std::string& error) override
  {
    if (name != "name")
      return this->vtkQuellStage::SetInputAttribute(port, connection, name, value, error);
    this->Names[connection] = value;
    return true;
  }

protected:
  vtkQuellImageWriter() { this->InitializePorts(); }
  void Execute(quell::StageFrame& frame) override
  {
    Log::File file;
    file.Name = this->File;
    const std::size_t hash = file.Name.find("####");
    if (hash != std::string::npos)
    {
      std::string number = std::to_string(frame.Tick());
      number.insert(0, 4 - std::min<std::size_t>(4, number.size()), '0');
      file.Name.replace(hash, 4, number);
    }
    const quell::Rect r = frame.Region();
    file.Region = r;
    for (int k = 0; k < frame.Connections(0); ++k)
    {
      const quell::ImageIn in = frame.Input(0, k);
      const auto named = this->Names.find(k);
      auto& pixels = file.Layers[named == this->Names.end() ? this->GetInputArray(0, k) : named->second];
      for (int y = r.y0; y < r.y1; ++y)
        for (int x = r.x0; x < r.x1; ++x)
          pixels.insert(pixels.end(), in.at(x, y), in.at(x, y) + in.components);
    }
    this->Written = file.Name;
    TheLog().Files.push_back(file);
  }

private:
  std::string File, Written;
  std::map<int, std::string> Names;
};

class vtkQuellDisplayTransform : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellDisplayTransform);
  const std::string& GetView() const { return this->View; }
  void SetView(const std::string& s)
  {
    this->View = s;
    this->Modified();
  }
  const std::string& GetDisplay() const { return this->Display; }
  void SetDisplay(const std::string& s)
  {
    this->Display = s;
    this->Modified();
  }

protected:
  vtkQuellDisplayTransform() { this->InitializePorts(); }
  void ExecuteTile(const quell::StageFrame& frame, const quell::Rect& tile) const override
  {
    const quell::ImageIn in = frame.Input(0);
    const quell::ImageOut out = frame.Output("display");
    for (int y = tile.y0; y < tile.y1; ++y)
      for (int x = tile.x0; x < tile.x1; ++x)
        for (int c = 0; c < 3; ++c)
          out.at(x, y)[c] = in.at(x, y)[c] * 0.25f;
  }

private:
  std::string View, Display;
};

inline vtkStandardNewMacro(vtkQuellTestSource);
inline vtkStandardNewMacro(vtkQuellTestBox);
inline vtkStandardNewMacro(vtkQuellTestAccumulate);
inline vtkStandardNewMacro(vtkQuellTestMix);
inline vtkStandardNewMacro(vtkQuellTestSum);
inline vtkStandardNewMacro(vtkQuellTestGuided);
inline vtkStandardNewMacro(vtkQuellTestReader);
inline vtkStandardNewMacro(vtkQuellImageWriter);
inline vtkStandardNewMacro(vtkQuellDisplayTransform);
inline QUELL_STAGE_DESCRIPTION(vtkQuellTestSource) inline QUELL_STAGE_DESCRIPTION(vtkQuellTestBox) inline QUELL_STAGE_DESCRIPTION(vtkQuellTestAccumulate) inline QUELL_STAGE_DESCRIPTION(
  vtkQuellTestMix) inline QUELL_STAGE_DESCRIPTION(vtkQuellTestSum) inline QUELL_STAGE_DESCRIPTION(vtkQuellTestGuided) inline QUELL_STAGE_DESCRIPTION(vtkQuellTestReader) inline QUELL_STAGE_DESCRIPTION(vtkQuellImageWriter) inline QUELL_STAGE_DESCRIPTION(vtkQuellDisplayTransform)

  inline void vtkQuellTestSource::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellTestSource;
  using quell::ArrayKind;
  d.Category = "Test";
  d.Brief = "A number for every pixel.";
  d.Output("radiance", ArrayKind::Color, "light");
  d.Output("albedo", ArrayKind::Albedo, "reflectance");
  d.Output("normal", ArrayKind::Normal, "normal");
  d.Output("depth", ArrayKind::Depth, "depth");
  QUELL_INT(d, Width, "pixels", "Width of the frame.");
  QUELL_INT(d, Height, "pixels", "Height of the frame.");
  QUELL_INT(d, Seed, "", "Seed.");
  QUELL_PATH(d, Scene, "Scene file.");
}
inline void vtkQuellTestBox::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellTestBox;
  using quell::ArrayKind;
  d.Category = "Test";
  d.Brief = "Mean over a box.";
  d.Input("radiance", ArrayKind::Color, "radiance", "image");
  d.OptionalInput("normal", ArrayKind::Normal, "normal", "copied to mask");
  d.Output("radiance", ArrayKind::Color, "mean");
  d.Output("mask", ArrayKind::Scalar, "normal.z");
  QUELL_INT(d, Radius, "pixels", "Radius of the box.");
  QUELL_DOUBLE(d, Gain, "", "Factor.");
  QUELL_ENUM(d, Mode, "Does nothing.", "Scale", "Drop");
  QUELL_BOOL(d, Quiet, "Does nothing.");
}
inline void vtkQuellTestAccumulate::Describe(quell::StageDescription& d)
{
  using quell::ArrayKind;
  d.Category = "Test";
  d.Brief = "Adds its past.";
  d.Input("radiance", ArrayKind::Color, "radiance", "image");
  d.Input("history", ArrayKind::Color, "radiance", "the past");
  d.Output("radiance", ArrayKind::Color, "sum");
  d.Output("history", ArrayKind::History, "whether there was a past");
}
inline void vtkQuellTestMix::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellTestMix;
  using quell::ArrayKind;
  d.Category = "Test";
  d.Brief = "Mixes with its past.";
  d.Input("radiance", ArrayKind::Color, "radiance", "image");
  d.DelayedInput("history", ArrayKind::Color, "radiance", "the past");
  d.Output("radiance", ArrayKind::Color, "mix");
  QUELL_DOUBLE(d, Alpha, "", "Weight of the image.");
}
inline void vtkQuellTestSum::Describe(quell::StageDescription& d)
{
  using quell::ArrayKind;
  d.Category = "Test";
  d.Brief = "Adds images.";
  d.RepeatableInput("radiance", ArrayKind::Color, "radiance", "terms");
  d.Output("radiance", ArrayKind::Color, "sum");
}
inline void vtkQuellTestGuided::Describe(quell::StageDescription& d)
{
  d.Input("radiance", quell::ArrayKind::Color, "radiance", "");
  d.RepeatableInput("guide", quell::ArrayKind::Any, "albedo", "").Attribute("name", "");
  d.Inputs[1].Optional = true;
  d.Output("radiance", quell::ArrayKind::Color, "");
}
inline void vtkQuellTestReader::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellTestReader;
  d.Category = "Test";
  d.Brief = "Arrays of a file.";
  QUELL_STRING(d, File, "Name.");
}
inline void vtkQuellImageWriter::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellImageWriter;
  d.Category = "Test";
  d.Brief = "Writes.";
  d.Sink = true;
  d.RepeatableInput("layer", quell::ArrayKind::Any, "radiance", "layers").Attribute("name", "of the layer");
  QUELL_STRING(d, File, "Name.");
}
inline void vtkQuellDisplayTransform::Describe(quell::StageDescription& d)
{
  using Self = vtkQuellDisplayTransform;
  d.Category = "Test";
  d.Brief = "Shows.";
  d.Input("radiance", quell::ArrayKind::Color, "radiance", "image");
  d.Output("display", quell::ArrayKind::Display, "quarter");
  QUELL_STRING(d, View, "View.");
  QUELL_STRING(d, Display, "Display.");
}

inline const quell::StageRegistry& Registry()
{
  static const quell::StageRegistry registry = []
  {
    quell::StageRegistry r;
    r.Add<vtkQuellTestSource>();
    r.Add<vtkQuellTestBox>();
    r.Add<vtkQuellTestAccumulate>();
    r.Add<vtkQuellTestMix>();
    r.Add<vtkQuellTestSum>();
    r.Add<vtkQuellTestGuided>();
    r.Add<vtkQuellTestReader>();
    r.Add<vtkQuellImageWriter>();
    r.Add<vtkQuellDisplayTransform>();
    return r;
  }();
  return registry;
}

/// The graph of a pipeline with this inside; a mistake in it fails the test.
inline std::shared_ptr<quell::Graph> Load(const std::string& body, const quell::GraphOptions& options = {})
{
  quell::Diagnostics messages;
  const auto document = quell::ReadPipelineText("<pipeline version=\"1\">" + body + "</pipeline>", "t.xml", messages);
  auto graph = quell::BuildGraph(document, Registry(), options, messages);
  EXPECT_FALSE(messages.HasErrors()) << messages.ToText();
  return graph;
}

inline quell::StageCounters CountersOf(const quell::PipelineExecutor& executor, const std::string& node)
{
  for (const quell::NodeCounters& c : executor.Counters())
    if (c.Path == node)
      return c.Counters;
  ADD_FAILURE() << "no live node " << node;
  return {};
}
}

#endif
