// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "relight/viewer/field/app.h"
#include "relight/viewer/gui/input.h"

namespace refield {

const std::vector<Shortcut<App>>& shortcuts();

}  // namespace refield
