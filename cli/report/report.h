// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json_fwd.hpp>

#include <array>
#include <filesystem>
#include <vector>

#include "core/base/run_context.h"
#include "core/session/capture_session.h"

namespace refield::report {

/// A folder of its own among the system's temporary files, removed with all it holds at the end of its life.
class ScratchFolder {
 public:
  /// Throws DeviceError where the system refuses.
  ScratchFolder();
  ~ScratchFolder();
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

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
