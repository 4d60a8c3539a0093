// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/gui/gl_window.h"

#define GL_GLEXT_PROTOTYPES
#define GLFW_INCLUDE_NONE

#include <GL/gl.h>
#include <GL/glext.h>
#include <GLFW/glfw3.h>
#include <backends/imgui_impl_opengl3.h>

#include <cerrno>

#include "core/base/number_text.h"
#include "relight/viewer/gui/widgets.h"

namespace refield {

namespace {

constexpr float font_size_px = 15.0f;

ImVec4 grey(float value, float alpha = 1.0f) {
  return {value, value, value, alpha};
}

/// The desktop's usual fonts; without them Dear ImGui's own, which has no signs beyond ASCII.
void load_font(float scale) {
  ImGuiIO& io = ImGui::GetIO();
  static const ImWchar signs[] = {0x20,   0xff,   0x2010, 0x2044, 0x2070, 0x207f, 0x2150,
                                  0x215e, 0x2190, 0x2193, 0x2211, 0x2265, 0};
  for (const char* file :
       {"/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf",
        "/usr/share/fonts/dejavu-sans-fonts/DejaVuSans.ttf", "/usr/share/fonts/TTF/DejaVuSans.ttf",
        "/usr/share/fonts/truetype/liberation/LiberationSans-Regular.ttf"})
    if (fs::exists(file) &&
        io.Fonts->AddFontFromFileTTF(file, font_size_px * scale, nullptr, signs) != nullptr)
      return;
  io.FontGlobalScale = scale;
}

[[noreturn]] void fail(const std::string& what, const std::string& remedy) {
  const char* reason = nullptr;
  glfwGetError(&reason);
  throw DeviceError("viewer", ENODEV, what, reason != nullptr ? " (" + std::string(reason) + ")" : "", "; ",
                    remedy);
}

/// Of a window, by GLFW's pointer to it.
struct Input {
  InputQueue queue;
  FrameInput frame;  ///< what the events of the frame were, as they are applied
};

Input& input_of(GLFWwindow* window) {
  return *static_cast<Input*>(glfwGetWindowUserPointer(window));
}

void on_move(GLFWwindow* window, double x, double y) {
  // Windows are measured in points, pictures in pixels; on some screens they differ.
  int width = 0, height = 0, pixels_wide = 0, pixels_high = 0;
  glfwGetWindowSize(window, &width, &height);
  glfwGetFramebufferSize(window, &pixels_wide, &pixels_high);
  const ImVec2 at = vector(x * pixels_wide / std::max(width, 1), y * pixels_high / std::max(height, 1));
  input_of(window).queue.push({InputEvent::Kind::mouse_move, [=] { ImGui::GetIO().MousePos = at; }});
}

void on_button(GLFWwindow* window, int button, int action, int) {
  if (button > GLFW_MOUSE_BUTTON_MIDDLE) return;
  input_of(window).queue.push(
      {InputEvent::Kind::mouse_button, [=] { ImGui::GetIO().MouseDown[button] = action == GLFW_PRESS; }});
}

void on_scroll(GLFWwindow* window, double x, double y) {
  input_of(window).queue.push({InputEvent::Kind::other, [=] {
                                 ImGui::GetIO().MouseWheelH += static_cast<float>(x);
                                 ImGui::GetIO().MouseWheel += static_cast<float>(y);
                               }});
}

void on_key(GLFWwindow* window, int key, int, int action, int modifiers) {
  Input& input = input_of(window);
  input.queue.push({InputEvent::Kind::other, [=, &input] {
                      ImGuiIO& io = ImGui::GetIO();
                      const bool is_down = action != GLFW_RELEASE;
                      if (key >= 0 && key < IM_ARRAYSIZE(io.KeysDown)) io.KeysDown[key] = is_down;
                      io.KeyShift = (modifiers & GLFW_MOD_SHIFT) != 0;
                      io.KeyCtrl = (modifiers & GLFW_MOD_CONTROL) != 0;
                      if (is_down && !io.KeyCtrl) input.frame.keys.push_back({key, io.KeyShift});
                    }});
}

void on_character(GLFWwindow* window, unsigned code_point) {
  input_of(window).queue.push(
      {InputEvent::Kind::other, [=] { ImGui::GetIO().AddInputCharacter(code_point); }});
}

void on_drop(GLFWwindow* window, int count, const char** files) {
  Input& input = input_of(window);
  input.queue.push({InputEvent::Kind::other, [&input, dropped = std::vector<fs::path>(files, files + count)] {
                      input.frame.dropped.insert(input.frame.dropped.end(), dropped.begin(), dropped.end());
                    }});
}

/// Keys that text fields need, under the numbers that GLFW gives them.
void map_keys(ImGuiIO& io) {
  io.KeyMap[ImGuiKey_Tab] = GLFW_KEY_TAB;
  io.KeyMap[ImGuiKey_LeftArrow] = GLFW_KEY_LEFT;
  io.KeyMap[ImGuiKey_RightArrow] = GLFW_KEY_RIGHT;
  io.KeyMap[ImGuiKey_Home] = GLFW_KEY_HOME;
  io.KeyMap[ImGuiKey_End] = GLFW_KEY_END;
  io.KeyMap[ImGuiKey_Delete] = GLFW_KEY_DELETE;
  io.KeyMap[ImGuiKey_Backspace] = GLFW_KEY_BACKSPACE;
  io.KeyMap[ImGuiKey_Enter] = GLFW_KEY_ENTER;
  io.KeyMap[ImGuiKey_Escape] = GLFW_KEY_ESCAPE;
  io.KeyMap[ImGuiKey_A] = GLFW_KEY_A;
}

/// Neutral greys around pictures, so that they alone have colour; amber marks what is selected.
void apply_theme(float scale) {
  load_font(scale);
  ImGui::StyleColorsDark();
  ImGuiStyle& style = ImGui::GetStyle();
  style.WindowRounding = 6.0f;
  style.ChildRounding = 6.0f;
  style.FrameRounding = 4.0f;
  style.GrabRounding = 4.0f;
  style.PopupRounding = 6.0f;
  style.ScrollbarRounding = 6.0f;
  style.ScrollbarSize = 11.0f;
  style.WindowBorderSize = 0.0f;
  style.FramePadding = ImVec2(8.0f, 4.0f);
  style.ItemSpacing = ImVec2(8.0f, 6.0f);
  style.WindowPadding = ImVec2(12.0f, 10.0f);
  style.GrabMinSize = 12.0f;
  style.ScaleAllSizes(scale);

  const ImVec4 accent(0.94f, 0.64f, 0.24f, 1.0f), soft_accent(0.94f, 0.64f, 0.24f, 0.35f);
  ImVec4* colours = style.Colors;
  colours[ImGuiCol_Text] = grey(0.86f);
  colours[ImGuiCol_TextDisabled] = grey(0.52f);
  colours[ImGuiCol_WindowBg] = grey(0.135f);
  colours[ImGuiCol_ChildBg] = grey(0.0f, 0.0f);
  colours[ImGuiCol_PopupBg] = grey(0.12f, 0.97f);
  colours[ImGuiCol_Border] = grey(0.26f);
  colours[ImGuiCol_FrameBg] = grey(0.20f);
  colours[ImGuiCol_FrameBgHovered] = grey(0.25f);
  colours[ImGuiCol_FrameBgActive] = grey(0.28f);
  colours[ImGuiCol_ScrollbarBg] = grey(0.0f, 0.0f);
  colours[ImGuiCol_ScrollbarGrab] = grey(0.30f);
  colours[ImGuiCol_CheckMark] = accent;
  colours[ImGuiCol_SliderGrab] = grey(0.40f);
  colours[ImGuiCol_SliderGrabActive] = ImVec4(0.72f, 0.46f, 0.14f, 1.0f);
  colours[ImGuiCol_Button] = grey(0.22f);
  colours[ImGuiCol_ButtonHovered] = grey(0.29f);
  colours[ImGuiCol_ButtonActive] = soft_accent;
  colours[ImGuiCol_Header] = grey(0.20f);
  colours[ImGuiCol_HeaderHovered] = grey(0.26f);
  colours[ImGuiCol_HeaderActive] = soft_accent;
  colours[ImGuiCol_Separator] = grey(0.24f);
  colours[ImGuiCol_TableHeaderBg] = grey(0.17f);
  colours[ImGuiCol_TableRowBgAlt] = grey(1.0f, 0.02f);
}

}  // namespace

struct GlWindow::Impl {
  /// What glfwInit() began; ends it.
  struct Library {
    Library() {
      if (glfwInit() == GLFW_FALSE)
        fail("there is no display to open a window on",
             "run it on a desktop, over 'ssh -X', or under 'xvfb-run'; 'refield relight' writes files "
             "without");
    }
    ~Library() { glfwTerminate(); }
    Library(const Library&) = delete;
    Library& operator=(const Library&) = delete;
  };

