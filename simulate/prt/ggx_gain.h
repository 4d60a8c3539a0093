// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>

namespace refield::prt {

/// The exponent of Phong's lobe around the mirror direction that stands for a GGX lobe of α = roughness²:
/// n = 3/8 (1/α² − 1). A lobe of Blinn's half vectors is as wide with n_b = 2/α² − 2 (Walter et al. 2007,
/// section 5.2), and the angle from the mirror direction is twice that between half vector and normal, so
/// that n = n_b/4 (Fisher and Woo 1994); three quarters of it have the least error with GgxGain, under light
/// as smooth as exp(4 cos), for roughness .3 to .7. `roughness` above 0, to 1.
float phong_exponent(float roughness);

/// What GGX reflects of uniform light at an angle over what the Phong lobe does that stands for it. Phong's
/// loses its cosine towards grazing angles, GGX (Smith's height-correlated shadowing, Schlick's Fresnel
/// reflection) nearly nothing: reflectance at normal incidence f₀ is reflected as f₀ · scale + offset of the
/// lobe (the two terms of Karis 2013).
class GgxGain {
 public:
  explicit GgxGain(float roughness);

  struct At {
    float scale, offset;

    /// Metals have no diffuse part; their Fresnel reflection keeps their colour.
    Eigen::Array3f operator()(const Eigen::Array3f& specular, bool metal) const {
      if (metal) return specular * (scale + offset);
      return specular * scale + (specular > 0.0f).select(Eigen::Array3f::Constant(offset), 0.0f);
    }
  };
  /// `cosine` of the line of sight to the normal; that of below the horizon is taken without its sign.
  At operator()(float cosine) const;

 private:
  static constexpr std::size_t places = 32;
  std::array<At, places> table_;  // at the middles of equal parts of the cosine
};

}  // namespace refield::prt
