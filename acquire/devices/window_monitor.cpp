// SPDX-License-Identifier: Apache-2.0
#include "acquire/devices/monitors.h"

#define GL_GLEXT_PROTOTYPES
#define GLFW_INCLUDE_NONE

#include <GL/gl.h>
#include <GL/glext.h>
#include <GLFW/glfw3.h>
#include <time.h>

#include <algorithm>
#include <cerrno>
#include <string_view>

#include "acquire/devices/tethered_camera.h"

namespace refield {

namespace {

[[noreturn]] void fail(const std::string& what) {
  const char* reason = nullptr;
  glfwGetError(&reason);
  throw DeviceError("window monitor", ENODEV,
                    reason == nullptr ? what : what + " (" + std::string(reason) + ")");
}

/// The connection to the desktop, for as long as it is needed.
class Desktop {
 public:
  Desktop() {
    if (glfwInit() == GLFW_FALSE)
      fail("there is no desktop to open a window on; set DISPLAY or WAYLAND_DISPLAY, or use a KMS monitor");
  }
  ~Desktop() { glfwTerminate(); }
  Desktop(const Desktop&) = delete;
  Desktop& operator=(const Desktop&) = delete;

  std::vector<GLFWmonitor*> displays() const {
    int count = 0;
    GLFWmonitor** all = glfwGetMonitors(&count);
    return {all, all + count};
  }
};

WindowDisplay description_of(GLFWmonitor* display) {
  const GLFWvidmode* mode = glfwGetVideoMode(display);
  if (mode == nullptr) fail("cannot read the display's mode");
  return {glfwGetMonitorName(display), mode->width, mode->height, static_cast<double>(mode->refreshRate)};
}

/// Letters as the keyboard's layout has them.
std::optional<WindowKey> window_key(int key, int scancode) {
  switch (key) {
    case GLFW_KEY_SPACE:
    case GLFW_KEY_RIGHT:
    case GLFW_KEY_DOWN:
      return WindowKey::next;
    case GLFW_KEY_LEFT:
    case GLFW_KEY_UP:
    case GLFW_KEY_BACKSPACE:
      return WindowKey::back;
    case GLFW_KEY_ESCAPE:
      return WindowKey::stop;
    default:
      break;
  }
  const char* name = glfwGetKeyName(key, scancode);
  if (name == nullptr) return std::nullopt;
  if (name == std::string_view("p")) return WindowKey::pause;
  if (name == std::string_view("q")) return WindowKey::stop;
  return std::nullopt;
}

}  // namespace

std::vector<WindowDisplay> window_displays() {
  const Desktop desktop;
  std::vector<WindowDisplay> displays;
  for (GLFWmonitor* display : desktop.displays()) displays.push_back(description_of(display));
  return displays;
}

struct WindowMonitor::State {
  Desktop desktop;
  WindowDisplay display;
  int width = 0, height = 0;  // of light maps
  int screen_width = 0, screen_height = 0;
  int scale = 1;
  bool waits = false;
  bool is_exposed = false;  // what was covered must be drawn again
  std::vector<WindowKey> keys;
  std::unique_ptr<GLFWwindow, decltype(&glfwDestroyWindow)> window{nullptr, glfwDestroyWindow};

  explicit State(const WindowMonitorOptions& options) {
    const auto displays = desktop.displays();
    if (options.display < 0 || static_cast<std::size_t>(options.display) >= displays.size())
      throw InputError("the desktop has ", displays.size(), " display(s); there is no display ",
                       options.display);
    GLFWmonitor* chosen = displays[static_cast<std::size_t>(options.display)];
    display = description_of(chosen);
    open_window(chosen);
    // Pixels of the screen, not the desktop's points.
    glfwGetFramebufferSize(window.get(), &screen_width, &screen_height);
    width = options.width > 0 ? options.width : screen_width;
    height = options.height > 0 ? options.height : screen_height;
    scale = std::min(screen_width / width, screen_height / height);
    if (scale < 1)
      throw InputError(display.name, ": light maps of ", width, "×", height,
                       " texels are larger than the screen of ", screen_width, "×", screen_height, " pixels");
    prepare_drawing();
    waits = swaps_wait();
  }

