// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <CLI/CLI.hpp>
#include <string>

#include "acquire/session_writer.h"

namespace refield::cli {

/// Adds --resume and --force, of which only one can be given; `what` is in the output folder ("a capture").
void add_if_exists(CLI::App& verb, IfExists& choice, const std::string& what);

}  // namespace refield::cli
