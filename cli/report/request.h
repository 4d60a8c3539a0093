// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <nlohmann/json_fwd.hpp>

#include "refield/session.h"

namespace refield::report {

/// What a report is made of. The first field tells which frames it was not estimated from.
struct ReportRequest {
  Session session;
  std::vector<std::filesystem::path> fields{};  ///< at least one
  std::filesystem::path truth{};                ///< a simulated session's folder; empty: none
  /// (x, y) whose kernels are shown; empty: chosen by the program.
  std::vector<std::array<int, 2>> pixels{};
  std::filesystem::path output{};
};

/// Writes the page, once all of it is known, and returns its figures.
/// Throws InputError for a missing field, one that does not fit the session and a pixel outside the image.
nlohmann::ordered_json write_report(const ReportRequest& request, const RunContext& run = {});

}  // namespace refield::report
