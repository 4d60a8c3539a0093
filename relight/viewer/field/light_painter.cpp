// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/field/light_painter.h"

#include <tbb/parallel_for.h>
#include <Eigen/Geometry>

#include <numbers>

#include "core/base/number_text.h"
#include "core/image/image.h"
#include "core/light/cube_map.h"

namespace refield {

namespace {

/// The lat-long map in which light sources stand where they stand on a cube map: as fine as the cube's faces
/// are.
LightDomain panorama_of(const LightDomain& domain) {
  if (domain.parameterisation != Parameterisation::cube) return domain;
  return {4 * domain.width, 2 * domain.width, Parameterisation::lat_long};
}

double radius_texels(const PaintedLight& spot, const LightDomain& domain) {
  return std::max(spot.size * panorama_of(domain).height, 0.5);
}

/// The width of the ring in which a spot fades out, half of it outside, as a share of its radius.
double fading(const PaintedLight& spot, const LightDomain& domain) {
  return std::max(0.2, 1.0 / radius_texels(spot, domain));
}

bool is_around(const LightDomain& domain) {
  return domain.parameterisation != Parameterisation::monitor;
}

Eigen::Vector3d direction_at(double column, double row, const LightDomain& domain) {
  if (domain.parameterisation == Parameterisation::cube) return cube_direction(column, row, domain.width);
  return lat_long_direction(column, row, domain.width, domain.height);
}

double overlap(double left, double right, double x) {
  return std::max(0.0, std::min(right, x + 1.0) - std::max(left, x));
}

/// Share that a bar covers of the column of which a texel is the middle; on a cube, of the panorama's.
double bar_coverage(const PaintedLight& light_source, const LightDomain& domain, int x, int y) {
  const LightDomain panorama = panorama_of(domain);
  const double width = panorama.width;
  double column = x;
  if (domain.parameterisation == Parameterisation::cube)
    column =
        lat_long_position(direction_at(x + 0.5, y + 0.5, domain), panorama.width, panorama.height).x() - 0.5;
  const double left = (light_source.x - 0.5 * light_source.size) * width,
               right = left + light_source.size * width;
  double covered = overlap(left, right, column);
  if (is_around(domain))
    covered += overlap(left - width, right - width, column) + overlap(left + width, right + width, column);
  return std::min(covered, 1.0);
}

/// Distance of a point from a spot's centre, in units of its radius.
class SpotDistance {
 public:
  SpotDistance(const PaintedLight& light_source, const LightDomain& domain)
      : domain_(domain), panorama_(panorama_of(domain)) {
    radius_ = radius_texels(light_source, domain);
    column_ = light_source.x * panorama_.width;
    row_ = light_source.y * panorama_.height;
    if (is_around(domain)) towards_ = direction_at(column_, row_, panorama_);
  }

  /// Of a point of the map, in texels.
  double operator()(double column, double row) const {
    return is_around(domain_) ? of(direction_at(column, row, domain_)) : on_monitor(column, row);
  }
  /// Of a point where light sources stand, in fractions.
  double of_fraction(double x, double y) const {
    const double column = x * panorama_.width, row = y * panorama_.height;
    return is_around(domain_) ? of(direction_at(column, row, panorama_)) : on_monitor(column, row);
  }

 private:
  double on_monitor(double column, double row) const {
    return std::hypot(column - column_, row - row_) / radius_;
  }
  double of(const Eigen::Vector3d& direction) const {
    const double angle = std::atan2(direction.cross(towards_).norm(), direction.dot(towards_));
    return angle / std::numbers::pi * panorama_.height / radius_;
  }

