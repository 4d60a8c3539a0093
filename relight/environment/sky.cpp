// SPDX-License-Identifier: Apache-2.0
#include "relight/environment/environment.h"

#include <algorithm>

#include "core/base/units.h"

namespace refield {

namespace {

using Eigen::Array3d;
using std::numbers::pi;
constexpr double sun_radius = 0.265 * pi / 180.0;
constexpr double ground_albedo = 0.2;

/// The distribution of Perez et al., relative: zenith angle θ, angle to the sun γ.
struct Perez {
  double a, b, c, d, e;
  double at(double cos_theta, double gamma) const {
    return (1.0 + a * std::exp(b / std::max(cos_theta, 0.01))) *
           (1.0 + c * std::exp(d * gamma) + e * std::cos(gamma) * std::cos(gamma));
  }
};

/// Luminance in kcd/m² and chromaticity of a sky.
class Sky {
 public:
  Sky(double sun_zenith_angle, double turbidity)
      : sun_cos_(std::cos(sun_zenith_angle)), sun_(sun_zenith_angle) {
    const double t = turbidity, s = sun_zenith_angle;
    luminance_ = {0.1787 * t - 1.4630, -0.3554 * t + 0.4275, -0.0227 * t + 5.3251, 0.1206 * t - 2.5771,
                  -0.0670 * t + 0.3703};
    x_ = {-0.0193 * t - 0.2592, -0.0665 * t + 0.0008, -0.0004 * t + 0.2125, -0.0641 * t - 0.8989,
          -0.0033 * t + 0.0452};
    y_ = {-0.0167 * t - 0.2608, -0.0950 * t + 0.0092, -0.0079 * t + 0.2102, -0.0441 * t - 1.6537,
          -0.0109 * t + 0.0529};
    const double chi = (4.0 / 9.0 - t / 120.0) * (pi - 2.0 * s);
    zenith_luminance_ = std::max(0.0, (4.0453 * t - 4.9710) * std::tan(chi) - 0.2155 * t + 2.4192);
    const Eigen::Vector4d powers(s * s * s, s * s, s, 1.0);
    const Eigen::RowVector3d haze(t * t, t, 1.0);
    Eigen::Matrix<double, 3, 4> x, y;
    x << 0.00166, -0.00375, 0.00209, 0.0, -0.02903, 0.06377, -0.03202, 0.00394, 0.11693, -0.21196, 0.06052,
        0.25886;
    y << 0.00275, -0.00610, 0.00317, 0.0, -0.04214, 0.08970, -0.04153, 0.00516, 0.15346, -0.26756, 0.06670,
        0.26688;
    zenith_x_ = haze * x * powers;
    zenith_y_ = haze * y * powers;
  }

  /// Linear sRGB.
  Array3d radiance(double cos_theta, double gamma) const {
    const auto relative = [&](const Perez& perez) {
      return perez.at(cos_theta, gamma) / perez.at(1.0, sun_);
    };
    const double luminance = zenith_luminance_ * relative(luminance_);
    const double x = zenith_x_ * relative(x_), y = zenith_y_ * relative(y_);
    const Eigen::Vector3d xyz(luminance * x / y, luminance, luminance * (1.0 - x - y) / y);
    Eigen::Matrix3d rgb_from_xyz;
    rgb_from_xyz << 3.2406, -1.5372, -0.4986, -0.9689, 1.8758, 0.0415, 0.0557, -0.2040, 1.0570;
    return (rgb_from_xyz * xyz).array().max(0.0);
  }

  /// Illuminance of the sun on a plane that faces it, klx.
  Array3d sun(double turbidity) const {
    constexpr double beyond_the_air = 128.0;
    const Array3d wavelength(0.610, 0.550, 0.465);  // micrometres
    const double degrees = degrees_from_radians(sun_);
    const double air_mass = 1.0 / (std::max(sun_cos_, 0.0) + 0.15 * std::pow(93.885 - degrees, -1.253));
    const double haze = 0.04608 * turbidity - 0.04586;
    return beyond_the_air *
           (-air_mass * (0.008735 * wavelength.pow(-4.08) + haze * wavelength.pow(-1.3))).exp();
  }

