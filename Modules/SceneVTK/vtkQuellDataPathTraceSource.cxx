// SPDX-License-Identifier: BSD-3-Clause
#include "vtkQuellDataPathTraceSource.h"

#include "quellVtkMaterial.h"
#include "vtkActor.h"
#include "vtkAssemblyNode.h"
#include "vtkAssemblyPath.h"
#include "vtkCamera.h"
#include "vtkDemandDrivenPipeline.h"
#include "vtkInformation.h"
#include "vtkInformationVector.h"
#include "vtkLight.h"
#include "vtkLightCollection.h"
#include "vtkMapper.h"
#include "vtkMatrix4x4.h"
#include "vtkObjectFactory.h"
#include "vtkPropCollection.h"
#include "vtkProperty.h"
#include "vtkQuellArraySetKey.h"
#include "vtkRenderer.h"
#include "vtkStreamingDemandDrivenPipeline.h"
#include "vtkTexture.h"
#include "vtkWindow.h"

#include <algorithm>
#include <cmath>

using SDDP = vtkStreamingDemandDrivenPipeline;

vtkStandardNewMacro(vtkQuellDataPathTraceSource);

namespace
{
/// When anything that a renderer shows was changed last, upstream of mappers and textures too; executes nothing.
class LastChange
{
public:
  vtkMTimeType Time = 0;

  void Of(vtkObject* object)
  {
    if (object)
      this->Time = std::max(this->Time, object->GetMTime());
  }
  void OfInputs(vtkAlgorithm* algorithm)
  {
    if (!algorithm)
      return;
    this->Of(algorithm);
    for (int port = 0; port < algorithm->GetNumberOfInputPorts(); ++port)
      for (int i = 0; i < algorithm->GetNumberOfInputConnections(port); ++i)
        if (auto upstream = vtkDemandDrivenPipeline::SafeDownCast(algorithm->GetInputExecutive(port, i)))
        {
          upstream->UpdatePipelineMTime();
          this->Time = std::max(this->Time, upstream->GetPipelineMTime());
        }
  }
  void OfRenderer(vtkRenderer* renderer)
  {
    this->Of(renderer);
    this->Of(renderer->GetViewProps());
    this->Of(renderer->GetLights());
    if (renderer->IsActiveCameraCreated())
      this->Of(renderer->GetActiveCamera());
    this->OfInputs(renderer->GetEnvironmentTexture());
    vtkCollectionSimpleIterator at;
    renderer->GetLights()->InitTraversal(at);
    while (vtkLight* light = renderer->GetLights()->GetNextLight(at))
    {
      this->Of(light);
      this->Of(light->GetTransformMatrix());
    }
    renderer->GetViewProps()->InitTraversal(at);
    while (vtkProp* prop = renderer->GetViewProps()->GetNextProp(at))
    {
      this->Of(prop);
      if (!prop->GetVisibility())
        continue;
      prop->InitPathTraversal();
      while (vtkAssemblyPath* path = prop->GetNextPath())
      {
        vtkCollectionSimpleIterator along;
        path->InitTraversal(along);
        while (vtkAssemblyNode* node = path->GetNextNode(along))
          this->Of(node->GetViewProp());
        if (auto actor = vtkActor::SafeDownCast(path->GetLastNode()->GetViewProp()))
        {
          this->OfInputs(actor->GetMapper());
          this->OfInputs(actor->GetTexture());
          this->Of(actor->GetProperty());
          for (const auto& texture : actor->GetProperty()->GetAllTextures())
            this->OfInputs(texture.second);
        }
      }
    }
  }
};
}

struct vtkQuellDataPathTraceSource::Sources
{
  vtkSmartPointer<vtkRenderer> Renderer;
  quell::RendererOptions Options;
  std::vector<quell::DataMaterial> Materials;
  quell::SceneRecorder Recorder;
  std::shared_ptr<const quell::Scene> Scene;
  int Made = 0;
  // What Scene was made of.
  bool Stale = true; ///< options or materials changed
  vtkMTimeType RendererTime = 0;
  std::vector<std::pair<vtkDataObject*, vtkMTimeType>> Data;
  int Size[2] = { 0, 0 };
  int Tick = 0;
  double Rate = 0;
  int SeenWindow[2] = { 0, 0 };
  vtkTimeStamp WindowTime;
};

vtkQuellDataPathTraceSource::vtkQuellDataPathTraceSource()
  : From(new Sources)
{
  this->SetNumberOfInputPorts(1);
}
vtkQuellDataPathTraceSource::~vtkQuellDataPathTraceSource() = default;

void vtkQuellDataPathTraceSource::SetMaterial(int connection, const quell::DataMaterial& material)
{
  if (connection < 0)
  {
    vtkErrorMacro("no connection " << connection);
    return;
  }
  if (int(this->From->Materials.size()) <= connection)
    this->From->Materials.resize(std::size_t(connection) + 1);
  this->From->Materials[std::size_t(connection)] = material;
  this->From->Stale = true;
  this->Modified();
}

