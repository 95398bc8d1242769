// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellStage.h"

#include "quellPixelMemory.h"
#include "vtkDataArray.h"
#include "vtkExecutive.h"
#include "vtkFieldData.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkInformation.h"
#include "vtkInformationIntegerKey.h"
#include "vtkInformationIntegerVectorKey.h"
#include "vtkInformationVector.h"
#include "vtkPointData.h"
#include "vtkQuellArraySetKey.h"
#include "vtkSMPTools.h"
#include "vtkStreamingDemandDrivenPipeline.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <exception>
#include <mutex>
#include <new>
#include <thread>

using SDDP = vtkStreamingDemandDrivenPipeline;

namespace
{
quell::Rect RectOf(const int e[6])
{
  return { e[0], e[2], e[1] + 1, e[3] + 1 };
}
void ExtentOf(const quell::Rect& r, int e[6])
{
  e[0] = r.x0;
  e[1] = r.x1 - 1;
  e[2] = r.y0;
  e[3] = r.y1 - 1;
  e[4] = e[5] = 0;
}
std::string SizeText(const quell::Rect& r)
{
  return std::to_string(r.width()) + " x " + std::to_string(r.height());
}
std::string ArrayList(vtkImageData* image)
{
  std::string text;
  for (int i = 0; i < image->GetPointData()->GetNumberOfArrays(); ++i)
    if (const char* name = image->GetPointData()->GetArrayName(i))
      text += (text.empty() ? "" : ", ") + std::string(name);
  return text.empty() ? "none" : text;
}
/// Adds what can be asked of a producer: made there, or passed through. False: who knows.
bool ArraysUpstream(vtkAlgorithm* producer, std::vector<quell::OutputArray>& arrays)
{
  for (vtkAlgorithm* at = producer;;)
  {
    auto* stage = vtkQuellStage::SafeDownCast(at);
    if (!stage)
      return false;
    const auto add = [&arrays](const std::vector<quell::OutputArray>& made)
    { arrays.insert(arrays.end(), made.begin(), made.end()); };
    add(stage->GetDescription().Outputs);
    try
    {
      add(stage->ListDynamicOutputs());
    }
    catch (const std::exception&)
    {
      return false;
    }
    if (stage->GetDescription().Inputs.empty())
      return true;
    if (stage->GetNumberOfInputConnections(0) == 0)
      return false;
    at = stage->GetInputAlgorithm(0, 0);
  }
}
}

struct vtkQuellStage::PortState
{
  bool Delayed = false;
  vtkSmartPointer<vtkImageData> History;
  std::vector<std::string> Arrays; ///< per connection; empty: the port's default
};

vtkQuellStage::vtkQuellStage() = default;
vtkQuellStage::~vtkQuellStage() = default;

void vtkQuellStage::InitializePorts()
{
  if (quell::detail::BuildingPrototype())
    return;
  const auto& inputs = this->GetDescription().Inputs;
  this->SetNumberOfInputPorts(int(inputs.size()));
  this->SetNumberOfOutputPorts(1);
  this->Ports.clear();
  for (size_t i = 0; i < inputs.size(); ++i)
    this->Ports.emplace_back(new PortState);
}

const char* vtkQuellStage::PrimaryArray()
{
  return "@primary";
}

vtkQuellArraySetKey* vtkQuellStage::REQUESTED_ARRAYS()
{
  static vtkQuellArraySetKey* key = new vtkQuellArraySetKey("REQUESTED_ARRAYS", "vtkQuellStage");
  return key;
}
vtkQuellArraySetKey* vtkQuellStage::PROVIDED_ARRAYS()
{
  static vtkQuellArraySetKey* key = new vtkQuellArraySetKey("PROVIDED_ARRAYS", "vtkQuellStage");
  return key;
}
vtkInformationIntegerKey* vtkQuellStage::IS_QUELL_STAGE()
{
  static vtkInformationIntegerKey* key = vtkInformationIntegerKey::MakeKey("IS_QUELL_STAGE", "vtkQuellStage");
  return key;
}

