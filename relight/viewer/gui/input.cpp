// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/gui/input.h"

#include <algorithm>

#include "core/base/errors.h"

namespace refield {

std::vector<InputEvent> InputQueue::take_frame() {
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

KeyChanged key_named(const std::vector<ShortcutKey>& shortcuts, const std::string& name) {
  const auto found = std::ranges::find(shortcuts, name, &ShortcutKey::name);
  if (found != shortcuts.end()) return {found->key, true, found->with_shift, false};
  std::string known;
  for (const ShortcutKey& shortcut : shortcuts) known.append(known.empty() ? "" : " ").append(shortcut.name);
  throw InputError("no shortcut has the key '" + name + "'; there are " + known);
}

}  // namespace refield
