// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "cli/verbs.h"

namespace refield::studies {

using cli::Action;
using cli::Common;

// The verbs of refield-studies. Each adds its subcommand and, when that is named, sets `action`. They write
// tables as CSV, which draw.py draws.
void add_chart(CLI::App& app, const Common& common, Action& action);
void add_prt_chart(CLI::App& app, Action& action);
void add_dynamic_chart(CLI::App& app, Action& action);
void add_dynamic_bases(CLI::App& app, Action& action);
void add_pack_chart(CLI::App& app, const Common& common, Action& action);

}  // namespace refield::studies
