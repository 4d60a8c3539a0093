// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>

#include "acquire/import/bracket_merge.h"

namespace refield {

/// What the highest samples of a bracket say about the level at which its camera saturates.
struct HighestSamples {
  double level = 0.0;          ///< highest sample of all exposures
  std::size_t at_level = 0;    ///< samples of `file` within 0.1 % of it
  std::filesystem::path file;  ///< exposure with the most of them
  bool piles_up = false;       ///< far more samples have that level than the levels below it
  bool is_saturation = false;  ///< they pile up, and no evenly lit surface explains it
};

/// Looks for samples that pile up below the saturation that the files state (RAW: their white level;
/// integers: the largest value; floats: none). A flat surface without noise piles up too. Clipping is certain
/// if the level is 2^k − 1 of fewer bits, or 1 for floats (12 bits in 16, a developed picture as floats), if
/// two exposures of different times end at it, or if two colours of a sensor do.
HighestSamples highest_samples(const Bracket& bracket);

}  // namespace refield
