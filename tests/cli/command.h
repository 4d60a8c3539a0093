// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <iosfwd>
#include <string>
#include <vector>

namespace refield::test {

/// What a run of the program left behind.
struct CommandResult {
  int status = -1;  ///< exit status; 128 + signal when a signal ended it
  std::string out;  ///< standard output
  std::string err;  ///< standard error
};

/// For GoogleTest's messages.
void PrintTo(const CommandResult& result, std::ostream* stream);

/// Runs a program with the given arguments and waits for it.
CommandResult run_program(const std::string& program, const std::vector<std::string>& arguments);

/// The same with the built `refield`.
CommandResult run_refield(const std::vector<std::string>& arguments);

}  // namespace refield::test
