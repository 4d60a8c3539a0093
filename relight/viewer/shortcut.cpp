// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/shortcut.h"

#include <algorithm>

#include "core/errors.h"

namespace refield {

KeyChanged key_named(const std::vector<ShortcutKey>& shortcuts, const std::string& name) {
  const auto found = std::ranges::find(shortcuts, name, &ShortcutKey::name);
  if (found != shortcuts.end()) return {found->key, true, found->with_shift, false};
  std::string known;
  for (const ShortcutKey& shortcut : shortcuts) known.append(known.empty() ? "" : " ").append(shortcut.name);
  throw InputError("no shortcut has the key '" + name + "'; there are " + known);
}

}  // namespace refield