  LightDomain domain_, panorama_;
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

/// From where to where, of −1 to 1, a cap of directions reaches along an axis of a cube's face; nothing where
/// it lies beside the face. `along` and `ahead`: its middle, in the face's axes.
std::optional<std::pair<double, double>> reach_on_face(double along, double ahead, double radius) {
  const double sine = std::sin(radius) / std::hypot(along, ahead);
  if (radius >= 0.5 * std::numbers::pi || !(sine < 1.0)) return std::pair{-1.0, 1.0};
  // The planes through the face's other axis that touch the cap.
  const double middle = std::atan2(along, ahead), half = std::asin(sine);
  const double low = std::max(middle - half, -0.25 * std::numbers::pi),
               high = std::min(middle + half, 0.25 * std::numbers::pi);
  if (!(low < high)) return std::nullopt;
  return std::pair{std::tan(low), std::tan(high)};
}

std::optional<Box> spot_box_on_cube(const PaintedLight& spot, const LightDomain& domain) {
  const LightDomain panorama = panorama_of(domain);
  const Eigen::Vector3d towards = direction_at(spot.x * panorama.width, spot.y * panorama.height, panorama);
  const double radius =
      radius_texels(spot, domain) * (1.0 + 0.5 * fading(spot, domain)) / panorama.height * std::numbers::pi;
  const auto texel = [&](double place) { return 0.5 * (place + 1.0) * domain.width; };
  std::optional<Box> box;
  for (int face = 0; face < cube_faces; ++face) {
    const Eigen::Vector3d seen = cube_face_axes(face) * towards;
    const auto columns = reach_on_face(seen.x(), seen.z(), radius),
               rows = reach_on_face(-seen.y(), seen.z(), radius);
    if (!columns || !rows) continue;
    const double top = static_cast<double>(face) * domain.width;
    const auto on_face = clipped(texel(columns->first), top + texel(rows->first), texel(columns->second),
                                 top + texel(rows->second), domain);
    if (!on_face) continue;
    if (!box) box = on_face;
    box = Box{std::min(box->x0, on_face->x0), std::min(box->y0, on_face->y0), std::max(box->x1, on_face->x1),
              std::max(box->y1, on_face->y1)};
  }
  return box;
}

}  // namespace

std::optional<Box> light_source_box(const PaintedLight& light_source, const LightDomain& domain) {
  if (domain.parameterisation == Parameterisation::cube) {
    if (light_source.shape == PaintedLight::Shape::bar) return Box{0, 0, domain.width, domain.height};
    return spot_box_on_cube(light_source, domain);
  }
  const double width = domain.width, height = domain.height;
  double half_width = 0.5 * light_source.size * width, top = 0.0, bottom = height;
  if (light_source.shape == PaintedLight::Shape::spot) {
    const double reach = radius_texels(light_source, domain) * (1.0 + 0.5 * fading(light_source, domain));
    top = light_source.y * height - reach;
    bottom = light_source.y * height + reach;
    half_width = is_around(domain) ? width * half_width_of_cap(reach / height * std::numbers::pi,
                                                               light_source.y * std::numbers::pi)
                                   : reach;
  }
  const double left = light_source.x * width - half_width, right = light_source.x * width + half_width;
  if (is_around(domain) && (left < 0.0 || right > width)) return clipped(0.0, top, width, bottom, domain);
  return clipped(left, top, right, bottom, domain);
}

void add_light_source(const PaintedLight& light_source, const Box& within, LightMap& light) {
  const LightDomain domain = light.domain();
  const auto lit = light_source_box(light_source, domain);
  if (!light_source.is_on || !lit) return;
  const Box box{std::max(lit->x0, within.x0), std::max(lit->y0, within.y0), std::min(lit->x1, within.x1),
                std::min(lit->y1, within.y1)};
  const SpotDistance distance(light_source, domain);
  const double ring = fading(light_source, domain);
  for (int y = box.y0; y < box.y1; ++y)
    for (int x = box.x0; x < box.x1; ++x) {
      const double coverage = light_source.shape == PaintedLight::Shape::bar
                                  ? bar_coverage(light_source, domain, x, y)
                                  : std::clamp((1.0 - distance(x + 0.5, y + 0.5)) / ring + 0.5, 0.0, 1.0);
      for (int c = 0; c < 3; ++c)
        light.radiance.at(x, y, c) +=
            static_cast<float>(coverage * light_source.radiance * light_source.colour[c]);
    }
}

bool is_on_light_source(const PaintedLight& light_source, const LightDomain& domain, double x, double y) {
  constexpr double least_reach_texels = 6.0;
  if (light_source.shape == PaintedLight::Shape::bar) {
    double apart = std::abs(x - light_source.x);
    if (is_around(domain)) apart = std::min(apart, 1.0 - apart);
    return apart <= std::max(0.5 * light_source.size, least_reach_texels / panorama_of(domain).width);
  }
  const SpotDistance distance(light_source, domain);
  return distance.of_fraction(x, y) <=
         std::max(1.1, least_reach_texels / radius_texels(light_source, domain));
}

namespace {

constexpr int max_panorama_width = 1024;  // a screen's panel has no more pixels

std::size_t texel_number(const Point& texel, const LightDomain& domain) {
  const int x = std::clamp(static_cast<int>(texel.x), 0, domain.width - 1),
            y = std::clamp(static_cast<int>(texel.y), 0, domain.height - 1);
  return static_cast<std::size_t>(y) * domain.width + x;
}

bool has_proportions(const Image& image, double width, double height) {
  constexpr double tolerance = 0.01;  // sizes are whole numbers of texels
  return std::abs(image.width * height / (image.height * width) - 1.0) < tolerance;
}

void require_proportions(const Image& image, const LightDomain& domain) {
  const std::string given = "the map is " + size_text(image.width, image.height);
  if (domain.parameterisation == Parameterisation::cube && !has_proportions(image, 1.0, 6.0))
    throw InputError(given, ", the field expects a cube map: six square faces from top to bottom (1:6)");
  if (domain.parameterisation == Parameterisation::lat_long && !has_proportions(image, 2.0, 1.0) &&
      !has_proportions(image, domain.width, domain.height))
    throw InputError(given, ", the field expects a lat-long map, which is twice as wide as high");
}

bool has_same_map(const LightSetup& a, const LightSetup& b) {
  return a.map == b.map && a.environment == b.environment && a.projector == b.projector &&
         (!a.has_map() || a.turns == b.turns);
}

/// A map of the domain's own kind, turned or slid.
LightMap turned(const LightSetup& setup) {
  LightMap map = *setup.map;
  if (setup.turns == 0.0) return map;
  // A monitor's map is shifted in the same way.
  map.parameterisation = Parameterisation::lat_long;
  LightMap result = rotated(map, setup.turns);
  result.parameterisation = setup.domain.parameterisation;
  return result;
}

}  // namespace

LightPanorama::LightPanorama(const LightDomain& domain) : domain_(domain), shown_(domain) {
  if (domain.parameterisation != Parameterisation::cube) return;
  const int width = std::min(4 * domain.width, max_panorama_width);
  shown_ = {width, width / 2, Parameterisation::lat_long};
  for (int y = 0; y < shown_.height; ++y)
    for (int x = 0; x < shown_.width; ++x)
      texel_.push_back(static_cast<std::uint32_t>(texel_number(texel_at({x + 0.5, y + 0.5}), domain)));
}

Image LightPanorama::show(const Image& map) const {
  Image image(shown_.width, shown_.height, map.channels);
  const auto channels = static_cast<std::size_t>(map.channels);
  for (std::size_t pixel = 0; pixel < texel_.size(); ++pixel)
    std::copy_n(map.values.begin() + static_cast<std::ptrdiff_t>(texel_[pixel] * channels), channels,
                image.values.begin() + static_cast<std::ptrdiff_t>(pixel * channels));
  return image;
}

Point LightPanorama::texel_at(const Point& shown) const {
  if (domain_.parameterisation != Parameterisation::cube) return shown;
  const Eigen::Vector2d texel =
      cube_position(lat_long_direction(shown.x, shown.y, shown_.width, shown_.height), domain_.width);
  return {texel.x(), texel.y()};
}

FittedLight fit_light(const Image& image, const LightDomain& domain) {
  const Parameterisation kind = domain.parameterisation;
  if (image.width == domain.width && image.height == domain.height) return {{image, kind}, ""};
  require_proportions(image, domain);
  const std::string note =
      size_text(image.width, image.height) + " to " + size_text(domain.width, domain.height) + ", by area";
  if (kind != Parameterisation::monitor || has_proportions(image, domain.width, domain.height))
    return {{resample_area(image, domain.width, domain.height), kind}, note};
  const bool is_wider =
      static_cast<double>(image.width) * domain.height > static_cast<double>(image.height) * domain.width;
  return {{resample_area_cropped(image, domain.width, domain.height), kind},
          note + (is_wider ? ", sides cropped" : ", top and bottom cropped")};
}

std::optional<Box> united(const std::optional<Box>& a, const std::optional<Box>& b) {
  if (!a) return b;
  if (!b) return a;
  return Box{std::min(a->x0, b->x0), std::min(a->y0, b->y0), std::max(a->x1, b->x1), std::max(a->y1, b->y1)};
}

void LightSetup::set_map(std::optional<LightMap> light) {
  if (light && light->domain() != domain)
    throw InputError("a light map of ", shape_text(light->radiance), " does not fit the field's of ",
                     domain.width, "×", domain.height);
  map = light ? std::make_shared<const LightMap>(*std::move(light)) : nullptr;
  environment.reset();
  projector.reset();
}

void LightSetup::set_turns(double wanted) {
  if (wanted == turns) return;
  if (domain.parameterisation == Parameterisation::cube && !environment)
    throw InputError("cube light maps cannot be turned here; turn the panorama that the cube was made of");
  turns = wanted - std::floor(wanted);
}

std::optional<std::size_t> LightSetup::light_source_at(double x, double y) const {
  for (std::size_t i = light_sources.size(); i-- > 0;)
    if (is_on_light_source(light_sources[i], domain, x, y)) return i;
  return std::nullopt;
}

LightPainter::LightPainter(const LightDomain& domain)
    : light_{Image(domain.width, domain.height, 3), domain.parameterisation},
      setup_(domain),
      turned_(domain) {}

void LightPainter::turn_map(const LightSetup& setup, const RunContext& run) {
  if (has_same_map(turned_, setup)) return;
  LightMap behind;
  EnvironmentShare share;
  if (setup.environment) {
    EnvironmentLight seen = setup.projector->project(*setup.environment, setup.turn(), run);
    run.throw_if_stopped();  // else it may be incomplete
    behind = std::move(seen.light);
    share = seen.share;
  } else if (setup.has_map()) {
    behind = turned(setup);
  }
  behind_ = std::move(behind);
  share_ = share;
  turned_ = setup;
}

std::optional<Box> LightPainter::paint(const LightSetup& setup, const RunContext& run) {
  const LightSetup before = setup_;
  // A map may have been turned for a setup that was never painted.
  const bool is_all_new = !has_same_map(before, setup) || before.ambient != setup.ambient ||
                          (setup.has_map() && before.map_gain != setup.map_gain) ||
                          !has_same_map(turned_, before);
  turn_map(setup, run);
  setup_ = setup;
  std::optional<Box> changed;
  if (is_all_new) changed = everything();
  const std::size_t light_sources = std::max(before.light_sources.size(), setup.light_sources.size());
  for (std::size_t i = 0; i < light_sources && !is_all_new; ++i) {
    const PaintedLight* old = i < before.light_sources.size() ? &before.light_sources[i] : nullptr;
    const PaintedLight* now = i < setup.light_sources.size() ? &setup.light_sources[i] : nullptr;
    if (old && now && *old == *now) continue;
    for (const PaintedLight* light_source : {old, now})
      if (light_source) changed = united(changed, light_source_box(*light_source, setup.domain));
  }
  if (changed) compose(*changed);
  return changed;
}

void LightPainter::compose(const Box& box) {
  const bool has_map = setup_.has_map();
  tbb::parallel_for(tbb::blocked_range<int>(box.y0, box.y1, 16), [&](const auto& rows) {
    const auto first = static_cast<std::size_t>(box.x0) * 3,
               count = static_cast<std::size_t>(box.width()) * 3;
    for (int y = rows.begin(); y != rows.end(); ++y) {
      const auto texels = light_.radiance.row(y).subspan(first, count);
      std::ranges::fill(texels, static_cast<float>(setup_.ambient));
      if (!has_map) continue;
      const auto behind = std::as_const(behind_.radiance).row(y).subspan(first, count);
      for (std::size_t i = 0; i < count; ++i) texels[i] += static_cast<float>(setup_.map_gain) * behind[i];
    }
    for (const PaintedLight& light_source : setup_.light_sources)
      add_light_source(light_source, {box.x0, rows.begin(), box.x1, rows.end()}, light_);
  });
}

}  // namespace refield
