// SPDX-License-Identifier: Apache-2.0
#include "acquire/devices/window_monitor.h"

#include <SDL.h>
#include <time.h>

#include <algorithm>
#include <cerrno>
#include <utility>

#include "core/base/errors.h"

namespace refield {

namespace {

[[noreturn]] void fail(const std::string& what) {
  throw DeviceError("window monitor", ENODEV, what + " (" + SDL_GetError() + ")");
}

/// SDL's video part, for as long as it is needed. Signals stay ours.
class Video {
 public:
  Video() {
    SDL_SetHint(SDL_HINT_NO_SIGNAL_HANDLERS, "1");
    SDL_SetHint(SDL_HINT_RENDER_SCALE_QUALITY, "nearest");
    SDL_SetHint(SDL_HINT_VIDEO_HIGHDPI_DISABLED, "0");
    if (SDL_InitSubSystem(SDL_INIT_VIDEO) != 0) fail(no_desktop);
    // SDL has drivers that draw to nowhere, and takes them where nothing else is.
    const std::string driver = SDL_GetCurrentVideoDriver() ? SDL_GetCurrentVideoDriver() : "";
    for (const char* nowhere : {"dummy", "offscreen", "evdev"})
      if (driver == nowhere) {
        SDL_QuitSubSystem(SDL_INIT_VIDEO);
        throw DeviceError("window monitor", ENODEV, no_desktop);
      }
  }
  ~Video() { SDL_QuitSubSystem(SDL_INIT_VIDEO); }
  static constexpr const char* no_desktop =
      "there is no desktop to open a window on; set DISPLAY or WAYLAND_DISPLAY, or use a KMS monitor";
  Video(const Video&) = delete;
  Video& operator=(const Video&) = delete;
};

WindowDisplay display_at(int index) {
  SDL_DisplayMode mode{};
  if (SDL_GetDesktopDisplayMode(index, &mode) != 0) fail("cannot ask the display for its mode");
  const char* name = SDL_GetDisplayName(index);
  return {name ? name : "display " + std::to_string(index), mode.w, mode.h,
          static_cast<double>(mode.refresh_rate)};
}

TimePoint monotonic_now() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return TimePoint(std::chrono::seconds(now.tv_sec) + std::chrono::nanoseconds(now.tv_nsec));
}

struct Deleter {
  void operator()(SDL_Window* window) const { SDL_DestroyWindow(window); }
  void operator()(SDL_Renderer* renderer) const { SDL_DestroyRenderer(renderer); }
  void operator()(SDL_Texture* texture) const { SDL_DestroyTexture(texture); }
};

}  // namespace

bool has_window_monitor() {
  return true;
}

std::vector<WindowDisplay> window_displays() {
  const Video video;
  std::vector<WindowDisplay> displays;
  for (int i = 0; i < SDL_GetNumVideoDisplays(); ++i) displays.push_back(display_at(i));
  return displays;
}

struct WindowMonitor::State {
  Video video;
  WindowDisplay display;
  int width = 0, height = 0;  // of light maps
  int screen_width = 0, screen_height = 0;
  int scale = 1;
  bool waits = false;
  bool covered = false;
  std::vector<WindowKey> keys;
  std::unique_ptr<SDL_Window, Deleter> window;
  std::unique_ptr<SDL_Renderer, Deleter> renderer;
  std::unique_ptr<SDL_Texture, Deleter> texture;

  explicit State(const WindowMonitorOptions& options) {
    const int displays = SDL_GetNumVideoDisplays();
    if (options.display < 0 || options.display >= displays)
      throw InputError("the desktop has " + std::to_string(displays) + " display(s); there is no display " +
                       std::to_string(options.display));
    display = display_at(options.display);
    open_window(options.display);
    // Pixels of the screen, not the desktop's points.
    if (SDL_GetRendererOutputSize(renderer.get(), &screen_width, &screen_height) != 0)
      fail("cannot ask for the window's size in pixels");
    width = options.width > 0 ? options.width : screen_width;
    height = options.height > 0 ? options.height : screen_height;
    scale = std::min(screen_width / width, screen_height / height);
    if (scale < 1)
      throw InputError(display.name + ": light maps of " + std::to_string(width) + "×" +
                       std::to_string(height) + " texels are larger than the screen of " +
                       std::to_string(screen_width) + "×" + std::to_string(screen_height) + " pixels");
    texture.reset(
        SDL_CreateTexture(renderer.get(), SDL_PIXELFORMAT_RGB24, SDL_TEXTUREACCESS_STREAMING, width, height));
    if (!texture) fail("cannot create the image");
    SDL_SetTextureBlendMode(texture.get(), SDL_BLENDMODE_NONE);
    SDL_SetTextureScaleMode(texture.get(), SDL_ScaleModeNearest);
  }

