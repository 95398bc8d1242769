// SPDX-License-Identifier: BSD-3-Clause
// quell-fuzz-state [options, see quellFuzzWatch.h] [FILE|DIRECTORY...]
//
// Reads mutated files of the program's own making, and colour configurations. Seeds are made at the start; files named
// are further ones. Promises:
// - a checkpoint (*.checkpoint) is refused with a sentence, or reads, writes the same bytes again, and the run that
//   goes on from it makes finite pixels or an error;
// - a colour configuration (*.ocio) or a table that one refers to (*.cube, *.clf ...) gives values in [0, 1] or an
//   error with the configuration's name;
// - a cost model (*.json) leaves finite, positive costs.
#include "../AllStages.h"
#include "quellCheckpoint.h"
#include "quellCostModel.h"
#include "quellFuzzFiles.h"
#include "quellFuzzTools.h"
#include "quellGraph.h"
#include "quellPipelineExecutor.h"
#include "quellPipelineReader.h"
#include "quellProvenance.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkObject.h"
#include "vtkPointData.h"
#include "vtkQuellDisplayTransform.h"

#include <OpenColorIO/OpenColorIO.h>
#include <nlohmann/json.hpp>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <memory>
#include <sstream>
#include <stdexcept>

namespace fs = std::filesystem;
namespace OCIO = OCIO_NAMESPACE;
using namespace quell;

namespace
{
/// Two frames of history a node, and samples that go on.
const char* const PipelineText = R"xml(<pipeline version="1">
  <time first="0" count="6"/>
  <node id="pt" type="PathTraceSource">
    <property name="Scene" value="$(scene)"/><property name="Width" value="9"/><property name="Height" value="7"/>
    <property name="SamplesPerPixel" value="6"/>
  </node>
  <node id="taa" type="TemporalAntialias">
    <input port="radiance" from="pt:radiance"/>
    <input port="motion" from="pt:motion"/>
    <input port="depth" from="pt:depth"/>
    <input port="history" from="taa:radiance" delay="1"/>
  </node>
  <node id="old" type="Reproject">
    <input port="depth" from="pt:depth"/><input port="normal" from="pt:normal"/><input port="id" from="pt:id"/>
    <input port="motion" from="pt:motion"/>
    <input port="history" from="acc:radiance" delay="1"/><input port="moments" from="acc:moments" delay="1"/>
    <input port="length" from="acc:history" delay="1"/><input port="previousDepth" from="pt:depth" delay="1"/>
    <input port="previousNormal" from="pt:normal" delay="1"/><input port="previousId" from="pt:id" delay="1"/>
  </node>
  <node id="acc" type="TemporalAccumulate">
    <input port="radiance" from="pt:radiance"/><input port="history" from="old:radiance"/>
    <input port="moments" from="old:moments"/><input port="length" from="old:history"/>
  </node>
  <output name="a" from="taa:radiance" file="a.####.exr"/>
  <output name="b" from="acc:radiance" file="b.####.exr"/>
</pipeline>)xml";

std::shared_ptr<Graph> Pipeline()
{
  std::string text = PipelineText;
  const std::string variable = "$(scene)";
  text.replace(text.find(variable), variable.size(), QUELL_SOURCE_DIR "/Data/Scenes/cornell-box.gltf");
  Diagnostics messages;
  const auto graph = BuildGraph(ReadPipelineText(text, "state.xml", messages), Registry(), {}, messages);
  if (messages.HasErrors())
    throw std::runtime_error(messages.ToText());
  return graph;
}

/// After two frames, and with some samples of the third.
void WriteCheckpoints(const fs::path& directory)
{
  PipelineExecutor executor(Pipeline(), Registry());
  executor.SetWriteOutputs(false);
  executor.Request("taa", { "radiance" });
  executor.Request("acc", { "radiance" });
  for (int tick = 0; tick < 2; ++tick)
    if (const TickResult result = executor.RunTick(tick); !result.Ok)
      throw std::runtime_error(result.Error);
  Checkpoint checkpoint;
  checkpoint.Identity = IdentityOf(executor, {}, 0, "1");
  checkpoint.Tick = 1;
  checkpoint.Frame = *executor.GetHistory().FindFrame(1);
  WriteCheckpoint((directory / "frames.checkpoint").string(), checkpoint);
  const auto token = std::make_shared<CancelToken>();
  executor.SetCancelToken(token);
  executor.SetProgress([&](const std::string&, double) { token->Finish(); });
  if (const TickResult result = executor.RunTick(2); !result.Ok || result.Partial.empty())
    throw std::runtime_error("the frame was not finished early: " + result.Error);
  checkpoint.WorkTick = 2;
  checkpoint.Unfinished = { 2, 5 };
  checkpoint.Work = executor.SaveWork();
  if (checkpoint.Work.empty())
    throw std::runtime_error("no samples to keep");
  WriteCheckpoint((directory / "samples.checkpoint").string(), checkpoint);
  checkpoint.Frame.clear();
  WriteCheckpoint((directory / "work.checkpoint").string(), checkpoint);
}

