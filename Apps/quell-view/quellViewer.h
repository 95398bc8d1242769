// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellViewer_h
#define quellViewer_h

#include "quellEditDocument.h"
#include "quellGraphModel.h"
#include "quellPresenter.h"
#include "quellRenderSession.h"
#include "quellSettings.h"
#include "quellTradePoints.h"
#include "quellWindow.h"

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace quell
{
/// Named rectangles of the last frame, so that scripts can say what they click instead of where it is.
using Marks = std::map<std::string, ImVec4>; ///< x0, y0, x1, y1

enum class CompareMode
{
  Off,
  Wipe,
  Flip,
  Difference,
  Signed,
  Relative,
  FlipMap
};
enum class SourceB
{
  Node,
  Reference,
  Kept,      ///< a picture put aside
  Parameters ///< the same node of another parameter set
};

/// A pixel's weights as they are drawn.
struct WeightsSummary
{
  Rect Window;
  std::vector<double> Values; ///< of all parts together, row by row from the bottom
  double Most = 0, Sum = 0, Squares = 0;
  bool Negative = false;
  int LargestX = 0, LargestY = 0; ///< from the pixel
  std::size_t Needed = 0;         ///< pixels that hold 99 % of the weight
  int Reach = 2;                  ///< how far those are from the pixel
  double At(int x, int y) const
  {
    return this
      ->Values[std::size_t(y - this->Window.y0) * std::size_t(this->Window.width()) + std::size_t(x - this->Window.x0)];
  }
};

/// The viewer: a document being edited, the session that runs it, and the panels. Draws with Dear ImGui; one object
/// per window. All of it runs on the event loop's thread; work is done by RenderSession and Presenter.
class Viewer
{
public:
  struct Options
  {
    GraphOptions Graph; ///< -D, --set, --seed
    std::optional<int> Frame;
    std::string Show;         ///< "node", "node:array" or an output's name; empty: the first output
    std::string Reference;    ///< image to compare with
    std::string SettingsFile; ///< empty: nothing is remembered
    bool Plain = false;       ///< for pictures that must not change: no times, no machine's figures
  };
  Viewer(Window& window, const StageRegistry& registry, const Options& options);
  ~Viewer();

  /// A pipeline file, a picture with a pipeline in it or without one, or a scene.
  bool Open(const std::string& file);
  void New();
  void Ui();
  /// Nothing is at work and everything that was made is on the screen.
  bool IsIdle() const;
  /// The picture and its data are those of the newest wish.
  std::shared_ptr<const ViewFrame> Frame() const { return this->Shown; }
  std::shared_ptr<const Presentation> Pictures() const { return this->Presented; }
  /// Of the pixel in panel Pixel; null: none yet.
  std::shared_ptr<const ViewWeights> Weights() const { return this->Weighed; }
  const Marks& GetMarks() const { return this->LastMarks; }
  EditDocument& Document() { return this->Doc; }
  const ViewTarget& Target() const { return this->A; }
  /// Why there is nothing to see; empty: there is.
  std::string ErrorText() const;
  /// There is something to show that the last frame did not have.
  bool HasNews() const;
  /// Counts the pictures that went to the screen's textures.
  std::uint64_t PictureCount() const { return this->Uploads; }
  /// Something is at work whose progress is shown.
  bool IsWorking() const;
  void ShowTab(const std::string& tab) { this->WantedTab = tab; }

  static std::string DataDirectory();

private:
  // quellViewer.cxx
  void Shortcuts();
  void MenuBar();
  void Layout();
  void Welcome(const ImVec2& min, const ImVec2& max);
  void StatusBar();
  void TimelineBar();
  void Dialogs();
  void FileDialog();
  void HelpOverlay();
  void Splitter(const char* name, bool vertical, float& fraction, float from, float to, float lo, float hi);
  void UpdateWish();
  bool Exists(const ViewTarget& target) const;
  ViewTarget InputOf(const ViewTarget& lost) const;
  void TakeResults();
  void ChooseDefaultTarget();
  void Save(bool as);
  void SaveHere();
  void AskToClose(const std::string& action);
  /// A page about a file that cannot be opened hides the graph.
  bool OnErrorPage() const { return !this->OpenErrors.empty(); }
  void Perform(std::string action); ///< a copy: the question that holds it is answered
  void OpenFileDialog(const std::string& purpose, const std::string& title, const std::string& extensions);
  void FileChosen(const std::string& purpose, const std::string& file);
  void Tell(const std::string& text, bool isError = false);
  void SelectTarget(const std::string& node, const std::string& array);
  std::string RelativeToFile(const std::string& path) const;
  void Mark(const std::string& name);
  void MarkRect(const std::string& name, const ImVec2& a, const ImVec2& b);
  bool Button(const char* label, const std::string& mark, const char* tooltip = nullptr, bool enabled = true);
  void Tooltip(const std::string& text);
  float S(double v) const { return float(v * this->Scale); }

  // quellViewerImage.cxx
  void ImagePanel(const ImVec2& min, const ImVec2& max);
  void ImageToolbar();
  void DisplayControls(const std::function<void(float, double)>& next, const std::function<float(double)>& width);
  void CompareControls(const std::function<void(float, double)>& next, const std::function<float(double)>& width);
  void CloseMenuOnEscape();
  std::string DifferenceText() const;
  void DrawImage(const ImVec2& min, const ImVec2& max);
  void Legend(const DisplayImage& image, const ImVec2& at, const std::string& title);
  void Inspector();
  void SummarizeWeights();
  void WeightsMap(float side);
  void WeightsPanel(const std::vector<std::string>& filters, int x, int y);
  void WeighPinned();
  void ComparePanel();
  void HistogramPlot();
  void CameraGesture(const ImVec2& min, const ImVec2& max, bool hovered);
  Picture PictureOf(const ViewTarget& target) const;
  Picture PictureIn(const std::shared_ptr<const ViewFrame>& frame, const ViewTarget& target) const;
  void PutParametersAside();
  void SwapParameters();
  std::string NameOfSetB() const;
  Picture PictureB() const;

  // quellViewerPanels.cxx
  void RightPanel(const ImVec2& min, const ImVec2& max);
  void PropertiesTab();
  void MistakesOf(const std::string& box);
  void TemplatePanel();
  void PropertyRow(const std::string& scope, const std::string& box, const Property& row);
  void PipelineTab();
  void TradeTab();
  void MessagesPanel(const ImVec2& min, const ImVec2& max);
  void PropertyMenu(const std::string& scope, const std::string& box, const Property& row, const std::string& shown);
  std::string NodePathOf(const std::string& box) const;
  std::string ValueNow(const std::string& scope, const std::string& text, int depth = 0) const;
  ///@{ What the command line gave counts until it is edited here. Value and option; empty: the file's counts.
  std::optional<std::pair<std::string, std::string>> GivenProperty(
    const std::string& scope, const std::string& box, const std::string& name) const;
  std::optional<std::pair<std::string, std::string>> GivenVariable(const std::string& name) const;
  void DropGivenProperty(const std::string& scope, const std::string& box, const std::string& name);
  void DropGivenVariable(const std::string& name);
  void RenameGiven(const std::string& box, const std::string& name);
  ///@}
  void RenameFromPanel(const std::string& box, const std::string& name);
  void PropertyErrorText(const std::string& of);
  void AddTradePoint();
  /// A point of what is looked at now, without figures.
  TradePoint PointNow() const;

  // quellViewerGraph.cxx
  struct BoxLayout
  {
    ImVec2 Position, Size;         ///< in graph units
    std::vector<int> ShownOutputs; ///< indices of output pins that have a row
    float InTop = 0;
  };
  void GraphPanel(const ImVec2& min, const ImVec2& max);
  void RefreshGraph();
  void PlaceNewBoxes();
  ImVec2 ToScreen(const ImVec2& graph) const;
  ImVec2 ToGraph(const ImVec2& screen) const;
  ImVec2 PinPosition(int box, int pin, bool output) const;
  void PaletteWindow();
  void AddFromPalette(const std::string& type, bool isTemplate, const std::string& library = std::string());
  bool TemplateFits(const PipelineTemplate& t) const;
  void ConnectWherever(int box, int pin, bool isOutput, const std::string& to);
  void Reveal(const std::set<std::string>& boxes);
  void KeepInView();
  void ArrangeAll();
  void FitGraph();
  void CopySelection(bool cut);
  void Paste();
  void DeleteSelection(bool reconnect);
  void DuplicateSelection();
  void EnterScope(const std::string& scope);
  void BeginRename(const std::string& box);
  void AskForTemplate();

  Window& Win;
  const StageRegistry& Registry;
  Options Given;
  double Scale = 1;
  Settings Remembered;
  EditDocument Doc;
  std::uint64_t DocSeen = 0;
  std::unique_ptr<RenderSession> Session;
  std::unique_ptr<Presenter> Present;
  std::vector<std::string> Views;

  // what is shown
  ViewTarget A, B;
  std::vector<ViewTarget> Lost; ///< what was shown until its node went: when it comes back, it is shown again
  std::shared_ptr<const PipelineDocument> LastDocument;
  /// What was shown of documents that undo can bring back, and when.
  std::map<std::weak_ptr<const PipelineDocument>, ViewTarget, std::owner_less<>> ShownOf;
  SourceB BFrom = SourceB::Reference;
  CompareMode Compared = CompareMode::Off;
  bool FlipShowsB = false;
  float WipeAt = 0.5f;
  float Gain = 8;
  DisplaySettings Display;
  Picture Reference, Kept;
  std::string ReferenceFile, KeptName, ReferenceError;
  std::string ReferenceKey; ///< the file and when it was written
  int KeptTick = 0;
  /// Parameter set B and what runs it: while the two are compared, both run the same frame, or follow the same camera.
  std::shared_ptr<const PipelineDocument> SetB;
  std::unique_ptr<RenderSession> SessionB;
  std::shared_ptr<const ViewFrame> ShownB, GoodB;
  Timeline KnownTicks; ///< of the pipeline; while a mistake keeps them from being known, those before the mistake
  int Tick = 0;
  bool Playing = false, Looping = true, Paused = false;
  bool Refine = false;
  HistoryMode History = HistoryMode::Exact;
  std::optional<Mat4> Camera;
  int CameraSerial = 0;
  bool HurryNext = true;
  std::uint64_t WishSerial = 0, PresentSerial = 0;
  std::shared_ptr<const ViewFrame> Shown, LastGood;
  std::shared_ptr<const ViewCheck> Checked;
  std::shared_ptr<const Presentation> Presented;
  WindowTexture TextureA, TextureB, TextureMap;
  std::uint64_t TexturesOf = 0, Uploads = 0;

  // image view
  bool FitImage = true;
  double Zoom = 1;
  ImVec2 Centre{ 0, 0 }; ///< image pixel in the middle of the view, from the top left
  bool PixelValid = false, PixelPinned = false;
  int PixelX = 0, PixelY = 0; ///< from the top left
  bool CameraMode = false, WantAllArrays = false;
  bool AllArrays = false;           ///< asked for in panel Pixel: what the picture's node did not make costs time
  std::optional<bool> LogHistogram; ///< empty: by what the array is
  bool DraggingWipe = false;
  std::string WeighNode; ///< chosen; empty: the nearest filter
  bool WantWeights = false;
  std::shared_ptr<const ViewWeights> Weighed;
  WindowTexture TextureWeights;
  std::shared_ptr<const ViewWeights> WeightsOf; ///< what the summary and the texture are of
  WeightsSummary WeightsSum;

  // graph
  std::string Scope;
  GraphModel Model;
  std::vector<BoxLayout> Boxes;
  std::vector<std::pair<double, double>> Arranged; ///< of a graph whose file has no places
  std::string ArrangedKey;
  std::set<std::string> Selected;
  std::set<std::string> Expanded; ///< boxes whose outputs are all shown
  ImVec2 GraphOffset{ 0, 0 }, GraphMin{ 0, 0 }, GraphMax{ 0, 0 };
  float GraphZoom = 1;
  bool GraphWantsFit = true;
  std::set<std::string> Revealed; ///< boxes that came and are to be seen
  bool MessagesOpen = true;
  std::size_t MessagesCount = 0;
  std::uint64_t ModelOf = 0;
  std::uint64_t ModelArraysOf = 0;
  std::string ModelScope = "?";
  struct Drag
  {
    enum class What
    {
      None,
      Pan,
      Boxes,
      Rubber,
      LinkFromOutput, ///< looking for an input
      LinkFromInput   ///< looking for an output
    } Kind = What::None;
    ImVec2 Start, StartOffset;
    int Box = -1, Pin = -1;
    std::map<std::string, ImVec2> Origins;
    bool Moved = false;
    int TakenLink = -1; ///< index of the link that was picked up at its end
  } Dragging;
  int HoveredLink = -1;
  bool PaletteOpen = false, PaletteFocus = false;
  ImVec2 PaletteAt{ 0, 0 }; ///< in graph units
  ImVec2 PaletteScreen{ 0, 0 };
  std::string PaletteSearch;
  int PaletteChoice = 0;
  int PaletteLinkBox = -1, PaletteLinkPin = -1; ///< a link that was dropped on nothing
  bool PaletteLinkOutput = true;
  int PaletteOnLink = -1;
  std::shared_ptr<const PipelineDocument> Library;
  std::string Renaming, RenameText;
  bool RenameFocus = false;
  std::string Clipboard;

  // trade
  TradePoints Points;
  bool CollectPoints = true;
  TradePoint LastPoint; ///< that was added, and the frame it is of
  std::uint64_t PointOf = 0;
  std::unique_ptr<LedgerRun> Ledger;

  // windows and dialogs
  float GraphFraction = 0.42f, RightFraction = 0.27f;
  bool ShowHelp = false, ShowMessages = true, ShowWelcome = true;
  std::string RightTab = "Node", WantedTab;
  std::string Message;
  bool MessageIsError = false;
  double MessageUntil = 0;
  std::uint64_t MessageOf = 0; ///< the document's revision: what was wrong with an edit is gone with the next one
  std::vector<Diagnostic> OpenErrors;
  std::string OpenErrorFile;
  std::string PendingAction; ///< after the question about unsaved changes
  bool AskUnsaved = false;
  std::string DialogPurpose, DialogTitle, DialogDirectory, DialogName, DialogExtensions;
  bool DialogOpen = false, DialogFocus = false;
  std::string DialogNote;  ///< why the file dialog is still open
  bool AskChanged = false; ///< the file was changed by another program
  bool EditingDoc = false;
  bool AskTemplateName = false, TemplateNameFocus = false;
  std::string TemplateName = "group", TemplateNameError;
  std::string NewPortName, NewPortType = "color";
  std::string NewVariableType = "int", NewVariableName, PropertyError, PropertyErrorOf;
  std::uint64_t PropertyErrorAt = 0; ///< the document's revision
  std::map<std::string, std::string> EditTexts;
  Marks ThisMarks, LastMarks;
  std::uint64_t Drawn = 0;
  bool SettingsChanged = false;
};
}

#endif
