// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <CLI/CLI.hpp>

#include <memory>
#include <vector>

#include "refield/run_context.h"

namespace refield::cli {

/// Options that every verb shares.
struct Common {
  bool json = false;   ///< figures as JSON on standard output
  bool quiet = false;  ///< no progress
  bool force = false;  ///< output of an earlier run is replaced
};

/// The user stopped the verb and was told already what goes on and how to continue.
struct Detached : Interrupted {};

/// What the command line asked for; called once, after parsing.
using Action = std::function<void()>;

/// Makes `action` run(*options, common) when `verb` is named.
template <class Options, class Run>
void on_command(CLI::App& verb, const std::shared_ptr<Options>& options, const Common& common, Action& action,
                Run run) {
  verb.callback([=, &common, &action] { action = [=, &common] { run(*options, common); }; });
}

/// Runs the command of these words, without "refield". Throws what the verb throws.
void run_words(std::vector<std::string> words);

// One file a verb. Each adds its subcommand and, when that is named, sets `action`.
void add_simulate(CLI::App& app, const Common& common, Action& action);
void add_precompute(CLI::App& app, const Common& common, Action& action);
void add_render(CLI::App& app, const Common& common, Action& action);
void add_acquire(CLI::App& app, const Common& common, Action& action);
void add_estimate(CLI::App& app, const Common& common, Action& action);
void add_merge(CLI::App& app, const Common& common, Action& action);
void add_submit(CLI::App& app, const Common& common, Action& action);
void add_relight(CLI::App& app, const Common& common, Action& action);
void add_compare(CLI::App& app, const Common& common, Action& action);
void add_export_web(CLI::App& app, const Common& common, Action& action);
void add_pack(CLI::App& app, const Common& common, Action& action);
void add_info(CLI::App& app, const Common& common, Action& action);
void add_view(CLI::App& app, const Common& common, Action& action);

// One file a subcommand of `refield acquire`. Each adds its own to `group`.
void add_acquire_devices(CLI::App& group, const Common& common, Action& action);
void add_acquire_colour(CLI::App& group, const Common& common, Action& action);
void add_acquire_geometry(CLI::App& group, const Common& common, Action& action);
void add_acquire_calibrate(CLI::App& group, const Common& common, Action& action);
void add_acquire_run(CLI::App& group, const Common& common, Action& action);
void add_acquire_import(CLI::App& group, const Common& common, Action& action);
void add_acquire_guide(CLI::App& group, const Common& common, Action& action);
void add_acquire_lights(CLI::App& group, const Common& common, Action& action);
void add_acquire_show(CLI::App& group, const Common& common, Action& action);
void add_acquire_probe(CLI::App& group, const Common& common, Action& action);

}  // namespace refield::cli
