// SPDX-License-Identifier: BSD-3-Clause
#include "quellWindow.h"

#include "quellImageFile.h"
#include "vtkCallbackCommand.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkOpenGLRenderWindow.h"
#include "vtkPointData.h"
#include "vtkRenderWindow.h"
#include "vtkRenderWindowInteractor.h"
#include "vtkRenderer.h"
#include "vtkStringArray.h"
#include "vtkTextureObject.h"
#include "vtkUnsignedCharArray.h"

#include <backends/imgui_impl_opengl3.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>

namespace quell
{
namespace
{
struct NamedKey
{
  const char* Sym;
  int Key;
};
// ImGui 1.86 knows these; everything else goes by Window::Pressed.
const NamedKey NamedKeys[] = { { "Tab", ImGuiKey_Tab }, { "Left", ImGuiKey_LeftArrow },
  { "Right", ImGuiKey_RightArrow }, { "Up", ImGuiKey_UpArrow }, { "Down", ImGuiKey_DownArrow },
  { "Prior", ImGuiKey_PageUp }, { "Next", ImGuiKey_PageDown }, { "Home", ImGuiKey_Home }, { "End", ImGuiKey_End },
  { "Insert", ImGuiKey_Insert }, { "Delete", ImGuiKey_Delete }, { "BackSpace", ImGuiKey_Backspace },
  { "Return", ImGuiKey_Enter }, { "KP_Enter", ImGuiKey_KeyPadEnter }, { "Escape", ImGuiKey_Escape },
  { "a", ImGuiKey_A }, { "c", ImGuiKey_C }, { "v", ImGuiKey_V }, { "x", ImGuiKey_X }, { "y", ImGuiKey_Y },
  { "z", ImGuiKey_Z } };

std::string Lower(std::string s)
{
  if (s.size() == 1 && s[0] >= 'A' && s[0] <= 'Z')
  {
    s[0] = char(s[0] - 'A' + 'a');
  }
  return s;
}

double Now()
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}
}

// ---- textures -------------------------------------------------------------------------------------------------------
WindowTexture::WindowTexture() = default;
WindowTexture::~WindowTexture() = default;

void WindowTexture::Release()
{
  this->Object = nullptr;
  this->W = this->H = 0;
}

void WindowTexture::Upload(vtkRenderWindow* window, const DisplayImage& image)
{
  auto* context = vtkOpenGLRenderWindow::SafeDownCast(window);
  if (!context || image.Rgba.empty())
  {
    this->Release();
    return;
  }
  context->MakeCurrent();
  if (!this->Object)
  {
    this->Object = vtkSmartPointer<vtkTextureObject>::New();
    this->Object->SetContext(context);
  }
  this->Object->SetWrapS(vtkTextureObject::ClampToEdge);
  this->Object->SetWrapT(vtkTextureObject::ClampToEdge);
  this->Object->SetMinificationFilter(vtkTextureObject::Linear);
  this->Object->SetMagnificationFilter(this->Smooth ? vtkTextureObject::Linear : vtkTextureObject::Nearest);
  this->Object->Create2DFromRaw(
    unsigned(image.Width), unsigned(image.Height), 4, VTK_UNSIGNED_CHAR, const_cast<std::uint8_t*>(image.Rgba.data()));
  this->Object->Activate();
  this->Object->SendParameters();
  this->Object->Deactivate();
  this->W = image.Width;
  this->H = image.Height;
}

void WindowTexture::SetSmooth(bool smooth)
{
  if (smooth != this->Smooth)
  {
    this->Smooth = smooth;
    if (this->Object)
    {
      this->Object->SetMagnificationFilter(smooth ? vtkTextureObject::Linear : vtkTextureObject::Nearest);
      this->Object->Activate();
      this->Object->SendParameters();
      this->Object->Deactivate();
    }
  }
}

ImTextureID WindowTexture::Id() const
{
  return this->Object ? reinterpret_cast<ImTextureID>(std::uintptr_t(this->Object->GetHandle())) : nullptr;
}