  Library library;
  GLFWwindow* window = nullptr;
  Input input;
  GLFWcursor* hand = nullptr;
  std::chrono::steady_clock::time_point last_frame = std::chrono::steady_clock::now();

  Impl(int width, int height) {
    glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 3);
    glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 3);
    glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
    window = glfwCreateWindow(width, height, "refield", nullptr, nullptr);
    if (window == nullptr)
      fail("cannot open a window with OpenGL 3.3",
           "update the graphics driver, or set LIBGL_ALWAYS_SOFTWARE=1 to draw without one");
    glfwMakeContextCurrent(window);
    glfwSwapInterval(1);
    glfwSetWindowSizeLimits(window, 720, 520, GLFW_DONT_CARE, GLFW_DONT_CARE);
    hand = glfwCreateStandardCursor(GLFW_HAND_CURSOR);
    ImGui::CreateContext();
    ImGuiIO& io = ImGui::GetIO();
    io.IniFilename = nullptr;
    map_keys(io);
    float scale = 1.0f, scale_y = 1.0f;
    glfwGetWindowContentScale(window, &scale, &scale_y);
    apply_theme(scale);
    ImGui_ImplOpenGL3_Init("#version 330 core");
  }
  ~Impl() {
    ImGui_ImplOpenGL3_Shutdown();
    ImGui::DestroyContext();
    if (hand != nullptr) glfwDestroyCursor(hand);
    glfwDestroyWindow(window);
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  ScreenImage shot(int width, int height) const {
    ScreenImage image{width, height, 3, {}};
    image.levels.resize(std::size_t{3} * width * height);
    std::vector<std::uint8_t> upside_down(image.levels.size());
    glPixelStorei(GL_PACK_ALIGNMENT, 1);
    glReadPixels(0, 0, width, height, GL_RGB, GL_UNSIGNED_BYTE, upside_down.data());
    const std::size_t line = std::size_t{3} * width;
    for (int y = 0; y < height; ++y)
      std::copy_n(upside_down.begin() + static_cast<std::ptrdiff_t>(line * y), line,
                  image.levels.begin() + static_cast<std::ptrdiff_t>(line * (height - 1 - y)));
    return image;
  }
};

