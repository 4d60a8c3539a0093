// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <map>
#include <vector>

#include "core/base/run_context.h"

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

/// One file to be read by a library that a hostile file can crash, hang, or make use up memory.
struct IsolatedReading {
  std::string reader;                  ///< a name of the reader program's: "hdf5", "mesh"
  std::vector<std::string> arguments;  ///< the file first
  IsolationLimits limits = {};
};

/// The answer of a reader: from run.read_isolated where that is set, else from `read` in this process.
/// nullopt where `read` throws anything but Interrupted, or the other process did not survive.
std::optional<std::string> answer_of(const IsolatedReading& reading, FileReader read, const RunContext& run);

/// Reads in a new process that runs `program` (see reader_process.h), for RunContext::read_isolated. nullopt
/// where it crashed, hung, used more than the limits allow or answered too long. Keeps accidents in, not
/// intruders: the process has the caller's rights. It ends with the calling process. Safe in processes with
/// threads. Throws DeviceError when the program cannot be started, Interrupted when `run` is stopped.
std::optional<std::string> read_in_process(const fs::path& program, const IsolatedReading& reading,
                                           const RunContext& run);

}  // namespace refield