vtkInformationIntegerVectorKey* vtkQuellStage::PASS_REGION()
{
  static vtkInformationIntegerVectorKey* key =
    vtkInformationIntegerVectorKey::MakeKey("PASS_REGION", "vtkQuellStage", 4);
  return key;
}

void vtkQuellStage::RequestRegion(vtkInformation* info, const quell::Rect& region)
{
  quell::Rect all = region;
  if (info->Has(PASS_REGION()))
  {
    int r[4];
    info->Get(PASS_REGION(), r);
    all = region.united({ r[0], r[1], r[2], r[3] });
    const int united[4] = { all.x0, all.y0, all.x1, all.y1 };
    info->Set(PASS_REGION(), united, 4);
  }
  int extent[6];
  ExtentOf(all, extent);
  info->Set(SDDP::UPDATE_EXTENT(), extent, 6);
}

void vtkQuellStage::PrintSelf(ostream& os, vtkIndent indent)
{
  this->Superclass::PrintSelf(os, indent);
  for (const quell::Property& p : this->GetDescription().Properties)
    os << indent << p.Name << ": " << p.GetText(this) << "\n";
}

bool vtkQuellStage::SetPropertyText(const std::string& name, const std::string& text, std::string& error)
{
  const quell::Property* p = this->GetDescription().FindProperty(name);
  if (!p)
  {
    error = "no property \"" + name + "\"";
    return false;
  }
  return p->SetText(this, text, error);
}

std::string vtkQuellStage::GetPropertyText(const std::string& name) const
{
  const quell::Property* p = this->GetDescription().FindProperty(name);
  return p ? p->GetText(this) : std::string();
}

void vtkQuellStage::SetInputArray(int port, int connection, const std::string& name)
{
  auto& arrays = this->Ports.at(port)->Arrays;
  if (int(arrays.size()) <= connection)
    arrays.resize(connection + 1);
  if (arrays[connection] == name)
    return;
  arrays[connection] = name;
  this->Modified();
}

const std::string& vtkQuellStage::GetInputArray(int port, int connection) const
{
  const auto& arrays = this->Ports.at(port)->Arrays;
  if (connection < int(arrays.size()) && !arrays[connection].empty())
    return arrays[connection];
  return this->GetDescription().Inputs.at(port).Array;
}

void vtkQuellStage::ConnectInput(const std::string& port, vtkAlgorithm* producer, const std::string& array)
{
  const int index = this->GetDescription().InputIndex(port);
  if (index < 0)
  {
    vtkErrorMacro("no input \"" << port << "\"");
    return;
  }
  const bool repeatable = this->GetDescription().Inputs[index].Repeatable;
  const int connection = repeatable ? this->GetNumberOfInputConnections(index) : 0;
  if (repeatable)
    this->AddInputConnection(index, producer->GetOutputPort());
  else
    this->SetInputConnection(index, producer->GetOutputPort());
  this->SetInputArray(index, connection, array);
}

void vtkQuellStage::SetHistory(int port, vtkImageData* image)
{
  PortState& state = *this->Ports.at(port);
  if (state.Delayed && state.History == image)
    return;
  state.Delayed = true;
  state.History = image;
  this->Modified();
}

vtkImageData* vtkQuellStage::GetHistory(int port) const
{
  return this->Ports.at(port)->History;
}

bool vtkQuellStage::IsDelayed(int port) const
{
  return this->Ports.at(port)->Delayed;
}

void vtkQuellStage::SetAlwaysMake(const quell::ArraySet& names)
{
  if (names == this->AlwaysMake)
    return;
  this->AlwaysMake = names;
  this->Modified();
}

void vtkQuellStage::SetTimeline(const quell::Timeline& t)
{
  if (t.First == this->Ticks.First && t.Count == this->Ticks.Count && t.Rate == this->Ticks.Rate)
    return;
  this->Ticks = t;
  this->Modified();
}

void vtkQuellStage::SetMetadata(const std::map<std::string, std::string>&) {}

