// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "relight/viewer/app.h"
#include "relight/viewer/input.h"

namespace refield {

/// A key and what it does. The help shows them all, grouped in this order.
struct Shortcut {
  std::string group;
  std::string name;  ///< "Shift+E"
  int key = 0;       ///< GLFW's
  bool with_shift = false;
  std::string help;
  std::function<void(App&)> action;
};

const std::vector<Shortcut>& shortcuts();

/// Does what a pressed key stands for; nothing for other keys and releases.
void handle_key(App& app, const KeyChanged& key);

/// The event of pressing a shortcut of that name. Throws InputError for a name that none has.
KeyChanged key_named(const std::string& name);

}  // namespace refield
