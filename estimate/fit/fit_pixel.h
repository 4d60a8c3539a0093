// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <functional>
#include <span>
#include <vector>

#include "core/base/aligned_memory.h"
#include "core/field/predicted_error.h"
#include "estimate/fit/kernel_cache.h"
#include "estimate/fit/nnls.h"
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
  /// Weights of light cells and not of rectangles that a search found. Not kept on disk.
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

/// Grows one pixel's kd-tree of rectangles (Matusik et al. 2004, section 5.2): starts from the whole light
/// map and greedily splits the leaf that serves best, re-solving for non-negative weights after each split.
///
/// The fit lives in coordinates of an orthonormal basis Q of the space that the leaves' columns span.
/// Replacing a leaf by its halves keeps that space and adds one direction, so Q only ever grows by a vector a
/// step, and each candidate split keeps its coordinates in Q, its remaining squared norm and its product with
/// the samples up to date at the cost of one inner product of length `images` a step. Gram matrices then come
/// from coordinates, not from images.
class PixelFitter {
 public:
  /// Called with (subdivisions, boxes, weights [boxes × 3]) after every solve.
  using Observer = std::function<void(int, std::span<const Box>, std::span<const float>)>;

  PixelFitter(KernelCache& cache, const EstimateOptions& options);

  /// Deviation from the paper in all modes but `paper`: a split is scored by its projected gain (⟨d,r⟩²/‖d⊥‖²
  /// summed over channels, with the residual r of the non-negative fit), not by solving for all candidates;
  /// prototypes found no loss.
  PixelKernels fit(const PixelSamples& samples, const Observer& observer = {});

 private:
  struct Leaf {
    Box box;
    std::vector<int> candidates;
  };
  struct Candidate {
    const Split* split;
    int leaf;
    std::array<float, 3> residual_norm2;  // ‖d⊥‖²
    std::array<float, 3> with_samples;    // ⟨d,b⟩
  };

  void start(const PixelSamples& samples);
  void add_candidates(int leaf);
  void split_leaf(int candidate);
  void append_direction(const std::array<const float*, 3>& direction, std::vector<float>& coordinates);
  void update_candidates();
  void update_gram(int leaf);
  void solve();
  int best_by_gain();
  int best_by_solving();
  double residual_after(const Candidate& candidate, double give_up_above);
  double residual_bound(int candidate) const;
  double squared_residual() const;
  PixelKernels leaves_as_kernels() const;
  void report(const Observer& observer, int subdivisions) const;

  float* basis(int c, int k) {
    return basis_.data() + (static_cast<std::size_t>(c) * max_leaves_ + k) * stride_;
  }
  float* coordinates(int candidate, int c) {
    return candidate_coordinates_.data() + (static_cast<std::size_t>(candidate) * 3 + c) * coordinate_stride_;
  }
  const float* coordinates(int candidate, int c) const {
    return candidate_coordinates_.data() + (static_cast<std::size_t>(candidate) * 3 + c) * coordinate_stride_;
  }
  double* leaf_coordinates(int leaf, int c) {
    return leaf_coordinates_.data() + (static_cast<std::size_t>(leaf) * 3 + c) * max_leaves_;
  }
  const double* leaf_coordinates(int leaf, int c) const {
    return leaf_coordinates_.data() + (static_cast<std::size_t>(leaf) * 3 + c) * max_leaves_;
  }
  const double* gram(int c) const {
    return gram_.data() + static_cast<std::size_t>(c) * max_leaves_ * max_leaves_;
  }
  double* gram(int c) { return gram_.data() + static_cast<std::size_t>(c) * max_leaves_ * max_leaves_; }

  KernelCache& cache_;
  EstimateOptions options_;
  int max_leaves_;
  std::size_t stride_;             // of vectors over images
  std::size_t coordinate_stride_;  // of vectors of coordinates in the basis

  MaskedSamples samples_;
  std::vector<Leaf> leaves_;
  std::vector<Candidate> candidates_;
  std::vector<int> live_, unused_;                       // candidate slots
  int rank_ = 0;                                         // vectors in the basis
  AlignedFloats basis_;                                  // [3 × max_leaves × stride]
  std::array<std::vector<double>, 3> samples_in_basis_;  // y = Qᵀb
  std::array<std::vector<double>, 3> fit_in_basis_;      // z = Qᵀ A x
  AlignedFloats candidate_coordinates_;   // [candidates × 3 × coordinate_stride], zero beyond the basis
  std::vector<double> leaf_coordinates_;  // [max_leaves × 3 × max_leaves]
  std::vector<double> gram_;              // [3 × max_leaves × max_leaves]
  std::array<std::vector<double>, 3> with_samples_;  // h = Aᵀb
  std::array<std::vector<double>, 3> weights_;       // x
  NnlsSolver nnls_;

  AlignedFloats scratch_;
  std::vector<double> trial_gram_, trial_h_, trial_x_;
  std::vector<const float*> pointers_;
  std::vector<float> products_;
  std::vector<float> gains_;
  AlignedFloats fit_coordinates_;
};

}  // namespace refield
