// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/aligned_memory.h"
#include "core/base/run_context.h"
#include "core/field/light_basis.h"
#include "core/light/light_map.h"
#include "core/session/capture_session.h"
#include "estimate/fit/light_groups.h"

namespace refield {

/// Throws InputError, naming `name`, for a light that is black everywhere or does not have the domain's size.
void require_usable(const LightMap& light, const LightDomain& domain, const std::string& name);

/// The sums R_k · L_j of eq. 6 for any rectangle and all training lights at once: one summed-area table whose
/// entries are vectors over channels and lights, so that a column of A costs four contiguous reads. Kept in
/// double, as every summed-area table here; 24 bytes × lights a texel.
class BoxTable {
 public:
  /// Reads the frames' lights; `hats` are summed along. Throws InputError when one is black everywhere, not
  /// finite or of another size.
  BoxTable(std::span<const CaptureFrame> frames, LightDomain domain, HatGrid hats = {},
           const RunContext& run = {});
  /// For lights in memory.
  explicit BoxTable(std::span<const LightMap> lights, HatGrid hats = {}, const RunContext& run = {});

  /// A table of some of the images, which shares this one's memory.
  BoxTable subset(const std::vector<int>& images) const;

  const LightDomain& domain() const { return domain_; }
  int images() const { return images_; }
  /// Length of one channel's column, padded (see vector_kernels.h).
  std::size_t stride() const { return stride_; }
  /// Sums over `box`: [3 × stride] floats, channel by channel, `extent` ≥ stride apart; padding zero.
  void column(const Box& box, float* column, std::size_t extent) const;
  void column(const Box& box, float* values) const { column(box, values, stride_); }
  /// Sums of one channel: [stride].
  void channel_column(const Box& box, int channel, float* values) const;
  /// The products of these with a vector over the images and with themselves, without writing them down.
  void products(const Box& box, int channel, const float* vector, float& with_vector, float& squared) const;

  /// Asks for the sums at a corner of rectangles in advance, from channel `first` to before `last`: most
  /// of the time that a column takes is waiting for them.
  void prefetch(int x, int y, int first, int last) const;

  const HatGrid& hats() const { return hats_; }
  /// Sums of the lights weighted by hat function `node`: [images] of a channel.
  const double* hat_sums(int node, int channel) const {
    return hat_sums_.data() + (static_cast<std::size_t>(node) * 3 + channel) * images_;
  }

  /// All sums are kept divided by this power of two: 1, unless the lights are so bright or dim that single
  /// precision would not hold the squares of what the fit computes. A weight found with them must be divided
  /// by it.
  double unit() const { return unit_; }

  /// Multiplies all sums of image j by weights[j], [images], > 0, as the samples are to be. Tables that share
  /// this one's memory are no longer valid.
  void weight_images(std::span<const float> weights);
  /// The weights, [images]; 1 before weight_images().
  std::span<const float> image_weights() const { return weights_; }

  /// See light_groups.h, [images]; of a table that is no subset.
  std::span<const int> light_groups() const { return groups_; }
  int light_rank() const { return light_rank_; }

  static std::uint64_t bytes(const LightDomain& domain, std::uint64_t images);

 private:
  BoxTable(LightDomain domain, int images, HatGrid hats);
  void fill(std::span<const LightMap> lights, int first, std::span<LightSketch> sketches);
  void integrate(const RunContext& run);
  void choose_unit();
  std::size_t size() const {
    return static_cast<std::size_t>(domain_.width + 1) * (domain_.height + 1) * 3 * stored_images_;
  }
  /// While the table is filled.
  double* writable() { return const_cast<double*>(prefix_.get()); }
  /// Upper before lower, left before right.
  std::array<const double*, 4> corners(const Box& box, int channel) const;
  const double* corner(int x, int y) const {
    return prefix_.get() + (static_cast<std::size_t>(y) * (domain_.width + 1) + x) * 3 * stored_images_;
  }
  LightDomain domain_;
  double unit_ = 1.0;
  int images_;
  int stored_images_;
  std::vector<int> selected_;  // which of the stored images; empty: all
  std::size_t stride_;
  HatGrid hats_;
  std::vector<float> weights_;  // [images]
  std::vector<int> groups_;     // [images]
  int light_rank_ = 0;
  std::vector<double> hat_sums_;          // [hats × 3 × images]
  std::shared_ptr<const double> prefix_;  // [(height+1) × (width+1) × 3 × images]
};

}  // namespace refield
