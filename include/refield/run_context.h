// SPDX-License-Identifier: Apache-2.0
#pragma once

/// What the caller of a long operation supplies, and what the library throws.
///
/// Public: RunContext (on_progress, on_note, stop, read_isolated, max_threads), StageProgress, and the errors
/// InputError, FormatError, DeviceError and SolverError, all derived from Error. Interrupted, which follows
/// RunContext::stop, is no Error. A default RunContext is silent and never stops; the library itself writes
/// nothing to standard error, reads no global flag and handles no signal. Callbacks come from any thread.
#include "core/base/errors.h"
#include "core/base/isolated.h"
#include "core/base/run_context.h"