// ---- the window -----------------------------------------------------------------------------------------------------
Window::Window(const Options& options)
  : View(vtkSmartPointer<vtkRenderWindow>::New())
  , Renderer(vtkSmartPointer<vtkRenderer>::New())
  , Events(vtkSmartPointer<vtkRenderWindowInteractor>::New())
  , Command(vtkSmartPointer<vtkCallbackCommand>::New())
  , OffScreen(options.OffScreen)
{
  this->View->SetMultiSamples(0);
  this->View->SetOffScreenRendering(options.OffScreen);
  this->View->SetSize(options.Width, options.Height);
  this->View->SetWindowName(options.Title.c_str());
  this->Renderer->SetBackground(0.098, 0.102, 0.114);
  this->View->AddRenderer(this->Renderer);
  this->Events->SetInteractorStyle(nullptr);
  this->Events->SetRenderWindow(this->View);
  // ImGui draws; VTK's own answer to an exposed window would be a frame without it.
  this->Events->EnableRenderOff();
  if (!options.OffScreen)
  {
    this->Events->Initialize();
  }
  else
  {
    this->Events->SetSize(options.Width, options.Height); // nobody but scripts sends events
  }
  this->View->Render();

  this->UiScale = options.Scale;
  if (!(this->UiScale > 0))
  {
    this->UiScale = options.OffScreen ? 1 : ScreenScale(this->View->GetGenericDisplayId());
  }

  IMGUI_CHECKVERSION();
  this->Context = ImGui::CreateContext();
  ImGuiIO& io = ImGui::GetIO();
  io.IniFilename = nullptr;
  io.LogFilename = nullptr;
  io.BackendPlatformName = "vtk";
  io.ConfigInputTextCursorBlink = !options.OffScreen;
  for (const NamedKey& k : NamedKeys)
  {
    io.KeyMap[k.Key] = k.Key;
  }
  if (options.SharesClipboard)
  {
    this->Copied.reset(new Clipboard);
    io.ClipboardUserData = this;
    io.SetClipboardTextFn = [](void* self, const char* text)
    { static_cast<Window*>(self)->Copied->Set(text ? text : ""); };
    io.GetClipboardTextFn = [](void* self) -> const char*
    {
      Window& w = *static_cast<Window*>(self);
      w.Pasted = w.Copied->Get();
      return w.Pasted.c_str();
    };
  }
  this->LoadFonts();
  vtkOpenGLRenderWindow::SafeDownCast(this->View)->MakeCurrent();
  ImGui_ImplOpenGL3_Init("#version 150");

  this->Command->SetClientData(this);
  this->Command->SetCallback(
    [](vtkObject*, unsigned long event, void* self, void* data) { static_cast<Window*>(self)->Handle(event, data); });
  this->Renderer->AddObserver(vtkCommand::EndEvent, this->Command);
  for (unsigned long e :
    { vtkCommand::MouseMoveEvent, vtkCommand::LeftButtonPressEvent, vtkCommand::LeftButtonReleaseEvent,
      vtkCommand::RightButtonPressEvent, vtkCommand::RightButtonReleaseEvent, vtkCommand::MiddleButtonPressEvent,
      vtkCommand::MiddleButtonReleaseEvent, vtkCommand::MouseWheelForwardEvent, vtkCommand::MouseWheelBackwardEvent,
      vtkCommand::KeyPressEvent, vtkCommand::KeyReleaseEvent, vtkCommand::ConfigureEvent, vtkCommand::ExposeEvent,
      vtkCommand::ExitEvent, vtkCommand::DropFilesEvent, vtkCommand::LeaveEvent, vtkCommand::LeftButtonDoubleClickEvent,
      vtkCommand::RightButtonDoubleClickEvent, vtkCommand::MiddleButtonDoubleClickEvent })
  {
    this->Events->AddObserver(e, this->Command);
  }
  this->LastTime = Now();
}

Window::~Window()
{
  this->Renderer->RemoveObserver(this->Command);
  this->Events->RemoveObserver(this->Command);
  vtkOpenGLRenderWindow::SafeDownCast(this->View)->MakeCurrent();
  ImGui::SetCurrentContext(this->Context);
  ImGui_ImplOpenGL3_Shutdown();
  ImGui::DestroyContext(this->Context);
  this->View->Finalize();
}

void Window::LoadFonts()
{
  ImGuiIO& io = ImGui::GetIO();
  static const ImWchar ranges[] = { 0x20, 0x17F, 0x370, 0x3FF, 0x2010, 0x2044, 0x2070, 0x209C, 0x2190, 0x21FF, 0x2200,
    0x22FF, 0x25A0, 0x25FF, 0x2600, 0x26FF, 0x2713, 0x2717, 0 };
  const std::string dir = "/usr/share/fonts/truetype/dejavu/";
  std::error_code ec;
  const auto load = [&](const char* name, double size) -> ImFont*
  {
    const std::string path = dir + name;
    if (!std::filesystem::is_regular_file(path, ec))
    {
      return nullptr;
    }
    ImFontConfig config;
    config.OversampleH = 2;
    config.OversampleV = 1;
    return io.Fonts->AddFontFromFileTTF(path.c_str(), float(std::floor(size * this->UiScale + 0.5)), &config, ranges);
  };
  ImFont* regular = load("DejaVuSans.ttf", 14);
  this->Fonts = regular != nullptr;
  if (!regular)
  {
    ImFontConfig config;
    config.SizePixels = float(std::floor(13 * this->UiScale));
    regular = io.Fonts->AddFontDefault(&config);
  }
  this->BoldFont = load("DejaVuSans-Bold.ttf", 14);
  this->SmallFont = load("DejaVuSans.ttf", 12);
  this->MonoFont = load("DejaVuSansMono.ttf", 13);
  this->BoldFont = this->BoldFont ? this->BoldFont : regular;
  this->SmallFont = this->SmallFont ? this->SmallFont : regular;
  this->MonoFont = this->MonoFont ? this->MonoFont : regular;
}

