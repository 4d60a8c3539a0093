// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <string>
#include <vector>

namespace refield {

/// The fraction of unpolarised light that a mirror returns, for each channel (red, green, blue) and angle of
/// incidence.
class MirrorReflectance {
 public:
  /// Fresnel's equations for a conductor of complex refractive index n + ik.
  static MirrorReflectance conductor(const std::array<double, 3>& n, const std::array<double, 3>& k);

  /// Chromium, what "chrome" balls are plated with; reflects .55 to .56 at normal incidence. n and k at 659,
  /// 549 and 451 nm: P. B. Johnson, R. W. Christy, Optical constants of transition metals, Phys. Rev. B 9
  /// (1974).
  static MirrorReflectance chrome();

  /// Bare silver, .98 to .99; n and k at 660, 549 and 451 nm: P. B. Johnson, R. W. Christy, Optical constants
  /// of the noble metals, Phys. Rev. B 6 (1972).
  static MirrorReflectance silver();

  /// A measured reflectance at normal incidence, each above 0 and at most 1, rising to 1 at grazing by
  /// Schlick's approximation (C. Schlick, Computer Graphics Forum 13, 1994). Throws InputError.
  static MirrorReflectance measured(const std::array<double, 3>& at_normal_incidence);

  /// "chrome", "silver", "perfect" (1 at every angle), or one or three numbers: measured(). Throws
  /// InputError.
  static MirrorReflectance from_text(const std::string& text);

  /// `cos_incidence` in [0, 1]: 1 at normal incidence, 0 grazing.
  std::array<float, 3> at(double cos_incidence) const;

 private:
  template <class Reflectance>
  static MirrorReflectance tabulated(const Reflectance& reflectance);
  std::vector<std::array<float, 3>> table_;  // over the cosine, equally spaced
};

/// Reads "0.5" (all channels) or "0.5,0.6,0.7". Throws InputError naming `option`.
std::array<double, 3> channel_numbers(const std::string& text, const std::string& option);

}  // namespace refield
