// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <deque>
#include <filesystem>
#include <string>
#include <variant>
#include <vector>

namespace refield {

/// What a window's user does. Positions are pixels of the window, top left first. A script makes the same
/// events as mouse and keyboard, and they go the same way from there.
struct MouseMoved {
  double x = 0.0;
  double y = 0.0;
};
enum class MouseButton { left = 0, right = 1, middle = 2 };
struct MouseButtonChanged {
  MouseButton button = MouseButton::left;
  bool is_down = false;
};
struct MouseScrolled {
  double x = 0.0;
  double y = 0.0;
};
/// `key`: GLFW's number.
struct KeyChanged {
  int key = 0;
  bool is_down = false;
  bool with_shift = false;
  bool with_control = false;
};
struct CharacterTyped {
  unsigned code_point = 0;
};
struct FilesDropped {
  std::vector<std::filesystem::path> files;
};
using InputEvent =
    std::variant<MouseMoved, MouseButtonChanged, MouseScrolled, KeyChanged, CharacterTyped, FilesDropped>;

/// Events in the order in which they happened.
class InputQueue {
 public:
  void push(InputEvent event) { events_.push_back(std::move(event)); }
  bool is_empty() const { return events_.empty(); }

  /// Takes the events of one frame: all up to the first that comes after a press or release and would blur
  /// where or in what order that was. A click that began and ended between two frames so takes two.
  std::vector<InputEvent> take_frame();

 private:
  std::deque<InputEvent> events_;
};

}  // namespace refield
