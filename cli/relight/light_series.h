// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cli/relight/relight_options.h"
#include "cli/relight/seen_share.h"
#include "core/reflectance_field.h"
#include "relight/relight.h"

namespace refield::cli {

/// One of the lights to show a field under.
struct SeriesLight {
  std::string name;                             ///< its image's, without extension
  std::optional<std::filesystem::path> source;  ///< the file that it comes from, where it is one file's
  LightSource make;                             ///< reads or computes it; from several threads at a time
};

/// What the options ask a field to be lit by.
struct LightSeries {
  std::vector<SeriesLight> lights{};
  bool is_sequence = false;  ///< frames of a motion, not files of their own
  /// Filled in as environments are put onto the monitor's window; null where there is none.
  std::shared_ptr<SeenShares> seen{};
};

/// Reads nothing but headers, and maps that a whole sequence shares. Throws InputError for options that do
/// not fit together or to the field.
LightSeries light_series(const RelightOptions& options, const ReflectanceField& field);

/// The part of it that is about environments: maps, turning maps, fades from map to map, days.
LightSeries environment_series(const RelightOptions& options, const ReflectanceField& field);

/// "bar_0007"
std::string frame_name(const char* what, int frame);

/// The one file that is to be turned. Throws InputError naming `option` when it is not one.
std::filesystem::path only_file(const std::vector<std::string>& patterns, const char* option);

}  // namespace refield::cli
