// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "core/image.h"
#include "core/reflectance_field.h"
#include "core/run_context.h"

namespace refield::web {

/// What an exported page costs.
struct ExportReport {
  std::size_t files = 0;
  std::uint64_t bytes = 0;     ///< of all files
  double relative_rmse = 0.0;  ///< of the page's field against the full one, over the lights below
  int largest_difference = 0;  ///< of tone-mapped 8-bit values there, at the exposure of the page
  double exposure = 1.0;       ///< that the page starts with
};

/// A light map that a page brings along: of the field's own size, or a panorama (lat-long) that it shows
/// through the monitor's window.
struct PageMap {
  std::string name;
  Image radiance;  ///< [height × width × 3]
};

/// Writes a page that relights `field` in a browser (WebGL 2) into `folder`: HTML, style, scripts and data,
/// for any static server or straight from disk. The page's rounding is measured under white light and four
/// bars. `title` heads the page. `maps` are stored as half floats. Throws InputError for a field that does
/// not fit a page, DeviceError where the disk refuses.
ExportReport export_page(const ReflectanceField& field, const std::string& title,
                         const std::filesystem::path& folder, const std::vector<PageMap>& maps = {},
                         const RunContext& run = {});

}  // namespace refield::web
