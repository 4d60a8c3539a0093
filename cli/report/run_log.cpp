// SPDX-License-Identifier: Apache-2.0
#include "cli/report/run_log.h"

#include <sys/resource.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <string_view>

#include "cli/report/html.h"
#include "core/errors.h"
#include "core/files.h"
#include "core/json_text.h"

namespace refield::report {

namespace fs = std::filesystem;

namespace {

template <class T>
std::optional<T> number(const nlohmann::ordered_json& json, const char* key) {
  const auto found = json.find(key);
  if (found == json.end() || !found->is_number()) return std::nullopt;
  return found->get<T>();
}

/// "foreseen_memory_bytes": 457278272 reads "foreseen memory 457 MB".
std::string detail(std::string key, const nlohmann::ordered_json& value) {
  static constexpr std::string_view bytes = "_bytes";
  const bool in_bytes = value.is_number() && key.ends_with(bytes);
  if (in_bytes) key.resize(key.size() - bytes.size());
  std::ranges::replace(key, '_', ' ');
  key += ' ';
  if (in_bytes) return key + bytes_text(value.get<double>());
  if (value.is_number_float()) return key + significant(value.get<double>(), 3);
  return key + (value.is_string() ? value.get<std::string>() : json_text(value));
}

}  // namespace

fs::path run_log_path(const fs::path& made) {
  fs::path path = made.lexically_normal();
  if (!path.has_filename()) path = path.parent_path();
  return path += ".log.json";
}

void write_run_log(const fs::path& made, const std::string& stage, double seconds,
                   const nlohmann::ordered_json& details) {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  nlohmann::ordered_json log = {{"stage", stage},
                                {"seconds", seconds},
                                {"peak_memory_bytes", static_cast<std::uint64_t>(usage.ru_maxrss) * 1024}};
  log.update(details);
  write_text_atomically(run_log_path(made), json_text(log, 2) + "\n");
}

std::optional<RunLog> read_run_log(const fs::path& path) {
  if (!fs::is_regular_file(path)) return std::nullopt;
  const auto json = nlohmann::ordered_json::parse(read_text(path), nullptr, false);
  if (!json.is_object() || !json.contains("stage") || !json["stage"].is_string())
    throw FormatError(path, "is not the log of a run; remove it or run that stage again");
  RunLog log;
  log.path = path;
  log.stage = json["stage"].get<std::string>();
  log.seconds = number<double>(json, "seconds");
  log.peak_memory_bytes = number<std::uint64_t>(json, "peak_memory_bytes");
  log.threads = number<int>(json, "threads");
  // The last: names of what was made, which the path says.
  static const std::set<std::string> told_elsewhere = {"stage", "seconds", "peak_memory_bytes", "threads",
                                                       "field"};
  for (const auto& [key, value] : json.items())
    if (!told_elsewhere.contains(key) && (value.is_number() || value.is_string()))
      log.details += (log.details.empty() ? "" : ", ") + detail(key, value);
  return log;
}

std::vector<RunLog> find_run_logs(const ReportInput& input) {
  std::vector<fs::path> made;
  if (!input.truth_folder.empty()) made.push_back(input.truth_folder);
  if (!input.session.folder.empty()) made.push_back(input.session.folder);
  for (const FieldEntry& entry : input.fields) made.push_back(entry.path);
  std::vector<RunLog> logs;
  for (const fs::path& path : made)
    if (auto log = read_run_log(run_log_path(path))) logs.push_back(std::move(*log));
  return logs;
}

}  // namespace refield::report