/// Tables in every format that the library writes, and configurations with each kind of transform.
void WriteColours(const fs::path& directory)
{
  const fs::path shipped = QUELL_SOURCE_DIR "/Data/Color/config.ocio";
  const OCIO::ConstConfigRcPtr config = OCIO::Config::CreateFromFile(shipped.c_str());
  for (int i = 0; i < OCIO::Baker::getNumFormats(); ++i)
  {
    const OCIO::BakerRcPtr baker = OCIO::Baker::Create();
    baker->setConfig(config);
    baker->setFormat(OCIO::Baker::getFormatNameByIndex(i));
    baker->setInputSpace("sRGB");
    baker->setTargetSpace("sRGB ACES-like");
    baker->setCubeSize(3);
    baker->setShaperSize(4);
    std::ostringstream out;
    try
    {
      baker->bake(out);
    }
    catch (const OCIO::Exception&)
    {
      continue; // a format that wants a shaper space
    }
    Save(directory / ("table" + std::to_string(i) + "." + OCIO::Baker::getFormatExtensionByIndex(i)), out.str());
  }
  const OCIO::GroupTransformRcPtr group = OCIO::GroupTransform::Create();
  const OCIO::MatrixTransformRcPtr matrix = OCIO::MatrixTransform::Create();
  const double m44[16] = { 1, 0.1, 0, 0, 0, 0.9, 0, 0, 0, 0, 1.1, 0, 0, 0, 0, 1 };
  matrix->setMatrix(m44);
  group->appendTransform(matrix);
  const OCIO::Lut1DTransformRcPtr lut1 = OCIO::Lut1DTransform::Create(5, false);
  group->appendTransform(lut1);
  const OCIO::Lut3DTransformRcPtr lut3 = OCIO::Lut3DTransform::Create(2);
  group->appendTransform(lut3);
  const OCIO::RangeTransformRcPtr range = OCIO::RangeTransform::Create();
  range->setMinInValue(0);
  range->setMinOutValue(0);
  group->appendTransform(range);
  const OCIO::CDLTransformRcPtr cdl = OCIO::CDLTransform::Create();
  const double slope[3] = { 1.1, 0.9, 1 };
  cdl->setSlope(slope);
  group->appendTransform(cdl);
  const OCIO::ExponentWithLinearTransformRcPtr exponent = OCIO::ExponentWithLinearTransform::Create();
  const double gamma[4] = { 2.4, 2.4, 2.4, 1 }, offset[4] = { 0.055, 0.055, 0.055, 0 };
  exponent->setGamma(gamma);
  exponent->setOffset(offset);
  group->appendTransform(exponent);
  const OCIO::LogAffineTransformRcPtr log = OCIO::LogAffineTransform::Create();
  log->setBase(2);
  group->appendTransform(log);
  const auto write = [&](const OCIO::GroupTransform& transform, const char* format, const char* name)
  {
    std::ostringstream out;
    transform.write(config, format, out);
    Save(directory / name, out.str());
  };
  write(*group, "Academy/ASC Common LUT Format", "all.clf");
  write(*group, "Color Transform Format", "all.ctf");
  const OCIO::GroupTransformRcPtr grade = OCIO::GroupTransform::Create();
  grade->appendTransform(cdl->createEditableCopy());
  write(*grade, "ColorCorrection", "grade.cc");
  write(*grade, "ColorCorrectionCollection", "grade.ccc");
  write(*grade, "ColorDecisionList", "grade.cdl");
  Save(
    directory / "table.spi1d", "Version 1\nFrom 0 1\nLength 4\nComponents 3\n{\n0 0 0\n.3 .2 .3\n.6 .6 .7\n1 1 1\n}\n");
  Save(directory / "table.spi3d", "SPILUT 1.0\n3 3\n2 2 2\n0 0 0 0 0 0\n0 0 1 0 0 1\n0 1 0 0 1 0\n0 1 1 0 1 1\n"
                                  "1 0 0 1 0 0\n1 0 1 1 0 1\n1 1 0 1 1 0\n1 1 1 1 1 1\n");
  Save(directory / "matrix.spimtx", "1 0 0 0\n0 .9 0 100\n0 .1 1 0\n");
  Save(directory / "volume.vf",
    "#Inventor V2.1 ascii\ngrid_size 2 2 2\nglobal_transform 1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n"
    "data\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 0 1\n1 0 1\n0 1 1\n1 1 1\n");
  Save(directory / "table.lut", "LUT: 3 4\n0\n80\n160\n255\n0\n80\n160\n255\n0\n90\n150\n255\n");

  Save(directory / "shipped.ocio", Contents(shipped));
  Save(directory / "aces-like.spi1d", Contents(shipped.parent_path() / "aces-like.spi1d"));
  Save(directory / "kinds.ocio", R"(ocio_profile_version: 2
environment: {SHOT: a, LOOK: "$SHOT"}
search_path: [., luts, $SHOT]
strictparsing: false
family_separator: /
luma: [0.2126, 0.7152, 0.0722]
roles: {default: lin, scene_linear: lin, data: raw, cie_xyz_d65_interchange: xyz}
file_rules:
  - !<Rule> {name: exr, colorspace: lin, pattern: "*", extension: exr}
  - !<Rule> {name: Default, colorspace: raw}
viewing_rules:
  - !<Rule> {name: any, colorspaces: [lin, raw]}
shared_views:
  - !<View> {name: shared, view_transform: tone, display_colorspace: <USE_DISPLAY_NAME>, rule: any}
displays:
  screen:
    - !<View> {name: toned, view_transform: tone, display_colorspace: screen, looks: "+warm, -cold"}
    - !<View> {name: graded, colorspace: graded}
    - !<Views> [shared]
active_displays: [screen]
active_views: [toned, graded, shared]
inactive_colorspaces: [hidden]
named_transforms:
  - !<NamedTransform>
    name: nt
    aliases: [nt2]
    transform: !<LogTransform> {base: 10, direction: inverse}
view_transforms:
  - !<ViewTransform>
    name: tone
    from_scene_reference: !<GroupTransform>
      children:
        - !<GradingPrimaryTransform> {style: log, brightness: {rgb: [0.1, 0, 0], master: 0.1}, contrast: {rgb: [1, 1, 1], master: 1.1}}
        - !<GradingRGBCurveTransform> {style: log, red: {control_points: [0, 0, 0.5, 0.6, 1, 1]}}
        - !<GradingToneTransform> {style: linear, blacks: {rgb: [1.1, 1, 1], master: 1, start: 0, width: 4}}
        - !<FixedFunctionTransform> {style: ACES_Glow10}
        - !<FixedFunctionTransform> {style: REC2100_Surround, params: [0.8]}
        - !<ExposureContrastTransform> {style: video, exposure: 1, contrast: 0.9, gamma: 1.1, pivot: 0.18, dynamic: true}
        - !<BuiltinTransform> {style: UTILITY - ACES-AP0_to_CIE-XYZ-D65_BFD}
display_colorspaces:
  - !<ColorSpace>
    name: screen
    aliases: [screen2]
    from_display_reference: !<GroupTransform>
      children:
        - !<MatrixTransform> {matrix: [3.24, -1.54, -0.5, 0, -0.97, 1.88, 0.04, 0, 0.06, -0.2, 1.06, 0, 0, 0, 0, 1]}
        - !<ExponentWithLinearTransform> {gamma: 2.4, offset: 0.055, style: mirror, direction: inverse}
looks:
  - !<Look> {name: warm, process_space: lin, transform: !<CDLTransform> {slope: [1.1, 1, 0.9], offset: [0, 0, 0.01], power: [1, 1.1, 1], sat: 0.9}}
  - !<Look> {name: cold, process_space: raw, transform: !<ExponentTransform> {value: [1.1, 1, 0.9, 1]}, inverse_transform: !<ExponentTransform> {value: 2.2}}
colorspaces:
  - !<ColorSpace> {name: lin, family: a/b, categories: [x, y], encoding: scene-linear}
  - !<ColorSpace> {name: raw, isdata: true}
  - !<ColorSpace> {name: hidden, to_scene_reference: !<AllocationTransform> {allocation: lg2, vars: [-8, 7, 0.004]}}
  - !<ColorSpace>
    name: xyz
    to_scene_reference: !<LogCameraTransform> {base: 10, log_side_slope: 0.2, log_side_offset: 0.6, lin_side_slope: 5, lin_side_offset: 0.05, lin_side_break: 0.01, linear_slope: 5}
  - !<ColorSpace>
    name: graded
    from_scene_reference: !<GroupTransform>
      children:
        - !<ColorSpaceTransform> {src: lin, dst: xyz}
        - !<LookTransform> {src: lin, dst: raw, looks: warm}
        - !<LogAffineTransform> {base: 2, log_side_slope: [1, 1, 1], lin_side_offset: 0.1}
        - !<RangeTransform> {min_in_value: 0, max_in_value: 1, min_out_value: 0, max_out_value: 1}
        - !<FileTransform> {src: aces-like.spi1d, interpolation: best}
        - !<FileTransform> {src: grade.ccc, cccid: 0, interpolation: tetrahedral}
        - !<DisplayViewTransform> {src: lin, display: screen, view: toned, direction: inverse}
)");
}

