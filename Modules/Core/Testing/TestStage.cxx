// SPDX-License-Identifier: BSD-3-Clause
#include "Threads.h"
#include "TestStages.h"
#include "quellFrameHistory.h"
#include "vtkDataArray.h"
#include "vtkImageData.h"
#include "vtkImageShiftScale.h"
#include "vtkNew.h"
#include "vtkPointData.h"
#include "vtkQuellCollector.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <gtest/gtest.h>
#include <thread>

using namespace quelltest;

namespace
{
float At(vtkAlgorithm* a, const char* name, int x, int y, int c = 0)
{
  auto image = vtkImageData::SafeDownCast(a->GetOutputDataObject(0));
  vtkDataArray* array = image->GetPointData()->GetArray(name);
  if (!array)
    return NAN;
  int p[3] = { x, y, 0 };
  return float(array->GetComponent(image->ComputePointId(p), c));
}
struct Quiet
{
  Quiet() { vtkObject::SetGlobalWarningDisplay(0); }
  ~Quiet() { vtkObject::SetGlobalWarningDisplay(1); }
};
}

TEST(Stage, TracesOnlyTheGrownRegionAndOnlyWhatIsRead)
{
  vtkNew<vtkQuellTestSource> source;
  vtkNew<vtkQuellTestBox> box;
  box->SetRadius(3);
  box->ConnectInput("radiance", source);
  box->ConnectInput("depth", source);
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(box, { "radiance" }, { 10, 8, 12, 9 });
  ASSERT_TRUE(sink->UpdateTick(0));
  EXPECT_EQ(source->LastRegion, (quell::Rect{ 7, 5, 15, 12 }));
  EXPECT_EQ(source->GetCounters().Pixels, 8 * 7);
  EXPECT_EQ(source->LastWanted, (quell::ArraySet{ "radiance" }));
  EXPECT_EQ(source->GetCounters().Bytes, 8 * 7 * 3 * 4);
  EXPECT_EQ(box->GetCounters().Pixels, 2);
}

TEST(Stage, RegionEqualsCropBitForBit)
{
  vtkNew<vtkQuellTestSource> source;
  vtkNew<vtkQuellTestBox> first, second;
  first->SetRadius(2);
  second->SetRadius(3);
  first->ConnectInput("radiance", source);
  second->ConnectInput("radiance", first);
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(second, { "radiance" });
  ASSERT_TRUE(sink->UpdateTick(0));
  vtkNew<vtkImageData> whole;
  whole->DeepCopy(second->GetOutput());
  const quell::Rect regions[] = { { 0, 0, 1, 1 }, { 5, 5, 20, 9 }, { 38, 22, 40, 24 }, { 0, 10, 40, 11 } };
  for (const quell::Rect& r : regions)
  {
    sink->ClearRequests();
    sink->AddRequest(second, { "radiance" }, r);
    second->Modified();
    ASSERT_TRUE(sink->UpdateTick(0));
    for (int y = r.y0; y < r.y1; ++y)
      for (int x = r.x0; x < r.x1; ++x)
        for (int c = 0; c < 3; ++c)
        {
          int p[3] = { x, y, 0 };
          const float a = At(second, "radiance", x, y, c);
          const float b = float(whole->GetPointData()->GetArray("radiance")->GetComponent(whole->ComputePointId(p), c));
          ASSERT_EQ(std::memcmp(&a, &b, 4), 0) << x << " " << y;
        }
  }
}

TEST(Stage, TwoPortsOnOneProducerAreUnited)
{
  vtkNew<vtkQuellTestSource> source;
  vtkNew<vtkQuellTestBox> box;
  box->SetRadius(4);
  box->ConnectInput("radiance", source);
  box->ConnectInput("depth", source);
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(box, { "radiance", "mask" }, { 10, 10, 11, 11 });
  ASSERT_TRUE(sink->UpdateTick(2));
  EXPECT_EQ(source->LastRegion, (quell::Rect{ 6, 6, 15, 15 }));
  EXPECT_EQ(source->LastWanted, (quell::ArraySet{ "depth", "radiance" }));
  EXPECT_EQ(source->GetCounters().Executions, 1);
  EXPECT_EQ(At(box, "mask", 10, 10), vtkQuellTestSource::Value(2, 'd', 10, 10, 0));
}