  void open_window(int index) {
    const int place = static_cast<int>(SDL_WINDOWPOS_UNDEFINED_DISPLAY(static_cast<unsigned>(index)));
    window.reset(SDL_CreateWindow("refield", place, place, display.width, display.height,
                                  SDL_WINDOW_FULLSCREEN_DESKTOP | SDL_WINDOW_BORDERLESS |
                                      SDL_WINDOW_ALLOW_HIGHDPI | SDL_WINDOW_ALWAYS_ON_TOP));
    if (!window) fail("cannot open a full-screen window");
    renderer.reset(SDL_CreateRenderer(window.get(), -1, SDL_RENDERER_PRESENTVSYNC));
    if (!renderer) fail("cannot draw into the window");
    SDL_RendererInfo info{};
    waits = SDL_GetRendererInfo(renderer.get(), &info) == 0 && (info.flags & SDL_RENDERER_PRESENTVSYNC) != 0;
    SDL_ShowCursor(SDL_DISABLE);
    SDL_DisableScreenSaver();
  }

  /// Throws when the window was closed: no one sees what is shown.
  void handle_events() {
    SDL_Event event;
    while (SDL_PollEvent(&event)) {
      if (event.type == SDL_QUIT ||
          (event.type == SDL_WINDOWEVENT && event.window.event == SDL_WINDOWEVENT_CLOSE))
        throw DeviceError(display.name, ENODEV,
                          "the window was closed; start again, where it stopped, with --resume or --from");
      if (event.type == SDL_WINDOWEVENT && event.window.event == SDL_WINDOWEVENT_EXPOSED) covered = true;
      if (event.type != SDL_KEYDOWN || event.key.repeat != 0) continue;
      switch (event.key.keysym.sym) {
        case SDLK_SPACE:
        case SDLK_RIGHT:
        case SDLK_DOWN:
          keys.push_back(WindowKey::next);
          break;
        case SDLK_LEFT:
        case SDLK_UP:
        case SDLK_BACKSPACE:
          keys.push_back(WindowKey::back);
          break;
        case SDLK_p:
          keys.push_back(WindowKey::pause);
          break;
        case SDLK_ESCAPE:
        case SDLK_q:
          keys.push_back(WindowKey::stop);
          break;
        default:
          break;
      }
    }
  }

  void draw(const DriveImage& image) const {
    if (SDL_UpdateTexture(texture.get(), nullptr, image.levels.data(), 3 * width) != 0)
      fail("cannot draw the pattern");
    draw_texture();
  }

  void draw_texture() const {
    const SDL_Rect place = {(screen_width - width * scale) / 2, (screen_height - height * scale) / 2,
                            width * scale, height * scale};
    if (SDL_SetRenderDrawColor(renderer.get(), 0, 0, 0, 255) != 0 || SDL_RenderClear(renderer.get()) != 0 ||
        SDL_RenderCopy(renderer.get(), texture.get(), nullptr, &place) != 0)
      fail("cannot draw the pattern");
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
  if (std::exchange(state.covered, false)) {
    state.draw_texture();
    SDL_RenderPresent(state.renderer.get());
  }
  return std::exchange(state.keys, {});
}

TimePoint WindowMonitor::show(const DriveImage& image) {
  State& state = *state_;
  if (image.width != state.width || image.height != state.height ||
      image.levels.size() != std::size_t{3} * state.width * state.height)
    throw InputError(state.display.name + ": a pattern of " + std::to_string(image.width) + "×" +
                     std::to_string(image.height) + " does not fit the " + std::to_string(state.width) + "×" +
                     std::to_string(state.height) + " texels of the configured light maps");
  state.handle_events();
  // Twice: the first swap may only queue the picture behind the one on screen; the second returns once that
  // has given way.
  for (int i = 0; i < 2; ++i) {
    state.draw(image);
    SDL_RenderPresent(state.renderer.get());
  }
  state.handle_events();
  return monotonic_now();
}

}  // namespace refield
