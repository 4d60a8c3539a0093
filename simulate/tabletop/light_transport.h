// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/light/light_map.h"
#include "simulate/tabletop/scene.h"

namespace refield {

/// The boxes that traced transport is made of: squares of 1, 2, 4, ... texels on a fixed grid over the light
/// map, those at its right and lower edge cut off there. Level 0 holds single texels; on the coarsest level
/// squares are no larger than a sixteenth of the map's width.
class LightHierarchy {
 public:
  explicit LightHierarchy(const LightDomain& domain);

  const LightDomain& domain() const { return domain_; }
  int coarsest_level() const { return static_cast<int>(levels_.size()) - 1; }
  int columns(int level) const { return levels_[level].columns; }
  int rows(int level) const { return levels_[level].rows; }
  /// Number of squares on all levels; they are numbered from 0, level by level.
  std::uint32_t size() const { return size_; }
  std::uint32_t node(int level, int column, int row) const {
    return levels_[level].first + static_cast<std::uint32_t>(row) * levels_[level].columns + column;
  }
  std::uint32_t node_of_texel(int level, int x, int y) const { return node(level, x >> level, y >> level); }
  Box box(int level, int column, int row) const;
  Box box(std::uint32_t node) const;

 private:
  struct Level {
    std::uint32_t first;
    int columns, rows;
  };
  LightDomain domain_;
  std::vector<Level> levels_;
  std::uint32_t size_ = 0;
};

/// One box of a pixel's row of T: the weights multiply the *sum* of the texel values in the box.
struct TransportEntry {
  std::uint32_t node;  ///< of the LightHierarchy
  float weight[3];
};

/// Gathers one row of T at a time, from any number of contributions in any order.
class TransportRow {
 public:
  explicit TransportRow(const LightHierarchy& hierarchy);

  /// Adds weight · (sum of the node's texels) to the pixel.
  void add(std::uint32_t node, const Rgb& weight) {
    if (!is_touched_[node]) {
      is_touched_[node] = 1;
      touched_.push_back(node);
    }
    sum_[node] += weight;
  }
  /// Adds weight · (mean of the node's texels).
  void add_mean(std::uint32_t node, const Rgb& weight) {
    add(node, weight / static_cast<float>(hierarchy_->box(node).area()));
  }

  /// The row, by ascending nodes, and an empty accumulator. Entries with less than 1e-5 of the pixel's light
  /// are dropped and the others scaled up, a channel each, so that the pixel under white light stays what it
  /// was.
  std::vector<TransportEntry> take();

 private:
  const LightHierarchy* hierarchy_;
  std::vector<Rgb> sum_;  // [nodes], zero outside `touched_`
  std::vector<std::uint32_t> touched_;
  std::vector<char> is_touched_;
};

/// What one pixel sees of the monitor by way of mirrors and glass alone.
///
/// A pixel's samples, one a cell of a grid, meet the monitor at points; the pixel sees all that lies between
/// them. So each sample stands for the area up to halfway to its neighbours, as ray differentials do (Igehy
/// 1999): points would leave gaps wherever a curved mirror spreads a pixel over more texels than it has
/// samples.
class SpecularFootprints {
 public:
  void clear() { samples_.clear(); }

  /// A sample of grid cell (i, j) that reached the monitor at `position` (column, row, in texels). `path`
  /// tells reflections from refractions on the way: only samples of the same path are neighbours.
  void add(int i, int j, std::uint32_t path, const Eigen::Vector2f& position, const Rgb& throughput) {
    samples_.push_back({i, j, path, position, throughput});
  }

  /// Spreads every sample over its footprint, an upright rectangle cut off at the monitor's rim. Nothing is
  /// lost.
  void deposit(const LightHierarchy& hierarchy, TransportRow& row) const;

 private:
  struct Sample {
    int i, j;
    std::uint32_t path;
    Eigen::Vector2f position;
    Rgb throughput;
  };
  Eigen::Vector2f extent(const Sample& sample) const;
  std::vector<Sample> samples_;
};

/// How much work tracing may spend.
struct TraceOptions {
  int pixel_grid = 2;       ///< samples per pixel: pixel_grid², stratified
  int specular_grid = 5;    ///< the same for pixels in which a sample meets glass or a mirror
  int secondary_rays = 16;  ///< for interreflection, a sample
  int caustic_rays = 24;    ///< towards glass and mirrors, a sample: at most that many for each object
  double tolerance =
      0.3;               ///< a box is divided while the integrand varies by more than this share over it ...
  double energy = 4e-4;  ///< ... and that variation is more than this share of the pixel's light
  bool centre_samples = true;  ///< look at the centres of boxes too, not only at their corners
  int depth = 4;               ///< surfaces a path may meet after the first, specular ones not counted
  std::uint64_t seed = 1;
  /// The same random numbers in every pixel: what is left of the sampling error varies smoothly over a
  /// surface instead of showing as grain.
  bool same_paths = false;

  /// `level` 1: quick, for large images; 2: balanced; 3: without grain, for pictures. Throws InputError
  /// otherwise.
  static TraceOptions of_quality(int level, std::uint64_t seed);
};

/// What a pixel sees.
struct PixelTransport {
  std::vector<TransportEntry> entries;  ///< ascending nodes
  Rgb ambient = Rgb::Zero();            ///< room light with the monitor switched off
};

/// Scratch memory of one thread.
struct TraceScratch {
  explicit TraceScratch(const LightHierarchy& hierarchy);

  /// What the monitor's integrand f · cos θ · cos θ' / r² · visibility was found to be at a lattice point, if
  /// this sample has looked there already.
  struct LatticeValue {
    std::uint32_t stamp = 0;
    Rgb value = Rgb::Zero();
  };
  std::vector<LatticeValue> lattice;  ///< points at half texels, [2·height + 1 × 2·width + 1]
  std::uint32_t stamp = 0;
  TransportRow row;
  std::uint64_t rays = 0;  ///< traced so far
};

/// Traces one camera pixel: from the camera backwards until every path has met the monitor or is lost. The
/// result depends on the options and the pixel alone.
///
/// Light that falls straight from the monitor on a surface is integrated over the boxes of the hierarchy,
/// divided where a shadow's edge crosses them or the integrand varies; behind mirrors and glass it goes to
/// single texels. Light by way of further surfaces comes from random paths (path tracing with next event
/// estimation; Kajiya 1986) and goes to the coarsest boxes, caustics through paths aimed at the glass.
///
/// The boxes *are* the scene's transport matrix by definition: no rendering stands above them. tests/simulate
/// compares them with closed forms and with independent Monte Carlo integration.
PixelTransport trace_pixel(const TabletopScene& scene, const LightHierarchy& hierarchy,
                           const TraceOptions& options, int x, int y, TraceScratch& scratch);

}  // namespace refield