TEST(Collector, SixOutputsRunTheSourceOncePerFrame)
{
  vtkNew<vtkQuellTestSource> source;
  vtkNew<vtkQuellTestBox> boxes[3];
  vtkNew<vtkQuellCollector> sink;
  const char* arrays[] = { "direct", "indirect", "emission" };
  for (int i = 0; i < 3; ++i)
  {
    boxes[i]->ConnectInput("radiance", source, arrays[i]);
    sink->AddRequest(boxes[i], { "radiance" });
    sink->AddRequest(source, { arrays[i] });
  }
  for (int t = 0; t < 3; ++t)
    ASSERT_TRUE(sink->UpdateTick(t));
  EXPECT_EQ(source->GetCounters().Executions, 3);
  EXPECT_EQ(source->LastWanted, (quell::ArraySet{ "direct", "indirect", "emission" }));
  ASSERT_TRUE(sink->UpdateTick(2));
  EXPECT_EQ(source->GetCounters().Executions, 3) << "a second identical request executes nothing";
  EXPECT_EQ(boxes[0]->GetCounters().Executions, 3);
}

TEST(Collector, WholeFrameAndRegionOfOneProducerInEitherOrder)
{
  for (bool wholeFirst : { true, false })
  {
    vtkNew<vtkQuellTestSource> source;
    vtkNew<vtkQuellTestBox> box;
    box->ConnectInput("radiance", source);
    vtkNew<vtkQuellCollector> sink;
    if (wholeFirst)
      sink->AddRequest(source, { "depth" });
    sink->AddRequest(box, { "radiance" }, { 10, 8, 12, 9 });
    if (!wholeFirst)
      sink->AddRequest(source, { "depth" });
    ASSERT_TRUE(sink->UpdateTick(0));
    EXPECT_EQ(source->LastRegion, (quell::Rect{ 0, 0, 40, 24 })) << wholeFirst;
    EXPECT_EQ(source->GetCounters().Executions, 1);
  }
}

TEST(Collector, DemandDoesNotSurviveThePass)
{
  vtkNew<vtkQuellTestSource> source;
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(source, { "radiance", "albedo", "normal" });
  ASSERT_TRUE(sink->UpdateTick(0));
  sink->ClearRequests();
  sink->AddRequest(source, { "depth" }, { 1, 1, 3, 3 });
  ASSERT_TRUE(sink->UpdateTick(1));
  EXPECT_EQ(source->LastWanted, (quell::ArraySet{ "depth" }));
  EXPECT_EQ(source->LastRegion, (quell::Rect{ 1, 1, 3, 3 }));
}

TEST(Stage, PassesThroughWhatItDoesNotMake)
{
  vtkNew<vtkQuellTestSource> source;
  vtkNew<vtkQuellTestBox> box;
  box->ConnectInput("radiance", source);
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(box, { "radiance", "albedo" }, { 4, 4, 8, 8 });
  ASSERT_TRUE(sink->UpdateTick(0));
  EXPECT_EQ(At(box, "albedo", 5, 6, 2), vtkQuellTestSource::Value(0, 'a', 5, 6, 2));
  sink->ClearRequests();
  sink->AddRequest(box, { "albedo" });
  ASSERT_TRUE(sink->UpdateTick(0));
  EXPECT_EQ(
    box->GetOutput()->GetPointData()->GetArray("albedo"), source->GetOutput()->GetPointData()->GetArray("albedo"));
  EXPECT_EQ(box->GetCounters().Executions, 1) << "pure pass-through computes nothing";
}

TEST(Stage, FailureLeavesNothingAndRecovers)
{
  Quiet quiet;
  vtkNew<vtkQuellTestSource> source;
  vtkNew<vtkQuellTestBox> box;
  box->ConnectInput("radiance", source);
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(box, { "radiance" });
  source->FailOnce = true;
  EXPECT_FALSE(sink->UpdateTick(0));
  ASSERT_EQ(sink->FailedStage(), source.GetPointer());
  EXPECT_EQ(source->GetErrorText(), "the source broke");
  EXPECT_EQ(source->GetOutput()->GetPointData()->GetNumberOfArrays(), 0);
  ASSERT_TRUE(sink->UpdateTick(0));
  EXPECT_EQ(sink->FailedStage(), nullptr);
  EXPECT_FLOAT_EQ(At(box, "radiance", 5, 5), vtkQuellTestSource::Value(0, 'r', 5, 5, 0));
}

