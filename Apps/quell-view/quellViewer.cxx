// SPDX-License-Identifier: BSD-3-Clause
// The frame around the panels: menus, shortcuts, dialogs, and what is asked of the session.
#include "quellViewer.h"

#include "quellImageFile.h"
#include "quellPipelineReader.h"
#include "quellUi.h"
#include "vtkImageData.h"
#include "vtkPointData.h"

#include <imgui_internal.h>
#include <imgui_stdlib.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>

namespace fs = std::filesystem;

namespace quell
{
namespace
{
std::string LowerExtension(const std::string& file)
{
  std::string e = fs::path(file).extension().string();
  std::transform(e.begin(), e.end(), e.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  return e;
}

bool IsPicture(const std::string& file)
{
  static const std::set<std::string> kinds{ ".exr", ".hdr", ".png", ".jpg", ".jpeg", ".ppm", ".pfm", ".pgm" };
  return kinds.count(LowerExtension(file)) != 0;
}
bool IsScene(const std::string& file)
{
  static const std::set<std::string> kinds{ ".gltf", ".glb", ".obj" };
  return kinds.count(LowerExtension(file)) != 0;
}

}

std::string Viewer::DataDirectory()
{
  std::error_code ec;
  if (const char* dir = std::getenv("QUELL_DATA_DIR"))
  {
    return dir;
  }
  const fs::path program = fs::read_symlink("/proc/self/exe", ec);
  const fs::path installed = program.parent_path().parent_path() / "share/quell";
  return fs::is_directory(installed, ec) ? installed.string() : std::string(QUELL_SOURCE_DATA_DIR);
}

Viewer::Viewer(Window& window, const StageRegistry& registry, const Options& options)
  : Win(window)
  , Registry(registry)
  , Given(options)
  , Scale(window.Scale())
  , Doc(&registry)
  , Session(new RenderSession(registry))
  , Present(new Presenter)
  , Views(DisplayMapper::Views())
{
  ApplyStyle(float(this->Scale));
  this->Remembered.Load(options.SettingsFile);
  this->GraphFraction = float(this->Remembered.Number("layout.graph", 0.4, 0.05, 0.9));
  this->RightFraction = float(this->Remembered.Number("layout.right", 0.27, 0.05, 0.9));
  this->RightTab = this->WantedTab = this->Remembered.Text("layout.tab", "Node");
  this->Display.View = this->Remembered.Text("display.view");
  if (std::find(this->Views.begin(), this->Views.end(), this->Display.View) == this->Views.end())
  {
    this->Display.View = this->Views.empty() ? std::string() : this->Views.front();
  }
  if (!options.Reference.empty())
  {
    this->FileChosen("reference", options.Reference);
  }
}

Viewer::~Viewer()
{
  this->Remembered.Set("layout.graph", double(this->GraphFraction));
  this->Remembered.Set("layout.right", double(this->RightFraction));
  this->Remembered.Set("layout.tab", this->RightTab);
  this->Remembered.Set("display.view", this->Display.View);
  if (this->Win.Width() > 200 && this->Win.Height() > 200)
  {
    this->Remembered.Set("window.width", this->Win.Width());
    this->Remembered.Set("window.height", this->Win.Height());
  }
  this->Remembered.Save();
  this->Ledger.reset();
  this->Present.reset();
  this->Session.reset();
  this->TextureA.Release();
  this->TextureB.Release();
  this->TextureMap.Release();
  this->TextureWeights.Release();
}

// ---- documents ------------------------------------------------------------------------------------------------------
void Viewer::Tell(const std::string& text, bool isError)
{
  this->Message = text;
  this->MessageIsError = isError;
  this->MessageUntil = ImGui::GetTime() + (isError ? 8 : 4);
  this->MessageOf = this->Doc.Revision();
}

std::string Viewer::RelativeToFile(const std::string& path) const
{
  std::error_code ec;
  const fs::path base =
    this->Doc.HasFile() ? fs::absolute(fs::path(this->Doc.File()), ec).parent_path() : fs::current_path(ec);
  const fs::path full = fs::absolute(path, ec);
  const fs::path relative = full.lexically_relative(base);
  // A way up to the root and down again says less than the whole path.
  const std::string text = relative.generic_string();
  return relative.empty() || std::count(text.begin(), text.end(), '.') > 12 ? full.generic_string() : text;
}

void Viewer::New()
{
  this->Doc.Clear();
  this->A = this->B = ViewTarget();
  this->Lost.clear();
  this->LastDocument.reset();
  this->ShownOf.clear();
  this->KnownTicks = Timeline();
  this->Revealed.clear();
  this->Scope.clear();
  this->Selected.clear();
  this->Expanded.clear();
  this->Shown.reset();
  this->LastGood.reset();
  this->Camera.reset();
  this->SetB.reset();
  this->ShownB.reset();
  this->GoodB.reset();
  this->SessionB.reset();
  if (this->BFrom == SourceB::Parameters)
  {
    this->BFrom = SourceB::Reference;
    this->Compared = CompareMode::Off;
  }
  this->Points.Clear();
  this->Ledger.reset();
  this->OpenErrors.clear();
  this->OpenErrorFile.clear();
  this->Tick = 0;
  this->Playing = false;
  this->ShowWelcome = false;
  this->GraphWantsFit = true;
  this->FitImage = true;
  this->PixelPinned = false;
  this->AllArrays = false;
  this->Given.Graph = GraphOptions();
}

bool Viewer::Open(const std::string& file)
{
  if ((IsScene(file) || IsPicture(file)) && this->OnErrorPage())
  {
    // It would be added to a graph that nobody sees.
    if (!this->Doc.Nodes("").empty() || this->Doc.HasFile() || this->Doc.IsDirty())
    {
      this->Tell(fs::path(file).filename().string() +
                   " was not taken: it would change the pipeline behind this page. Go back first, then drop it again",
        true);
      return false;
    }
    this->OpenErrors.clear();
    this->OpenErrorFile.clear();
  }
  std::error_code ec;
  const std::string extension = LowerExtension(file);
  if (IsScene(file))
  {
    // Into the document that is open: its path tracer shows the scene, or a new one does.
    for (const PipelineNode& n : this->Doc.Nodes(""))
    {
      if (n.Type.Value == "PathTraceSource")
      {
        const PipelineText* now = this->Doc.FindProperty("", n.Id.Value, "Scene");
        const std::string path = this->RelativeToFile(file);
        if (now && now->Value.compare(0, 2, "$(") == 0 && now->Value.back() == ')')
        {
          const std::string variable = now->Value.substr(2, now->Value.size() - 3);
          this->Doc.SetVariable(variable, path);
          this->DropGivenVariable(variable);
        }
        else
        {
          this->Doc.SetProperty("", n.Id.Value, "Scene", path);
        }
        this->DropGivenProperty("", n.Id.Value, "Scene");
        this->Camera.reset();
        this->Tell(n.Id.Value + " shows " + fs::path(file).filename().string());
        return true;
      }
    }
    const ImVec2 at = this->ToGraph(ImVec2((this->GraphMin.x + this->GraphMax.x) / 2 - this->S(90),
      (this->GraphMin.y + this->GraphMax.y) / 2 - this->S(40)));
    const std::string id = this->Doc.AddNode("", "PathTraceSource", double(at.x), double(at.y));
    this->Doc.SetProperty("", id, "Scene", this->RelativeToFile(file));
    this->ShowWelcome = false;
    this->SelectTarget(id, "radiance");
    return true;
  }
  if (IsPicture(file))
  {
    // A picture with a pipeline in it can be the pipeline; as a drop it is an image to look at.
    std::string first;
    try
    {
      const ReadReport header = ReadImageHeader(file);
      const auto pipeline = header.Metadata.find("pipeline");
      // Without radiance what it does hold is shown.
      const auto isRadiance = [](const FileArray& a) { return a.Name == "radiance"; };
      if (!header.Arrays.empty() && std::none_of(header.Arrays.begin(), header.Arrays.end(), isRadiance))
      {
        first = header.Arrays.front().Name;
      }
      if (pipeline != header.Metadata.end() && this->Doc.Nodes("").empty())
      {
        Diagnostics messages;
        auto document = ReadPipelineText(pipeline->second, file, messages);
        if (!messages.HasErrors())
        {
          this->New();
          this->Doc.Set(document);
          this->Points.Clear(this->Doc.Get());
          this->Tell("opened the pipeline in " + fs::path(file).filename().string());
          return true;
        }
      }
    }
    catch (const StageError& e)
    {
      this->OpenErrors.clear();
      Diagnostic d;
      d.Place.File = file;
      d.What = e.what();
      this->OpenErrors.push_back(d);
      this->OpenErrorFile = file;
      return false;
    }
    const ImVec2 at = this->ToGraph(ImVec2((this->GraphMin.x + this->GraphMax.x) / 2 - this->S(90),
      (this->GraphMin.y + this->GraphMax.y) / 2 - this->S(40)));
    const std::string id = this->Doc.AddNode("", "ImageReader", double(at.x), double(at.y), "image");
    this->Doc.SetProperty("", id, "File", this->RelativeToFile(file));
    this->ShowWelcome = false;
    this->SelectTarget(id, first);
    return true;
  }
  std::vector<Diagnostic> messages;
  EditDocument opened(&this->Registry);
  if (!opened.Open(file, messages))
  {
    this->OpenErrors = messages;
    this->OpenErrorFile = file;
    this->Remembered.RemoveRecent(file);
    return false;
  }
  const GraphOptions options = this->Given.Graph;
  this->New();
  this->Given.Graph = options;
  this->Doc = std::move(opened);
  this->Points.Clear(this->Doc.Get());
  if (this->Doc.Nodes("").empty() && !this->Doc.Get()->Templates.empty())
  {
    this->EnterScope(this->Doc.Get()->Templates.front().Name.Value); // a library
    this->WantedTab = "Pipeline";
  }
  this->Remembered.AddRecent(file);
  this->Remembered.Save();
  return true;
}

void Viewer::Save(bool as)
{
  if (as || !this->Doc.HasFile())
  {
    this->OpenFileDialog("save", "Save the pipeline as", ".xml");
    return;
  }
  if (this->Doc.ChangedOnDisk())
  {
    this->AskChanged = true;
    return;
  }
  this->SaveHere();
}

void Viewer::SaveHere()
{
  std::string error;
  if (this->Doc.Save(this->Doc.File(), error))
  {
    this->Tell("saved " + this->Doc.File());
    if (!this->PendingAction.empty())
    {
      this->Perform(this->PendingAction);
    }
  }
  else
  {
    this->Tell(error, true);
    this->PendingAction.clear();
  }
}

void Viewer::AskToClose(const std::string& action)
{
  if (this->Doc.IsDirty())
  {
    this->PendingAction = action;
    this->AskUnsaved = true;
    return;
  }
  this->Perform(action);
}

void Viewer::Perform(std::string action)
{
  this->PendingAction.clear();
  if (action == "quit")
  {
    this->Win.Close();
  }
  else if (action == "new")
  {
    this->New();
  }
  else if (action == "open")
  {
    this->OpenFileDialog("open", "Open a pipeline, a picture or a scene", ".xml .exr .gltf .glb .obj .hdr .png .jpg");
  }
  else if (action.compare(0, 5, "file:") == 0)
  {
    this->Open(action.substr(5));
  }
}

void Viewer::OpenFileDialog(const std::string& purpose, const std::string& title, const std::string& extensions)
{
  this->DialogPurpose = purpose;
  this->DialogTitle = title;
  this->DialogExtensions = extensions;
  this->DialogOpen = true;
  this->DialogFocus = true;
  this->DialogNote.clear();
  std::error_code ec;
  if (this->DialogDirectory.empty())
  {
    this->DialogDirectory = this->Remembered.Text("dialog.directory");
    if (!fs::is_directory(this->DialogDirectory, ec))
    {
      this->DialogDirectory = fs::current_path(ec).string();
    }
  }
  if (this->Doc.HasFile())
  {
    const fs::path parent = fs::absolute(this->Doc.File(), ec).parent_path();
    if (fs::is_directory(parent, ec) && purpose != "reference")
    {
      this->DialogDirectory = parent.string();
    }
  }
  this->DialogName = purpose == "save"
                       ? (this->Doc.HasFile() ? fs::path(this->Doc.File()).filename().string() : "pipeline.xml")
                       : std::string();
}

void Viewer::FileChosen(const std::string& purpose, const std::string& file)
{
  if (purpose == "open")
  {
    this->Open(file);
  }
  else if (purpose == "save")
  {
    std::string error;
    const std::string name = fs::path(file).extension().empty() ? file + ".xml" : file;
    if (this->Doc.Save(name, error))
    {
      this->Remembered.AddRecent(name);
      this->Tell("saved " + name);
      if (!this->PendingAction.empty())
      {
        this->Perform(this->PendingAction);
      }
    }
    else
    {
      // The name is there to be corrected.
      this->OpenFileDialog("save", "Save the pipeline as", ".xml");
      this->DialogDirectory = fs::path(file).parent_path().string();
      this->DialogName = fs::path(file).filename().string();
      this->DialogNote = error;
    }
  }
  else if (purpose == "reference")
  {
    try
    {
      ReadReport report;
      this->Reference.Image = ReadImageFile(file, &report);
      this->Reference.Array.clear();
      for (const FileArray& a : report.Arrays)
      {
        if (a.Name == "radiance")
        {
          this->Reference.Array = a.Name;
        }
      }
      if (this->Reference.Array.empty() && !report.Arrays.empty())
      {
        this->Reference.Array = report.Arrays.front().Name;
      }
      this->Reference.Kind = KindOf(this->Reference.Array, 3);
      this->ReferenceFile = file;
      std::error_code ec;
      const auto written = fs::last_write_time(file, ec).time_since_epoch().count();
      this->ReferenceKey = fs::weakly_canonical(file, ec).string() + " " + std::to_string(written);
      this->ReferenceError.clear();
      this->BFrom = SourceB::Reference;
    }
    catch (const StageError& e)
    {
      this->ReferenceError = e.what();
      this->Tell(e.what(), true);
    }
  }
  else if (purpose.compare(0, 9, "property:") == 0)
  {
    const std::string rest = purpose.substr(9);
    const std::size_t dot = rest.rfind('.');
    this->Doc.SetProperty(this->Scope, rest.substr(0, dot), rest.substr(dot + 1), this->RelativeToFile(file));
    this->DropGivenProperty(this->Scope, rest.substr(0, dot), rest.substr(dot + 1));
  }
  else if (purpose.compare(0, 7, "output:") == 0)
  {
    // What a run writes is named as seen from where it runs.
    const std::string rest = purpose.substr(7);
    const std::size_t dot = rest.rfind('.');
    this->Doc.SetProperty(this->Scope, rest.substr(0, dot), rest.substr(dot + 1), file);
    this->DropGivenProperty(this->Scope, rest.substr(0, dot), rest.substr(dot + 1));
  }
  else if (purpose.compare(0, 9, "variable:") == 0)
  {
    this->Doc.SetVariable(purpose.substr(9), this->RelativeToFile(file));
    this->DropGivenVariable(purpose.substr(9));
  }
  else if (purpose == "picture")
  {
    try
    {
      if (const std::shared_ptr<const ViewFrame> frame = this->LastGood)
      {
        const ViewTarget target = ResolveTarget(*frame->Document, this->A);
        if (vtkImageData* image = frame->Image(target.Node))
        {
          const std::string name = fs::path(file).extension().empty() ? file + ".exr" : file;
          WriteImageFile(name, image);
          this->Tell("wrote " + name);
        }
      }
    }
    catch (const StageError& e)
    {
      this->Tell(e.what(), true);
    }
  }
}

// ---- what is asked of the session -----------------------------------------------------------------------------------
void Viewer::SelectTarget(const std::string& node, const std::string& array)
{
  this->A = { node, array };
  this->Lost.clear();
  this->HurryNext = true;
}

bool Viewer::Exists(const ViewTarget& target) const
{
  return this->Doc.FindNode("", TopOf(target.Node)) != nullptr;
}

/// What the node's first input read, as far up as there still is something.
ViewTarget Viewer::InputOf(const ViewTarget& lost) const
{
  ViewTarget at = lost;
  std::set<std::string> seen;
  while (this->LastDocument && !this->Exists(at) && seen.insert(TopOf(at.Node)).second)
  {
    const std::vector<PipelineNode>& nodes = this->LastDocument->Nodes;
    const auto node =
      std::find_if(nodes.begin(), nodes.end(), [&at](const PipelineNode& n) { return n.Id.Value == TopOf(at.Node); });
    if (node == nodes.end() || node->Inputs.empty())
    {
      return {};
    }
    at.Node = NodeOfReference(node->Inputs.front().From.Value, &at.Array);
  }
  return !at.Node.empty() && this->Exists(at) ? at : ViewTarget();
}

void Viewer::ChooseDefaultTarget()
{
  const PipelineDocument& d = *this->Doc.Get();
  if (!this->Lost.empty() && this->Exists(this->Lost.back()))
  {
    this->A = this->Lost.back();
    this->Lost.pop_back();
    return;
  }
  if (!this->A.Node.empty())
  {
    if (this->Exists(this->A))
    {
      return;
    }
    // Undo of a rename or of a template made of nodes: what was shown had another name.
    const auto before = this->ShownOf.find(this->Doc.Get());
    if (before != this->ShownOf.end() && this->Exists(before->second))
    {
      this->A = before->second;
      return;
    }
    const ViewTarget lost = this->A;
    this->A = this->InputOf(lost);
    this->Lost.push_back(lost);
    if (!this->A.Node.empty())
    {
      return;
    }
  }
  if (!this->Given.Show.empty())
  {
    std::string array;
    const std::string node = NodeOfReference(this->Given.Show, &array);
    this->A = { node.empty() ? this->Given.Show : node, array };
    for (const PipelineOutput& o : d.Outputs)
    {
      if (o.Name.Value == this->Given.Show)
      {
        const std::string from = NodeOfReference(o.From.Value, &array);
        this->A = { from, array };
      }
    }
    this->Given.Show.clear();
    return;
  }
  for (const PipelineOutput& o : d.Outputs)
  {
    std::string array;
    const std::string node = NodeOfReference(o.From.Value, &array);
    if (!node.empty())
    {
      this->A = { node, array };
      return;
    }
  }
  // Without an output the last node that nobody reads is what all others are for.
  std::set<std::string> read;
  for (const PipelineNode& n : d.Nodes)
  {
    for (const PipelineInput& i : n.Inputs)
    {
      read.insert(TopOf(NodeOfReference(i.From.Value)));
    }
  }
  for (const PipelineNode& n : d.Nodes)
  {
    if (this->A.Node.empty() || !read.count(n.Id.Value))
    {
      this->A = { n.Id.Value, "" };
    }
  }
}

void Viewer::UpdateWish()
{
  if (this->Doc.Get()->Nodes.empty())
  {
    // Nothing of the graph that was here stays on the screen.
    this->Shown.reset();
    this->LastGood.reset();
    this->Checked.reset();
    this->Presented.reset();
    this->TexturesOf = 0;
    return;
  }
  this->ChooseDefaultTarget();
  this->LastDocument = this->Doc.Get();
  this->ShownOf[this->LastDocument] = this->A;
  if (this->ShownOf.size() > 512)
  {
    for (auto i = this->ShownOf.begin(); i != this->ShownOf.end();)
    {
      i = i->first.expired() ? this->ShownOf.erase(i) : std::next(i);
    }
  }
  ViewWish w;
  w.Document = this->Doc.Get();
  w.Options = this->Given.Graph;
  // --set of a node that was deleted here is no mistake; the node may come back.
  GraphOptions::Assignments& sets = w.Options.Properties;
  sets.erase(std::remove_if(sets.begin(), sets.end(),
               [this](const auto& p)
               {
                 const std::string id = TopOf(p.first.substr(0, p.first.rfind('.')));
                 return id.find(':') == std::string::npos && !this->Doc.FindNode("", id);
               }),
    sets.end());
  w.Tick = this->Given.Frame ? *this->Given.Frame : this->Tick;
  w.Targets.push_back(ResolveTarget(*w.Document, this->A));
  if (this->Compared != CompareMode::Off && this->BFrom == SourceB::Node && !this->B.Node.empty())
  {
    const ViewTarget b = ResolveTarget(*w.Document, this->B);
    if (b != w.Targets.front())
    {
      w.Targets.push_back(b);
    }
  }
  if (this->CameraMode && this->LastGood)
  {
    // What a drag turns around.
    const auto known = this->LastGood->Arrays.find(w.Targets.front().Node);
    if (known != this->LastGood->Arrays.end() &&
        std::any_of(known->second.begin(), known->second.end(), [](const OutputArray& a) { return a.Name == "depth"; }))
    {
      w.Targets.push_back({ w.Targets.front().Node, "depth" });
    }
  }
  w.AllArrays = this->WantAllArrays;
  w.History = this->History;
  w.Play = this->Playing;
  w.Loop = this->Looping;
  w.PlayRate = this->Checked ? this->KnownTicks.Rate : 24;
  w.Refine = this->Refine;
  w.Paused = this->Paused;
  w.Camera = this->Camera;
  w.CameraSerial = this->CameraSerial;
  w.Hurry = this->HurryNext;
  this->WishSerial = this->Session->Wish(w);
  this->HurryNext = true;
  if (this->SetB && this->Compared != CompareMode::Off && this->BFrom == SourceB::Parameters)
  {
    if (!this->SessionB)
    {
      this->SessionB.reset(new RenderSession(this->Registry));
    }
    w.Document = this->SetB;
    w.Targets.resize(1);
    w.Targets[0] = ResolveTarget(*w.Document, this->A);
    w.AllArrays = false;
    // A plays; B follows frame by frame.
    w.Play = false;
    this->SessionB->Wish(w);
  }
}

void Viewer::PutParametersAside()
{
  if (!this->Doc.Nodes("").empty())
  {
    this->SetB = this->Doc.Get();
    this->GoodB = this->LastGood; // that is what it looks like until it ran itself
    this->BFrom = SourceB::Parameters;
    this->Compared = this->Compared == CompareMode::Off ? CompareMode::Wipe : this->Compared;
    this->Tell("these parameters are set B; change some, and compare");
  }
}

void Viewer::SwapParameters()
{
  if (this->SetB)
  {
    const std::shared_ptr<const PipelineDocument> now = this->Doc.Get();
    this->Doc.Replace("swap the parameter sets", this->SetB);
    this->SetB = now;
    this->BFrom = SourceB::Parameters;
  }
}

std::string Viewer::NameOfSetB() const
{
  if (!this->SetB || this->SetB == this->Doc.Get() || *this->SetB == *this->Doc.Get())
  {
    return "set B, the same as A";
  }
  return "set B: " + ChangeText(*this->Doc.Get(), *this->SetB);
}

void Viewer::TakeResults()
{
  if (this->Doc.Get()->Nodes.empty())
  {
    return;
  }
  this->Checked = this->Session->Checked();
  // A mistake that keeps the pipeline from being built says nothing about its frames: the place in time stays.
  if (this->Checked && (this->Checked->Errors == 0 || this->Checked->Ticks.Count > 1 || this->KnownTicks.Count <= 1))
  {
    this->KnownTicks = this->Checked->Ticks;
  }
  const std::shared_ptr<const ViewFrame> latest = this->Session->Latest();
  if (latest && latest != this->Shown)
  {
    this->Shown = latest;
    if (latest->Ok)
    {
      this->LastGood = latest;
      for (const ViewFrame::Node& n : latest->Nodes)
      {
        if (n.Counters.Executions > 0)
        {
          this->Points.Learn(n.Path, n.Counters.Seconds, n.Counters.Rays);
        }
      }
      if (this->Playing && !this->Camera)
      {
        this->Tick = latest->Tick;
      }
    }
    if (latest->Serial == this->WishSerial && this->Given.Frame)
    {
      this->Tick = *this->Given.Frame;
      this->Given.Frame.reset();
    }
  }
  if (this->Playing && !this->Looping && this->Checked &&
      this->Tick >= this->KnownTicks.First + this->KnownTicks.Count - 1 && this->Session->Idle())
  {
    this->Playing = false;
  }
  if (this->SessionB)
  {
    const std::shared_ptr<const ViewFrame> other = this->SessionB->Latest();
    if (other && other != this->ShownB)
    {
      this->ShownB = other;
      this->GoodB = other->Ok ? other : this->GoodB;
    }
  }
  this->WeighPinned();
  this->Weighed = this->Session->Weights();
  PresentWish p;
  if (this->LastGood)
  {
    p.A = this->PictureOf(this->A);
    if (this->Compared != CompareMode::Off)
    {
      p.B = this->PictureB();
    }
  }
  p.Display = this->Display;
  p.Map = this->Compared == CompareMode::Difference ? CompareMap::Difference
          : this->Compared == CompareMode::Signed   ? CompareMap::SignedDifference
          : this->Compared == CompareMode::Relative ? CompareMap::RelativeError
          : this->Compared == CompareMode::FlipMap  ? CompareMap::Flip
                                                    : CompareMap::None;
  p.Gain = double(this->Gain);
  p.WantHistogram = this->RightTab == "Compare";
  // A lamp is a thousand times as bright as what it shines on, and variances spread as far.
  const DisplayStyle style =
    p.A ? StyleOf(p.A.Kind, ArrayView(p.A.Image, p.A.Array).components) : DisplayStyle::Automatic;
  p.LogHistogram =
    this->LogHistogram ? *this->LogHistogram : style == DisplayStyle::View || style == DisplayStyle::LogHeat;
  p.Reference = this->Reference;
  if (this->Reference && (this->RightTab == "Compare" || this->RightTab == "Trade"))
  {
    p.Metrics = { "relMSE", "MAE", "PSNR", "SSIM", "FLIP" };
    if (this->Playing || this->Camera)
    {
      p.Metrics = { "relMSE", "MAE", "PSNR" }; // the others take longer than a frame
    }
  }
  this->PresentSerial = this->Present->Wish(p);
  const std::shared_ptr<const Presentation> now = this->Present->Latest();
  if (now != this->Presented)
  {
    this->Presented = now;
    if (now)
    {
      // What is published in two steps has its pictures in the first and its map in the second.
      if (now->Serial != this->TexturesOf)
      {
        this->TextureA.Upload(this->Win.Get(), now->A);
        this->TextureB.Upload(this->Win.Get(), now->B);
        this->TexturesOf = now->Serial;
        ++this->Uploads;
      }
      if (now->Map.Width > 0 || this->TextureMap.Width() > 0)
      {
        this->TextureMap.Upload(this->Win.Get(), now->Map);
        ++this->Uploads;
      }
    }
    if (now && now->Complete)
    {
      this->AddTradePoint();
    }
  }
}

bool Viewer::IsIdle() const
{
  if (this->Doc.Get()->Nodes.empty())
  {
    return true;
  }
  return this->Session->Idle() && this->Session->Latest() == this->Shown && this->Session->Weights() == this->Weighed &&
         this->Present->Idle() && this->Present->Latest() == this->Presented &&
         (!this->Presented || this->Presented->Serial == this->PresentSerial) &&
         (!this->SessionB || (this->SessionB->Idle() && this->SessionB->Latest() == this->ShownB)) &&
         (!this->Ledger || this->Ledger->Finished());
}

bool Viewer::HasNews() const
{
  return !this->Doc.Get()->Nodes.empty() &&
         (this->Session->Latest() != this->Shown || this->Present->Latest() != this->Presented ||
           this->Session->Checked() != this->Checked || this->Session->Weights() != this->Weighed ||
           (this->SessionB && this->SessionB->Latest() != this->ShownB));
}

bool Viewer::IsWorking() const
{
  return !this->Doc.Get()->Nodes.empty() &&
         (!this->Session->Idle() || !this->Present->Idle() || (this->SessionB && !this->SessionB->Idle()) ||
           (this->Ledger && !this->Ledger->Finished()));
}

std::string Viewer::ErrorText() const
{
  if (!this->OpenErrors.empty())
  {
    return this->OpenErrors.front().ToText();
  }
  return this->Shown && !this->Shown->Ok ? this->Shown->Error : std::string();
}

// ---- widgets --------------------------------------------------------------------------------------------------------
void Viewer::MarkRect(const std::string& name, const ImVec2& a, const ImVec2& b)
{
  this->ThisMarks[name] = ImVec4(a.x, a.y, b.x, b.y);
}

void Viewer::Mark(const std::string& name)
{
  if (ImGui::IsItemVisible())
  {
    this->MarkRect(name, ImGui::GetItemRectMin(), ImGui::GetItemRectMax());
  }
}

void Viewer::Tooltip(const std::string& text)
{
  if (ImGui::IsItemHovered(ImGuiHoveredFlags_AllowWhenDisabled) && !text.empty() && !ImGui::IsMouseDown(0))
  {
    ShowTooltip(text, this->S(360));
  }
}

bool Viewer::Button(const char* label, const std::string& mark, const char* tooltip, bool enabled)
{
  ImGui::BeginDisabled(!enabled);
  const bool pressed = ImGui::Button(label);
  ImGui::EndDisabled();
  this->Mark(mark);
  if (tooltip)
  {
    this->Tooltip(tooltip);
  }
  return pressed;
}

/// Within a menu: Dear ImGui alone closes it by a click beside it.
void Viewer::CloseMenuOnEscape()
{
  if (this->Win.Pressed("Escape"))
  {
    ImGui::CloseCurrentPopup();
  }
}

void Viewer::Splitter(const char* name, bool vertical, float& fraction, float from, float to, float lo, float hi)
{
  const float thick = this->S(5);
  const float at = to - fraction * (to - from);
  const ImVec2 a = vertical ? ImVec2(at - thick / 2, lo) : ImVec2(lo, at - thick / 2);
  const ImVec2 b = vertical ? ImVec2(at + thick / 2, hi) : ImVec2(hi, at + thick / 2);
  ImGui::SetNextWindowPos(a);
  ImGui::SetNextWindowSize(ImVec2(b.x - a.x, b.y - a.y));
  ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, ImVec2(0, 0));
  ImGui::PushStyleVar(ImGuiStyleVar_WindowMinSize, ImVec2(1, 1));
  ImGui::PushStyleColor(ImGuiCol_WindowBg, Colors::Background);
  ImGui::Begin((std::string("##splitter") + name).c_str(), nullptr,
    ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoSavedSettings |
      ImGuiWindowFlags_NoNavFocus | ImGuiWindowFlags_NoFocusOnAppearing);
  ImGui::InvisibleButton("grip", ImVec2(b.x - a.x, b.y - a.y));
  this->Mark(std::string("splitter/") + name);
  if (ImGui::IsItemActive())
  {
    const float mouse = vertical ? ImGui::GetIO().MousePos.x : ImGui::GetIO().MousePos.y;
    fraction = std::min(0.85f, std::max(0.1f, (to - mouse) / std::max(1.f, to - from)));
  }
  if (ImGui::IsItemHovered() || ImGui::IsItemActive())
  {
    ImGui::GetWindowDrawList()->AddRectFilled(a, b, ImGui::GetColorU32(Colors::Accent));
    ImGui::SetMouseCursor(vertical ? ImGuiMouseCursor_ResizeEW : ImGuiMouseCursor_ResizeNS);
  }
  ImGui::End();
  ImGui::PopStyleColor();
  ImGui::PopStyleVar(2);
}

// ---- shortcuts ------------------------------------------------------------------------------------------------------
void Viewer::Shortcuts()
{
  const Window& w = this->Win;
  const bool typing = ImGui::GetIO().WantTextInput;
  if (w.Pressed("F1") || (!typing && (w.Pressed("question", false, true) || w.Pressed("question"))))
  {
    this->ShowHelp = !this->ShowHelp;
  }
  if (w.Pressed("Escape"))
  {
    if (this->ShowHelp)
    {
      this->ShowHelp = false;
    }
    else if (this->PaletteOpen)
    {
      this->PaletteOpen = false;
    }
    else if (!typing && this->Session && !this->Session->Idle())
    {
      this->Playing = false;
      this->Session->Cancel();
      if (this->SessionB)
      {
        this->SessionB->Cancel();
      }
      this->Paused = false;
      this->Tell("stopped; change something or press R to run it again");
    }
  }
  if (this->DialogOpen || this->AskUnsaved || this->AskChanged)
  {
    return;
  }
  // The page about a file covers a graph: what would change or save that waits until it is seen again.
  const bool save = w.Pressed("s", true), saveAs = w.Pressed("s", true, true);
  if ((save || saveAs) && this->OnErrorPage())
  {
    this->Tell("nothing saved: go back to the pipeline first", true);
  }
  else if (save || saveAs)
  {
    this->Save(saveAs);
  }
  if (w.Pressed("o", true))
  {
    this->AskToClose("open");
  }
  if (w.Pressed("n", true))
  {
    this->AskToClose("new");
  }
  if (w.Pressed("q", true))
  {
    this->AskToClose("quit");
  }
  if (typing || this->OnErrorPage())
  {
    return;
  }
  if (w.Pressed("z", true))
  {
    this->Doc.Undo();
  }
  if (w.Pressed("y", true) || w.Pressed("z", true, true))
  {
    this->Doc.Redo();
  }
  if (w.Pressed("c", true))
  {
    this->CopySelection(false);
  }
  if (w.Pressed("x", true))
  {
    this->CopySelection(true);
  }
  if (w.Pressed("v", true))
  {
    this->Paste();
  }
  if (w.Pressed("d", true))
  {
    this->DuplicateSelection();
  }
  if (w.Pressed("a", true))
  {
    this->Selected.clear();
    for (const GraphBox& b : this->Model.Boxes)
    {
      this->Selected.insert(b.Id);
    }
  }
  if (w.Pressed("Delete") || w.Pressed("BackSpace"))
  {
    this->DeleteSelection(false);
  }
  if (w.Pressed("Delete", true) || w.Pressed("BackSpace", true))
  {
    this->DeleteSelection(true);
  }
  if (w.Pressed("F2") && this->Selected.size() == 1)
  {
    this->BeginRename(*this->Selected.begin());
  }
  if (w.Pressed("l"))
  {
    this->ArrangeAll();
  }
  if (w.Pressed("a"))
  {
    this->FitGraph();
  }
  if (w.Pressed("f"))
  {
    this->FitImage = true;
  }
  if (w.Pressed("1"))
  {
    this->FitImage = false;
    this->Zoom = 1;
  }
  if (w.Pressed("space"))
  {
    this->Camera.reset();
    this->Playing = !this->Playing;
  }
  if (w.Pressed("Left"))
  {
    this->Playing = false;
    this->Camera.reset();
    this->Tick = std::max(this->KnownTicks.First, this->Tick - 1);
  }
  if (w.Pressed("Right"))
  {
    this->Playing = false;
    this->Camera.reset();
    const int last = this->KnownTicks.First + std::max(1, this->KnownTicks.Count) - 1;
    this->Tick = std::min(last, this->Tick + 1);
  }
  if (w.Pressed("Home"))
  {
    this->Playing = false;
    this->Camera.reset();
    this->Tick = this->KnownTicks.First;
  }
  if (w.Pressed("End"))
  {
    this->Playing = false;
    this->Camera.reset();
    this->Tick = this->KnownTicks.First + std::max(1, this->KnownTicks.Count) - 1;
  }
  if (w.Pressed("r"))
  {
    this->Paused = false;
    ++this->CameraSerial;
  }
  if (w.Pressed("c"))
  {
    this->CameraMode = !this->CameraMode;
  }
  if (w.Pressed("h"))
  {
    this->Camera.reset();
  }
  if (w.Pressed("w"))
  {
    this->Compared = this->Compared == CompareMode::Wipe ? CompareMode::Off : CompareMode::Wipe;
  }
  if (w.Pressed("d"))
  {
    this->Compared = this->Compared == CompareMode::Difference ? CompareMode::Off : CompareMode::Difference;
  }
  if (w.Pressed("x"))
  {
    if (this->Compared != CompareMode::Flip)
    {
      this->Compared = CompareMode::Flip;
      this->FlipShowsB = true;
    }
    else
    {
      this->FlipShowsB = !this->FlipShowsB;
    }
  }
  if (w.Pressed("p"))
  {
    this->PutParametersAside();
  }
  if (w.Pressed("p", false, true))
  {
    this->SwapParameters();
  }
  if (w.Pressed("g", true))
  {
    this->AskForTemplate();
  }
  if (w.Pressed("k") && this->LastGood)
  {
    this->Kept = this->PictureOf(this->A);
    this->KeptName = this->A.Node + (this->A.Array.empty() ? "" : ":" + this->A.Array);
    this->KeptTick = this->Tick;
    this->BFrom = SourceB::Kept;
    this->Tell("put " + this->KeptName + " aside as B");
  }
  if (w.Pressed("plus", false, true) || w.Pressed("plus") || w.Pressed("equal"))
  {
    this->Display.Exposure = std::min(16., this->Display.Exposure + 0.5);
  }
  if (w.Pressed("minus"))
  {
    this->Display.Exposure = std::max(-16., this->Display.Exposure - 0.5);
  }
  if (w.Pressed("0"))
  {
    this->Display.Exposure = 0;
  }
  if (w.Pressed("BackSpace", false, false, true) || w.Pressed("Up", false, false, true))
  {
    this->EnterScope("");
  }
}

// ---- the frame ------------------------------------------------------------------------------------------------------
void Viewer::MenuBar()
{
  if (!ImGui::BeginMainMenuBar())
  {
    return;
  }
  if (ImGui::BeginMenu("File"))
  {
    const auto item = [this](const char* label, const char* key, const char* mark, bool enabled = true)
    {
      const bool pressed = ImGui::MenuItem(label, key, false, enabled);
      this->Mark(std::string("menu/") + mark);
      return pressed;
    };
    if (item("New", "Ctrl+N", "new"))
    {
      this->AskToClose("new");
    }
    if (item("Open\u2026", "Ctrl+O", "open"))
    {
      this->AskToClose("open");
    }
    const std::vector<std::string> recent = this->Remembered.Recent();
    if (ImGui::BeginMenu("Recent", !recent.empty()))
    {
      for (const std::string& f : recent)
      {
        if (ImGui::MenuItem(ShortPath(f).c_str()))
        {
          this->AskToClose("file:" + f);
        }
        this->Tooltip(f);
      }
      ImGui::EndMenu();
    }
    std::error_code ec;
    const fs::path shipped = fs::path(DataDirectory()) / "Pipelines";
    if (ImGui::BeginMenu("Shipped pipelines", fs::is_directory(shipped, ec)))
    {
      std::vector<std::string> files;
      for (const auto& e : fs::directory_iterator(shipped, ec))
      {
        if (e.path().extension() == ".xml")
        {
          files.push_back(e.path().string());
        }
      }
      std::sort(files.begin(), files.end());
      for (const std::string& f : files)
      {
        if (ImGui::MenuItem(fs::path(f).stem().string().c_str()))
        {
          this->AskToClose("file:" + f);
        }
      }
      ImGui::EndMenu();
    }
    ImGui::Separator();
    if (item("Save", "Ctrl+S", "save", !this->OnErrorPage()))
    {
      this->Save(false);
    }
    if (item("Save as\u2026", "Ctrl+Shift+S", "save-as", !this->OnErrorPage()))
    {
      this->Save(true);
    }
    if (item("Write the picture\u2026", "", "write-picture", this->LastGood != nullptr && !this->OnErrorPage()))
    {
      this->OpenFileDialog("picture", "Write the arrays of the shown node", ".exr .hdr .png");
      this->DialogName = this->A.Node + ".exr";
    }
    ImGui::Separator();
    if (item("Quit", "Ctrl+Q", "quit"))
    {
      this->AskToClose("quit");
    }
    ImGui::EndMenu();
  }
  this->Mark("menu/File");
  if (ImGui::BeginMenu("Edit", !this->OnErrorPage()))
  {
    const bool some = !this->Selected.empty();
    if (ImGui::MenuItem(this->Doc.CanUndo() ? ("Undo " + this->Doc.UndoLabel()).c_str() : "Undo", "Ctrl+Z", false,
          this->Doc.CanUndo()))
    {
      this->Doc.Undo();
    }
    if (ImGui::MenuItem(this->Doc.CanRedo() ? ("Redo " + this->Doc.RedoLabel()).c_str() : "Redo", "Ctrl+Y", false,
          this->Doc.CanRedo()))
    {
      this->Doc.Redo();
    }
    ImGui::Separator();
    if (ImGui::MenuItem("Cut", "Ctrl+X", false, some))
    {
      this->CopySelection(true);
    }
    if (ImGui::MenuItem("Copy as XML", "Ctrl+C", false, some))
    {
      this->CopySelection(false);
    }
    if (ImGui::MenuItem("Paste", "Ctrl+V"))
    {
      this->Paste();
    }
    if (ImGui::MenuItem("Duplicate", "Ctrl+D", false, some))
    {
      this->DuplicateSelection();
    }
    if (ImGui::MenuItem("Delete", "Del", false, some))
    {
      this->DeleteSelection(false);
    }
    if (ImGui::MenuItem("Delete and reconnect", "Ctrl+Del", false, some))
    {
      this->DeleteSelection(true);
    }
    if (ImGui::MenuItem("Rename", "F2", false, this->Selected.size() == 1))
    {
      this->BeginRename(*this->Selected.begin());
    }
    if (ImGui::MenuItem("Make a template\u2026", "Ctrl+G", false, some && this->Scope.empty()))
    {
      this->AskForTemplate();
    }
    this->Mark("menu/make-template");
    ImGui::Separator();
    if (ImGui::MenuItem("Put the parameters aside as set B", "P", false, !this->Doc.Nodes("").empty()))
    {
      this->PutParametersAside();
    }
    if (ImGui::MenuItem("Swap set A and set B", "Shift+P", false, this->SetB != nullptr))
    {
      this->SwapParameters();
    }
    ImGui::Separator();
    if (ImGui::MenuItem("Arrange the graph", "L"))
    {
      this->ArrangeAll();
    }
    ImGui::EndMenu();
  }
  this->Mark("menu/Edit");
  if (ImGui::BeginMenu("View"))
  {
    if (ImGui::MenuItem("Fit the image", "F", this->FitImage))
    {
      this->FitImage = true;
    }
    if (ImGui::MenuItem("One pixel is one pixel", "1"))
    {
      this->FitImage = false;
      this->Zoom = 1;
    }
    if (ImGui::MenuItem("Fit the graph", "A"))
    {
      this->FitGraph();
    }
    ImGui::Separator();
    ImGui::MenuItem("Flag pixels that are not finite", nullptr, &this->Display.FlagNonFinite);
    ImGui::MenuItem("Go on sampling while idle", nullptr, &this->Refine);
    this->Tooltip("After the pipeline's own samples the picture is refined with 2, 4, 8 ... times as many. What is "
                  "shown then is better than what a run writes.");
    ImGui::Separator();
    ImGui::TextDisabled("History of a frame");
    for (const auto& h : { std::make_pair(HistoryMode::Exact, "All frames before it, as a run"),
           std::make_pair(HistoryMode::Short, "As many as matter"), std::make_pair(HistoryMode::None, "None") })
    {
      if (ImGui::MenuItem(h.second, nullptr, this->History == h.first))
      {
        this->History = h.first;
      }
    }
    ImGui::EndMenu();
  }
  this->Mark("menu/View");
  if (ImGui::BeginMenu("Help"))
  {
    if (ImGui::MenuItem("Keys and gestures", "F1"))
    {
      this->ShowHelp = true;
    }
    ImGui::EndMenu();
  }
  this->Mark("menu/Help");

  // The file in the middle, what the session does on the right.
  const std::string name = this->Doc.HasFile() ? fs::path(this->Doc.File()).filename().string() : "untitled";
  const std::string title = name + (this->Doc.IsDirty() ? " \u2022" : "");
  const float middle = ImGui::GetWindowWidth() / 2 - ImGui::CalcTextSize(title.c_str()).x / 2;
  ImGui::SetCursorPosX(std::max(ImGui::GetCursorPosX() + this->S(20), middle));
  ImGui::PushFont(this->Win.Bold());
  ImGui::TextUnformatted(title.c_str());
  ImGui::PopFont();
  if (this->Doc.HasFile())
  {
    this->Tooltip(this->Doc.File() + (this->Doc.IsDirty() ? "\nnot saved yet" : ""));
  }
  this->Win.SetTitle((this->Doc.IsDirty() ? "* " : "") + name + " - Quell"); // window managers read Latin-1 here

  const ViewProgress progress = this->Session->Progress();
  if (progress.Busy && !this->Given.Plain)
  {
    std::string text = progress.Node;
    if (!progress.Phase.empty())
    {
      text = progress.Phase + (text.empty() ? "" : " \u00b7 " + text);
    }
    const float width = this->S(170);
    ImGui::SetCursorPosX(ImGui::GetWindowWidth() - width - this->S(40));
    ImGui::SetCursorPosY(ImGui::GetCursorPosY() + this->S(2));
    ImGui::PushStyleColor(ImGuiCol_PlotHistogram, Colors::Accent);
    ImGui::ProgressBar(float(progress.Fraction), ImVec2(width, ImGui::GetFrameHeight() - this->S(4)), text.c_str());
    ImGui::PopStyleColor();
    ImGui::SameLine();
    if (ImGui::SmallButton("\u2715"))
    {
      this->Playing = false;
      this->Session->Cancel();
    }
    this->Tooltip("Stop (Esc)");
  }
  ImGui::EndMainMenuBar();
}

void Viewer::Layout()
{
  const ImGuiIO& io = ImGui::GetIO();
  const float top = ImGui::GetFrameHeight() + this->S(1);
  const float bottom = io.DisplaySize.y - this->S(60);
  const float width = io.DisplaySize.x;
  const float right = width * (1 - this->RightFraction);
  const float middle = bottom - this->GraphFraction * (bottom - top);
  const float half = this->S(3);
  const bool welcome = this->ShowWelcome && this->Doc.Nodes("").empty() && this->Doc.Get()->Templates.empty();
  if (welcome || !this->OpenErrors.empty())
  {
    this->Welcome(ImVec2(0, top), ImVec2(width, io.DisplaySize.y));
    return;
  }
  this->ImagePanel(ImVec2(0, top), ImVec2(right - half, middle - half));
  this->GraphPanel(ImVec2(0, middle + half), ImVec2(right - half, bottom));
  this->RightPanel(ImVec2(right + half, top), ImVec2(width, bottom));
  this->Splitter("right", true, this->RightFraction, 0, width, top, bottom);
  this->Splitter("graph", false, this->GraphFraction, top, bottom, 0, right - half);
  this->TimelineBar();
}

void Viewer::Welcome(const ImVec2& min, const ImVec2& max)
{
  ImGui::SetNextWindowPos(min);
  ImGui::SetNextWindowSize(ImVec2(max.x - min.x, max.y - min.y));
  ImGui::Begin("##welcome", nullptr,
    ImGuiWindowFlags_NoTitleBar | ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_NoMove |
      ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoBringToFrontOnFocus);
  const float width = std::min(this->S(640), max.x - min.x - this->S(40));
  const float left = (max.x - min.x - width) / 2;
  const auto rule = [&]
  {
    const ImVec2 at = ImGui::GetCursorScreenPos();
    ImGui::GetWindowDrawList()->AddLine(at, ImVec2(at.x + width, at.y), ImGui::GetColorU32(Colors::Line));
    ImGui::Dummy(ImVec2(0, this->S(4)));
  };
  ImGui::SetCursorPos(ImVec2(left, this->S(max.y - min.y > this->S(520) ? 60 : 24)));
  ImGui::BeginGroup();
  ImGui::PushTextWrapPos(ImGui::GetCursorPosX() + width);
  if (!this->OpenErrors.empty())
  {
    Heading(this->Win, "This file cannot be opened");
    ImGui::TextColored(Colors::Dim, "%s", this->OpenErrorFile.c_str());
    ImGui::Dummy(ImVec2(0, this->S(8)));
    int line = 0;
    for (const Diagnostic& d : this->OpenErrors)
    {
      ImGui::PushID(line++);
      if (d.Place.Line > 0)
      {
        ImGui::TextColored(Colors::Accent, "line %d, column %d", d.Place.Line, d.Place.Column);
      }
      ImGui::TextColored(d.Level == Severity::Error ? Colors::Error : Colors::Warning, "%s",
        ((d.Where.empty() ? std::string() : d.Where + ": ") + d.What).c_str());
      if (!d.Hint.empty())
      {
        ImGui::TextColored(Colors::Dim, "%s", d.Hint.c_str());
      }
      const std::string source = LineOfFile(d.Place.File, d.Place.Line);
      if (!source.empty())
      {
        ImGui::PushFont(this->Win.Mono());
        ImGui::TextColored(Colors::Dim, "%4d |  %s", d.Place.Line, source.c_str());
        ImGui::PopFont();
      }
      ImGui::Dummy(ImVec2(0, this->S(6)));
      ImGui::PopID();
    }
    if (this->Button("Back", "welcome/back"))
    {
      this->OpenErrors.clear();
      this->OpenErrorFile.clear();
    }
    ImGui::SameLine();
    if (this->Button("Try again", "welcome/again"))
    {
      const std::string file = this->OpenErrorFile;
      this->OpenErrors.clear();
      this->Open(file);
    }
    if (!this->Doc.Nodes("").empty())
    {
      ImGui::TextColored(Colors::Dim, "%s is as it was; \"Back\" leads to it.",
        this->Doc.HasFile() ? fs::path(this->Doc.File()).filename().string().c_str() : "The pipeline");
    }
    if (!this->Message.empty() && ImGui::GetTime() < this->MessageUntil)
    {
      ImGui::TextColored(this->MessageIsError ? Colors::Error : Colors::Accent, "%s", this->Message.c_str());
      this->Mark("welcome/message");
    }
  }
  else
  {
    ImGui::SetWindowFontScale(1.6f);
    Heading(this->Win, "Quell");
    ImGui::SetWindowFontScale(1);
    ImGui::TextColored(
      Colors::Dim, "Turn noisy path-traced frames into clean ones, see every step, and what each costs and buys.");
    ImGui::Dummy(ImVec2(0, this->S(14)));
    if (this->Button("Open a pipeline\u2026", "welcome/open"))
    {
      this->AskToClose("open");
    }
    ImGui::SameLine();
    if (this->Button("Start with an empty graph", "welcome/new"))
    {
      this->New();
    }
    ImGui::Dummy(ImVec2(0, this->S(4)));
    ImGui::TextColored(Colors::Dim, "or drop a pipeline (.xml), a scene (.gltf, .glb, .obj) or a picture (.exr, .hdr, "
                                    ".png) on the window");
    std::error_code ec;
    const fs::path shipped = fs::path(DataDirectory()) / "Pipelines";
    ImGui::Dummy(ImVec2(0, this->S(14)));
    ImGui::TextUnformatted("Shipped with Quell");
    rule();
    for (const char* name : { "quick", "svgf", "still", "denoise-file", "layers-direct-indirect" })
    {
      const fs::path file = shipped / (std::string(name) + ".xml");
      if (fs::is_regular_file(file, ec))
      {
        if (ImGui::Selectable(name, false, 0, ImVec2(this->S(170), 0)))
        {
          this->Open(file.string());
        }
        this->Mark(std::string("welcome/") + name);
        ImGui::SameLine();
        ImGui::SetCursorPosX(left + this->S(185));
        ImGui::TextColored(Colors::Dim, "%s", Fitted(PipelineBrief(file.string()), width - this->S(190)).c_str());
      }
    }
    const std::vector<std::string> recent = this->Remembered.Recent();
    if (!recent.empty())
    {
      ImGui::Dummy(ImVec2(0, this->S(14)));
      ImGui::TextUnformatted("Recent");
      rule();
      for (const std::string& f : recent)
      {
        if (ImGui::Selectable((ShortPath(f) + "##" + f).c_str(), false, 0, ImVec2(width, 0)))
        {
          this->Open(f);
        }
        this->Tooltip(f);
      }
    }
  }
  ImGui::PopTextWrapPos();
  ImGui::EndGroup();
  ImGui::End();
}

void Viewer::TimelineBar()
{
  const ImGuiIO& io = ImGui::GetIO();
  const float height = this->S(60);
  ImGui::SetNextWindowPos(ImVec2(0, io.DisplaySize.y - height));
  ImGui::SetNextWindowSize(ImVec2(io.DisplaySize.x, height));
  ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, ImVec2(this->S(8), this->S(5)));
  ImGui::Begin(
    "##timeline", nullptr, ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoSavedSettings);
  const Timeline ticks = this->KnownTicks;
  const int last = ticks.First + std::max(1, ticks.Count) - 1;
  this->Tick = std::min(last, std::max(ticks.First, this->Tick));
  const bool many = ticks.Count > 1;
  const auto go = [&](int tick)
  {
    this->Playing = false;
    this->Camera.reset();
    this->Tick = std::min(last, std::max(ticks.First, tick));
  };
  ImGui::BeginDisabled(!many);
  if (IconButton("first", Icon::First, this->Scale))
  {
    go(ticks.First);
  }
  this->Mark("time/first");
  this->Tooltip("First frame (Home)");
  ImGui::SameLine(0, this->S(2));
  if (IconButton("back", Icon::StepBack, this->Scale))
  {
    go(this->Tick - 1);
  }
  this->Mark("time/back");
  this->Tooltip("One frame back (Left)");
  ImGui::SameLine(0, this->S(2));
  if (IconButton("play", this->Playing ? Icon::Pause : Icon::Play, this->Scale))
  {
    this->Camera.reset();
    if (!this->Playing && this->Tick == last)
    {
      this->Tick = ticks.First;
    }
    this->Playing = !this->Playing;
  }
  this->Mark("time/play");
  this->Tooltip(this->Playing ? "Stop (Space)" : "Play (Space)");
  ImGui::SameLine(0, this->S(2));
  if (IconButton("step", Icon::StepForward, this->Scale))
  {
    go(this->Tick + 1);
  }
  this->Mark("time/step");
  this->Tooltip("One frame on (Right)");
  ImGui::SameLine(0, this->S(2));
  if (IconButton("last", Icon::Last, this->Scale))
  {
    go(last);
  }
  this->Mark("time/last");
  this->Tooltip("Last frame (End)");
  ImGui::SameLine(0, this->S(8));
  if (IconButton("loop", Icon::Loop, this->Scale, this->Looping))
  {
    this->Looping = !this->Looping;
  }
  this->Mark("time/loop");
  this->Tooltip(this->Looping ? "Playing begins anew at the end" : "Playing stops at the end");
  ImGui::EndDisabled();
  ImGui::SameLine(0, this->S(12));
  ImGui::SetNextItemWidth(std::max(this->S(80), ImGui::GetContentRegionAvail().x - this->S(this->Camera ? 270 : 230)));
  ImGui::BeginDisabled(!many);
  int tick = this->Tick;
  if (!many)
  {
    ImGui::PushStyleColor(ImGuiCol_SliderGrab, ImVec4(0, 0, 0, 0));
  }
  if (ImGui::SliderInt("##tick", &tick, ticks.First, std::max(last, ticks.First + 1), many ? "frame %d" : ""))
  {
    go(tick);
  }
  if (!many)
  {
    ImGui::PopStyleColor();
  }
  this->Mark("time/slider");
  ImGui::EndDisabled();
  ImGui::SameLine(0, this->S(12));
  if (this->Camera)
  {
    ImGui::AlignTextToFramePadding();
    const int frames = this->LastGood ? this->LastGood->LiveTicks : 0;
    ImGui::TextColored(Colors::Accent, frames == 1 ? "live camera, 1 frame" : "live camera, %d frames", frames);
    ImGui::SameLine();
    if (ImGui::SmallButton("home"))
    {
      this->Camera.reset();
    }
    this->Mark("time/home");
    this->Tooltip("Back to the scene's camera (H)");
  }
  else
  {
    ImGui::AlignTextToFramePadding();
    ImGui::TextColored(Colors::Dim, many ? "%d frames at %g a second" : "a still", ticks.Count, ticks.Rate);
  }
  this->StatusBar();
  ImGui::End();
  ImGui::PopStyleVar();
}

