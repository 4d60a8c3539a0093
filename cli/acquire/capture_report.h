// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/capture/capture.h"
#include "acquire/capture/session_writer.h"
#include "cli/acquire/until_error.h"
#include "cli/verbs.h"
#include "core/base/json.h"

namespace refield::cli {

/// Says how a capture into `session` went, as text or, where asked for, as JSON, and writes the run's log
/// beside the session. `until` may be null.
void report_capture(const CaptureSummary& summary, const fs::path& session, const UntilError* until,
                    const Common& common);

/// Checks the photographs of a session (check_capture()) and prints the verdict, all of it where something is
/// not good; with `figures`, adds it to them instead. Nothing for a folder that is not a session.
void report_check(const fs::path& session, Json* figures = nullptr);

/// Adds --resume, which sets `choice` to IfExists::resume.
void add_resume_flag(CLI::App& verb, IfExists& choice);
/// `choice` or, with --force, IfExists::replace. Throws InputError where both were given.
IfExists if_exists(IfExists choice, const Common& common);

}  // namespace refield::cli