TEST(Stage, SourceThatDoesNotKnowItsSizeFailsBeforeWork)
{
  Quiet quiet;
  vtkNew<vtkQuellTestSource> source;
  source->SetWidth(0);
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(source, { "radiance" });
  EXPECT_FALSE(sink->UpdateTick(0));
  ASSERT_TRUE(sink->FailedStage());
  EXPECT_EQ(sink->FailedStage()->GetErrorText(), "no such scene");
  EXPECT_EQ(source->GetCounters().Executions, 0);
}

TEST(Stage, SaysWhatIsMissing)
{
  Quiet quiet;
  vtkNew<vtkQuellTestBox> box;
  box->Update();
  EXPECT_EQ(box->GetErrorText(), "required input \"radiance\" is not connected");
  vtkNew<vtkQuellTestSource> small, large;
  small->SetWidth(8);
  box->ConnectInput("radiance", large);
  box->ConnectInput("depth", small);
  box->Update();
  EXPECT_EQ(box->GetErrorText(), "input \"depth\" is 8 x 24 pixels, but input \"radiance\" is 40 x 24");
  box->ConnectInput("depth", large, "albedo");
  box->SetAlwaysMake({ "mask" });
  box->Update();
  EXPECT_EQ(box->GetErrorText(),
    "input \"depth\" wants depth (1 x float along the view axis), but \"albedo\" has 3 components");
}

namespace
{
/// Wants guides of three components, and misses "alpha" where it is known not to be.
class vtkQuellTestChoosy : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellTestChoosy);
  int Executed = 0;
  void CheckConnections(quell::ConnectionCheck& check) const override
  {
    for (int c = 0; c < check.Count(1); ++c)
      check.WantComponents(1, c, { 2, 3, 5 });
    check.WantAtMost(1, 2, "two are enough");
    std::vector<quell::OutputArray> arrays;
    if (check.At(0, 0).Holds(arrays))
      check.Warn(0, 0, std::to_string(arrays.size()) + " arrays, no alpha");
  }

protected:
  vtkQuellTestChoosy() { this->InitializePorts(); }
  void Execute(quell::StageFrame&) override { ++this->Executed; }
};
vtkStandardNewMacro(vtkQuellTestChoosy);
QUELL_STAGE_DESCRIPTION(vtkQuellTestChoosy)
void vtkQuellTestChoosy::Describe(quell::StageDescription& d)
{
  d.Input("radiance", quell::ArrayKind::Color, "radiance", "");
  d.RepeatableInput("guide", quell::ArrayKind::Any, "albedo", "");
  d.Inputs[1].Optional = true;
  d.Output("radiance", quell::ArrayKind::Color, "");
}
}

TEST(Stage, ChecksItsConnectionsBeforeItExecutes)
{
  vtkNew<vtkQuellTestSource> source;
  vtkNew<vtkQuellTestChoosy> stage;
  stage->ConnectInput("radiance", source);
  stage->ConnectInput("guide", source, "normal");
  stage->Update();
  EXPECT_EQ(stage->GetErrorText(), "");
  EXPECT_EQ(stage->Executed, 1);
  const std::string known = std::to_string(source->GetDescription().Outputs.size());
  ASSERT_EQ(stage->GetWarnings().size(), 1u);
  EXPECT_EQ(stage->GetWarnings()[0], "input \"radiance\": " + known + " arrays, no alpha");
  stage->SetConnectionsChecked(true);
  stage->Modified();
  stage->Update();
  EXPECT_TRUE(stage->GetWarnings().empty()) << "told by the one who checked";

  vtkObject::GlobalWarningDisplayOff();
  stage->ConnectInput("guide", source, "depth");
  stage->Update();
  EXPECT_EQ(stage->GetErrorText(), "input \"guide\": \"depth\" has 1 component, wanted are 2, 3 or 5");
  EXPECT_EQ(stage->Executed, 2) << "not with a mistake";
  stage->SetInputArray(1, 1, "normal");
  stage->ConnectInput("guide", source, "normal");
  stage->Update();
  EXPECT_EQ(stage->GetErrorText(), "input \"guide\": 3 connections, at most 2 are possible; two are enough");
  vtkObject::GlobalWarningDisplayOn();

  // What a stock image's producer can make, nobody knows.
  vtkNew<vtkImageData> image;
  image->SetDimensions(2, 2, 1);
  image->AllocateScalars(VTK_FLOAT, 3);
  vtkNew<vtkQuellTestChoosy> behind;
  behind->SetInputDataObject(0, image);
  behind->Update();
  EXPECT_EQ(behind->GetErrorText(), "");
  EXPECT_TRUE(behind->GetWarnings().empty());
}

