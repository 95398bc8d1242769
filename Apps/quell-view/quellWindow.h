// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellWindow_h
#define quellWindow_h

#include "quellClipboard.h"
#include "quellDisplayMapping.h"
#include "vtkCallbackCommand.h"
#include "vtkImageData.h"
#include "vtkRenderWindow.h"
#include "vtkRenderWindowInteractor.h"
#include "vtkRenderer.h"
#include "vtkSmartPointer.h"
#include "vtkTextureObject.h"

#include <imgui.h>

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

namespace quell
{
/// One thing that a mouse or a keyboard did.
struct WindowEvent
{
  enum class Kind
  {
    Move,   ///< X, Y
    Button, ///< Button, Down
    Wheel,  ///< Amount
    Key,    ///< Sym (X11's name), Down, modifiers
    Text,   ///< Character
    Drop    ///< Files
  };
  Kind What = Kind::Move;
  double X = 0, Y = 0; ///< from the top left
  int Button = 0;      ///< 0 left, 1 right, 2 middle
  bool Down = false;
  double Amount = 0;
  std::string Sym;
  unsigned int Character = 0;
  bool Control = false, Shift = false, Alt = false;
  std::vector<std::string> Files;
};

/// A texture of the window. (quell::Texture is a scene's.)
class WindowTexture
{
public:
  WindowTexture();
  ~WindowTexture();
  void Upload(vtkRenderWindow* window, const DisplayImage& image);
  ImTextureID Id() const;
  int Width() const { return this->W; }
  int Height() const { return this->H; }
  void SetSmooth(bool smooth);
  void Release();

private:
  vtkSmartPointer<vtkTextureObject> Object;
  int W = 0, H = 0;
  bool Smooth = false;
};

/// A vtkRenderWindow whose renderer draws Dear ImGui on top (on its EndEvent). VTK's interactor is where events come
/// from, so what a test replays takes the way of a real mouse.
class Window
{
public:
  struct Options
  {
    int Width = 1440, Height = 900;
    bool OffScreen = false;
    double Scale = 0; ///< 0: from the screen's resolution
    std::string Title = "Quell";
    /// Copied text is there for other programs and theirs for us; off screen nobody asked for that.
    bool SharesClipboard = false;
  };
  explicit Window(const Options& options);
  ~Window();
  Window(const Window&) = delete;
  void operator=(const Window&) = delete;

  /// Handles events, draws one frame with `ui`. False after the window was closed.
  bool Frame(const std::function<void()>& ui);
  /// Events are waiting that the last frame did not take (a click ends in the frame after it began).
  bool HasEvents() const { return !this->Queue.empty(); }
  /// Asks the system for events without drawing; true when some came.
  bool Poll();
  /// Frames are laid out but not painted: scripts that nobody watches. Pixels and Screenshot paint the last one.
  void SetBlind(bool blind) { this->Blind = blind; }
  /// Paints what the last frame laid out.
  void Paint();
  void Close() { this->Closing = true; }
  void KeepOpen() { this->Closing = false; }
  bool IsClosing() const { return this->Closing; }

  /// X11's name of a key that went down in this frame, with exactly these modifiers.
  bool Pressed(const char* sym, bool control = false, bool shift = false, bool alt = false) const;
  bool AnyKeyPressed() const { return !this->Keys.empty(); }
  std::vector<std::string> TakeDrops();

  vtkRenderWindow* Get() const { return this->View; }
  vtkRenderWindowInteractor* Interactor() const { return this->Events; }
  double Scale() const { return this->UiScale; }
  int Width() const;
  int Height() const;
  void SetTitle(const std::string& title);
  ImFont* Bold() const { return this->BoldFont; }
  ImFont* Small() const { return this->SmallFont; }
  ImFont* Mono() const { return this->MonoFont; }
  bool HasFonts() const { return this->Fonts; }

  /// Sends an event the way VTK's interactor does.
  void Send(const WindowEvent& event);
  /// Called for every event that arrives.
  void SetRecorder(std::function<void(const WindowEvent&)> recorder) { this->Recorder = std::move(recorder); }

  /// The last frame, 3 bytes a pixel, row 0 on top.
  std::vector<std::uint8_t> Pixels(int& width, int& height);
  /// As PNG; throws StageError.
  void Screenshot(const std::string& file);

private:
  void Handle(unsigned long event, void* data);
  void Take(const WindowEvent& e);
  void LoadFonts();

  vtkSmartPointer<vtkRenderWindow> View;
  vtkSmartPointer<vtkRenderer> Renderer;
  vtkSmartPointer<vtkRenderWindowInteractor> Events;
  vtkSmartPointer<vtkCallbackCommand> Command;
  ImGuiContext* Context = nullptr;
  std::unique_ptr<Clipboard> Copied;
  std::string Pasted; ///< what ImGui was given last
  ImFont *BoldFont = nullptr, *SmallFont = nullptr, *MonoFont = nullptr;
  bool Fonts = false;
  double UiScale = 1;
  std::deque<WindowEvent> Queue;
  std::vector<WindowEvent> Keys; ///< that went down in this frame
  std::set<std::string> Typed;   ///< keys that are down and were characters of a field
  std::vector<std::string> Drops;
  std::function<void(const WindowEvent&)> Recorder;
  bool Closing = false;
  bool OffScreen = false;
  bool Arrived = false, Blind = false;
  double LastTime = 0;
  std::string LastTitle;
};

/// Width x height pixels of 3 bytes, row 0 on top, as an image with one array `display` in [0, 1].
vtkSmartPointer<vtkImageData> ImageOfPixels(const std::vector<std::uint8_t>& rgb, int width, int height);
}

#endif