void vtkQuellStage::SetMetadataSource(const MetadataSource&) {}

bool vtkQuellStage::SetInputAttribute(int port, int, const std::string& name, const std::string&, std::string& error)
{
  error = "input \"" + this->GetDescription().Inputs.at(port).Name + "\" has no attribute \"" + name + "\"";
  return false;
}

double vtkQuellStage::ScratchBytes(const quell::Rect&, const quell::Rect&, const quell::ArraySet&)
{
  return 0;
}

void vtkQuellStage::BeginBands(const quell::Rect& region) {}

bool vtkQuellStage::LoadWork(const std::string&, std::string& error)
{
  error = "this type of stage keeps no work";
  return false;
}

int vtkQuellStage::HaloFor(int port) const
{
  const int halo = this->GetDescription().Inputs.at(port).Halo;
  return halo > 0 ? halo : 0;
}

bool vtkQuellStage::NeedsInput(int, const quell::ArraySet&) const
{
  return true;
}

bool vtkQuellStage::Makes(const std::string& array) const
{
  return this->GetDescription().FindOutput(array) != nullptr;
}

double vtkQuellStage::HistoryWeight(int) const
{
  return 1;
}

bool vtkQuellStage::AllowsOtherExtent(int) const
{
  return false;
}

void vtkQuellStage::DescribeSource(int& width, int& height)
{
  width = height = 0;
}

int vtkQuellStage::Fail(const std::string& text)
{
  this->ErrorText = text;
  for (int i = 0; i < this->GetNumberOfOutputPorts(); ++i)
    if (vtkDataObject* output = this->GetOutputDataObject(i))
      output->Initialize();
  vtkErrorMacro(<< text);
  return 0;
}

int vtkQuellStage::FillInputPortInformation(int port, vtkInformation* info)
{
  info->Set(INPUT_REQUIRED_DATA_TYPE(), "vtkImageData");
  // VTK knows nothing of delayed inputs: RequestInformation says which required input is missing.
  info->Set(INPUT_IS_OPTIONAL(), 1);
  if (this->GetDescription().Inputs.at(port).Repeatable)
    info->Set(INPUT_IS_REPEATABLE(), 1);
  return 1;
}

quell::ArraySet vtkQuellStage::WantedFrom(vtkInformation* outInfo) const
{
  const auto& outputs = this->GetDescription().Outputs;
  quell::ArraySet wanted;
  if (outInfo->Has(REQUESTED_ARRAYS()))
    wanted = REQUESTED_ARRAYS()->Read(outInfo);
  else
    wanted.insert(PrimaryArray());
  wanted.erase(std::string());
  if (wanted.erase(PrimaryArray()) && !outputs.empty())
    wanted.insert(outputs.front().Name);
  wanted.insert(this->AlwaysMake.begin(), this->AlwaysMake.end());
  return wanted;
}