TEST(Stage, WorksBehindAStockFilter)
{
  vtkNew<vtkQuellTestSource> source;
  vtkNew<vtkImageShiftScale> stock;
  stock->SetInputConnection(source->GetOutputPort());
  stock->SetScale(2);
  stock->SetOutputScalarTypeToDouble();
  vtkNew<vtkQuellTestBox> box;
  box->SetRadius(0);
  box->ConnectInput("radiance", stock);
  box->Update();
  EXPECT_EQ(box->GetErrorText(), "");
  EXPECT_EQ(source->LastWanted, (quell::ArraySet{ "radiance" }));
  EXPECT_FLOAT_EQ(At(box, "radiance", 3, 4), 2 * vtkQuellTestSource::Value(0, 'r', 3, 4, 0));
}

TEST(Stage, CancelIsAFailureThatCanBeRepeated)
{
  Quiet quiet;
  vtkNew<vtkQuellTestSource> source;
  vtkNew<vtkQuellTestBox> box;
  box->ConnectInput("radiance", source);
  auto token = std::make_shared<quell::CancelToken>();
  box->SetCancelToken(token);
  token->Cancel();
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(box, { "radiance" });
  EXPECT_FALSE(sink->UpdateTick(0));
  EXPECT_EQ(box->GetErrorText(), "cancelled");
  EXPECT_EQ(box->GetOutput()->GetPointData()->GetNumberOfArrays(), 0);
  token->Reset();
  EXPECT_TRUE(sink->UpdateTick(0));
  EXPECT_FALSE(std::isnan(At(box, "radiance", 0, 0)));
}

TEST(Stage, FinishIsNoCancel)
{
  vtkNew<vtkQuellTestSource> source;
  vtkNew<vtkQuellTestBox> box;
  box->ConnectInput("radiance", source);
  auto token = std::make_shared<quell::CancelToken>();
  box->SetCancelToken(token);
  token->Finish();
  EXPECT_TRUE(token->IsFinishing());
  EXPECT_FALSE(token->IsCancelled());
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(box, { "radiance" });
  EXPECT_TRUE(sink->UpdateTick(0)) << "stages that do not sample complete the frame";
  EXPECT_FALSE(std::isnan(At(box, "radiance", 0, 0)));
  token->Cancel();
  token->ResetCancel();
  EXPECT_TRUE(token->IsFinishing()) << "a failure takes the user's wish not back";
  token->Reset();
  EXPECT_FALSE(token->IsFinishing());
}

// What the tests with threads rest on: seven pieces of work meet, so seven threads are at work at once.
TEST(Threads, AreAsManyAsAsked)
{
  // TBB goes beyond the processors of the machine (WithThreads); VTK's own threads do not.
  const bool limited = std::string(vtkSMPTools::GetBackend()) != "TBB";
  for (int wanted : { 2, 3, 7 })
  {
    const int threads = limited ? std::min(wanted, int(std::thread::hardware_concurrency())) : wanted;
    std::atomic<int> begun{ 0 };
    const auto meet = [&](vtkIdType, vtkIdType)
    {
      ++begun;
      const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
      while (begun < threads && std::chrono::steady_clock::now() < end)
        std::this_thread::yield();
      EXPECT_GE(begun, threads) << "a thread is missing";
    };
    quelltest::WithThreads(threads, [&] { vtkSMPTools::For(0, threads, 1, meet); });
  }
}

