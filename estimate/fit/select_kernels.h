// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <vector>

#include "estimate/fit/nnls.h"
#include "estimate/fit/tree_search.h"

namespace refield {

/// Bayesian information criterion of a fit with unknown noise (Schwarz 1978): N log(residual / N) +
/// parameters · log N. The residual is taken as no smaller than float32 columns can tell.
inline double information_criterion(double squared_residual, double squared_samples, double measured,
                                    int parameters) {
  constexpr double exact_fit = 1e-10;
  const double floor = std::max(exact_fit * squared_samples, std::numeric_limits<double>::min());
  return measured * std::log(std::max(squared_residual, floor) / measured) + parameters * std::log(measured);
}

/// What a rectangle costs in the information criterion for having been searched: 2 log D, D ≈ 5000 being the
/// rectangles that a tree could have reached. A constant, so that criteria from different trees can be
/// compared. Measured on a noisy capture: 17 to 22 are best, 12 costs 10 %; on a clean one 12 is 3 % better.
constexpr double usual_search_penalty = 17.0;

/// A pixel's samples b as a dictionary sees them.
struct PixelCoordinates {
  std::array<std::vector<float>, 3> inside;  ///< Qᵀb, [rank]
  std::array<std::vector<float>, 3> smooth;  ///< Vᵀb, [smooth rank]
  std::array<double, 3> squared{};           ///< ‖b‖²
  double measured = 0.0;                     ///< samples that were measured, over channels
  double search_penalty = usual_search_penalty;
};

/// What was chosen for a pixel.
struct KernelChoice {
  int smooth_class = 0;
  std::vector<int> boxes;                      ///< of the dictionary
  std::array<std::vector<double>, 3> weights;  ///< ≥ 0, of the boxes
  double criterion = 0.0;                      ///< lower is better
};

/// What a pixel tells of the classes that suit the next, which is like it.
struct ClassGuess {
  int best = -1;               ///< −1: none known
  std::vector<double> behind;  ///< [classes], by how much each class's criterion was worse; 0 where untried
};

/// Final weights of a pixel.
struct PixelWeights {
  std::array<std::vector<double>, 3> hats;   ///< [hats], empty without a smooth part
  std::array<std::vector<double>, 3> boxes;  ///< [chosen]
  std::array<double, 3> squared_residual{};
};

/// Chooses how much smooth part and which few rectangles explain a pixel.
///
/// For each class of smoothness: non-negative orthogonal matching pursuit (the rectangle whose part
/// perpendicular to the chosen ones correlates best, positively, with the residual; then all weights anew) in
/// the metric that the class prescribes, along which an information criterion says how many rectangles the
/// samples can bear: BIC (Schwarz 1978) with the penalty for the search of Chen and Chen 2008 (extended BIC)
/// and the evidence of the smooth part. The class with the lowest criterion wins.
///
/// A kd-tree has to split its way down to a small highlight and so spends a dozen leaves of equal weight on
/// it; with the tree's inner rectangles to choose from as well, the same function takes two kernels.
///
/// Works on Gram matrices in coordinates, which all pixels of a block share: a step costs some products of
/// the dictionary's size instead of the number of images.
class KernelSelector {
 public:
  explicit KernelSelector(const SmoothSpace& smooth);

  /// The dictionary that the next calls choose from; must outlive them.
  void prepare(const TreeDictionary& dictionary);
  /// At most `most` kernels, hats included. Looks at the class guessed first, leaves out those guessed to be
  /// far behind, and brings the guess up to date.
  KernelChoice select(const PixelCoordinates& pixel, int most, ClassGuess& guess);
  /// Non-negative weights of the chosen rectangles together with the hats (eq. 6). `noise_kept`: of each
  /// channel, the part of the noise variance that the samples still have; the prior of the hats weighs that
  /// much less. `like`: empty, or [hats × 3] weights of hats in a fit that is alike; those without any are
  /// held at first, which changes nothing but the time.
  PixelWeights solve(const PixelCoordinates& pixel, const KernelChoice& choice,
                     const std::array<double, 3>& noise_kept, std::span<const float> like = {});

 private:
  struct Metric {
    bool ready = false;
    std::array<AlignedFloats, 3> norm2;        // [padded size]
    std::array<AlignedFloats, 3> least_norm2;  // [padded size]; who keeps no more says nothing new
    std::array<AlignedFloats, 3> gram;         // [size × padded size], rows made on demand
    std::vector<char> has_row;
  };
  Metric& metric(int smooth_class);
  /// A vector of coordinates, ready as left factor of products in the metric of a class.
  void weigh(float* coordinates, int smooth_class, int channel) const;
  void make_row(int smooth_class, int box);
  void load_samples(const PixelCoordinates& pixel, int smooth_class);
  KernelChoice pursue(const PixelCoordinates& pixel, int smooth_class, int most);
  int best_candidate(const Metric& metric);
  void add(int smooth_class, int box);

  const SmoothSpace& smooth_;
  const TreeDictionary* dictionary_ = nullptr;
  std::size_t padded_size_ = 0;
  std::vector<Metric> metrics_;

  // Of one pursuit.
  AlignedFloats left_;
  std::array<double, 3> squared_{};            // ‖b‖² in the metric
  std::array<AlignedFloats, 3> with_samples_;  // [padded size]
  std::array<AlignedFloats, 3> correlation_;   // with the residual
  std::array<AlignedFloats, 3> remaining_norm2_;
  std::array<AlignedFloats, 3> projections_;  // rows of the growing Cholesky factor, [chosen × padded size]
  std::vector<int> chosen_;
  std::vector<char> is_chosen_;
  std::array<std::vector<double>, 3> weights_;
  int gram_stride_ = 0;
  std::array<std::vector<double>, 3> chosen_gram_;  // [chosen × gram_stride_]
  std::array<std::vector<double>, 3> with_chosen_;  // products with the samples
  std::array<NnlsSolver, 3> nnls_;                  // each goes on from rectangle to rectangle
  AlignedFloats total_gain_;                        // [padded size]
  std::vector<double> gram_, raw_gram_, h_, x_;
  std::vector<const float*> pointers_;
  std::vector<float> products_;
};

}  // namespace refield