int vtkQuellStage::RequestInformation(
  vtkInformation*, vtkInformationVector** inputVector, vtkInformationVector* outputVector)
{
  this->ErrorText.clear();
  vtkInformation* outInfo = outputVector->GetInformationObject(0);
  outInfo->Set(IS_QUELL_STAGE(), 1);
  outInfo->Set(CAN_PRODUCE_SUB_EXTENT(), 1);
  const auto& description = this->GetDescription();
  try
  {
    int width = 0, height = 0;
    this->DescribeSource(width, height);
    if (width > 0 && height > 0)
    {
      int whole[6];
      ExtentOf({ 0, 0, width, height }, whole);
      outInfo->Set(SDDP::WHOLE_EXTENT(), whole, 6);
      const double spacing[3] = { 1, 1, 1 }, origin[3] = { 0, 0, 0 };
      outInfo->Set(vtkDataObject::SPACING(), spacing, 3);
      outInfo->Set(vtkDataObject::ORIGIN(), origin, 3);
      // Without both keys VTK does not pass a time request on.
      std::vector<double> ticks(std::max(1, this->Ticks.Count));
      for (size_t i = 0; i < ticks.size(); ++i)
        ticks[i] = this->Ticks.First + double(i);
      const double range[2] = { ticks.front(), ticks.back() };
      outInfo->Set(SDDP::TIME_STEPS(), ticks.data(), int(ticks.size()));
      outInfo->Set(SDDP::TIME_RANGE(), range, 2);
    }
    else
    {
      for (int p = 0; p < int(description.Inputs.size()); ++p)
      {
        const bool connected = inputVector[p]->GetNumberOfInformationObjects() > 0;
        if (p == 0 ? !connected : !connected && !this->Ports[p]->Delayed && !description.Inputs[p].Optional)
          throw quell::StageError("required input \"" + description.Inputs[p].Name + "\" is not connected");
      }
      if (description.Inputs.empty())
        throw quell::StageError("the source does not know its size");
      int whole[6] = { 0, -1, 0, -1, 0, -1 };
      inputVector[0]->GetInformationObject(0)->Get(SDDP::WHOLE_EXTENT(), whole);
      const quell::Rect first = RectOf(whole);
      if (first.empty() || whole[4] != whole[5])
        throw quell::StageError("input \"" + description.Inputs[0].Name + "\" is not an image of one slice");
      outInfo->Set(SDDP::WHOLE_EXTENT(), whole, 6);
      for (int p = 0; p < int(description.Inputs.size()); ++p)
        for (int c = 0; c < inputVector[p]->GetNumberOfInformationObjects(); ++c)
        {
          int other[6] = { 0, -1, 0, -1, 0, -1 };
          inputVector[p]->GetInformationObject(c)->Get(SDDP::WHOLE_EXTENT(), other);
          if (RectOf(other) != first && !this->AllowsOtherExtent(p))
            throw quell::StageError("input \"" + description.Inputs[p].Name + "\" is " + SizeText(RectOf(other)) +
                                    " pixels, but input \"" + description.Inputs[0].Name + "\" is " + SizeText(first));
        }
    }
  }
  catch (const std::bad_alloc&)
  {
    return this->Fail("there is not enough memory");
  }
  catch (const std::exception& e)
  {
    return this->Fail(e.what());
  }
  const int components = description.Outputs.empty() ? 3 : std::max(1, description.Outputs.front().Components);
  vtkDataObject::SetPointDataActiveScalarInfo(outInfo, VTK_FLOAT, components);
  return 1;
}

int vtkQuellStage::RequestUpdateExtent(
  vtkInformation*, vtkInformationVector** inputVector, vtkInformationVector* outputVector)
{
  vtkInformation* outInfo = outputVector->GetInformationObject(0);
  const auto& description = this->GetDescription();
  const quell::ArraySet asked = this->WantedFrom(outInfo);
  int e[6];
  outInfo->Get(SDDP::UPDATE_EXTENT(), e);
  const quell::Rect region = RectOf(e);

  // Two ports may share a producer: unite first, set once, or the last port would win.
  std::map<vtkInformation*, quell::Rect> regions;
  for (int p = 0; p < int(description.Inputs.size()); ++p)
  {
    const bool needed = this->NeedsInput(p, asked);
    for (int c = 0; c < inputVector[p]->GetNumberOfInformationObjects(); ++c)
    {
      vtkInformation* info = inputVector[p]->GetInformationObject(c);
      int w[6];
      info->Get(SDDP::WHOLE_EXTENT(), w);
      const quell::Rect whole = RectOf(w);
      quell::Rect read =
        this->AllowsOtherExtent(p)
          ? whole
          : (region.empty() ? region : region.grown(needed ? std::max(0, this->HaloFor(p)) : 0).clipped(whole));
      quell::ArraySet names{ std::string() };
      if (needed)
        names.insert(this->GetInputArray(p, c));
      if (p == 0 && c == 0)
        for (const std::string& name : asked)
          if (!description.FindOutput(name))
            names.insert(name);
      if (!info->Has(IS_QUELL_STAGE()) && (needed || names.size() > 1))
        names.insert(PrimaryArray());
      REQUESTED_ARRAYS()->Unite(info, names);
      const auto found = regions.find(info);
      if (found == regions.end())
        regions[info] = read;
      else
        found->second = found->second.united(read);
    }
  }
  for (const auto& entry : regions)
    RequestRegion(entry.first, entry.second);
  return 1;
}

