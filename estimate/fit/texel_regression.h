// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <map>

#include "core/session/capture_session.h"
#include "estimate/fit/box_table.h"
#include "estimate/fit/fit_pixel.h"

namespace refield {

/// Cells of a light map: rectangles whose texels have equal values in every training light (a light source, a
/// block of a coarse display). Empty if there are more than `max_single_light_cells`, so that light has many
/// degrees of freedom, or fewer than two. Texels that are black in all lights belong to no cell.
std::vector<Box> light_cells(const BoxTable& table);

/// Prior covariance of the weights of cells, see weight_covariance().
struct CellPrior {
  double length;
  double independent;
};
/// Those that a pixel selects from.
std::span<const CellPrior> cell_priors();
/// Ratios of noise variance to the mean variance of a sample that a pixel selects from.
inline constexpr int cell_noise_levels = 20;
double cell_noise_ratio(int level);

/// The training lights' sums over `cells`: [images × cells] of each channel, in the table's unit.
std::array<Eigen::MatrixXd, 3> lights_of(const BoxTable& table, std::span<const Box> cells);

/// Prior covariance of the weights of cells: a Matérn covariance (ν = 3/2) of their distance, in widths of
/// the light map (diameters of the sphere for maps of directions), of this length, and an independent part.
Eigen::MatrixXd weight_covariance(double length, double independent, std::span<const Box> cells,
                                  const LightDomain& domain);

/// Gaussian process regression with one weight per light cell, for light with few degrees of freedom. The
/// prior covariance of the weights is smooth over the light map (Matérn, ν = 3/2) plus independent. Each
/// pixel selects the length, the share of the independent part and the ratio of noise to signal by the
/// evidence of its samples in all channels (Rasmussen and Williams 2006, eqs. 2.25, 4.17 and 5.8; the scale
/// of the prior is integrated out by its maximum). The independent part alone is ridge regression. The
/// weights are the most probable non-negative ones. Threads share it.
class TexelRegression {
 public:
  /// `cells`: of the table that this one may be a part of.
  TexelRegression(const BoxTable& table, std::span<const Box> cells);

  /// Whether the lights are nearly orthogonal, as photographs of one light source at a time are. Nothing then
  /// tells noise from detail, and the regression interpolates the samples.
  bool is_interpolating() const { return noise_levels_ == 1; }
  /// Whether the lights that differ are; with several photographs of each, the regression need not
  /// interpolate.
  bool is_of_single_lights() const { return is_of_single_lights_; }

  struct Fit {
    PixelKernels kernels;    ///< of the cells with a weight
    double criterion = 0.0;  ///< −2 log evidence, comparable with criterion_of()
  };
  /// Fits a pixel; unmeasured samples are left out. No kernels where all measured samples are zero.
  Fit fit(const PixelSamples& samples) const;

  /// This criterion for another model: the Bayesian information criterion with a penalty for the search of
  /// rectangles, as the selection of rectangles uses it.
  double criterion_of(const PixelKernels& kernels, const PixelSamples& samples) const;

  /// Leave-one-out residuals of a pixel that fit() fitted, [3 × stride], zero where not measured. Returns
  /// their squared sum.
  double leave_one_out(const PixelKernels& kernels, const MaskedSamples& samples, float* residuals) const;

  /// The squared sum of the residuals' part that is error of the weights, as the evidence expects it: the
  /// variance of each sample given all others, by the prior and the noise of PixelKernels::light_class, less
  /// the noise. Weights that are zero in `kernels` have no error if the pixel uses the regression.
  double expected_error(const PixelKernels& kernels, const MaskedSamples& samples) const;

