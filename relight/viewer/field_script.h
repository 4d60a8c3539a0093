// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "relight/viewer/app.h"
#include "relight/viewer/script_player.h"

namespace refield {

/// What scripts can do with a field; `app` must outlive it.
ScriptStage field_stage(App& app);

}  // namespace refield