int vtkQuellStage::RequestData(vtkInformation*, vtkInformationVector** inputVector, vtkInformationVector* outputVector)
{
  this->ErrorText.clear();
  this->Warnings.clear();
  this->CountedWarning.clear();
  // After a failure VTK goes on with the other inputs of every reader, and comes here again on each path.
  if (this->IsCancelled())
    return this->Fail("cancelled");
  vtkInformation* outInfo = outputVector->GetInformationObject(0);
  vtkImageData* output = vtkImageData::GetData(outInfo);
  const auto& description = this->GetDescription();
  int e[6];
  outInfo->Get(SDDP::UPDATE_EXTENT(), e);
  int w[6] = { e[0], e[1], e[2], e[3], e[4], e[5] };
  outInfo->Get(SDDP::WHOLE_EXTENT(), w);
  output->Initialize();
  output->SetExtent(e);

  quell::StageFrame frame;
  frame.Stage = this;
  frame.OutputImage = output;
  frame.OutputRegion = RectOf(e);
  frame.WholeFrame = RectOf(w);
  frame.FrameTick = this->Ticks.First;
  if (outInfo->Has(SDDP::UPDATE_TIME_STEP()))
    frame.FrameTick = int(outInfo->Get(SDDP::UPDATE_TIME_STEP()));
  const quell::ArraySet asked = this->WantedFrom(outInfo);
  frame.Wanted = asked;
  try
  {
    frame.Images.resize(description.Inputs.size());
    for (int p = 0; p < int(description.Inputs.size()); ++p)
    {
      if (!this->NeedsInput(p, asked))
        continue;
      if (this->Ports[p]->Delayed)
      {
        if (this->Ports[p]->History)
          frame.Images[p].push_back(this->Ports[p]->History);
        continue;
      }
      for (int c = 0; c < inputVector[p]->GetNumberOfInformationObjects(); ++c)
        frame.Images[p].push_back(vtkImageData::GetData(inputVector[p], c));
    }
    vtkImageData* first = nullptr;
    if (!description.Inputs.empty() && inputVector[0]->GetNumberOfInformationObjects() > 0)
      first = vtkImageData::GetData(inputVector[0], 0);
    if (first)
    {
      frame.OutputFacts = quell::FrameFacts::Read(first->GetFieldData());
      output->SetSpacing(first->GetSpacing());
      output->SetOrigin(first->GetOrigin());
    }
    else
      frame.OutputFacts.Tick = frame.FrameTick;
    // Whatever is made of an unfinished frame is unfinished.
    for (const auto& images : frame.Images)
      for (vtkImageData* image : images)
        if (image && frame.OutputFacts.Partial.empty())
          frame.OutputFacts.Partial = quell::FrameFacts::Read(image->GetFieldData()).Partial;

    bool makes = false;
    for (const quell::OutputArray& made : description.Outputs)
      if (asked.count(made.Name))
      {
        frame.Output(made.Name);
        makes = true;
      }
    for (const std::string& name : asked)
      makes = makes || this->Makes(name);
    const bool dynamic = description.Inputs.empty() && !asked.empty();
    if (makes || dynamic || description.Sink)
    {
      const auto start = std::chrono::steady_clock::now();
      this->CheckConnectionsNow(inputVector);
      this->Execute(frame);
      this->Counters.Seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      ++this->Counters.Executions;
      this->Counters.Pixels += frame.OutputRegion.area();
      for (const auto& view : frame.Views)
        this->Counters.Bytes +=
          std::int64_t(view.second.extent.area()) * view.second.components * std::int64_t(sizeof(float));
    }

    // Everything else that was asked for passes through from port 0: by reference where the extents agree.
    for (const std::string& name : asked)
    {
      if (frame.Views.count(name) || !first)
        continue;
      vtkDataArray* array = first->GetPointData()->GetArray(name.c_str());
      if (!array)
        throw quell::StageError("no array \"" + name + "\": not made here, and input \"" + description.Inputs[0].Name +
                                "\" holds " + ArrayList(first));
      if (RectOf(first->GetExtent()) == frame.OutputRegion)
        output->GetPointData()->AddArray(array);
      else
      {
        const quell::Rect from = RectOf(first->GetExtent());
        auto crop = vtkSmartPointer<vtkDataArray>::Take(array->NewInstance());
        crop->SetName(name.c_str());
        crop->SetNumberOfComponents(array->GetNumberOfComponents());
        crop->SetNumberOfTuples(frame.OutputRegion.area());
        for (int y = frame.OutputRegion.y0; y < frame.OutputRegion.y1; ++y)
          crop->InsertTuples(vtkIdType(y - frame.OutputRegion.y0) * frame.OutputRegion.width(),
            frame.OutputRegion.width(), vtkIdType(y - from.y0) * from.width() + frame.OutputRegion.x0 - from.x0, array);
        output->GetPointData()->AddArray(crop);
      }
    }
    if (dynamic)
      for (const std::string& name : asked)
        if (!output->GetPointData()->GetArray(name.c_str()))
          throw quell::StageError("no array \"" + name + "\"; it has " + ArrayList(output));
  }
  catch (const std::bad_alloc&)
  {
    return this->Fail("there is not enough memory");
  }
  catch (const std::exception& error)
  {
    return this->Fail(error.what());
  }
  if (!description.Outputs.empty() && output->GetPointData()->HasArray(description.Outputs.front().Name.c_str()))
    output->GetPointData()->SetActiveScalars(description.Outputs.front().Name.c_str());
  else if (output->GetPointData()->GetNumberOfArrays() > 0)
    output->GetPointData()->SetActiveScalars(output->GetPointData()->GetArrayName(0));
  frame.OutputFacts.Write(output->GetFieldData());
  output->GetInformation()->Set(vtkDataObject::DATA_TIME_STEP(), double(frame.FrameTick));
  quell::ArraySet provided = asked;
  provided.insert(std::string());
  provided.insert(PrimaryArray());
  for (const auto& view : frame.Views)
    provided.insert(view.first);
  PROVIDED_ARRAYS()->Write(output->GetInformation(), provided);
  return 1;
}

