// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "cli/report/input.h"

namespace refield::report {

/// What a stage wrote about its own run, beside what it made.
struct RunLog {
  std::filesystem::path path;
  std::string stage;
  std::optional<double> seconds;
  std::optional<std::uint64_t> peak_memory_bytes;
  std::optional<int> threads;
  std::string details;  ///< the other entries, "bands 4, images 180"
};

/// Reads a run log: a JSON object of stage, seconds, peak_memory_bytes, threads and more. nullopt when there
/// is none. Throws FormatError when it is no such object.
std::optional<RunLog> read_run_log(const std::filesystem::path& path);

/// The logs of the stages that led to the report, in the data's order: simulate, acquire, estimate.
std::vector<RunLog> find_run_logs(const ReportInput& input);

}  // namespace refield::report
