// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <deque>
#include <memory>

#include "core/image/image_io.h"

namespace refield {

/// What a window's user does; `apply` hands it on.
struct InputEvent {
  enum class Kind { mouse_move, mouse_button, other };
  Kind kind = Kind::other;
  std::function<void()> apply = [] {};
};

/// Events in the order in which they happened.
class InputQueue {
 public:
  void push(InputEvent event) { events_.push_back(std::move(event)); }
  bool is_empty() const { return events_.empty(); }

  /// Takes the events of one frame: all up to the first that comes after a press or release and would blur
  /// where or in what order that was. A click that began and ended between two frames so takes two.
  std::vector<InputEvent> take_frame() {
    std::vector<InputEvent> frame;
    bool had_button = false;
    while (!events_.empty() && !(had_button && events_.front().kind != InputEvent::Kind::other)) {
      had_button |= events_.front().kind == InputEvent::Kind::mouse_button;
      frame.push_back(std::move(events_.front()));
      events_.pop_front();
    }
    return frame;
  }

 private:
  std::deque<InputEvent> events_;
};

struct PressedKey {
  int key = 0;  ///< GLFW's number
  bool with_shift = false;
};

/// What a frame is to act on, beside mouse and text, which Dear ImGui takes.
struct FrameInput {
  std::vector<PressedKey> keys;  ///< without Control
  std::vector<fs::path> dropped;
};

/// A window with OpenGL 3.3 and Dear ImGui: collects input, draws frames. One at a time.
class GlWindow {
 public:
  /// Throws DeviceError where there is no display or OpenGL is too old.
  GlWindow(int width, int height);
  ~GlWindow();
  GlWindow(const GlWindow&) = delete;
  GlWindow& operator=(const GlWindow&) = delete;

  bool is_closed() const;
  void set_title(const std::string& title);

  /// Collects what happened since the last call; waits for it up to `patience_s` where no earlier event is
  /// left. Whether there is an event.
  bool collect(double patience_s);

  /// Begins a frame with the next events.
  FrameInput begin_frame();
  /// Draws what was asked of Dear ImGui since begin_frame(), and shows it. `shot`, where given, takes what
  /// the window shows.
  void end_frame(ScreenImage* shot);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// A picture on the graphics card. Needs the window.
class Texture {
 public:
  Texture() = default;
  ~Texture();
  Texture(const Texture&) = delete;
  Texture& operator=(const Texture&) = delete;

  /// `rgba` [width × height × 4].
  void update(int width, int height, std::span<const std::uint8_t> rgba);
  /// Whether pixels blend into each other when enlarged.
  void set_smooth(bool is_smooth);
  /// As Dear ImGui takes it.
  void* handle() const;

 private:
  unsigned name_ = 0;
  int width_ = 0, height_ = 0;
  bool is_smooth_ = true;
};

}  // namespace refield