quell::DataMaterial vtkQuellDataPathTraceSource::GetMaterial(int connection) const
{
  return connection >= 0 && connection < int(this->From->Materials.size())
           ? this->From->Materials[std::size_t(connection)]
           : quell::DataMaterial();
}

void vtkQuellDataPathTraceSource::SetRenderer(vtkRenderer* renderer)
{
  if (this->From->Renderer == renderer)
    return;
  this->From->Renderer = renderer;
  this->From->Stale = true;
  // The background goes where alpha leaves room.
  this->SetAlwaysMake(renderer ? quell::ArraySet{ "alpha" } : quell::ArraySet());
  this->Modified();
}

vtkRenderer* vtkQuellDataPathTraceSource::GetRenderer() const
{
  return this->From->Renderer;
}

void vtkQuellDataPathTraceSource::SetRendererOptions(const quell::RendererOptions& options)
{
  this->From->Options = options;
  this->From->Stale = true;
  this->Modified();
}

const quell::RendererOptions& vtkQuellDataPathTraceSource::GetRendererOptions() const
{
  return this->From->Options;
}

int vtkQuellDataPathTraceSource::GetNumberOfScenes() const
{
  return this->From->Made;
}

bool vtkQuellDataPathTraceSource::HasSources()
{
  return this->From->Renderer || this->GetNumberOfInputConnections(0) > 0;
}

void vtkQuellDataPathTraceSource::CheckSettings()
{
  if (!this->HasSources())
    this->Superclass::CheckSettings();
}

int vtkQuellDataPathTraceSource::FillInputPortInformation(int, vtkInformation* info)
{
  info->Set(INPUT_REQUIRED_DATA_TYPE(), "vtkDataObject");
  info->Set(INPUT_IS_OPTIONAL(), 1);
  info->Set(INPUT_IS_REPEATABLE(), 1);
  return 1;
}

int vtkQuellDataPathTraceSource::ComputePipelineMTime(
  vtkInformation* request, vtkInformationVector** in, vtkInformationVector* out, int port, vtkMTimeType* mtime)
{
  if (!this->Superclass::ComputePipelineMTime(request, in, out, port, mtime))
    return 0;
  LastChange last;
  last.Of(this);
  Sources& from = *this->From;
  if (vtkRenderer* renderer = from.Renderer)
  {
    last.OfRenderer(renderer);
    if (vtkWindow* window = renderer->GetVTKWindow())
    {
      const int* size = window->GetSize();
      if (size[0] != from.SeenWindow[0] || size[1] != from.SeenWindow[1])
        from.WindowTime.Modified();
      std::copy_n(size, 2, from.SeenWindow);
    }
    last.Time = std::max(last.Time, from.WindowTime.GetMTime());
  }
  *mtime = std::max(*mtime, last.Time);
  return 1;
}

vtkTypeBool vtkQuellDataPathTraceSource::ProcessRequest(
  vtkInformation* request, vtkInformationVector** inInfo, vtkInformationVector* outInfo)
{
  // Both passes copy our time to the inputs first.
  if (request->Has(SDDP::REQUEST_UPDATE_TIME()) || request->Has(SDDP::REQUEST_UPDATE_EXTENT()))
  {
    // Ours are ticks, the data's are seconds.
    vtkInformation* out = outInfo->GetInformationObject(0);
    const double rate = this->Ticks.Rate > 0 ? this->Ticks.Rate : 1;
    if (out->Has(SDDP::UPDATE_TIME_STEP()))
      for (int i = 0; i < inInfo[0]->GetNumberOfInformationObjects(); ++i)
        inInfo[0]->GetInformationObject(i)->Set(SDDP::UPDATE_TIME_STEP(), out->Get(SDDP::UPDATE_TIME_STEP()) / rate);
  }
  return this->Superclass::ProcessRequest(request, inInfo, outInfo);
}

int vtkQuellDataPathTraceSource::RequestUpdateExtent(
  vtkInformation* request, vtkInformationVector** inInfo, vtkInformationVector* outInfo)
{
  // All of the data, whatever part of the picture is asked for; what is asked for are no arrays of the data.
  for (int i = 0; i < inInfo[0]->GetNumberOfInformationObjects(); ++i)
  {
    vtkInformation* info = inInfo[0]->GetInformationObject(i);
    REQUESTED_ARRAYS()->Write(info, {});
    if (info->Has(SDDP::WHOLE_EXTENT()))
    {
      int whole[6];
      info->Get(SDDP::WHOLE_EXTENT(), whole);
      info->Set(SDDP::UPDATE_EXTENT(), whole, 6);
    }
    info->Set(SDDP::UPDATE_PIECE_NUMBER(), 0);
    info->Set(SDDP::UPDATE_NUMBER_OF_PIECES(), 1);
    info->Set(SDDP::UPDATE_NUMBER_OF_GHOST_LEVELS(), 0);
  }
  return this->Superclass::RequestUpdateExtent(request, inInfo, outInfo);
}