void vtkQuellStage::Weigh(quell::StageFrame&, quell::PixelWeights&)
{
  throw quell::StageError("this stage has no weights to show");
}

bool vtkQuellStage::WeighPixel(int x, int y, quell::PixelWeights& weights, std::string& error)
{
  weights = quell::PixelWeights();
  const auto& description = this->GetDescription();
  const quell::Rect pixel{ x, y, x + 1, y + 1 };
  if (!RectOf(this->GetOutput()->GetExtent()).contains(pixel))
  {
    error = "pixel " + std::to_string(x) + ", " + std::to_string(y) + " is not in the frame that was made";
    return false;
  }
  quell::StageFrame frame;
  frame.Stage = this;
  frame.OutputRegion = pixel;
  int whole[6];
  this->GetOutput()->GetExtent(whole);
  this->GetOutputInformation(0)->Get(SDDP::WHOLE_EXTENT(), whole);
  frame.WholeFrame = RectOf(whole);
  frame.FrameTick = this->Ticks.First;
  if (!description.Outputs.empty())
    frame.Wanted.insert(description.Outputs.front().Name);
  frame.Images.resize(description.Inputs.size());
  for (int p = 0; p < int(description.Inputs.size()); ++p)
  {
    if (!this->NeedsInput(p, frame.Wanted))
      continue;
    if (this->Ports[p]->Delayed)
    {
      if (this->Ports[p]->History)
        frame.Images[p].push_back(this->Ports[p]->History);
      continue;
    }
    for (int c = 0; c < this->GetNumberOfInputConnections(p); ++c)
      frame.Images[p].push_back(vtkImageData::SafeDownCast(this->GetInputDataObject(p, c)));
  }
  try
  {
    this->Weigh(frame, weights);
  }
  catch (const std::exception& failure)
  {
    error = failure.what();
    return false;
  }
  return true;
}

