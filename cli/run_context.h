// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "refield/run_context.h"

namespace refield {

/// The command line's run context, one per process: progress and notes go to standard error, and SIGINT or
/// SIGTERM stop it. Files of libraries that damaged ones can crash are read by refield-reader in a process of
/// its own.
///  - Progress: a bar with the time left on a terminal; elsewhere lines with percentages, every ten seconds
///    at first and at least every ten minutes in a run of hours. Stages shorter than a second and stages
///    within others are not shown.
///  - Notes: one line each; where standard error is not a terminal, the time (UTC) stands before it.
const RunContext& run_context();

/// Silences progress and notes (--quiet).
void silence_progress();

/// From now on the first SIGINT or SIGTERM requests a clean stop; a second one ends the process at once.
void install_interrupt_handler();

}  // namespace refield
