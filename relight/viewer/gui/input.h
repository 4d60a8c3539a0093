// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <filesystem>
#include <functional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace refield {

/// What a window's user does. Positions are pixels of the window, top left first.
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
  std::vector<InputEvent> take_frame() {
    std::vector<InputEvent> frame;
    bool had_button = false;
    while (!events_.empty()) {
      const bool is_button = std::holds_alternative<MouseButtonChanged>(events_.front());
      if (had_button && (is_button || std::holds_alternative<MouseMoved>(events_.front()))) break;
      had_button |= is_button;
      frame.push_back(std::move(events_.front()));
      events_.pop_front();
    }
    return frame;
  }

 private:
  std::deque<InputEvent> events_;
};

/// A key and what it does. The help shows them all, grouped in their order.
struct ShortcutKey {
  std::string group;
  std::string name;  ///< "Shift+E"
  int key = 0;       ///< GLFW's
  bool with_shift = false;
  std::string help;
};

/// Of a window whose state is a `State`.
template <class State>
struct Shortcut : ShortcutKey {
  using Action = std::function<void(State&)>;
  Shortcut(ShortcutKey pressed, Action does) : ShortcutKey(std::move(pressed)), action(std::move(does)) {}
  Action action;
};

/// Does what a pressed key stands for; nothing for other keys and releases.
template <class State>
void handle_key(const std::vector<Shortcut<State>>& shortcuts, State& state, const KeyChanged& key) {
  if (!key.is_down || key.with_control) return;
  for (const auto& shortcut : shortcuts)
    if (shortcut.key == key.key && shortcut.with_shift == key.with_shift) return shortcut.action(state);
}

template <class State>
std::vector<ShortcutKey> keys_of(const std::vector<Shortcut<State>>& shortcuts) {
  return {shortcuts.begin(), shortcuts.end()};
}

}  // namespace refield
