// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/lamp.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace refield {

namespace {

double radius_texels(const Lamp& spot, const LightDomain& domain) {
  return std::max(spot.size * domain.height, 0.5);
}

/// The width of the ring in which a spot fades out, half of it outside, as a share of its radius.
double fading(const Lamp& spot, const LightDomain& domain) {
  return std::max(0.2, 1.0 / radius_texels(spot, domain));
}

bool wraps(const LightDomain& domain) {
  return domain.parameterisation == Parameterisation::lat_long;
}

double overlap(double left, double right, int x) {
  return std::max(0.0, std::min(right, x + 1.0) - std::max(left, static_cast<double>(x)));
}

/// Share of column `x` that a bar covers.
double bar_coverage(const Lamp& lamp, const LightDomain& domain, int x) {
  const double left = (lamp.x - 0.5 * lamp.size) * domain.width;
  const double right = left + lamp.size * domain.width;
  double covered = overlap(left, right, x);
  if (wraps(domain))
    covered += overlap(left - domain.width, right - domain.width, x) +
               overlap(left + domain.width, right + domain.width, x);
  return std::min(covered, 1.0);
}

/// Distance of a point, in texels, from a spot's centre, in units of its radius.
class SpotDistance {
 public:
  SpotDistance(const Lamp& lamp, const LightDomain& domain) : domain_(domain) {
    radius_ = radius_texels(lamp, domain);
    column_ = lamp.x * domain.width;
    row_ = lamp.y * domain.height;
    if (wraps(domain)) towards_ = lat_long_direction(column_, row_, domain.width, domain.height);
  }

  double operator()(double column, double row) const {
    if (!wraps(domain_)) return std::hypot(column - column_, row - row_) / radius_;
    const Eigen::Vector3d direction = lat_long_direction(column, row, domain_.width, domain_.height);
    const double angle = std::atan2(direction.cross(towards_).norm(), direction.dot(towards_));
    return angle / std::numbers::pi * domain_.height / radius_;
  }

 private:
  LightDomain domain_;
  double radius_ = 0.0, column_ = 0.0, row_ = 0.0;
  Eigen::Vector3d towards_ = Eigen::Vector3d::Zero();
};

std::optional<Box> clipped(double x0, double y0, double x1, double y1, const LightDomain& domain) {
  const auto texel = [](double position, int count) {
    return static_cast<int>(std::clamp(position, 0.0, static_cast<double>(count)));
  };
  const Box box{texel(std::floor(x0), domain.width), texel(std::floor(y0), domain.height),
                texel(std::ceil(x1), domain.width), texel(std::ceil(y1), domain.height)};
  if (box.width() <= 0 || box.height() <= 0) return std::nullopt;
  return box;
}

/// The columns that a spot of a lat-long map reaches to either side, as a share of the width; a half where it
/// holds a pole. A cap of angle r at polar angle θ spans asin(sin r / sin θ) of longitude.
double half_width_of_cap(double radius, double polar) {
  if (polar - radius <= 0.0 || polar + radius >= std::numbers::pi) return 0.5;
  return std::asin(std::min(1.0, std::sin(radius) / std::sin(polar))) / (2.0 * std::numbers::pi);
}

}  // namespace

std::optional<Box> lamp_box(const Lamp& lamp, const LightDomain& domain) {
  const double width = domain.width, height = domain.height;
  double half_width = 0.5 * lamp.size * width, top = 0.0, bottom = height;
  if (lamp.shape == Lamp::Shape::spot) {
    const double reach = radius_texels(lamp, domain) * (1.0 + 0.5 * fading(lamp, domain));
    top = lamp.y * height - reach;
    bottom = lamp.y * height + reach;
    half_width = wraps(domain)
                     ? width * half_width_of_cap(reach / height * std::numbers::pi, lamp.y * std::numbers::pi)
                     : reach;
  }
  const double left = lamp.x * width - half_width, right = lamp.x * width + half_width;
  if (wraps(domain) && (left < 0.0 || right > width)) return clipped(0.0, top, width, bottom, domain);
  return clipped(left, top, right, bottom, domain);
}

void add_lamp(const Lamp& lamp, const Box& within, LightMap& light) {
  const LightDomain domain = light.domain();
  const auto lit = lamp_box(lamp, domain);
  if (!lamp.is_on || !lit) return;
  const Box box{std::max(lit->x0, within.x0), std::max(lit->y0, within.y0), std::min(lit->x1, within.x1),
                std::min(lit->y1, within.y1)};
  const SpotDistance distance(lamp, domain);
  const double ring = fading(lamp, domain);
  for (int y = box.y0; y < box.y1; ++y)
    for (int x = box.x0; x < box.x1; ++x) {
      const double coverage = lamp.shape == Lamp::Shape::bar
                                  ? bar_coverage(lamp, domain, x)
                                  : std::clamp((1.0 - distance(x + 0.5, y + 0.5)) / ring + 0.5, 0.0, 1.0);
      for (int c = 0; c < 3; ++c)
        light.radiance.at(x, y, c) += static_cast<float>(coverage * lamp.radiance * lamp.colour[c]);
    }
}

bool is_on_lamp(const Lamp& lamp, const LightDomain& domain, double x, double y) {
  constexpr double least_reach_texels = 6.0;
  if (lamp.shape == Lamp::Shape::bar) {
    double apart = std::abs(x - lamp.x);
    if (wraps(domain)) apart = std::min(apart, 1.0 - apart);
    return apart <= std::max(0.5 * lamp.size, least_reach_texels / domain.width);
  }
  const SpotDistance distance(lamp, domain);
  return distance(x * domain.width, y * domain.height) <=
         std::max(1.1, least_reach_texels / radius_texels(lamp, domain));
}

}  // namespace refield