GlWindow::GlWindow(int width, int height) : impl_(std::make_unique<Impl>(width, height)) {
  GLFWwindow* window = impl_->window;
  glfwSetWindowUserPointer(window, &impl_->input);
  glfwSetCursorPosCallback(window, on_move);
  glfwSetMouseButtonCallback(window, on_button);
  glfwSetScrollCallback(window, on_scroll);
  glfwSetKeyCallback(window, on_key);
  glfwSetCharCallback(window, on_character);
  glfwSetDropCallback(window, on_drop);
}

GlWindow::~GlWindow() = default;

bool GlWindow::is_closed() const {
  return glfwWindowShouldClose(impl_->window) != 0;
}

void GlWindow::set_title(const std::string& title) {
  glfwSetWindowTitle(impl_->window, title.c_str());
}

bool GlWindow::collect(double patience_s) {
  if (patience_s > 0.0 && impl_->input.queue.is_empty())
    glfwWaitEventsTimeout(patience_s);
  else
    glfwPollEvents();
  return !impl_->input.queue.is_empty();
}

FrameInput GlWindow::begin_frame() {
  ImGuiIO& io = ImGui::GetIO();
  int width = 0, height = 0;
  glfwGetFramebufferSize(impl_->window, &width, &height);
  io.DisplaySize = ImVec2(static_cast<float>(width), static_cast<float>(height));
  const auto now = std::chrono::steady_clock::now();
  io.DeltaTime = std::max(1e-4f, std::chrono::duration<float>(now - impl_->last_frame).count());
  impl_->last_frame = now;
  for (const InputEvent& event : impl_->input.queue.take_frame()) event.apply();
  ImGui_ImplOpenGL3_NewFrame();
  ImGui::NewFrame();
  return std::exchange(impl_->input.frame, {});
}

void GlWindow::end_frame(ScreenImage* shot) {
  ImGui::Render();
  glfwSetCursor(impl_->window, ImGui::GetMouseCursor() == ImGuiMouseCursor_Hand ? impl_->hand : nullptr);
  int width = 0, height = 0;
  glfwGetFramebufferSize(impl_->window, &width, &height);
  glViewport(0, 0, width, height);
  glClearColor(0.085f, 0.085f, 0.09f, 1.0f);
  glClear(GL_COLOR_BUFFER_BIT);
  ImGui_ImplOpenGL3_RenderDrawData(ImGui::GetDrawData());
  if (shot != nullptr) *shot = impl_->shot(width, height);
  glfwSwapBuffers(impl_->window);
}

Texture::~Texture() {
  if (name_ != 0) glDeleteTextures(1, &name_);
}

void Texture::update(int width, int height, std::span<const std::uint8_t> rgba) {
  if (rgba.size() != std::size_t{4} * width * height)
    throw InputError("a texture takes four bytes per pixel");
  if (name_ == 0) {
    glGenTextures(1, &name_);
    glBindTexture(GL_TEXTURE_2D, name_);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, is_smooth_ ? GL_LINEAR : GL_NEAREST);
  }
  glBindTexture(GL_TEXTURE_2D, name_);
  glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
  if (width != width_ || height != height_)
    glTexImage2D(GL_TEXTURE_2D, 0, GL_RGBA8, width, height, 0, GL_RGBA, GL_UNSIGNED_BYTE, rgba.data());
  else
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, width, height, GL_RGBA, GL_UNSIGNED_BYTE, rgba.data());
  width_ = width;
  height_ = height;
}

void Texture::set_smooth(bool is_smooth) {
  if (is_smooth == is_smooth_) return;
  is_smooth_ = is_smooth;
  if (name_ == 0) return;
  glBindTexture(GL_TEXTURE_2D, name_);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, is_smooth ? GL_LINEAR : GL_NEAREST);
}

void* Texture::handle() const {
  // NOLINTNEXTLINE(performance-no-int-to-ptr): Dear ImGui carries OpenGL's numbers in pointers.
  return reinterpret_cast<void*>(static_cast<std::uintptr_t>(name_));
}

}  // namespace refield