void WriteSeeds(const fs::path& directory)
{
  vtkObject::GlobalWarningDisplayOff();
  OCIO::SetLoggingLevel(OCIO::LOGGING_LEVEL_NONE);
  WriteCheckpoints(directory);
  WriteColours(directory);
  Save(directory / "costs.json",
    nlohmann::json{ { "machine", MachineText() },
      { "nanoseconds", { { "ATrousFilter", 12.5 }, { "PathTraceSource cornell-box.gltf", 900 }, { "Sum", 1 } } } }
      .dump(1));
}

class StateFiles : public FuzzTarget
{
public:
  StateFiles(const fs::path& place, std::vector<FuzzCase> seeds, std::uint64_t seed)
    : Place(place)
    , Mutator(std::move(seeds), seed)
  {
  }

  std::uint64_t Fixed() const override { return this->Mutator.All().size(); }

  FuzzCase Make(std::uint64_t n) override
  {
    if (n < this->Mutator.All().size())
      return this->Mutator.All()[n];
    FuzzCase document = this->Mutator.Make(n);
    // What has a wrong size or hash gets no further: mostly they are put right.
    if (fs::path(document.Name).extension() == ".checkpoint" && document.Text.size() > 28 && n % 8 != 0)
    {
      std::string& text = document.Text;
      const std::uint64_t size = text.size();
      std::memcpy(&text[12], &size, sizeof size);
      ContentHash hash;
      hash.Add(text.data(), text.size() - 8);
      const std::uint64_t value = hash.Value();
      std::memcpy(&text[text.size() - 8], &value, sizeof value);
    }
    return document;
  }