void vtkQuellStage::CheckConnectionsNow(vtkInformationVector** inputVector)
{
  const auto& description = this->GetDescription();
  quell::ConnectionCheck check;
  check.Ports.resize(description.Inputs.size());
  const auto add = [&](int p, int c, vtkImageData* image, vtkAlgorithm* producer)
  {
    quell::ConnectionCheck::Connection connection;
    connection.Array = this->GetInputArray(p, c);
    vtkDataArray* array = image ? image->GetPointData()->GetArray(connection.Array.c_str()) : nullptr;
    if (image && !array && !image->GetInformation()->Has(PROVIDED_ARRAYS()))
      array = image->GetPointData()->GetScalars();
    connection.Components = array ? array->GetNumberOfComponents() : 0;
    connection.Holds = [producer](std::vector<quell::OutputArray>& arrays) { return ArraysUpstream(producer, arrays); };
    check.Ports[std::size_t(p)].push_back(connection);
  };
  for (int p = 0; p < int(description.Inputs.size()); ++p)
    if (this->Ports[std::size_t(p)]->Delayed)
      add(p, 0, this->Ports[std::size_t(p)]->History, nullptr);
    else
      for (int c = 0; c < inputVector[p]->GetNumberOfInformationObjects(); ++c)
        add(p, c, vtkImageData::GetData(inputVector[p], c), this->GetInputAlgorithm(p, c));
  this->CheckConnections(check);
  for (const auto& message : check.Messages())
    if (!message.Warning)
      throw quell::StageError(quell::ConnectionCheck::Text(description, message));
    else if (!this->ConnectionsChecked)
      this->Warnings.push_back(quell::ConnectionCheck::Text(description, message));
}

void vtkQuellStage::Prepare(quell::StageFrame&) {}
void vtkQuellStage::ExecuteTile(const quell::StageFrame&, const quell::Rect&) const {}

void vtkQuellStage::Execute(quell::StageFrame& frame)
{
  this->Prepare(frame);
  this->ForEachTile(frame.Region(), 64, [&](const quell::Rect& tile) { this->ExecuteTile(frame, tile); });
}

namespace
{
struct TileLoop
{
  std::function<void(vtkIdType)> Body;
  void operator()(vtkIdType begin, vtkIdType end)
  {
    for (vtkIdType i = begin; i < end; ++i)
      this->Body(i);
  }
};
}

void vtkQuellStage::ForEachTile(
  const quell::Rect& region, int tileSize, const std::function<void(const quell::Rect&)>& body, double from, double to)
{
  if (region.empty())
    return;
  const int columns = (region.width() + tileSize - 1) / tileSize;
  const int rows = (region.height() + tileSize - 1) / tileSize;
  const vtkIdType count = vtkIdType(columns) * rows;
  std::atomic<vtkIdType> done{ 0 };
  std::atomic<bool> stop{ false };
  std::exception_ptr failure;
  std::mutex failureMutex;
  const std::thread::id caller = std::this_thread::get_id();
  TileLoop loop;
  loop.Body = [&](vtkIdType i)
  {
    if (stop.load(std::memory_order_relaxed))
      return;
    if (this->IsCancelled())
    {
      stop = true;
      return;
    }
    const int x = region.x0 + int(i % columns) * tileSize, y = region.y0 + int(i / columns) * tileSize;
    try
    {
      body({ x, y, std::min(x + tileSize, region.x1), std::min(y + tileSize, region.y1) });
    }
    catch (...)
    {
      std::lock_guard<std::mutex> lock(failureMutex);
      if (!failure)
        failure = std::current_exception();
      stop = true;
    }
    const vtkIdType n = ++done;
    // Observers may touch a user interface, so only the calling thread reports.
    if (std::this_thread::get_id() == caller && count > 1)
      this->UpdateProgress(from + (to - from) * (double(n) / double(count)));
  };
  vtkSMPTools::For(0, count, 1, loop);
  if (failure)
    std::rethrow_exception(failure);
  if (this->IsCancelled())
    throw quell::StageError("cancelled");
}

