// SPDX-License-Identifier: Apache-2.0
#include "estimate/options.h"

namespace refield {

std::string_view v0_2::name_of(EstimateMode mode) {
  return mode == EstimateMode::paper ? "paper" : mode == EstimateMode::fast ? "fast" : "refined";
}

EstimateMode v0_2::estimate_mode_from_name(std::string_view name) {
  for (auto mode : {EstimateMode::refined, EstimateMode::paper, EstimateMode::fast})
    if (name == name_of(mode)) return mode;
  throw InputError("unknown mode '", name, "'; use refined, paper or fast");
}

int EstimateOptions::max_kernels() const {
  constexpr int of_the_paper = 25, by_data = 64;
  return kernels > 0 ? kernels : mode == EstimateMode::refined ? by_data : of_the_paper;
}

void EstimateOptions::check() const {
  const auto require = [](bool holds, const char* option, std::int64_t value, const char* range) {
    if (!holds) throw InputError(option, " is ", value, "; give a value of ", range);
  };
  require(kernels >= 0 && kernels <= 255, "--max-kernels", kernels, "1 to 255, or 0 to let the data decide");
  require(spatial_passes >= 0 && spatial_passes <= 16, "spatial passes", spatial_passes, "0 to 16");
  require(threads >= 0, "--threads", threads, "0 (all cores) or more");
  if (!(clip_level > 0.0f)) throw InputError("--clip is ", clip_level, "; give a positive radiance");
}

}  // namespace refield
