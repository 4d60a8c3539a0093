// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/aligned_memory.h"
#include "core/field/predicted_error.h"
#include "estimate/fit/tree_search.h"
#include "estimate/options.h"

namespace refield {

/// Samples of one pixel: for each channel [stride] floats over the images, NaN where not measured.
using PixelSamples = std::array<const float*, 3>;

/// A pixel's reflectance function, eq. 3: rectangles shared by the channels, and a weight of each channel.
struct PixelKernels {
  std::vector<Box> boxes;
  std::vector<float> weights;     ///< [boxes × 3], ≥ 0, of the sum of texel values
  std::vector<float> smooth;      ///< [hats × 3], ≥ 0; empty without a smooth part
  double squared_residual = 0.0;  ///< over images and channels
  double squared_samples = 0.0;   ///< Σ b² over images and channels
  /// Of a CellFit, [images × 3 × 3]: how far its fit to the channels of an image follows each of these
  /// samples. Not kept on disk.
  std::vector<float> leverage;
  /// Weights that TexelRegression found, of its cells. Not kept on disk.
  bool is_on_cells = false;
  /// What TexelRegression selected for the pixel, whichever model it uses: index of the prior ×
  /// cell_noise_levels + that of the noise; −1 for light with many degrees of freedom. Not kept on disk.
  int light_class = -1;
  ErrorEvidence evidence = {};  ///< filled by estimate_band() where it was asked for
};

/// Samples with the unmeasured ones taken out: zero in `values`, zero in `measured`, so that every product
/// over images skips them.
struct MaskedSamples {
  AlignedFloats values;    // [3 × stride]
  AlignedFloats measured;  // [3 × stride], 1 or 0
  bool complete = true;
  std::array<double, 3> squared{};  ///< Σ b² of each channel
  std::array<int, 3> count{};       ///< measured samples of each channel

  double squared_sum() const { return squared[0] + squared[1] + squared[2]; }
  int count_sum() const { return count[0] + count[1] + count[2]; }

  void assign(const PixelSamples& samples, std::size_t stride, int images);
};

/// Whether a rectangle shone in measured samples of a channel: `measured` is the squared sum over these of
/// its `column`. In the dark a column is the rounding of the table's sums, and a weight would be noise
/// divided by that: 1e11, of mirrors that clip whenever the rectangle shines. It gets none.
bool is_seen(float measured, const float* column, std::size_t stride);

/// How PixelFitter fits one pixel, in double precision.
struct PixelFit {
  using Real = double;
  static constexpr bool splits_dark_leaves = true;
  static constexpr bool keeps_solver = false;
  static constexpr bool targets_first = true;
};

/// Grows the tree of one pixel, whose samples may be incomplete. Paper mode solves for the weights of every
/// candidate and takes the best (Matusik et al. 2004, section 5.2).
class PixelFitter : GreedyTree<PixelFit> {
 public:
  /// Called with (subdivisions, boxes, weights [boxes × 3]) after every solve.
  using Observer = std::function<void(int, std::span<const Box>, std::span<const float>)>;

  PixelFitter(KernelCache& cache, const EstimateOptions& options);

  /// Deviation from the paper in all modes but `paper`: a split is scored by best_by_gain(), not by solving
  /// for all candidates; prototypes found no loss.
  PixelKernels fit(const PixelSamples& samples, const Observer& observer = {});

 private:
  int best_by_solving();
  double residual_after(const Candidate& candidate, double give_up_above);
  double residual_bound(const Candidate& candidate);
  PixelKernels leaves_as_kernels() const;
  void report(const Observer& observer) const;

  EstimateMode mode_;
  MaskedSamples samples_;
  NnlsSolver trial_nnls_;
  std::vector<double> trial_gram_, trial_h_, trial_x_;
};

}  // namespace refield
