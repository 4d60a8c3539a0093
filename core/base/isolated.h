// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/base/reader_process.h"
#include "core/base/run_context.h"

namespace refield {

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
std::optional<std::string> read_in_process(const std::filesystem::path& program,
                                           const IsolatedReading& reading, const RunContext& run);

}  // namespace refield
