// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Cholesky>

#include "core/image/image.h"
#include "core/light/light_map.h"

namespace refield {

/// Shares of a light's energy: radiance × solid angle, of all channels together.
struct LightShares {
  double interpolated = 0.0;  ///< from directions between the light sources
  /// Without effect on the picture: from texels that were black in all training lights and are far from all
  /// light sources, or that nothing interpolates.
  double unobserved = 0.0;
};

/// Interpolation between the light sources of a light stage, in lat-long maps. The reflectance per
/// irradiance as a function of the light's direction is the mean of a Gaussian process through those of the
/// sources (Rasmussen and Williams 2006, eq. 2.19 without noise), so a light from any direction equals a
/// fixed combination of the sources. The covariance of two directions at chord length c is
///     (1 − fine_share) · matérn(c ∕ length) + fine_share · matérn(c ∕ fine_length),
///     matérn(r) = (1 + √3 r) exp(−√3 r):
/// a part that is smooth over many sources, and a part that is known only near each source (highlights,
/// edges of shadows, noise). The second keeps the first smooth, yet at a source the picture is exact.
struct LightInterpolation {
  /// Rectangles of the light map, each lit as a whole: small, without overlap.
  std::vector<Box> sources;
  /// Lengths and distances are chords of the unit sphere.
  double length = 0.0;
  double fine_share = 0.0;  ///< 0 to 1
  double fine_length = 0.0;
  /// Up to this distance from the nearest source light is interpolated or extrapolated. From there its effect
  /// falls linearly, to nothing at 1.5 times the distance.
  double reach = 0.0;

  bool operator==(const LightInterpolation&) const = default;
  /// Why these values are impossible for maps of that domain; empty if they are not.
  std::string fault(const LightDomain& domain) const;
};

/// Moves light onto the sources of a LightInterpolation. Immutable; any number of threads may use it.
class LightInterpolator {
 public:
  /// Throws InputError for a fault().
  LightInterpolator(const LightInterpolation& interpolation, const LightDomain& domain);

  /// Replaces a light map by one that is black outside the sources and gives the same picture: radiance ×
  /// solid angle of each dark texel is added to the sources by their weights, which may be negative. Light on
  /// the sources stays where it is.
  void gather(Image& radiance) const;
  /// Shares of the energy of a light map.
  LightShares shares(const Image& radiance) const;

 private:
  /// Calls visit(irradiance, cosines of the angles to the sources, nearness) for the texels of a row that are
  /// not black and belong to no source.
  template <class Visit>
  void for_dark_texels(const Image& radiance, int row, Visit&& visit) const;
  /// Part of a texel's effect that stays: 1 near the sources, 0 far away.
  double nearness(const Eigen::VectorXd& cosines) const;

  LightInterpolation interpolation_;
  LightDomain domain_;
  Eigen::MatrixXd directions_;          // [sources × 3]
  Eigen::VectorXd solid_angles_;        // [sources]
  std::vector<double> row_angles_;      // [rows], solid angle of a texel
  std::vector<char> is_source_;         // [texels]
  Eigen::LLT<Eigen::MatrixXd> factor_;  // of the covariance of the sources
};

/// The interpolation that predicts each source best from all others, given responses [sources × 3 pixels] to
/// equal irradiance from each source: with the least relative RMSE, geometric mean over pixels. Nothing for
/// maps that are not lat-long, for fewer than 8 sources, for sources wider than 10°, or where the sources
/// leave no texel dark.
std::optional<LightInterpolation> fit_light_interpolation(const std::vector<Box>& sources,
                                                          const LightDomain& domain,
                                                          const Eigen::MatrixXd& responses);
/// Whether fit_light_interpolation() would fit one.
bool can_interpolate(const std::vector<Box>& sources, const LightDomain& domain);

}  // namespace refield
