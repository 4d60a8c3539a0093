// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cmath>

#include "estimate/fit/fit_tuning.h"
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

/// A pixel's samples b as a dictionary sees them.
struct PixelCoordinates {
  std::array<std::vector<float>, 3> inside;  ///< Qᵀb, [rank]
  std::array<std::vector<float>, 3> smooth;  ///< Vᵀb, [smooth rank]
  std::array<double, 3> squared{};           ///< ‖b‖²
  double measured = 0.0;                     ///< samples that were measured, over channels
  double search_penalty = FitTuning{}.search_penalty;
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
  explicit KernelSelector(const SmoothSpace& smooth, const FitTuning& tuning = {});

  /// The dictionary that the next calls choose from; must outlive them.
  void prepare(const TreeDictionary& dictionary);
  /// At most `max_kernels` kernels, hats included. Looks at the class guessed first, leaves out those guessed
  /// to be far behind, and brings the guess up to date.
  KernelChoice select(const PixelCoordinates& pixel, int max_kernels, ClassGuess& guess);
  /// Non-negative weights of the chosen rectangles together with the hats (eq. 6). `noise_kept`: of each
  /// channel, the part of the noise variance that the samples still have; the prior of the hats weighs that
  /// much less. `like`: empty, or [hats × 3] weights of hats in a fit that is alike; those without any are
  /// held at first, which changes nothing but the time.
  PixelWeights solve(const PixelCoordinates& pixel, const KernelChoice& choice,
                     const std::array<double, 3>& noise_kept, std::span<const float> like = {});

 private:
  /// Products of the dictionary's rectangles in the metric of a class.
  struct Metric {
    const SmoothClass* smooth_class = nullptr;
    bool ready = false;
    std::array<AlignedFloats, 3> norm2;      // [padded size]
    std::array<AlignedFloats, 3> min_norm2;  // [padded size]; a part with less is spanned by others
    std::array<AlignedFloats, 3> gram;       // [size × padded size], rows made on demand
    std::vector<char> has_row;
  };
  /// A pixel's samples in the metric of a class.
  struct Samples {
    std::array<double, 3> squared{};        // ‖b‖²
    std::array<AlignedFloats, 3> products;  // with the rectangles, [padded size]
  };
  /// One channel of a matching pursuit.
  struct PursuitChannel {
    AlignedFloats correlation;      // of the rectangles with the residual, [padded size]
    AlignedFloats remaining_norm2;  // of their parts perpendicular to the chosen ones, [padded size]
    AlignedFloats projections;      // rows of the growing Cholesky factor, [max_chosen × padded size]
    std::vector<double> weights;    // of the chosen
    std::vector<double> gram;       // of the chosen, [max_chosen × max_chosen]
    std::vector<double> products;   // of the chosen with the samples
    NnlsSolver nnls;                // continues from rectangle to rectangle
  };
  struct Pursuit {
    int max_chosen = 0;
    std::vector<int> chosen;  // rectangles
    std::vector<char> is_chosen;
    std::array<PursuitChannel, 3> channels;
  };
  /// What a fit to the chosen rectangles leaves and takes.
  struct FitSummary {
    double squared_residual = 0.0;
    int parameters = 0;  // weights above zero
    int kernels = 0;     // rectangles with such a weight
  };
  /// One channel's normal equations of hats and rectangles, in this order.
  struct NormalEquations {
    std::vector<double> raw_gram;  // [size × size]
    std::vector<double> gram;      // and the hats' prior
    std::vector<double> products;  // with the samples
    std::vector<double> x;
  };

  Metric& metric(int smooth_class);
  /// Makes a vector of coordinates the left factor of products in the metric of a class.
  void weigh(float* coordinates, const SmoothClass& smooth_class, int channel) const;
  void make_row(Metric& metric, int box);
  void load_samples(const PixelCoordinates& pixel, const SmoothClass& smooth_class);

  // The pursuit in one class, and its steps.
  KernelChoice pursue(const PixelCoordinates& pixel, int smooth_class, int max_kernels);
  void start_pursuit(const Metric& metric, int max_chosen);
  /// The rectangle that reduces the residual most; -1 for none.
  int best_candidate(const Metric& metric);
  /// Chooses it and solves for the weights again.
  void choose(Metric& metric, int box);
  /// Takes the direction of the rectangle chosen last out of all others.
  void remove_direction(const Metric& metric, int channel);
  void update_weights(const Metric& metric, int channel);
  FitSummary summarise_pursuit() const;

  /// Sets up the equations of solve() for a channel, in the metric without a smooth part.
  void load_equations(const Metric& raw, const PixelCoordinates& pixel, const KernelChoice& choice, int hats,
                      int channel);

  const SmoothSpace& smooth_;
  const FitTuning tuning_;
  const TreeDictionary* dictionary_ = nullptr;
  std::size_t padded_size_ = 0;
  std::vector<Metric> metrics_;  // [classes]

  // State for the current pixel and class; memory that is reused.
  Samples samples_;
  Pursuit pursuit_;
  NormalEquations equations_;
  AlignedFloats left_;                  // factor of products
  std::vector<const float*> pointers_;  // right factors
  std::vector<float> products_;
  AlignedFloats total_gain_;  // [padded size]
};

}  // namespace refield