void Viewer::StatusBar()
{
  ImGui::PushFont(this->Win.Small());
  if (!this->Message.empty() && ImGui::GetTime() < this->MessageUntil &&
      (!this->MessageIsError || this->MessageOf == this->Doc.Revision()))
  {
    ImGui::TextColored(this->MessageIsError ? Colors::Error : Colors::Accent, "%s", this->Message.c_str());
    this->Mark("told/" + this->Message);
    ImGui::PopFont();
    return;
  }
  std::string text;
  // What the list of mistakes says need not be said again.
  if (this->Shown && !this->Shown->Ok && !this->Shown->Error.empty() &&
      !(this->Checked && this->Checked->Document == this->Doc.Get() && this->Checked->Errors > 0))
  {
    ImGui::TextColored(Colors::Error, "%s", this->Shown->Error.c_str());
    ImGui::PopFont();
    return;
  }
  if (this->LastGood)
  {
    const ViewTarget target = ResolveTarget(*this->LastGood->Document, this->A);
    if (vtkImageData* image = this->LastGood->Image(target.Node))
    {
      const int* size = image->GetDimensions();
      text = std::to_string(size[0]) + " \u00d7 " + std::to_string(size[1]);
    }
    if (this->LastGood->SamplesAsked > 0)
    {
      text +=
        "   " + std::to_string(this->LastGood->Samples) +
        (this->LastGood->Samples < this->LastGood->SamplesAsked ? " of " + std::to_string(this->LastGood->SamplesAsked)
                                                                : std::string()) +
        (this->LastGood->Samples == 1 && this->LastGood->SamplesAsked == 1 ? " sample a pixel" : " samples a pixel");
    }
    if (!this->Given.Plain)
    {
      text += "   " + Milliseconds(1000 * this->LastGood->Seconds);
      double bytes = 0;
      for (const ViewFrame::Node& n : this->LastGood->Nodes)
      {
        bytes += n.Bytes + double(n.Counters.Held);
      }
      text += "   " + Bytes(bytes);
    }
    if (!this->LastGood->Warnings.empty())
    {
      ImGui::TextColored(Colors::Dim, "%s", text.c_str());
      ImGui::SameLine(0, this->S(16));
      ImGui::TextColored(Colors::Warning, "%s",
        (this->LastGood->Warnings.front() +
          (this->LastGood->Warnings.size() > 1
              ? " (and " + std::to_string(this->LastGood->Warnings.size() - 1) + " more)"
              : ""))
          .c_str());
      std::string all;
      for (const std::string& w : this->LastGood->Warnings)
      {
        all += (all.empty() ? "" : "\n") + w;
      }
      this->Tooltip(all);
      ImGui::PopFont();
      return;
    }
  }
  ImGui::TextColored(Colors::Dim, "%s", text.c_str());
  ImGui::PopFont();
}

