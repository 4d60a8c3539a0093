// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
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

/// MADE.log.json, beside the file or folder that a stage made. Beside, not inside: a folder that a resumed
/// run finished holds the same bytes as one that was made in one go.
std::filesystem::path run_log_path(const std::filesystem::path& made);

/// Writes the log of a run that made `made`, with the most memory that this process has held, then `details`
/// (an object).
void write_run_log(const std::filesystem::path& made, const std::string& stage, double seconds,
                   const nlohmann::ordered_json& details);

/// Reads a run log: a JSON object of stage, seconds, peak_memory_bytes, threads and more. nullopt when there
/// is none. Throws FormatError when it is no such object.
std::optional<RunLog> read_run_log(const std::filesystem::path& path);

/// The logs of the stages that led to the report, in the data's order: simulate, acquire, estimate.
std::vector<RunLog> find_run_logs(const ReportInput& input);

}  // namespace refield::report
