// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

namespace refield::peers {

/// A Gram matrix K = A Aᵀ (or A Σ Aᵀ) of the lights, [images × images], by its eigenvectors U. In their
/// coordinates β = Uᵀ b ridge regression and truncated SVD are diagonal, so one decomposition serves all
/// pixels and all settings.
struct GramSpectrum {
  Eigen::VectorXd values;   ///< descending, ≥ 0
  Eigen::MatrixXd vectors;  ///< columns, in the order of `values`

  explicit GramSpectrum(const Eigen::MatrixXd& gram);
};

enum class DualMethod {
  ridge,          ///< penalty by generalised cross-validation
  truncated_svd,  ///< rank by generalised cross-validation
  smooth_ridge,   ///< penalty by marginal likelihood, and with it the length scale of a smooth covariance
};

/// A diagonal method at each of its settings (penalties, or ranks), and what assesses a setting.
struct DualFilters {
  Eigen::MatrixXd factors;      ///< [images × settings]: α = U (factors ∘ β)
  Eigen::MatrixXd misfit;       ///< [settings × images]: what β² are weighted with in the criterion
  Eigen::VectorXd denominator;  ///< [settings], of GCV; of the likelihood the log determinant
  DualMethod method;

  DualFilters(const GramSpectrum& spectrum, DualMethod method);

  /// Criterion of each setting for one channel of one pixel, [settings]; lower is better. `squared` = β².
  ///  - GCV: n ‖(I − S) b‖² / tr(I − S)², S the smoother (Golub, Heath and Wahba 1979, eq. 1.7).
  ///  - marginal likelihood: −2 log p(b) for b ~ N(0, σ² (K + λ I)), σ² the most likely, up to a constant
  ///    (Rasmussen and Williams 2006, eq. 5.8).
  Eigen::VectorXd criterion(const Eigen::Ref<const Eigen::VectorXd>& squared) const;
};

/// Penalties that are tried: a factor of 10^¼ apart, from 1e-9 to 10 times the largest eigenvalue.
double penalty(const GramSpectrum& spectrum, Eigen::Index setting);
inline constexpr Eigen::Index penalties = 41;

}  // namespace refield::peers
