// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <span>
#include <vector>

#include "estimate/nnls.h"
#include "estimate/vector_kernels.h"

namespace refield {

/// Rectangles to choose from and the samples to explain, both as coordinates in an orthonormal basis Q of the
/// space that the rectangles' columns span: a few dozen numbers instead of one an image.
struct KernelDictionary {
  int size = 0;                          ///< rectangles
  std::size_t stride = 0;                ///< length of coordinate vectors, padded (see vector_kernels.h)
  std::array<AlignedFloats, 3> columns;  ///< [size × stride] of each channel
  std::array<std::vector<double>, 3> samples;  ///< Qᵀb, [stride]
  double squared_outside = 0.0;  ///< ‖b‖² outside the space, which no rectangle here explains
  double squared_samples = 0.0;  ///< ‖b‖²
  double measured = 0.0;         ///< samples that were measured, over channels

  void resize(int rectangles, std::size_t coordinates);
  float* column(int channel, int rectangle) { return columns[channel].data() + rectangle * stride; }
  const float* column(int channel, int rectangle) const {
    return columns[channel].data() + rectangle * stride;
  }
};

/// Chooses few rectangles that explain a pixel, and their non-negative weights: non-negative orthogonal
/// matching pursuit (the rectangle whose part perpendicular to the chosen ones correlates best, positively,
/// with the residual; then all weights anew), along which the Bayesian information criterion says how many
/// the samples can bear (Schwarz 1978).
///
/// A kd-tree has to split its way down to a small highlight and so spends a dozen leaves of equal weight on
/// it; with the tree's inner rectangles to choose from as well, the same function takes two kernels.
class KernelSelector {
 public:
  /// At most `most` rectangles. Afterwards chosen(), weights() and squared_residual() hold the choice.
  void select(const KernelDictionary& dictionary, int most);

  const std::vector<int>& chosen() const { return best_chosen_; }
  /// Weight of a channel of each chosen rectangle, ≥ 0.
  const std::vector<double>& weights(int channel) const { return best_weights_[channel]; }
  double squared_residual() const { return best_residual_; }

 private:
  int best_candidate(const KernelDictionary& dictionary);
  void add(const KernelDictionary& dictionary, int rectangle);

  std::vector<int> chosen_, best_chosen_;
  std::vector<char> is_chosen_;
  std::array<std::vector<double>, 3> weights_, best_weights_;
  double best_residual_ = 0.0;
  std::array<AlignedFloats, 3> residual_;  // Qᵀ(b − A x)
  std::array<std::vector<float>, 3> norm2_,
      remaining_norm2_;  // of each rectangle, and perpendicular to the chosen ones
  std::array<std::vector<double>, 3> gram_, with_samples_;
  AlignedFloats orthonormal_;  // of the chosen ones, [3 × chosen × stride]
  std::vector<const float*> pointers_;
  std::vector<float> products_;
  NnlsSolver nnls_;
  int most_ = 0;
};

/// Bayesian information criterion of a fit with unknown noise: N log(residual / N) + parameters · log N. The
/// residual is taken as no smaller than float32 columns can tell.
double information_criterion(double squared_residual, double squared_samples, double measured,
                             int parameters);

}  // namespace refield
