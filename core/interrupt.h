// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace refield {

/// From now on the first SIGINT or SIGTERM asks for a clean stop; a second one ends the process at once.
void install_interrupt_handler();

bool interrupted();

/// Throws Interrupted once a stop was asked for, or the caller's group of TBB tasks was cancelled. Called
/// between units of work whose results are already safe on disk.
void throw_if_interrupted();

}  // namespace refield
