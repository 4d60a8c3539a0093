// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "estimate/quality/outlier_frames.h"

namespace refield {

/// Ridge regression on blurred lights of some frames, in its dual form: predicts any pixel from itself under
/// the other lights, for any exponent of the tone curve.
class LightPredictors {
 public:
  /// Blurs and ridges to choose from; the one that predicts best should be taken, though undisturbed captures
  /// differ by a few per cent of residual between them.
  static constexpr std::size_t ways = 6;

  /// `chosen`: numbers of the images that take part.
  LightPredictors(const LightFeatures& lights, std::span<const int> chosen);

  void use(std::size_t way);
  /// Number of lights of which none is a multiple of another: copies tell nothing of what a weak predictor
  /// does not know.
  int different_lights() const { return different_lights_; }
  /// Whether lights have parts in common. Of single light sources a tone curve only changes the brightness,
  /// as gains do.
  bool are_mixtures() const { return are_mixtures_; }
  /// Before exponents other than 1.
  void prepare_exponents();

  /// (Gram matrix + ridge)⁻¹ [images × images]. Pixels have a constant of their own: room light that does not
  /// change must not look like a tone curve.
  Eigen::MatrixXd inverse(int channel, double exponent, bool with_constant = true) const;

  /// A [images × images]: A b is what each sample of a series b is more than the others predict of it.
  /// Images after each other whose lights are multiples of each other do not predict each other: they agree
  /// whatever the rig does slowly.
  Eigen::MatrixXf leave_one_out(int channel, double exponent, bool with_constant = true) const;

  /// Of lights [images × images] under transport whose covariance over the map is a Gaussian, once smooth,
  /// then with more and more detail besides. Over `brightness` squared: the square roots of the first one's
  /// diagonal.
  std::vector<Eigen::MatrixXd> smooth_grams(int channel, double exponent, Eigen::VectorXd& brightness) const;

  /// The constant of each series (column).
  Eigen::VectorXf constants(int channel, double exponent, const Eigen::MatrixXf& series) const;

 private:
  void blur(int first, int last);

  const LightFeatures& lights_;
  std::vector<int> chosen_;
  std::array<std::vector<std::vector<int>>, 3> folds_;  // of more than one image, by channel
  int different_lights_ = 0;
  bool are_mixtures_ = false;
  std::size_t way_ = ways;
  bool has_exponents_ = false;
  /// [channel][derivative by the exponent]: blurred lights [images × cells].
  std::array<std::array<Eigen::MatrixXd, 3>, 3> blurred_;
};

/// Weights of pixels (columns) by their residuals: 1 ∕ the sum of squares.
Eigen::VectorXf inverse_powers(const Eigen::MatrixXf& residuals);

/// Mean over series (columns) of the logarithm of residual power over power.
double criterion(const Eigen::MatrixXf& leave_one_out, const Eigen::MatrixXf& series);

/// Whether photographs agree that residuals `after` [channel][images × pixels] are smaller than `before`:
/// mean over its standard error of the logarithm of their powers' ratio. A few photographs that gain much
/// show nothing.
double agreement(const std::array<Eigen::MatrixXf, 3>& before, const std::array<Eigen::MatrixXf, 3>& after);

/// Relative root mean square of a residual whose criterion, mean over the channels, is `value`.
double relative(double value);

}  // namespace refield
