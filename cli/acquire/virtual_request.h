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

/// Options of `refield acquire virtual`.
struct VirtualOptions {
  fs::path recipe;
  fs::path truth;
  fs::path session;
  fs::path calibration;
  std::string lights;
  std::vector<double> exposures;
  std::optional<int> exposure_count;
  std::optional<double> exposure_ratio;
  std::string noise;
  std::optional<int> frames;
  int ambient_frames = 0;  ///< CaptureRequest::ambient_repeats
  fs::path mask;
  bool auto_mask = false;
  fs::path background;
  std::optional<std::uint64_t> seed;
  std::string order = "given";
  std::string until_error;
  int min_images = 30;
  int check_every = 10;
  std::optional<int> reference_every;
  fs::path reference_light;
  bool trigger = false;
  bool keep_raw = false;
  bool half = false;
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
