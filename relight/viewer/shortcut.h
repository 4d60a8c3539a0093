// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "relight/viewer/input.h"

namespace refield {

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

/// The event of pressing a shortcut of that name. Throws InputError for a name that none has.
KeyChanged key_named(const std::vector<ShortcutKey>& shortcuts, const std::string& name);

}  // namespace refield
