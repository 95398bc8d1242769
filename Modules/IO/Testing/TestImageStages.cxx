// SPDX-License-Identifier: BSD-3-Clause
#include "IOTestTools.h"

#include "quellRegisterImageIO.h"
#include "vtkNew.h"
#include "vtkObject.h"
#include "vtkQuellCollector.h"
#include "vtkQuellImageReader.h"
#include "vtkQuellImageWriter.h"

using namespace quell;

namespace
{
/// Three frames `in.000N.exr` with radiance = tick + position, albedo and motion.
void MakeSequence(const TemporaryDirectory& dir, int count, int w = 12, int h = 9)
{
  for (int t = 0; t < count; ++t)
  {
    auto image = NewImage({ 0, 0, w, h });
    AddArray(image, "radiance", 3, [=](int x, int y, int c) { return 1000.f * t + 100 * y + x + 0.1f * c; });
    AddArray(image, "albedo", 3, [](int x, int, int) { return 0.05f * x; });
    AddArray(image, "motion", 2, [](int x, int y, int c) { return c ? float(y) : float(-x); });
    FrameFacts f;
    f.Tick = t;
    f.Time = t / 24.;
    f.Seed = 99;
    f.Write(image->GetFieldData());
    WriteImageFile(SequencePath(dir / "in.####.exr", t), image);
  }
}
}

TEST(ImageStages, ReadsOnlyWhatIsAskedFrameByFrame)
{
  TemporaryDirectory dir;
  MakeSequence(dir, 3);
  vtkNew<vtkQuellImageReader> reader;
  reader->SetFile(dir / "in.####.exr");
  Timeline line;
  line.Count = 3;
  reader->SetTimeline(line);
  const auto dynamic = reader->ListDynamicOutputs();
  std::set<std::string> names;
  for (const OutputArray& a : dynamic)
    names.insert(a.Name);
  EXPECT_EQ(names, (std::set<std::string>{ "radiance", "albedo", "motion" }));
  vtkNew<vtkQuellCollector> collector;
  for (int t = 0; t < 3; ++t)
  {
    collector->ClearRequests();
    collector->AddRequest(reader, { "albedo", "radiance" }, { 2, 1, 5, 4 });
    ASSERT_TRUE(collector->UpdateTick(t)) << reader->GetErrorText();
    vtkImageData* image = reader->GetOutput();
    EXPECT_EQ(image->GetPointData()->GetNumberOfArrays(), 2) << "motion was not asked for";
    EXPECT_EQ(Value(image, "radiance", 4, 3, 1), 1000.f * t + 304.1f);
    const FrameFacts f = FrameFacts::Read(image->GetFieldData());
    EXPECT_EQ(f.Tick, t);
    EXPECT_EQ(f.Seed, 99);
    EXPECT_EQ(f.Time, t / 24.);
  }
}

TEST(ImageStages, AnyFrameOfASequenceTellsItsArrays)
{
  TemporaryDirectory dir;
  MakeSequence(dir, 12);
  for (int t : { 0, 1, 2, 10 })
    std::filesystem::remove(SequencePath(dir / "in.####.exr", t));
  EXPECT_EQ(SequenceSample(dir / "in.####.exr", 0), dir / "in.0003.exr");
  EXPECT_EQ(SequenceSample(dir / "in.####.exr", 5), dir / "in.0005.exr");
  EXPECT_EQ(SequenceSample(dir / "in.##.exr", 0), dir / "in.00.exr") << "no such files";
  EXPECT_EQ(SequenceSample(dir / "in.exr", 0), dir / "in.exr");
  vtkNew<vtkQuellImageReader> reader;
  reader->SetFile(dir / "in.####.exr");
  EXPECT_EQ(reader->ListDynamicOutputs().size(), 3u) << "before a timeline is known";
}

TEST(ImageStages, PlainArrayRenamesOurOwnFilesToo)
{
  TemporaryDirectory dir;
  auto image = NewImage({ 0, 0, 4, 4 });
  AddArray(image, "radiance", 3, [](int, int, int) { return 0.5f; });
  WriteImageFile(dir / "plain.exr", image);
  vtkNew<vtkQuellImageReader> reader;
  reader->SetFile(dir / "plain.exr");
  reader->SetPlainArray("albedo");
  const auto list = reader->ListDynamicOutputs();
  ASSERT_EQ(list.size(), 1u);
  EXPECT_EQ(list[0].Name, "albedo");
  EXPECT_EQ(list[0].Kind, ArrayKind::Albedo);
}

TEST(ImageStages, ErrorsNameTheFileAndLeaveNothing)
{
  vtkObject::GlobalWarningDisplayOff();
  TemporaryDirectory dir;
  MakeSequence(dir, 2);
  vtkNew<vtkQuellImageReader> reader;
  reader->SetFile(dir / "in.####.exr");
  vtkNew<vtkQuellCollector> collector;
  collector->AddRequest(reader, { "albdeo" });
  EXPECT_FALSE(collector->UpdateTick(0));
  EXPECT_NE(reader->GetErrorText().find("did you mean \"albedo\""), std::string::npos) << reader->GetErrorText();
  collector->ClearRequests();
  collector->AddRequest(reader, { "albedo" });
  EXPECT_TRUE(collector->UpdateTick(1)) << reader->GetErrorText();
  EXPECT_FALSE(collector->UpdateTick(2)) << "there is no third file";
  EXPECT_NE(reader->GetErrorText().find("in.0002.exr"), std::string::npos) << reader->GetErrorText();
  EXPECT_EQ(reader->GetOutput()->GetPointData()->GetNumberOfArrays(), 0);
  // Another size in the middle of a sequence.
  auto small = NewImage({ 0, 0, 3, 3 });
  AddArray(small, "albedo", 3, &WildValue);
  WriteImageFile(dir / "in.0002.exr", small);
  reader->Modified();
  EXPECT_FALSE(collector->UpdateTick(2));
  EXPECT_NE(reader->GetErrorText().find("3 x 3"), std::string::npos) << reader->GetErrorText();
  vtkNew<vtkQuellImageReader> nothing;
  EXPECT_THROW(nothing->ListDynamicOutputs(), StageError);
  reader->SetFile(dir / "gone.exr");
  EXPECT_NE(ErrorOf([&] { reader->ListDynamicOutputs(); }).find("gone.exr"), std::string::npos);
  vtkObject::GlobalWarningDisplayOn();
}

