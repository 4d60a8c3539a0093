// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace refield {

/// What a process that reads one file may use. Generous for what reads the structure of a file.
struct IsolationLimits {
  std::uint64_t memory_bytes = std::uint64_t{1} << 30;  ///< above what it starts with; not kept under ASan
  int cpu_seconds = 20;
  unsigned wall_seconds = 120;  ///< ends a process that waits for something without using the processor
  std::size_t answer_bytes = std::size_t{64} << 20;
};

/// Reads a file with an unsafe library and returns what it found as bytes. May throw anything.
using FileReader = std::string (*)(const std::vector<std::string>& arguments);

/// The descriptor on which a reader process answers.
inline constexpr int answer_descriptor = 3;

/// What such a process is called with: reader, pid of its parent, limits, arguments of the reader.
std::vector<std::string> reader_arguments(const std::string& reader, long parent,
                                          const IsolationLimits& limits,
                                          const std::vector<std::string>& arguments);

/// The whole of such a program: sets its limits, runs the reader that its arguments name, writes the answer
/// and ends with status 0 where that is complete, without what libraries do at exit. This file needs no
/// library, so that the program starts in milliseconds.
[[noreturn]] void run_reader_process(int argc, char** argv, const std::map<std::string, FileReader>& readers);

}  // namespace refield
