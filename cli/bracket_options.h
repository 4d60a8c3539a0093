// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <CLI/CLI.hpp>

#include "acquire/import/bracket_merge.h"

namespace refield::cli {

/// Options that say what is known of the camera behind bracketed image files.
void add_bracket_camera(CLI::App& verb, BracketCamera& camera);

}  // namespace refield::cli