TEST(ImageStages, WriterKeepsRegionLayersFactsAndMetadata)
{
  TemporaryDirectory dir;
  MakeSequence(dir, 2);
  vtkNew<vtkQuellImageReader> reader;
  reader->SetFile(dir / "in.####.exr");
  vtkNew<vtkQuellImageWriter> writer;
  writer->ConnectInput("layer", reader, "radiance");
  writer->ConnectInput("layer", reader, "albedo");
  writer->ConnectInput("layer", reader, "motion");
  writer->SetFile(dir / "new/out.####.exr");
  std::string error;
  EXPECT_TRUE(writer->SetInputAttribute(0, 1, "name", "paint", error)) << error;
  EXPECT_FALSE(writer->SetInputAttribute(0, 1, "name", "a b", error));
  EXPECT_FALSE(writer->SetInputAttribute(0, 1, "sigma", "1", error));
  EXPECT_NE(error.find("sigma"), std::string::npos);
  writer->SetMetadata({ { "pipelineHash", "abc" } });
  vtkNew<vtkQuellCollector> collector;
  collector->AddRequest(writer, {}, { 2, 1, 6, 5 });
  for (int t = 0; t < 2; ++t)
  {
    ASSERT_TRUE(collector->UpdateTick(t)) << writer->GetErrorText();
    const std::string path = SequencePath(dir / "new/out.####.exr", t);
    EXPECT_EQ(writer->GetFilesWritten(), std::vector<std::string>{ path });
    ReadReport r;
    auto image = ReadImageFile(path, &r);
    EXPECT_EQ(r.DataWindow, (Rect{ 2, 1, 6, 5 }));
    EXPECT_EQ(r.Width, 12);
    EXPECT_EQ(r.Height, 9);
    EXPECT_EQ(r.Metadata["pipelineHash"], "abc");
    EXPECT_EQ(r.Facts.Tick, t);
    EXPECT_EQ(r.Facts.Seed, 99);
    EXPECT_EQ(Value(image, "radiance", 5, 4, 0), 1000.f * t + 405);
    EXPECT_EQ(Value(image, "paint", 3, 1, 0), 0.05f * 3);
    EXPECT_EQ(Value(image, "motion", 3, 2, 1), 2.f);
    EXPECT_EQ(Value(image, "motion", 3, 2, 0), -3.f);
  }
}

TEST(ImageStages, WriterPassesArraysOn)
{
  TemporaryDirectory dir;
  MakeSequence(dir, 1);
  vtkNew<vtkQuellImageReader> reader;
  reader->SetFile(dir / "in.0000.exr");
  vtkNew<vtkQuellImageWriter> writer;
  writer->ConnectInput("layer", reader, "radiance");
  writer->SetFile(dir / "out.exr");
  vtkNew<vtkQuellCollector> collector;
  collector->AddRequest(writer, { "albedo" });
  ASSERT_TRUE(collector->UpdateTick(0)) << writer->GetErrorText();
  EXPECT_EQ(Value(writer->GetOutput(), "albedo", 3, 0, 0), 0.05f * 3);
  EXPECT_EQ(ReadImageHeader(dir / "out.exr").Arrays.size(), 1u) << "only what is connected is written";
}

TEST(ImageStages, WriterFailureLeavesNoFile)
{
  vtkObject::GlobalWarningDisplayOff();
  TemporaryDirectory dir;
  MakeSequence(dir, 1);
  vtkNew<vtkQuellImageReader> reader;
  reader->SetFile(dir / "in.0000.exr");
  vtkNew<vtkQuellImageWriter> writer;
  writer->ConnectInput("layer", reader, "radiance");
  writer->SetFile(dir / "in.0000.exr/out.exr");
  vtkNew<vtkQuellCollector> collector;
  collector->AddRequest(writer, {});
  EXPECT_FALSE(collector->UpdateTick(0));
  EXPECT_EQ(collector->FailedStage(), writer);
  EXPECT_NE(writer->GetErrorText().find("out.exr"), std::string::npos) << writer->GetErrorText();
  EXPECT_TRUE(writer->GetFilesWritten().empty());
  writer->SetFile("");
  EXPECT_FALSE(collector->UpdateTick(0));
  EXPECT_EQ(dir.List(), std::vector<std::string>{ "in.0000.exr" });
  vtkObject::GlobalWarningDisplayOn();
}

TEST(ImageStages, Registered)
{
  StageRegistry registry;
  RegisterImageIOStages(registry);
  EXPECT_EQ(registry.Types(), (std::vector<std::string>{ "ImageReader", "ImageWriter" }));
  EXPECT_TRUE(registry.Describe("ImageWriter")->Sink);
  auto writer = registry.Create("ImageWriter");
  std::string error;
  EXPECT_TRUE(writer->SetPropertyText("Compression", "Piz", error)) << error;
  EXPECT_FALSE(writer->SetPropertyText("Compression", "Pizza", error));
  EXPECT_EQ(writer->GetPropertyText("Half"), "false");
}
