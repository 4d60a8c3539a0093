// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "relight/viewer/field/app.h"
#include "relight/viewer/gui/input.h"
#include "relight/viewer/gui/script.h"

namespace refield {

const std::vector<Shortcut<App>>& shortcuts();

/// What scripts can do with a field; `app` must outlive it.
ScriptStage field_stage(App& app);

}  // namespace refield