// ---- dialogs --------------------------------------------------------------------------------------------------------
void Viewer::Dialogs()
{
  if (this->AskUnsaved)
  {
    ImGui::OpenPopup("Unsaved changes");
  }
  ImGui::SetNextWindowPos(ImGui::GetMainViewport()->GetCenter(), ImGuiCond_Always, ImVec2(0.5f, 0.5f));
  if (ImGui::BeginPopupModal("Unsaved changes", nullptr, ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoMove))
  {
    ImGui::Text("%s has changes that are not saved.",
      this->Doc.HasFile() ? fs::path(this->Doc.File()).filename().string().c_str() : "This pipeline");
    ImGui::Dummy(ImVec2(0, this->S(8)));
    if (this->Button("Save", "ask/save"))
    {
      this->AskUnsaved = false;
      ImGui::CloseCurrentPopup();
      this->Save(false);
    }
    ImGui::SameLine();
    if (this->Button("Discard the changes", "ask/discard"))
    {
      this->AskUnsaved = false;
      ImGui::CloseCurrentPopup();
      const std::string action = this->PendingAction;
      if (action == "quit")
      {
        this->Doc.Clear();
      }
      this->Perform(action);
    }
    ImGui::SameLine();
    if (this->Button("Cancel", "ask/cancel") || this->Win.Pressed("Escape"))
    {
      this->AskUnsaved = false;
      this->PendingAction.clear();
      ImGui::CloseCurrentPopup();
    }
    ImGui::EndPopup();
  }
  if (this->AskChanged)
  {
    ImGui::OpenPopup("Changed by another program");
  }
  ImGui::SetNextWindowPos(ImGui::GetMainViewport()->GetCenter(), ImGuiCond_Always, ImVec2(0.5f, 0.5f));
  if (ImGui::BeginPopupModal(
        "Changed by another program", nullptr, ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoMove))
  {
    const std::string file = this->Doc.File();
    ImGui::Text("%s is not what it was when it was opened or saved here.", fs::path(file).filename().string().c_str());
    ImGui::TextColored(Colors::Dim, "Opening it again gives up the changes made here.");
    ImGui::Dummy(ImVec2(0, this->S(8)));
    const auto answered = [&](bool is)
    {
      if (is)
      {
        this->AskChanged = false;
        ImGui::CloseCurrentPopup();
      }
      return is;
    };
    if (answered(this->Button("Write over it", "changed/replace")))
    {
      this->SaveHere();
    }
    ImGui::SameLine();
    if (answered(this->Button("Save as...", "changed/as")))
    {
      this->Save(true);
    }
    ImGui::SameLine();
    if (answered(this->Button("Open it again", "changed/open")))
    {
      this->PendingAction.clear();
      this->Open(file);
    }
    ImGui::SameLine();
    if (answered(this->Button("Cancel", "changed/cancel") || this->Win.Pressed("Escape")))
    {
      this->PendingAction.clear();
    }
    ImGui::EndPopup();
  }
  if (this->AskTemplateName)
  {
    ImGui::OpenPopup("Make a template");
    this->AskTemplateName = false;
  }
  ImGui::SetNextWindowPos(ImGui::GetMainViewport()->GetCenter(), ImGuiCond_Always, ImVec2(0.5f, 0.5f));
  if (ImGui::BeginPopupModal("Make a template", nullptr, ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoMove))
  {
    ImGui::TextColored(Colors::Dim,
      this->Selected.size() == 1 ? "The selected node becomes a template with an instance in its place."
                                 : "The %d selected nodes become a template with an instance in their place.",
      int(this->Selected.size()));
    if (this->TemplateNameFocus)
    {
      ImGui::SetKeyboardFocusHere();
      this->TemplateNameFocus = false;
    }
    ImGui::AlignTextToFramePadding();
    ImGui::TextUnformatted("name");
    ImGui::SameLine();
    ImGui::SetNextItemWidth(this->S(260));
    bool make = ImGui::InputText(
      "##name", &this->TemplateName, ImGuiInputTextFlags_EnterReturnsTrue | ImGuiInputTextFlags_AutoSelectAll);
    this->Mark("template/name");
    if (!this->TemplateNameError.empty())
    {
      ImGui::PushTextWrapPos(this->S(420));
      ImGui::TextColored(Colors::Error, "%s", this->TemplateNameError.c_str());
      ImGui::PopTextWrapPos();
    }
    ImGui::Dummy(ImVec2(0, this->S(6)));
    make = this->Button("Make it", "template/make", nullptr, !this->TemplateName.empty()) || make;
    ImGui::SameLine();
    const bool close = this->Button("Cancel", "template/cancel") || this->Win.Pressed("Escape");
    if (make)
    {
      const GraphModel& model = this->Model;
      const auto typeOf = [&model](const std::string& from) -> std::string
      {
        std::string array;
        const int box = model.Find(TopOf(NodeOfReference(from, &array)));
        if (box < 0 || model.Boxes[std::size_t(box)].Outputs.empty())
        {
          return {};
        }
        const GraphBox& b = model.Boxes[std::size_t(box)];
        const int pin = array.empty() ? 0 : b.FindOutput(array);
        const ArrayKind kind = pin < 0 ? ArrayKind::Any : b.Outputs[std::size_t(pin)].Kind;
        return kind == ArrayKind::Any ? std::string() : KindName(kind);
      };
      this->TemplateNameError.clear();
      const std::string made =
        this->Doc.MakeTemplate(std::vector<std::string>(this->Selected.begin(), this->Selected.end()),
          this->TemplateName, typeOf, this->TemplateNameError);
      if (!made.empty())
      {
        if (this->Selected.count(this->A.Node))
        {
          this->A = { made, "" };
        }
        this->Selected = { made };
        this->Tell("template " + this->Doc.FindNode("", made)->Type.Value + "; a double click opens it");
        ImGui::CloseCurrentPopup();
      }
    }
    else if (close)
    {
      ImGui::CloseCurrentPopup();
    }
    ImGui::EndPopup();
  }
  this->FileDialog();
}

