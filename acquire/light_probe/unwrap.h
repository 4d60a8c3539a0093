// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>

#include "acquire/light_probe/mirror_ball.h"
#include "core/light/monitor_placement.h"

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

/// Reads "X,Y,R" of --ball; nullopt: "find".
std::optional<ImageCircle> circle_from_text(const std::string& text);

struct UnwrapOptions {
  int width = 512;  ///< of the light map, even; its height is half of it
  MirrorReflectance reflectance = MirrorReflectance::chrome();
  /// What the photograph is multiplied by, each channel: 1 / transmittance of neutral-density filters.
  std::array<double, 3> gain = {1.0, 1.0, 1.0};

  /// Throws InputError naming the option and its range.
  void check() const;
};

/// What one or several photographs of the ball say about the environment.
struct SeenLight {
  Image radiance;  ///< lat-long [width/2 × width × 3]; 0 where nothing was seen
  /// [width/2 × width × 1]; 0: not seen. Else the share of the texel that was seen times the fourth power of
  /// the ball's resolution there, relative to that in its middle: by it photographs are joined.
  Image weight;
  Mask clipped;  ///< non-zero: rests on samples that were clipped, so the radiance is a lower bound
};

/// The lat-long light map that a photograph of a mirror ball shows, see docs/guide/light-probe.md. `turn` is
/// the camera's: without one its optical axis is the middle of the light map, and +Y is up in the image. Each
/// texel is the mean radiance over its solid angle, by samples no further apart than a third of a pixel, so
/// that small bright sources keep their energy; each sample is divided by the mirror's reflectance at its
/// angle of incidence. `hidden`, empty or as large as the photograph, is non-zero where nothing may be taken
/// from: tripod, stand, photographer. Throws InputError for sizes that do not fit.
SeenLight unwrap(const Photograph& photograph, const MirrorBall& ball, const EulerAngles& turn,
                 const Mask& hidden, const UnwrapOptions& options);

/// One map from photographs from several sides: the mean by weight.
SeenLight join(const std::vector<SeenLight>& views);

/// A width that shows what the ball's middle resolves, rounded to 16, at most 4096.
int natural_width(const MirrorBall& ball);

/// Fills what no photograph shows (weight 0: the camera itself, what is behind the ball) from the texels
/// around it: each gets their mean, weighted by solid angle and the inverse cube of the distance on the
/// sphere, so that the fill meets its environment without a step, at the poles and across the map's edge as
/// anywhere else. Radiance where something was seen stays as it is. Throws InputError when nothing was seen
/// at all. Source: Matusik et al. 2004, section 6, "we automatically fill in the region where the camera is
/// visible with neighboring pixels"; the weights are ours.
void fill_unseen(SeenLight& light);

/// Fraction of the sphere that was not seen.
double unseen_fraction(const Image& weight);

}  // namespace refield
