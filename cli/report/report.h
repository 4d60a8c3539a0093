// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <vector>

#include "core/capture_session.h"
#include "core/run_context.h"

namespace refield::report {

/// What a report is made of.
struct ReportRequest {
  CaptureSession session;
  bool find_held_out = true;                  ///< which frames were held out is asked of the first field
  std::vector<std::filesystem::path> fields;  ///< at least one
  std::filesystem::path truth;                ///< a simulated session's folder; empty: none
  std::vector<std::array<int, 2>> pixels;  ///< (x, y) whose kernels are shown; empty: chosen by the program
  std::filesystem::path output;
};

/// Writes the page, once all of it is known, and returns its figures.
/// Throws InputError for a missing field, one that does not fit the session and a pixel outside the image.
nlohmann::ordered_json write_report(const ReportRequest& request, const RunContext& run = {});

}  // namespace refield::report