namespace quell
{
int StageFrame::Connections(int port) const
{
  return int(this->Images.at(port).size());
}

vtkImageData* StageFrame::InputImage(int port, int connection) const
{
  return this->Has(port, connection) ? this->Images[port][connection].GetPointer() : nullptr;
}

FrameFacts StageFrame::Facts(int port, int connection) const
{
  vtkImageData* image = this->InputImage(port, connection);
  return image ? FrameFacts::Read(image->GetFieldData()) : FrameFacts();
}

ImageIn StageFrame::Input(int port, int connection) const
{
  return this->InputArray(port, connection, this->Stage->GetInputArray(port, connection));
}

ImageIn StageFrame::InputArray(int port, int connection, const std::string& name) const
{
  vtkImageData* image = this->InputImage(port, connection);
  if (!image)
    return ImageIn();
  const InputPort& spec = this->Stage->GetDescription().Inputs[port];
  vtkDataArray* array = image->GetPointData()->GetArray(name.c_str());
  // A stock VTK image has one unnamed-by-us array: its scalars.
  if (!array && !image->GetInformation()->Has(vtkQuellStage::PROVIDED_ARRAYS()))
    array = image->GetPointData()->GetScalars();
  if (!array)
    throw StageError("input \"" + spec.Name + "\" has no array \"" + name + "\"; it holds " + ArrayList(image));
  const int wanted = KindComponents(spec.Kind);
  const bool own = name == this->Stage->GetInputArray(port, connection);
  if (own && wanted && array->GetNumberOfComponents() != wanted)
    throw StageError("input \"" + spec.Name + "\" wants " + KindName(spec.Kind) + " (" + KindDoc(spec.Kind) +
                     "), but \"" + name + "\" has " + std::to_string(array->GetNumberOfComponents()) + " components");
  vtkFloatArray* floats = vtkFloatArray::SafeDownCast(array);
  if (!floats)
  {
    vtkSmartPointer<vtkFloatArray>& copy = this->Converted[array];
    if (!copy)
    {
      copy = vtkSmartPointer<vtkFloatArray>::New();
      copy->DeepCopy(array);
    }
    floats = copy;
  }
  return ImageIn(floats->GetPointer(0), floats->GetNumberOfComponents(), RectOf(image->GetExtent()));
}

ImageOut StageFrame::Output(const std::string& name)
{
  const auto found = this->Views.find(name);
  if (found != this->Views.end())
    return found->second;
  const OutputArray* spec = this->Stage->GetDescription().FindOutput(name);
  if (!spec || !this->Wants(name))
    return ImageOut();
  return this->AddOutput(name, spec->Components);
}

ImageOut StageFrame::Output(const std::string& name) const
{
  const auto found = this->Views.find(name);
  return found == this->Views.end() ? ImageOut() : found->second;
}

ImageOut StageFrame::AddOutput(const std::string& name, int components)
{
  const auto found = this->Views.find(name);
  if (found != this->Views.end())
    return found->second;
  auto array = vtkSmartPointer<vtkFloatArray>::New();
  array->SetName(name.c_str());
  array->SetNumberOfComponents(components);
  const std::size_t count = std::size_t(this->OutputRegion.area()) * std::size_t(components);
  array->SetArray(TakePixelMemory(count), vtkIdType(count), 0, vtkFloatArray::VTK_DATA_ARRAY_USER_DEFINED);
  array->SetArrayFreeFunction([](void* memory) { GivePixelMemory(memory); });
  if (!this->Stage->FillsOutputs())
    std::memset(array->GetPointer(0), 0, count * sizeof(float));
  this->OutputImage->GetPointData()->AddArray(array);
  return this->Views[name] = ImageOut(array->GetPointer(0), components, this->OutputRegion);
}
}
