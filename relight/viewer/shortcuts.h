// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "relight/viewer/app.h"
#include "relight/viewer/shortcut.h"

namespace refield {

const std::vector<Shortcut<App>>& shortcuts();

}  // namespace refield