 private:
  /// What leave-one-out needs of a channel's measured samples.
  struct LeftOut {
    std::vector<int> measured;
    Eigen::VectorXd values;    ///< [images]
    Eigen::VectorXd dual;      ///< (K + λI)⁻¹ b, with all weights free
    Eigen::VectorXd diagonal;  ///< of (K + λI)⁻¹, where the weights that are held at zero are known
    Eigen::VectorXd misfit;    ///< (b − L w) / λ
  };
  LeftOut left_out_of(const PixelKernels& kernels, const MaskedSamples& samples, int channel) const;
  /// What the fit takes of the measured samples of one light: h hᵀ, since they are multiples of each other.
  struct GroupLeverage {
    Eigen::ArrayXd root;  ///< h
    double rest;          ///< 1 − hᵀh
  };
  static GroupLeverage leverage_of(const std::vector<int>& group, const LeftOut& out, double noise_ratio);
  /// Covariance of the samples for one prior and channel, V diag(values) Vᵀ.
  struct Spectrum {
    Eigen::MatrixXd vectors;                   ///< [images × rank]
    Eigen::VectorXd values;                    ///< ≥ 0; their sum is the number of images
    double scale = 1.0;                        ///< of the prior
    std::array<double, 32> log_determinant{};  ///< at each noise level
  };
  const Spectrum& spectrum(int prior, int channel) const {
    return spectra_[static_cast<std::size_t>(prior) * 3 + (is_grey_ ? 0 : channel)];
  }
  /// What leaving out the unmeasured samples u takes, from the inverse P of K + λI: P_u, and the Cholesky
  /// factor of P_uu. With these the inverse for the measured samples alone is P − P_u P_uu⁻¹ P_uᵀ.
  struct Gap {
    std::vector<int> unmeasured;
    Eigen::MatrixXd columns;  ///< [images × unmeasured]
    Eigen::LLT<Eigen::MatrixXd> factor;
  };
  Gap gap_of(int prior, int noise, int channel, const std::vector<int>& measured) const;
  /// P · samples.
  Eigen::VectorXd dual_of(int prior, int noise, int channel, const Eigen::VectorXd& samples) const;
  /// Most probable weights, of either sign, from the dual coefficients.
  Eigen::VectorXd weights_of(int prior, int channel, const Eigen::VectorXd& dual) const;
  /// Most probable weights of no negative one, by an active set method that always ends.
  Eigen::VectorXd non_negative(int prior, int noise, int channel, const Eigen::VectorXd& samples,
                               const std::vector<int>& measured) const;
  /// Covariance of the weights given the measured samples, in the unit of the prior; where all samples were
  /// measured it depends on the lights alone and is kept.
  std::shared_ptr<const Eigen::MatrixXd> posterior(int prior, int noise, int channel,
                                                   const std::vector<int>& measured) const;
  /// Dual coefficients, zero where not measured.
  Eigen::VectorXd solve(int prior, int noise, int channel, const Eigen::VectorXd& samples,
                        const std::vector<int>& measured) const;

  const BoxTable* table_;
  std::vector<Box> cells_;
  int images_;
  std::vector<std::vector<int>> repeats_;  // images of one light, which are left out together
  int noise_levels_;
  bool is_of_single_lights_;
  bool is_grey_ = true;                       // the lights of the three channels are equal
  std::array<Eigen::MatrixXd, 3> lights_;     // [images × cells]
  std::vector<Eigen::MatrixXd> covariances_;  // of the weights, of each prior
  std::vector<Spectrum> spectra_;             // [priors × 3]
  /// Weights of complete pixels from samples, where the lights determine them; else empty. [cells × images]
  std::array<Eigen::MatrixXd, 3> determined_;
  mutable std::mutex mutex_;  // of posteriors_ and precisions_
  mutable std::map<std::array<int, 3>, std::shared_ptr<const Eigen::MatrixXd>> posteriors_;
  mutable std::map<int, Eigen::MatrixXd> precisions_;  // inverse covariances_, where needed
};

/// The regressions of a capture and of its parts for cross-validation, each prepared when first used.
class TexelRegressions {
 public:
  explicit TexelRegressions(const BoxTable& table);
  /// With the cells that another of the same lights has found.
  TexelRegressions(const BoxTable& table, std::vector<Box> cells) : table_(table), cells_(std::move(cells)) {}

  const std::vector<Box>& cells() const { return cells_; }
  /// Null for light with many degrees of freedom.
  std::shared_ptr<const TexelRegression> of_all();
  /// The regression on the images `seen`.
  std::shared_ptr<const TexelRegression> of_part(const std::vector<int>& seen);

 private:
  const BoxTable& table_;
  std::vector<Box> cells_;
  std::mutex mutex_;
  std::map<std::vector<int>, std::shared_ptr<const TexelRegression>> parts_;  // by images, all: empty
  std::vector<std::unique_ptr<BoxTable>> tables_;
};

}  // namespace refield
