// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "common/options.h"
#include "refield/estimate.h"

namespace refield::cli {

/// What estimate and submit estimate from, and how.
struct EstimationArguments {
  CaptureOptions capture;
  std::vector<std::string> placements;
  std::string mode = "refined";
  double memory_gib = 4.0;
  std::string rig = "auto";
  EstimateOptions options;
};

/// Adds the session, the capture options, and those that the field depends on, with --memory and --threads.
void add_estimation_options(CLI::App& verb, EstimationArguments& arguments);

/// Adds --dry-run.
CLI::Option* add_dry_run_flag(CLI::App& verb, bool& dry_run);

/// Opens the input and completes arguments.options. Throws InputError.
Session open_estimation(EstimationArguments& arguments);

}  // namespace refield::cli
