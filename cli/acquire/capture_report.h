// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>

#include "acquire/capture.h"
#include "cli/acquire/until_error.h"
#include "cli/verbs.h"

namespace refield::cli {

/// Says how a capture into `session` went, as text or, where asked for, as JSON, and writes the run's log
/// beside the session. `until` may be null.
void report_capture(const CaptureSummary& summary, const std::filesystem::path& session,
                    const UntilError* until, const Common& common);

}  // namespace refield::cli