TEST(Stage, SameBitsForAnyNumberOfThreads)
{
  std::vector<float> first;
  for (int threads : { 1, 2, 3, 7 })
  {
    vtkNew<vtkQuellTestSource> source;
    source->SetWidth(200);
    source->SetHeight(130);
    vtkNew<vtkQuellTestBox> box;
    box->ConnectInput("radiance", source);
    quelltest::WithThreads(threads, [&] { box->Update(); });
    auto array = box->GetOutput()->GetPointData()->GetArray("radiance");
    const float* p = static_cast<float*>(array->GetVoidPointer(0));
    std::vector<float> v(p, p + array->GetNumberOfValues());
    if (first.empty())
      first = v;
    EXPECT_EQ(first, v);
  }
}

TEST(History, SetAgainChangesNothing)
{
  vtkNew<vtkQuellTestSource> source;
  vtkNew<vtkQuellTestFeedback> feedback;
  feedback->ConnectInput("radiance", source);
  feedback->SetHistory(1, nullptr);
  feedback->Update();
  EXPECT_EQ(feedback->GetCounters().Executions, 1);
  feedback->SetHistory(1, nullptr);
  feedback->Update();
  EXPECT_EQ(feedback->GetCounters().Executions, 1);
  EXPECT_FLOAT_EQ(At(feedback, "radiance", 3, 3), vtkQuellTestSource::Value(0, 'r', 3, 3, 0));
}

TEST(History, AccumulatesAcrossTicksAndRepeatsATick)
{
  vtkNew<vtkQuellTestSource> source;
  vtkNew<vtkQuellTestFeedback> feedback;
  feedback->ConnectInput("radiance", source);
  vtkNew<vtkQuellCollector> sink;
  sink->AddRequest(feedback, { "radiance" });
  quell::FrameHistory history;
  const auto run = [&](int tick)
  {
    feedback->SetHistory(1, history.Find(tick - 1, "feedback"));
    ASSERT_TRUE(sink->UpdateTick(tick));
    quell::FrameHistory::Frame frame;
    frame["feedback"] =
      quell::FrameHistory::Keep(feedback->GetOutput(), { "radiance" }, history.Find(tick, "feedback"));
    history.Commit(tick, frame);
  };
  const auto r = [](int t, int x) { return vtkQuellTestSource::Value(t, 'r', x, 5, 0); };
  run(0);
  run(1);
  run(2);
  const float expected = r(2, 4) + 0.5f * (r(1, 5) + 0.5f * r(0, 6));
  EXPECT_FLOAT_EQ(At(feedback, "radiance", 4, 5), expected);
  const auto before = feedback->GetCounters().Executions;
  run(2);
  EXPECT_EQ(feedback->GetCounters().Executions, before) << "same tick, same history: nothing to do";
  feedback->Modified();
  run(2);
  EXPECT_FLOAT_EQ(At(feedback, "radiance", 4, 5), expected) << "a slider move re-runs on the same past";
  run(9);
  EXPECT_FLOAT_EQ(At(feedback, "radiance", 4, 5), r(9, 4)) << "a jump has no history";
}

TEST(History, KeptArraysSurviveTheNextExecution)
{
  vtkNew<vtkQuellTestSource> source;
  source->Update();
  const auto kept = quell::FrameHistory::Keep(source->GetOutput(), { "radiance" }, nullptr);
  const double before = kept->GetPointData()->GetArray("radiance")->GetComponent(7, 0);
  source->SetWidth(41);
  source->Update();
  source->Modified();
  source->Update();
  EXPECT_EQ(kept->GetPointData()->GetArray("radiance")->GetComponent(7, 0), before);
}

TEST(History, ForgetsTheFarthestTick)
{
  quell::FrameHistory history(3);
  for (int t = 0; t < 5; ++t)
    history.Commit(t, {});
  EXPECT_FALSE(history.FindFrame(1));
  EXPECT_TRUE(history.FindFrame(2));
  history.Commit(1, {});
  EXPECT_TRUE(history.FindFrame(1));
  EXPECT_FALSE(history.FindFrame(4)) << "stepping back keeps what lies around";
}
