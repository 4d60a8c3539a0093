// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

#include <utility>

#include "acquire/hdr/bracket_files.h"
#include "acquire/series/capture_time.h"

namespace refield {

/// Mean brightness over the blocks of a grid, of each channel: [rows × columns × 3].
using BlockMeans = Eigen::VectorXf;

/// Of a light map, linear.
BlockMeans block_means(const Image& image);
/// Of one exposure, linearised by `linear_from_dn` [2^bits] where it has integers, `black` subtracted.
BlockMeans block_means(const BracketFile& file, const std::vector<float>& linear_from_dn, double black);

/// Brackets and lights in the order in which they were taken and shown.
struct OrderedSeries {
  std::vector<BlockMeans> photographs;  ///< one exposure of each bracket, the same for all
  std::vector<BlockMeans> lights;
  std::optional<BlockMeans> black;  ///< a photograph without light; else, or if brighter, the darkest bracket
  bool first_is_black = false;      ///< the first bracket is said to be one without light
  /// [brackets] and [lights]: when each was taken and shown, by clocks that need not agree; nullopt: unknown.
  std::vector<std::optional<ClockSeconds>> taken, shown;
};

struct OrderedPairing {
  std::vector<std::optional<std::size_t>> bracket_of;        ///< [lights]; nullopt: not photographed
  std::vector<std::size_t> black;                            ///< brackets without light
  std::vector<std::pair<std::size_t, std::size_t>> doubled;  ///< a bracket and the light that it shows again
  std::vector<std::size_t> stray;                            ///< brackets that show none of the lights
  /// Brightness and times tell this pairing from its neighbours, by one light earlier or later.
  bool is_certain = false;
};

/// Pairs brackets and lights in order, where brackets may be black, show a light again or none, and lights
/// may lack a bracket: the pairing of the highest likelihood, by dynamic programming. A photograph is
/// predicted from the light map by ridge regression of its block means, which alternates with the pairing;
/// times count by their distance to the series' common offset. Where counts are equal, the n-th bracket stays
/// that of the n-th light unless the evidence against it is strong.
OrderedPairing pair_in_order(const OrderedSeries& series);

}  // namespace refield