void Viewer::AskForTemplate()
{
  if (this->Scope.empty() && !this->Selected.empty())
  {
    this->AskTemplateName = this->TemplateNameFocus = true;
    this->TemplateNameError.clear();
  }
}

void Viewer::FileDialog()
{
  if (this->DialogOpen)
  {
    ImGui::OpenPopup("##files");
  }
  const ImGuiIO& io = ImGui::GetIO();
  ImGui::SetNextWindowPos(ImVec2(io.DisplaySize.x / 2, io.DisplaySize.y / 2), ImGuiCond_Always, ImVec2(0.5f, 0.5f));
  ImGui::SetNextWindowSize(ImVec2(
    std::min(this->S(680), io.DisplaySize.x - this->S(40)), std::min(this->S(500), io.DisplaySize.y - this->S(60))));
  if (!ImGui::BeginPopupModal(
        "##files", nullptr, ImGuiWindowFlags_NoTitleBar | ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoResize))
  {
    return;
  }
  Heading(this->Win, this->DialogTitle.c_str());
  bool quick = false; // chosen without the button that says what happens
  const bool saving = this->DialogPurpose == "save" || this->DialogPurpose == "picture" ||
                      this->DialogPurpose.compare(0, 7, "output:") == 0;
  std::error_code ec;
  std::string chosen;
  // The way to here, each part to be clicked.
  fs::path at;
  int part = 0;
  for (const fs::path& p : fs::path(this->DialogDirectory))
  {
    at = at.empty() ? p : at / p;
    if (p.string().empty())
    {
      continue;
    }
    ImGui::PushID(part++);
    if (part > 1)
    {
      ImGui::SameLine(0, this->S(3));
    }
    if (ImGui::SmallButton(p.string() == "/" ? "/" : p.string().c_str()))
    {
      this->DialogDirectory = at.string();
      ImGui::PopID();
      break;
    }
    ImGui::PopID();
  }
  // Under the list: the name, the buttons, and why the dialog is still open.
  const float note = this->DialogNote.empty() ? 0.f
                                              : ImGui::CalcTextSize(this->DialogNote.c_str(), nullptr, false,
                                                  std::max(ImGui::GetContentRegionAvail().x, this->S(60)))
                                                    .y +
                                                  ImGui::GetStyle().ItemSpacing.y;
  ImGui::BeginChild("list", ImVec2(0, -this->S(76) - note), true);
  std::vector<std::pair<bool, std::string>> entries;
  for (fs::directory_iterator i(this->DialogDirectory, fs::directory_options::skip_permission_denied, ec), end;
       !ec && i != end; i.increment(ec))
  {
    const std::string name = i->path().filename().string();
    std::error_code e;
    const bool directory = i->is_directory(e);
    const std::string extension = LowerExtension(name);
    if (name[0] != '.' &&
        (directory || (!extension.empty() &&
                        (" " + this->DialogExtensions + " ").find(" " + extension + " ") != std::string::npos)))
    {
      entries.emplace_back(!directory, name);
    }
    if (entries.size() > 5000)
    {
      break;
    }
  }
  std::sort(entries.begin(), entries.end());
  const std::string parent = fs::path(this->DialogDirectory).parent_path().string();
  if (parent != this->DialogDirectory && ImGui::Selectable("\u2191  ..", false, ImGuiSelectableFlags_DontClosePopups))
  {
    this->DialogDirectory = parent;
  }
  for (const auto& e : entries)
  {
    const fs::path full = fs::path(this->DialogDirectory) / e.second;
    ImGui::PushStyleColor(ImGuiCol_Text, e.first ? Colors::Text : Colors::Accent);
    if (ImGui::Selectable((e.first ? e.second : e.second + "/").c_str(), this->DialogName == e.second,
          ImGuiSelectableFlags_DontClosePopups | ImGuiSelectableFlags_AllowDoubleClick))
    {
      if (!e.first)
      {
        this->DialogDirectory = full.string();
        this->DialogName = saving ? this->DialogName : std::string();
      }
      else
      {
        this->DialogName = e.second;
        if (ImGui::IsMouseDoubleClicked(0))
        {
          chosen = full.string();
          quick = true;
        }
      }
    }
    ImGui::PopStyleColor();
    this->Mark("files/" + e.second);
  }
  if (entries.empty())
  {
    ImGui::TextColored(
      Colors::Dim, ec ? "this directory cannot be read" : "nothing here that fits: %s", this->DialogExtensions.c_str());
  }
  ImGui::EndChild();
  ImGui::SetNextItemWidth(-1);
  if (this->DialogFocus)
  {
    ImGui::SetKeyboardFocusHere();
    this->DialogFocus = false;
  }
  if (ImGui::InputTextWithHint("##name", saving ? "name of the file" : "name or path of the file", &this->DialogName,
        ImGuiInputTextFlags_EnterReturnsTrue))
  {
    chosen = (fs::path(this->DialogDirectory) / this->DialogName).string();
    quick = true;
  }
  if (ImGui::IsItemEdited())
  {
    this->DialogNote.clear();
  }
  this->Mark("files/name");
  const fs::path full = fs::path(this->DialogDirectory) / this->DialogName;
  const bool exists = fs::is_regular_file(
    this->DialogPurpose == "save" && full.extension().empty() ? full.string() + ".xml" : full.string(), ec);
  const bool naming = saving && this->DialogPurpose != "save" && this->DialogPurpose != "picture";
  if (this->Button(naming   ? "Choose"
                   : saving ? (exists ? "Replace" : "Save")
                            : "Open",
        "files/ok", nullptr, !this->DialogName.empty()))
  {
    chosen = full.string();
  }
  ImGui::SameLine();
  bool close = this->Button("Cancel", "files/cancel") || this->Win.Pressed("Escape");
  if (close && this->DialogPurpose == "save")
  {
    this->PendingAction.clear();
  }
  if (saving && exists)
  {
    ImGui::SameLine();
    ImGui::TextColored(Colors::Warning, "there is a file of that name");
  }
  if (!this->DialogNote.empty())
  {
    ImGui::PushStyleColor(ImGuiCol_Text, Colors::Error);
    ImGui::TextWrapped("%s", this->DialogNote.c_str());
    ImGui::PopStyleColor();
  }
  // Nothing is written over without the button that says so.
  if (saving && exists && !naming && quick && !chosen.empty())
  {
    this->DialogNote = "press Replace to write over " + fs::path(chosen).filename().string();
    chosen.clear();
  }
  if (!chosen.empty() && fs::is_directory(chosen, ec))
  {
    this->DialogDirectory = fs::weakly_canonical(chosen, ec).string();
    this->DialogName.clear();
    chosen.clear();
  }
  if (!chosen.empty())
  {
    close = true;
    this->Remembered.Set("dialog.directory", fs::path(chosen).parent_path().string());
  }
  if (close)
  {
    this->DialogOpen = false;
    ImGui::CloseCurrentPopup();
  }
  ImGui::EndPopup();
  if (!chosen.empty())
  {
    this->FileChosen(this->DialogPurpose, chosen);
  }
}