  void Begin() override
  {
    vtkObject::GlobalWarningDisplayOff();
    OCIO::SetLoggingLevel(OCIO::LOGGING_LEVEL_NONE);
    this->Pixels->SetExtent(0, 10, 0, 7, 0, 0);
    vtkNew<vtkFloatArray> radiance;
    radiance->SetName("radiance");
    radiance->SetNumberOfComponents(3);
    radiance->SetNumberOfTuples(this->Pixels->GetNumberOfPoints());
    const float values[] = { 0, 1, -1, 0.18f, 0.5f, 65504, 1e-30f, 3e38f, -3e38f, 2, 0.001f, 7, 100 };
    for (vtkIdType i = 0; i < radiance->GetNumberOfValues(); ++i)
      radiance->SetValue(i, values[std::size_t(i * 7 + i / 13) % std::size(values)]);
    this->Pixels->GetPointData()->SetScalars(radiance);
  }

  bool Check(const FuzzCase& document, std::uint64_t n) override
  {
    const std::string kind = fs::path(document.Name).extension().string();
    const fs::path file = this->Place / ("case" + kind);
    Save(file, document.Text);
    if (kind == ".checkpoint")
      return this->CheckCheckpoint(file.string());
    if (kind == ".json")
      return this->CheckCosts(file.string());
    if (kind == ".ocio")
      return this->CheckColours(file.string(), n);
    const fs::path config = this->Place / "refers.ocio";
    Save(config, "ocio_profile_version: 2\nroles: {scene_linear: lin, default: lin}\ndisplays:\n  d:\n"
                 "    - !<View> {name: v, colorspace: t}\ncolorspaces:\n  - !<ColorSpace> {name: lin}\n"
                 "  - !<ColorSpace> {name: t, from_scene_reference: !<FileTransform> {src: case" +
                   kind + (n % 4 == 0 ? ", interpolation: tetrahedral, direction: inverse}}\n" : "}}\n"));
    return this->CheckColours(config.string(), n);
  }

private:
  bool CheckCheckpoint(const std::string& file)
  {
    Checkpoint checkpoint;
    try
    {
      checkpoint = ReadCheckpoint(file);
    }
    catch (const StageError& e)
    {
      CheckMessage(e.what(), file);
      return false;
    }
    const std::string first = (this->Place / "first").string(), second = (this->Place / "second").string();
    WriteCheckpoint(first, checkpoint);
    WriteCheckpoint(second, ReadCheckpoint(first));
    Promise(Contents(first) == Contents(second), "what was written reads differently");
    if (!this->Graph)
      this->Graph = Pipeline();
    PipelineExecutor executor(this->Graph, Registry());
    executor.SetWriteOutputs(false);
    executor.Request("taa", { "radiance" });
    executor.Request("acc", { "radiance" });
    CheckMessage(DifferenceOf(checkpoint.Identity, IdentityOf(executor, {}, 0, "1")), "");
    std::string error;
    bool good = checkpoint.Tick >= 0 && checkpoint.Tick < 5;
    if (good && !checkpoint.Frame.empty() && !Restore(executor, checkpoint, error))
    {
      CheckMessage(error, "\"");
      good = false;
    }
    if (good && !checkpoint.Work.empty() && !executor.LoadWork(checkpoint.Work, error))
    {
      CheckMessage(error, " ");
      good = false;
    }
    // Also after a refusal: nothing of it may be left.
    const TickResult result = executor.RunTick(good ? checkpoint.Tick + 1 : 2);
    for (const std::string& warning : result.Warnings)
      CheckMessage(warning, "");
    if (!result.Ok)
    {
      CheckMessage(result.Error, "node");
      return false;
    }
    for (const char* node : { "taa", "acc" })
    {
      auto radiance = vtkFloatArray::SafeDownCast(executor.GetImage(node)->GetPointData()->GetArray("radiance"));
      Promise(radiance && radiance->GetNumberOfValues() == 9 * 7 * 3, "no picture");
      for (vtkIdType i = 0; i < radiance->GetNumberOfValues(); ++i)
        Promise(std::isfinite(radiance->GetValue(i)), "a pixel that is not finite");
    }
    return good;
  }