void vtkQuellDataPathTraceSource::DescribeSource(int& width, int& height)
{
  if (!this->HasSources())
  {
    this->Superclass::DescribeSource(width, height);
    return;
  }
  int window[2] = { 0, 0 };
  if (vtkRenderer* renderer = this->From->Renderer)
    if (vtkWindow* of = renderer->GetVTKWindow())
    {
      const int* size = of->GetSize();
      const double* part = renderer->GetViewport();
      for (int i = 0; i < 2; ++i)
        window[i] = int(std::lround(size[i] * std::max(0., std::min(1., part[i + 2] - part[i]))));
    }
  const auto size = [](int own, int windows) { return own > 0 ? own : windows > 0 ? std::min(windows, 32768) : 256; };
  width = size(this->GetWidth(), window[0]);
  height = size(this->GetHeight(), window[1]);
}

void vtkQuellDataPathTraceSource::Execute(quell::StageFrame& frame)
{
  if (!this->HasSources())
  {
    this->Superclass::Execute(frame);
    return;
  }
  Sources& from = *this->From;
  const int tick = frame.Tick(), size[2] = { frame.Whole().width(), frame.Whole().height() };
  const double rate = this->Ticks.Rate > 0 ? this->Ticks.Rate : 1;
  std::vector<std::pair<vtkDataObject*, vtkMTimeType>> data;
  for (int i = 0; i < this->GetNumberOfInputConnections(0); ++i)
  {
    vtkDataObject* object = this->GetInputDataObject(0, i);
    data.emplace_back(object, object ? object->GetMTime() : 0);
  }
  const auto rendererTime = [&]()
  {
    LastChange last;
    if (from.Renderer)
      last.OfRenderer(from.Renderer);
    return last.Time;
  };
  const bool same = from.Scene && !from.Stale && data == from.Data && rendererTime() == from.RendererTime &&
                    size[0] == from.Size[0] && size[1] == from.Size[1] && rate == from.Rate;
  // Motion ends at the tick that it was recorded for; later ticks stand still.
  if (same && (tick == from.Tick || tick == from.Tick + 1 || !from.Scene->Animated()))
    from.Recorder.Repeat(tick);
  else
  {
    from.Scene = nullptr;
    try
    {
      from.Recorder.Begin(tick, rate);
      if (from.Renderer)
      {
        quell::RendererOptions options = from.Options;
        options.Width = size[0];
        options.Height = size[1];
        from.Recorder.AddRenderer(from.Renderer, options);
      }
      for (std::size_t i = 0; i < data.size(); ++i)
        from.Recorder.AddData(data[i].first, this->GetMaterial(int(i)));
      from.Scene = from.Recorder.Finish();
    }
    catch (const quell::SceneError& error)
    {
      throw quell::StageError(error.what());
    }
    ++from.Made;
    from.Stale = false;
    from.Data = std::move(data);
    from.RendererTime = rendererTime();
    std::copy_n(size, 2, from.Size);
    from.Rate = rate;
  }
  from.Tick = tick;
  this->SetScene(from.Scene);
  this->Superclass::Execute(frame);
  this->PaintBackground(frame);
}

void vtkQuellDataPathTraceSource::PaintBackground(quell::StageFrame& frame)
{
  const Sources& from = *this->From;
  vtkRenderer* renderer = from.Renderer;
  const bool sky = from.Scene->Sky.Present || !this->GetEnvironment().empty() || this->GetDefaultSky() == Always ||
                   (this->GetDefaultSky() == WhenDark && !from.Scene->HasLight());
  if (!renderer || sky)
    return;
  const auto color = [&](const double* c) {
    return quell::detail::LinearFromDisplay({ c[0], c[1], c[2] }, from.Options.DisplayColors);
  };
  const quell::Vec3d bottom = color(renderer->GetBackground());
  const quell::Vec3d top = renderer->GetGradientBackground() ? color(renderer->GetBackground2()) : bottom;
  if (bottom == quell::Vec3d() && top == quell::Vec3d())
    return;
  const quell::ImageOut alpha = frame.Output("alpha");
  std::vector<quell::ImageOut> images;
  for (const char* name : { "radiance", "emission", "halfA", "halfB" })
    if (const quell::ImageOut image = frame.Output(name))
      images.push_back(image);
  if (images.empty())
    return;
  if (!alpha)
  {
    this->Warnings.push_back("the background is left out: keep \"alpha\" among the arrays of SetAlwaysMake");
    return;
  }
  const quell::Rect region = frame.Region();
  for (int y = region.y0; y < region.y1; ++y)
  {
    const double t = (y + 0.5) / frame.Whole().height();
    const quell::Vec3d behind = bottom * (1 - t) + top * t;
    for (int x = region.x0; x < region.x1; ++x)
    {
      const double free = 1 - double(*alpha.at(x, y));
      for (const quell::ImageOut& image : images)
        for (int c = 0; c < 3; ++c)
          image.at(x, y)[c] = float(image.at(x, y)[c] + free * behind[c]);
    }
  }
}