  void open_window(GLFWmonitor* chosen) {
    glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 3);
    glfwWindowHint(GLFW_AUTO_ICONIFY, GLFW_FALSE);  // stays where another window takes the keyboard
    window.reset(glfwCreateWindow(display.width, display.height, "refield", chosen, nullptr));
    if (!window) fail("cannot open a full-screen window with OpenGL 3.0");
    glfwFocusWindow(window.get());
    glfwSetInputMode(window.get(), GLFW_CURSOR, GLFW_CURSOR_HIDDEN);
    glfwSetWindowUserPointer(window.get(), this);
    glfwSetKeyCallback(window.get(), [](GLFWwindow* w, int key, int scancode, int action, int) {
      if (action != GLFW_PRESS) return;
      if (const auto pressed = window_key(key, scancode)) of(w).keys.push_back(*pressed);
    });
    glfwSetWindowRefreshCallback(window.get(), [](GLFWwindow* w) { of(w).is_exposed = true; });
    glfwMakeContextCurrent(window.get());
    glfwSwapInterval(1);
  }

  static State& of(GLFWwindow* w) { return *static_cast<State*>(glfwGetWindowUserPointer(w)); }

  /// The pattern is a texture of a framebuffer, which is copied to the screen without any shading.
  void prepare_drawing() const {
    unsigned texture = 0, framebuffer = 0;  // both go with the window
    glGenTextures(1, &texture);
    glBindTexture(GL_TEXTURE_2D, texture);
    glTexImage2D(GL_TEXTURE_2D, 0, GL_RGBA8, width, height, 0, GL_RGBA, GL_UNSIGNED_BYTE, nullptr);
    glGenFramebuffers(1, &framebuffer);
    glBindFramebuffer(GL_READ_FRAMEBUFFER, framebuffer);
    glFramebufferTexture2D(GL_READ_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, texture, 0);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    glDisable(GL_DITHER);
    glClearColor(0.0f, 0.0f, 0.0f, 1.0f);
    if (glCheckFramebufferStatus(GL_READ_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE ||
        glGetError() != GL_NO_ERROR)
      fail("cannot create the image");
  }

  /// Whether swaps, of a black screen, take as long as its refreshes: drivers accept the wish to wait where
  /// they cannot.
  bool swaps_wait() const {
    constexpr int unmeasured = 2, measured = 4;  // the first ones may only fill the queue
    TimePoint start{};
    for (int i = 0; i < unmeasured + measured; ++i) {
      if (i == unmeasured) start = monotonic_now();
      glClear(GL_COLOR_BUFFER_BIT);
      glfwSwapBuffers(window.get());
      glfwPollEvents();
    }
    const double refreshes = Seconds(monotonic_now() - start).count() / measured * display.refresh_hz;
    return refreshes > 0.5 && refreshes < 1.5;  // not where the rate is unknown or drawing is slow
  }

  /// Throws when the window was closed: no one sees what is shown.
  void handle_events() const {
    glfwPollEvents();
    if (glfwWindowShouldClose(window.get()) == GLFW_TRUE)
      throw DeviceError(display.name, ENODEV,
                        "the window was closed; start again, where it stopped, with --resume or --from");
  }

  void set_pattern(const DriveImage& image) const {
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, width, height, GL_RGB, GL_UNSIGNED_BYTE, image.levels.data());
  }

  void draw_pattern() const {
    const int left = (screen_width - width * scale) / 2, top = (screen_height - height * scale) / 2;
    glClear(GL_COLOR_BUFFER_BIT);
    // OpenGL counts the screen's lines from below.
    glBlitFramebuffer(0, 0, width, height, left, screen_height - top, left + width * scale,
                      screen_height - top - height * scale, GL_COLOR_BUFFER_BIT, GL_NEAREST);
    if (glGetError() != GL_NO_ERROR) fail("cannot draw the pattern");
    glfwSwapBuffers(window.get());
  }
};

WindowMonitor::WindowMonitor(const WindowMonitorOptions& options)
    : state_(std::make_unique<State>(options)) {}
WindowMonitor::~WindowMonitor() = default;

IlluminatorDescription WindowMonitor::describe() const {
  return {state_->display.name + " (window) " + std::to_string(state_->screen_width) + "×" +
              std::to_string(state_->screen_height),
          state_->width, state_->height, Seconds(0), Seconds(0)};
}

int WindowMonitor::pixels_per_texel() const {
  return state_->scale;
}

bool WindowMonitor::waits_for_blanking() const {
  return state_->waits;
}

std::vector<WindowKey> WindowMonitor::keys() {
  State& state = *state_;
  state.handle_events();
  if (std::exchange(state.is_exposed, false)) state.draw_pattern();
  return std::exchange(state.keys, {});
}

TimePoint WindowMonitor::show(const DriveImage& image) {
  State& state = *state_;
  require_size(image, state.width, state.height, state.display.name);
  state.handle_events();
  state.set_pattern(image);
  // Twice: the first swap may only queue the picture behind the one on screen; the second returns once that
  // has given way.
  for (int i = 0; i < 2; ++i) state.draw_pattern();
  glFinish();
  state.handle_events();
  return monotonic_now();
}

}  // namespace refield
