// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "cli/verbs.h"

namespace refield::cli {

// One file a subcommand of `refield acquire`. Each adds its own to `group`.
void add_acquire_devices(CLI::App& group, const Common& common, Action& action);
void add_acquire_calibrate(CLI::App& group, const Common& common, Action& action);
void add_acquire_run(CLI::App& group, const Common& common, Action& action);
void add_acquire_virtual(CLI::App& group, const Common& common, Action& action);
void add_acquire_import(CLI::App& group, const Common& common, Action& action);
void add_acquire_init(CLI::App& group, const Common& common, Action& action);
void add_acquire_lights(CLI::App& group, const Common& common, Action& action);
void add_acquire_show(CLI::App& group, const Common& common, Action& action);
void add_acquire_match(CLI::App& group, const Common& common, Action& action);
void add_acquire_probe(CLI::App& group, const Common& common, Action& action);

}  // namespace refield::cli
