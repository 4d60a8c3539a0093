// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "acquire/capture/capture.h"
#include "simulate/rig/virtual_rig.h"
#include "simulate/tabletop/recipe.h"
#include "simulate/tabletop/simulate.h"

namespace refield::cli {

namespace fs = std::filesystem;

/// Options of `refield acquire run` for a recipe; what they leave open is as the recipe says.
struct VirtualOptions {
  fs::path recipe;  ///< or a rig file
  fs::path truth;
  fs::path session;
  fs::path calibration;
  std::string light;
  std::vector<double> exposures;
  std::string max_noise;
  bool auto_mask = false;
  std::string order;  ///< empty: given
  std::string until_error;
  int min_images = 30;
  bool keep_raw = false;
  IfExists if_exists = IfExists::refuse;
};

/// The virtual camera and monitor of a recipe before the scene of scene_of(), with all that the recipe says
/// of them. The scene is traced for each position of a camera that moves.
VirtualRig rig_of(const fs::path& truth, const Recipe& recipe, std::uint64_t seed);

/// Tells `rig` before each of `lights` how far the capture is, see VirtualRig::set_place(); `rig`
/// must outlive the result.
std::function<void(std::size_t)> place_teller(VirtualRig& rig, const std::vector<CaptureLight>& lights);

/// What the options and the recipe ask the capture stage for.
CaptureRequest request_of(const VirtualOptions& options, const Recipe& recipe, std::uint64_t seed);

}  // namespace refield::cli