int Window::Width() const
{
  return this->View->GetSize()[0];
}
int Window::Height() const
{
  return this->View->GetSize()[1];
}

void Window::SetTitle(const std::string& title)
{
  if (title != this->LastTitle)
  {
    this->LastTitle = title;
    this->View->SetWindowName(title.c_str());
  }
}

void Window::Handle(unsigned long event, void* data)
{
  if (event == vtkCommand::EndEvent)
  {
    ImGui::SetCurrentContext(this->Context);
    if (ImDrawData* draw = ImGui::GetDrawData())
    {
      ImGui_ImplOpenGL3_RenderDrawData(draw);
    }
    return;
  }
  this->Arrived = true;
  WindowEvent e;
  int x = 0, y = 0;
  this->Events->GetEventPosition(x, y);
  e.X = x;
  e.Y = this->Height() - 1 - y;
  e.Control = this->Events->GetControlKey() != 0;
  e.Shift = this->Events->GetShiftKey() != 0;
  e.Alt = this->Events->GetAltKey() != 0;
  const auto button = [&](int b, bool down)
  {
    WindowEvent move = e;
    move.What = WindowEvent::Kind::Move;
    this->Take(move);
    e.What = WindowEvent::Kind::Button;
    e.Button = b;
    e.Down = down;
    this->Take(e);
  };
  switch (event)
  {
    case vtkCommand::MouseMoveEvent:
      this->Take(e);
      break;
    case vtkCommand::LeaveEvent:
      e.X = e.Y = -1e4;
      this->Take(e);
      break;
    case vtkCommand::LeftButtonPressEvent:
    case vtkCommand::LeftButtonDoubleClickEvent:
      button(0, true);
      break;
    case vtkCommand::LeftButtonReleaseEvent:
      button(0, false);
      break;
    case vtkCommand::RightButtonPressEvent:
    case vtkCommand::RightButtonDoubleClickEvent:
      button(1, true);
      break;
    case vtkCommand::RightButtonReleaseEvent:
      button(1, false);
      break;
    case vtkCommand::MiddleButtonPressEvent:
    case vtkCommand::MiddleButtonDoubleClickEvent:
      button(2, true);
      break;
    case vtkCommand::MiddleButtonReleaseEvent:
      button(2, false);
      break;
    case vtkCommand::MouseWheelForwardEvent:
    case vtkCommand::MouseWheelBackwardEvent:
      e.What = WindowEvent::Kind::Wheel;
      e.Amount = event == vtkCommand::MouseWheelForwardEvent ? 1 : -1;
      this->Take(e);
      break;
    case vtkCommand::KeyPressEvent:
    case vtkCommand::KeyReleaseEvent:
    {
      e.What = WindowEvent::Kind::Key;
      e.Down = event == vtkCommand::KeyPressEvent;
      const char* sym = this->Events->GetKeySym();
      e.Sym = Lower(sym ? sym : "");
      this->Take(e);
      const unsigned char code = static_cast<unsigned char>(this->Events->GetKeyCode());
      if (e.Down && code >= 32 && code != 127 && !e.Control && !e.Alt)
      {
        e.What = WindowEvent::Kind::Text;
        e.Character = code;
        this->Take(e);
      }
      break;
    }
    case vtkCommand::DropFilesEvent:
      if (auto* files = static_cast<vtkStringArray*>(data))
      {
        e.What = WindowEvent::Kind::Drop;
        for (vtkIdType i = 0; i < files->GetNumberOfValues(); ++i)
        {
          e.Files.push_back(files->GetValue(i));
        }
        this->Take(e);
      }
      break;
    case vtkCommand::ExitEvent:
      this->Closing = true;
      break;
    default:
      break;
  }
}

void Window::Take(const WindowEvent& e)
{
  if (this->Recorder)
  {
    this->Recorder(e);
  }
  this->Queue.push_back(e);
}

