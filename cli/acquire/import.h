// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "acquire/import/import_series.h"
#include "cli/verbs.h"

namespace refield::cli {

/// Options of `refield acquire import`.
struct ImportOptions {
  ImportRequest request;
  std::vector<std::string> photographs;
  std::string ambient;
  std::string light;
  std::string light_sources;  ///< a file, or "ball"
  std::vector<double> object_at;
  std::string ball = "find";
  std::optional<double> horizontal_fov;
  std::string flat_fields;
  std::string
      pair_by;  ///< "name", "order", "time"; empty: by name where the names have a pattern, else by order
  std::string light_content = "radiance";
  std::string parameterisation;
  std::vector<std::string> placements;
  std::vector<double> exposures;
  std::string mask;
  std::string offset = "0", drift = "0";  ///< of clocks: a number or "auto"
  std::optional<double> max_gap;
};

/// What `refield acquire import` makes of photographs beside a session: HDR photographs paired with light
/// maps by their times, or the response curve of the camera.
void match_by_time(const ImportOptions& options, const Common& common);
void estimate_camera_response(const ImportOptions& options, const Common& common);

}  // namespace refield::cli