void Viewer::HelpOverlay()
{
  if (!this->ShowHelp && !ImGui::IsPopupOpen("##help"))
  {
    return;
  }
  const ImGuiIO& io = ImGui::GetIO();
  ImGui::SetNextWindowPos(ImVec2(io.DisplaySize.x / 2, io.DisplaySize.y / 2), ImGuiCond_Always, ImVec2(0.5f, 0.5f));
  ImGui::SetNextWindowSize(ImVec2(
    std::min(this->S(920), io.DisplaySize.x - this->S(40)), std::min(this->S(560), io.DisplaySize.y - this->S(40))));
  // Everything else steps back.
  ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, ImVec2(this->S(24), this->S(20)));
  ImGui::PushStyleVar(ImGuiStyleVar_WindowRounding, this->S(6));
  if (!ImGui::IsPopupOpen("##help"))
  {
    ImGui::OpenPopup("##help");
  }
  if (!ImGui::BeginPopupModal("##help", nullptr,
        ImGuiWindowFlags_NoTitleBar | ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoMove |
          ImGuiWindowFlags_NoSavedSettings))
  {
    ImGui::PopStyleVar(2);
    return;
  }
  Heading(this->Win, "Keys and gestures");
  ImGui::SameLine(ImGui::GetWindowWidth() - this->S(24) - this->S(52));
  if (ImGui::SmallButton("Close"))
  {
    this->ShowHelp = false;
  }
  this->Mark("help/close");
  ImGui::Dummy(ImVec2(0, this->S(6)));
  if (ImGui::BeginTable("help", 2, ImGuiTableFlags_SizingStretchSame))
  {
    int column = -1;
    for (const HelpSection& section : HelpSections())
    {
      if (section.Column != column)
      {
        ImGui::TableNextColumn();
        column = section.Column;
      }
      ImGui::PushFont(this->Win.Bold());
      ImGui::TextColored(Colors::Accent, "%s", section.Title);
      ImGui::PopFont();
      ImGui::PushFont(this->Win.Small());
      for (const auto& line : section.Lines)
      {
        const float x = ImGui::GetCursorPosX();
        ImGui::TextColored(Colors::Text, "%s", line.first);
        ImGui::SameLine();
        ImGui::SetCursorPosX(x + this->S(128));
        ImGui::TextColored(Colors::Dim, "%s", line.second);
      }
      ImGui::PopFont();
      ImGui::Dummy(ImVec2(0, this->S(8)));
    }
    ImGui::EndTable();
  }
  if (!this->ShowHelp)
  {
    ImGui::CloseCurrentPopup();
  }
  ImGui::EndPopup();
  ImGui::PopStyleVar(2);
}

void Viewer::Ui()
{
  this->ThisMarks.clear();
  for (const std::string& file : this->Win.TakeDrops())
  {
    if (IsScene(file) || IsPicture(file))
    {
      this->Open(file);
    }
    else
    {
      this->AskToClose("file:" + file);
    }
  }
  if (this->Win.IsClosing() && this->Doc.IsDirty())
  {
    this->Win.KeepOpen();
    this->AskToClose("quit");
  }
  this->Shortcuts();
  if (!ImGui::IsMouseDown(0) && !ImGui::IsAnyItemActive())
  {
    this->Doc.EndMerge();
  }
  this->TakeResults();
  this->MenuBar();
  this->Layout();
  this->Dialogs();
  this->HelpOverlay();
  this->UpdateWish();
  this->LastMarks = this->ThisMarks;
}
}