void Window::Send(const WindowEvent& event)
{
  vtkRenderWindowInteractor* i = this->Events;
  const char code = event.What == WindowEvent::Kind::Text ? char(event.Character) : 0;
  i->SetEventInformation(int(event.X), this->Height() - 1 - int(event.Y), event.Control, event.Shift, code, 0,
    event.Sym.empty() ? nullptr : event.Sym.c_str());
  i->SetAltKey(event.Alt);
  switch (event.What)
  {
    case WindowEvent::Kind::Move:
      i->InvokeEvent(vtkCommand::MouseMoveEvent);
      break;
    case WindowEvent::Kind::Button:
    {
      const unsigned long down[3] = { vtkCommand::LeftButtonPressEvent, vtkCommand::RightButtonPressEvent,
        vtkCommand::MiddleButtonPressEvent };
      const unsigned long up[3] = { vtkCommand::LeftButtonReleaseEvent, vtkCommand::RightButtonReleaseEvent,
        vtkCommand::MiddleButtonReleaseEvent };
      i->InvokeEvent(event.Down ? down[event.Button] : up[event.Button]);
      break;
    }
    case WindowEvent::Kind::Wheel:
      for (int n = 0; n < int(std::fabs(event.Amount)); ++n)
      {
        i->InvokeEvent(event.Amount > 0 ? vtkCommand::MouseWheelForwardEvent : vtkCommand::MouseWheelBackwardEvent);
      }
      break;
    case WindowEvent::Kind::Key:
      i->InvokeEvent(event.Down ? vtkCommand::KeyPressEvent : vtkCommand::KeyReleaseEvent);
      break;
    case WindowEvent::Kind::Text:
      i->InvokeEvent(vtkCommand::KeyPressEvent);
      i->SetKeyCode(0);
      i->InvokeEvent(vtkCommand::KeyReleaseEvent);
      break;
    case WindowEvent::Kind::Drop:
    {
      vtkNew<vtkStringArray> files;
      for (const std::string& f : event.Files)
      {
        files->InsertNextValue(f);
      }
      i->InvokeEvent(vtkCommand::DropFilesEvent, files);
      break;
    }
  }
}

bool Window::Poll()
{
  this->Arrived = false;
  if (!this->OffScreen)
  {
    this->Events->ProcessEvents();
    if (this->Events->GetDone())
    {
      this->Closing = true;
      this->Events->SetDone(false);
    }
  }
  return this->Arrived || !this->Queue.empty();
}

bool Window::Pressed(const char* sym, bool control, bool shift, bool alt) const
{
  for (const WindowEvent& k : this->Keys)
  {
    if (k.Sym == sym && k.Control == control && k.Shift == shift && k.Alt == alt)
    {
      return true;
    }
  }
  return false;
}

std::vector<std::string> Window::TakeDrops()
{
  std::vector<std::string> files;
  files.swap(this->Drops);
  return files;
}