  bool CheckColours(const std::string& config, std::uint64_t n)
  {
    OCIO::ClearAllCaches();
    vtkNew<vtkQuellDisplayTransform> stage;
    stage->SetInputDataObject(this->Pixels);
    stage->SetConfig(config);
    if (n % 3 == 0)
      stage->SetView("graded");
    stage->Update();
    auto display = vtkFloatArray::SafeDownCast(stage->GetOutput()->GetPointData()->GetArray("display"));
    if (!display)
    {
      CheckMessage(stage->GetErrorText(), config);
      return false;
    }
    for (vtkIdType i = 0; i < display->GetNumberOfValues(); ++i)
      Promise(display->GetValue(i) >= 0 && display->GetValue(i) <= 1, "a value that no display has");
    return true;
  }

  bool CheckCosts(const std::string& file)
  {
    std::string problem;
    const CostModel model = CostModel::Load(file, problem);
    for (const auto& cost : model.Nanoseconds())
      Promise(std::isfinite(cost.second) && cost.second > 0, "a cost that is none: " + cost.first);
    CheckMessage(problem, problem.empty() ? "" : file);
    return problem.empty();
  }

  fs::path Place;
  FileMutator Mutator;
  vtkNew<vtkImageData> Pixels;
  std::shared_ptr<quell::Graph> Graph;
};
}

int main(int argc, char** argv)
{
  return RunFuzz(argc, argv, "quell-fuzz-state", WriteSeeds,
    [](const fs::path& directory, std::vector<FuzzCase> seeds, std::uint64_t seed)
    { return std::make_unique<StateFiles>(directory, std::move(seeds), seed); });
}
