// SPDX-License-Identifier: Apache-2.0
#include "acquire/import/bracket_saturation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <vector>

namespace refield {

namespace {

constexpr double width = 1e-3;      // of the level: sensors clip within some DN
constexpr std::size_t below = 10;   // ranges of that width to compare with
constexpr double contrast = 4.0;    // of the fullest of them
constexpr std::size_t enough = 8;   // samples
constexpr double min_share = 1e-4;  // of all samples: some 2 000 of a photograph
constexpr double max_share_of_frame = 0.5;

/// Samples of one exposure near the highest level.
struct Exposure {
  double highest = 0.0;
  std::size_t samples = 0;
  std::array<std::size_t, below + 1> in_range{};  ///< from the level downwards
  std::array<std::size_t, 3> of_colour{};         ///< of the first range

  bool piles_up() const {
    const std::size_t fullest = *std::max_element(in_range.begin() + 1, in_range.end());
    return in_range[0] >= enough && in_range[0] >= min_share * static_cast<double>(samples) &&
           static_cast<double>(in_range[0]) >= contrast * static_cast<double>(fullest);
  }
  bool piles_up_in_two_colours() const {
    return std::ranges::count_if(of_colour, [](std::size_t count) { return count >= enough; }) >= 2;
  }
};

template <class Visit>
void for_samples(const BracketFile& file, const Visit& visit) {
  if (file.bits == 0)
    for (std::size_t i = 0; i < file.linear.values.size(); ++i) visit(i, double{file.linear.values[i]});
  else
    for (std::size_t i = 0; i < file.frame.samples.size(); ++i) visit(i, double(file.frame.samples[i]));
}

std::size_t colour_of(const BracketFile& file, std::size_t sample) {
  const RawFrame& frame = file.frame;
  if (!is_bayer(frame.layout)) return sample % 3;
  const auto columns = static_cast<std::size_t>(frame.width);
  return static_cast<std::size_t>(
      bayer_channel(frame.layout, static_cast<int>(sample % columns), static_cast<int>(sample / columns)));
}

bool is_of_fewer_bits(double level, int bits) {
  for (int k = 8; k <= 16; ++k)
    if (level == (1 << k) - 1 && (bits == 0 || (k > 8 && k < bits))) return true;
  return bits == 0 && level == 1.0;
}

double sample(const BracketFile& file, std::size_t i) {
  return file.bits == 0 ? double{file.linear.values[i]} : double(file.frame.samples[i]);
}

/// Whether the samples of exposure `i` at the level have different values in the clearly shorter exposure
/// `j`: a surface that is evenly bright is so in both.
bool was_clipped(const Bracket& bracket, std::size_t i, std::size_t j, double level) {
  constexpr double another_time = 1.1, spread = 0.05;  // relative standard deviation
  if (bracket.exposures[i] < another_time * bracket.exposures[j]) return false;
  double count = 0.0, sum = 0.0, squares = 0.0;
  for_samples(bracket.files[i], [&](std::size_t at, double value) {
    if (value < level * (1.0 - width)) return;
    const double shorter = sample(bracket.files[j], at);
    count += 1.0;
    sum += shorter;
    squares += shorter * shorter;
  });
  return squares * count - sum * sum > spread * spread * sum * sum;
}

}  // namespace

HighestSamples highest_samples(const Bracket& bracket) {
  const BracketFile& first = bracket.files.at(0);
  const double stated = first.raw_levels  ? first.raw_levels->saturation
                        : first.bits == 0 ? std::numeric_limits<double>::infinity()
                                          : (1 << first.bits) - 1.0;
  std::vector<Exposure> exposures(bracket.files.size());
  HighestSamples result;
  if (!first.sigma.empty()) return result;  // merged already: sigma says what is clipped
  for (std::size_t i = 0; i < exposures.size(); ++i) {
    for_samples(bracket.files[i], [&](std::size_t, double value) {
      exposures[i].highest = std::max(exposures[i].highest, value);
      ++exposures[i].samples;
    });
    result.level = std::max(result.level, exposures[i].highest);
  }
  // Merging leaves out what lies that far below the stated saturation, see merge_exposures().
  const double margin =
      first.bits == 8 ? with_compressed_samples.clip_margin : with_unmeasured_saturation.clip_margin;
  if (!(result.level > 0.0) || !std::isfinite(result.level) || result.level >= stated * (1.0 - margin))
    return result;
  for (std::size_t i = 0; i < exposures.size(); ++i) {
    for_samples(bracket.files[i], [&](std::size_t sample, double value) {
      const double range = (1.0 - value / result.level) / width;
      if (!(range < static_cast<double>(below + 1))) return;
      ++exposures[i].in_range[static_cast<std::size_t>(range)];
      if (range < 1.0) ++exposures[i].of_colour[colour_of(bracket.files[i], sample)];
    });
    if (!exposures[i].piles_up()) continue;
    result.piles_up = true;
    if (exposures[i].in_range[0] > result.at_level) {
      result.at_level = exposures[i].in_range[0];
      result.file = bracket.paths[i];
    }
    for (std::size_t j = 0; j < exposures.size(); ++j)
      result.is_saturation |= was_clipped(bracket, i, j, result.level);
    const bool is_sensor = first.is_raw || is_bayer(first.frame.layout);
    const double share =
        static_cast<double>(exposures[i].in_range[0]) / static_cast<double>(exposures[i].samples);
    result.is_saturation |=
        is_of_fewer_bits(result.level, first.bits) ||
        (is_sensor && share < max_share_of_frame && exposures[i].piles_up_in_two_colours());
  }
  return result;
}

}  // namespace refield