bool Window::Frame(const std::function<void()>& ui)
{
  ImGui::SetCurrentContext(this->Context);
  ImGuiIO& io = ImGui::GetIO();
  this->Keys.clear();
  // Widgets look once a frame: a press and its release, or a press and the move after it, belong to different frames.
  // Characters that a field is waiting for do not: it takes all of them at once, so that a busy machine keeps up with
  // somebody who types.
  bool clicked = false, commanded = false;
  int characters = 0;
  std::vector<std::string> released;
  const auto isModifier = [](const std::string& sym)
  { return sym.compare(0, 7, "Control") == 0 || sym.compare(0, 5, "Shift") == 0 || sym.compare(0, 3, "Alt") == 0; };
  while (!this->Queue.empty())
  {
    const WindowEvent& e = this->Queue.front();
    const bool moves = e.X != double(io.MousePos.x) || e.Y != double(io.MousePos.y);
    const bool modifier = isModifier(e.Sym);
    const bool types = io.WantTextInput && !e.Control && !e.Alt && !modifier && e.What == WindowEvent::Kind::Key &&
                       (e.Down ? this->Queue.size() > 1 && this->Queue[1].What == WindowEvent::Kind::Text
                               : this->Typed.count(e.Sym) != 0);
    bool over = clicked || commanded;
    switch (e.What)
    {
      case WindowEvent::Kind::Move:
        over = over && moves;
        break;
      case WindowEvent::Kind::Wheel:
        over = clicked;
        break;
      case WindowEvent::Kind::Button:
        over = over || characters > 0;
        break;
      case WindowEvent::Kind::Text:
        over = clicked;
        break;
      case WindowEvent::Kind::Key:
        // A command is for what the characters before it made; a key that went up goes down again a frame later.
        over = over || (!types && characters > 0 && (e.Down || modifier)) ||
               (!types && e.Down && std::find(released.begin(), released.end(), e.Sym) != released.end());
        break;
      case WindowEvent::Kind::Drop:
        over = false;
        break;
    }
    if (over)
    {
      break;
    }
    io.KeyCtrl = e.Control;
    io.KeyShift = e.Shift;
    io.KeyAlt = e.Alt;
    switch (e.What)
    {
      case WindowEvent::Kind::Move:
        io.MousePos = ImVec2(float(e.X), float(e.Y));
        break;
      case WindowEvent::Kind::Button:
        io.MouseDown[e.Button] = e.Down;
        clicked = true;
        break;
      case WindowEvent::Kind::Wheel:
        (e.Shift ? io.MouseWheelH : io.MouseWheel) += float(e.Amount);
        break;
      case WindowEvent::Kind::Key:
        for (const NamedKey& k : NamedKeys)
        {
          if (e.Sym == k.Sym)
          {
            io.KeysDown[k.Key] = e.Down;
          }
        }
        if (e.Sym == "Control_L" || e.Sym == "Control_R")
        {
          io.KeyCtrl = e.Down;
        }
        if (e.Sym == "Shift_L" || e.Sym == "Shift_R")
        {
          io.KeyShift = e.Down;
        }
        if (e.Down)
        {
          this->Keys.push_back(e);
          commanded = !types && !modifier;
        }
        else
        {
          released.push_back(e.Sym);
        }
        if (types && e.Down)
        {
          this->Typed.insert(e.Sym);
        }
        else
        {
          this->Typed.erase(e.Sym);
        }
        break;
      case WindowEvent::Kind::Text:
        io.AddInputCharacter(e.Character);
        ++characters;
        break;
      case WindowEvent::Kind::Drop:
        this->Drops.insert(this->Drops.end(), e.Files.begin(), e.Files.end());
        break;
    }
    this->Queue.pop_front();
  }
  const double now = Now();
  // Off screen time is a count of frames, so that what is replayed looks the same every time.
  io.DeltaTime = this->OffScreen ? 1.f / 60 : float(std::max(1e-4, now - this->LastTime));
  this->LastTime = now;
  io.DisplaySize = ImVec2(float(this->Width()), float(this->Height()));
  vtkOpenGLRenderWindow::SafeDownCast(this->View)->MakeCurrent();
  ImGui_ImplOpenGL3_NewFrame();
  ImGui::NewFrame();
  ui();
  ImGui::Render();
  if (!this->Blind)
  {
    this->View->Render();
  }
  return !this->Closing;
}

void Window::Paint()
{
  this->View->Render();
}

std::vector<std::uint8_t> Window::Pixels(int& width, int& height)
{
  width = this->Width();
  height = this->Height();
  if (this->Blind)
  {
    this->View->Render();
  }
  vtkNew<vtkUnsignedCharArray> data;
  this->View->GetPixelData(0, 0, width - 1, height - 1, 0, data, 0);
  std::vector<std::uint8_t> out(std::size_t(width) * std::size_t(height) * 3);
  for (int y = 0; y < height; ++y)
  {
    std::memcpy(&out[std::size_t(y) * std::size_t(width) * 3], data->GetPointer(vtkIdType(height - 1 - y) * width * 3),
      std::size_t(width) * 3);
  }
  return out;
}

vtkSmartPointer<vtkImageData> ImageOfPixels(const std::vector<std::uint8_t>& rgb, int width, int height)
{
  vtkNew<vtkFloatArray> values;
  values->SetName("display");
  values->SetNumberOfComponents(3);
  values->SetNumberOfTuples(vtkIdType(width) * height);
  for (int y = 0; y < height; ++y)
  {
    const std::uint8_t* from = &rgb[std::size_t(height - 1 - y) * std::size_t(width) * 3];
    float* to = values->GetPointer(vtkIdType(y) * width * 3);
    for (int i = 0; i < 3 * width; ++i)
    {
      to[i] = float(from[i]) / 255.f;
    }
  }
  auto image = vtkSmartPointer<vtkImageData>::New();
  image->SetDimensions(width, height, 1);
  image->GetPointData()->AddArray(values);
  return image;
}

void Window::Screenshot(const std::string& file)
{
  int w = 0, h = 0;
  const std::vector<std::uint8_t> pixels = this->Pixels(w, h);
  const auto image = ImageOfPixels(pixels, w, h);
  WriteImageFile(file, image, { { "display", "", ArrayKind::Display, nullptr } });
}
}