 private:
  Perez luminance_, x_, y_;
  double zenith_luminance_, zenith_x_, zenith_y_;
  double sun_cos_, sun_;
};

/// The share of a texel that the sun's disc covers.
double covered_share(int x, int y, const Eigen::Vector3d& sun, const LightDomain& domain) {
  constexpr int samples = 16;
  const double near = sun_radius + 2.0 * pi / domain.width + pi / domain.height;
  if (lat_long_direction(x + 0.5, y + 0.5, domain.width, domain.height).dot(sun) <
      std::cos(std::min(near, pi)))
    return 0.0;
  int inside = 0;
  for (int j = 0; j < samples; ++j)
    for (int i = 0; i < samples; ++i)
      inside +=
          lat_long_direction(x + (i + 0.5) / samples, y + (j + 0.5) / samples, domain.width, domain.height)
              .dot(sun) >= std::cos(sun_radius);
  return inside / static_cast<double>(samples * samples);
}

double texel_angle(int y, const LightDomain& domain) {
  return 2.0 * pi / domain.width *
         (std::cos(pi * y / domain.height) - std::cos(pi * (y + 1) / domain.height));
}

void add_sun(LightMap& light, const Eigen::Vector3d& sun, const Array3d& energy) {
  const LightDomain domain = light.domain();
  struct Covered {
    int x, y;
    double share;
  };
  std::vector<Covered> texels;
  double angle = 0.0;
  for (int y = 0; y < domain.height; ++y)
    for (int x = 0; x < domain.width; ++x)
      if (const double share = covered_share(x, y, sun, domain); share > 0.0) {
        texels.push_back({x, y, share});
        angle += share * texel_angle(y, domain);
      }
  if (texels.empty()) {  // texels so large that the disc lies between their samples
    const Eigen::Vector2d at = lat_long_position(sun, domain.width, domain.height);
    texels.push_back({static_cast<int>(at.x()), std::min(static_cast<int>(at.y()), domain.height - 1), 1.0});
    angle = texel_angle(texels[0].y, domain);
  }
  for (const Covered& texel : texels)
    for (int c = 0; c < 3; ++c)
      light.radiance.at(texel.x, texel.y, c) += static_cast<float>(energy[c] * texel.share / angle);
}

}  // namespace

void SkyOptions::check() const {
  if (!(turbidity >= 1.7 && turbidity <= 10.0))
    throw InputError("turbidity is ", turbidity, "; give 1.7 (clear) to 10 (haze)");
  if (!(std::abs(latitude_degrees) <= 85.0))
    throw InputError("--latitude is ", latitude_degrees, "; give -85 to 85 degrees");
  if (width < 16 || width > 16384 || width % 2 != 0)
    throw InputError("a sky of ", width, " texels across; give an even number, 16 to 16384");
}

Eigen::Vector3d sun_direction(double done, const SkyOptions& options) {
  options.check();
  const double hour = pi * (std::clamp(done, 0.0, 1.0) - 0.5);
  const double latitude = radians_from_degrees(options.latitude_degrees);
  return {std::sin(hour), std::cos(hour) * std::cos(latitude), std::cos(hour) * std::sin(latitude)};
}

LightMap clear_sky(const Eigen::Vector3d& towards_sun, const SkyOptions& options) {
  options.check();
  const double elevation = std::asin(std::clamp(towards_sun.y(), 0.0, 1.0));
  const Sky sky(pi / 2.0 - elevation, options.turbidity);
  const Array3d sun = sky.sun(options.turbidity);
  LightMap light{Image(options.width, options.width / 2, 3), Parameterisation::lat_long};
  const LightDomain domain = light.domain();
  Array3d on_the_ground = sun * std::sin(elevation);  // klx
  const auto set = [&](int x, int y, const Array3d& radiance) {
    for (int c = 0; c < 3; ++c) light.radiance.at(x, y, c) = static_cast<float>(radiance[c]);
  };
  const int horizon = (domain.height + 1) / 2;
  for (int y = 0; y < horizon; ++y)
    for (int x = 0; x < domain.width; ++x) {
      const Eigen::Vector3d d = lat_long_direction(x + 0.5, y + 0.5, domain.width, domain.height);
      const Array3d radiance = sky.radiance(d.y(), std::acos(std::clamp(d.dot(towards_sun), -1.0, 1.0)));
      set(x, y, radiance);
      on_the_ground += radiance * std::max(d.y(), 0.0) * texel_angle(y, domain);
    }
  for (int y = horizon; y < domain.height; ++y)
    for (int x = 0; x < domain.width; ++x) set(x, y, ground_albedo / pi * on_the_ground);
  add_sun(light, towards_sun, sun);
  return light;
}

}  // namespace refield
