// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/image/image.h"
#include "core/light/light_map.h"
#include "core/light/monitor_placement.h"
#include "core/session/capture_session.h"
#include "simulate/tabletop/recipe.h"

namespace refield {

/// One light map of a data set.
struct LightSpec {
  std::string name;  ///< "train_007", "test_012"
  FrameRole role = FrameRole::train;
  std::string kind;  ///< "natural", "designed", "coloured", "bar", "square", "white", "black"
  int number = 0;    ///< within its role and kind
};

/// All light maps that a plan asks for, in the order of a session's frames.
std::vector<LightSpec> list_lights(const LightPlan& plan);

/// Makes the listed maps: linear radiance from 0 to 1, as a monitor shows it, and hands each with its place
/// in the list to `sink`, from several threads at the same time.
///  - natural: perspective views of made-up panoramas, rotated, exposed and clipped as a camera would.
///  Training and test
///    views never share a panorama.
///  - designed: saturated leaves (LeafPatterns). The first patterns of a longer list are those of a shorter
///  one.
///  - coloured: natural views of further panoramas in red, green, blue, cyan, magenta and yellow in turn.
///  - bar: white, an eighth of the width, sliding from the left edge to the right.
///  - square: white, a sixteenth of the width, at places spread over the map.
void make_lights(const std::vector<LightSpec>& list, const LightDomain& domain, std::uint64_t seed,
                 const std::function<void(std::size_t place, LightMap&& light)>& sink,
                 const RunContext& run = {});

/// A light map of one colour.
Image uniform_light(int width, int height, const std::array<float, 3>& colour);

/// A made-up surrounding, lat-long, linear radiance, sun and area lights far above 1: sky or ceiling,
/// horizon, buildings or walls, area lights and windows, and over all a dead-leaves pattern (Lee, Mumford and
/// Huang 2001): opaque shapes that cover one another, with sizes r distributed as r^-3. That gives what
/// estimation lives on, the statistics of natural images: sharp edges at all scales, heavy-tailed gradients,
/// a power spectrum that falls about as 1/f². `width` must be even; the height is half of it. Equal arguments
/// give equal panoramas.
Image make_panorama(std::uint64_t seed, std::uint64_t index, int width);

/// How someone looks into a panorama.
struct PanoramaView {
  EulerAngles turn{};  ///< of the one who looks
  double horizontal_fov_degrees = 70.0;
};

/// A perspective view, as a monitor shows it; four samples per texel. Radiance as in the panorama.
Image view_of_panorama(const Image& panorama, const PanoramaView& view, int width, int height);

/// Patterns designed for estimation, one after another: saturated dead leaves (docs/method/patterns.md).
///
/// Opaque rectangles of all sizes cover the map, others in each channel (Lee, Mumford and Huang 2001; sizes
/// uniform in the logarithm), and each is 0 or 1. The places are random. The levels are chosen so that a
/// pattern tells as much as possible that those before it have not told: a pixel's response is a Gaussian
/// process whose covariance is that of a pixel that sees one rectangle of unknown place and size, and the
/// levels maximise the variance of the response given the earlier patterns (all channels count, since a
/// pixel's kernels serve all three), with the mean held near one half. Equal arguments give equal patterns.
class LeafPatterns {
 public:
  LeafPatterns(const LightDomain& domain, std::uint64_t seed);
  LightMap next();

 private:
  struct Leaf {
    std::vector<std::pair<int, double>> cells;  ///< of the design grid, with the covered area
    double area = 0.0;                          ///< share of the map
    double variance = 0.0;
  };
  /// The visible leaves; `owner` receives the leaf of each texel.
  std::vector<Leaf> place_leaves(int number, int channel, std::vector<int>& owner) const;
  /// +1 or −1 for each leaf.
  std::vector<int> choose_levels(std::vector<Leaf>& leaves, int number, int channel);

  LightDomain domain_;
  std::uint64_t seed_;
  int columns_, rows_, made_ = 0;
  double noise_variance_;
  Eigen::MatrixXd covariance_;  ///< of the responses to single cells, given the patterns so far
};

}  // namespace refield
