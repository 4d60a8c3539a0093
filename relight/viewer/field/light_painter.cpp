// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/field/light_painter.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/errors.h"
#include "core/base/run_context.h"
#include "core/image/image.h"
#include "core/light/cube_map.h"
#include "relight/sequence.h"

namespace refield {

namespace {

constexpr int max_panorama_width = 1024;  // a screen's panel has no more pixels

std::size_t texel_number(const Point& texel, const LightDomain& domain) {
  const int x = std::clamp(static_cast<int>(texel.x), 0, domain.width - 1),
            y = std::clamp(static_cast<int>(texel.y), 0, domain.height - 1);
  return static_cast<std::size_t>(y) * domain.width + x;
}

std::string size_text(int width, int height) {
  return std::to_string(width) + "×" + std::to_string(height);
}

bool has_proportions(const Image& image, double width, double height) {
  constexpr double tolerance = 0.01;  // sizes are whole numbers of texels
  return std::abs(image.width * height / (image.height * width) - 1.0) < tolerance;
}

void require_proportions(const Image& image, const LightDomain& domain) {
  const std::string given = "the map is " + size_text(image.width, image.height);
  if (domain.parameterisation == Parameterisation::cube && !has_proportions(image, 1.0, 6.0))
    throw InputError(given + ", the field expects a cube map: six square faces from top to bottom (1:6)");
  if (domain.parameterisation == Parameterisation::lat_long && !has_proportions(image, 2.0, 1.0) &&
      !has_proportions(image, domain.width, domain.height))
    throw InputError(given + ", the field expects a lat-long map, which is twice as wide as high");
}

bool has_same_map(const LightSetup& a, const LightSetup& b) {
  return a.map() == b.map() && a.environment() == b.environment() && a.projector() == b.projector() &&
         (!a.has_map() || a.turns() == b.turns());
}

/// A map of the domain's own kind, turned or slid.
LightMap turned(const LightSetup& setup) {
  LightMap map = *setup.map();
  if (setup.turns() == 0.0) return map;
  // A monitor's map is shifted in the same way.
  map.parameterisation = Parameterisation::lat_long;
  LightMap result = rotated(map, setup.turns());
  result.parameterisation = setup.domain().parameterisation;
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

void LightSetup::set_map(std::optional<LightMap> map) {
  if (map && map->domain() != domain_)
    throw InputError("a light map of " + shape_text(map->radiance) + " does not fit the field's of " +
                     std::to_string(domain_.width) + "×" + std::to_string(domain_.height));
  map_ = map ? std::make_shared<const LightMap>(*std::move(map)) : nullptr;
  environment_.reset();
  projector_.reset();
}

void LightSetup::set_environment(std::shared_ptr<const PreparedEnvironment> environment,
                                 std::shared_ptr<const EnvironmentProjector> projector) {
  map_.reset();
  environment_ = std::move(environment);
  projector_ = std::move(projector);
}

void LightSetup::set_turns(double turns) {
  if (turns == turns_) return;
  if (domain_.parameterisation == Parameterisation::cube && !environment_)
    throw InputError("cube light maps cannot be turned here; turn the panorama that the cube was made of");
  turns_ = turns - std::floor(turns);
}

std::size_t LightSetup::add(const PaintedLight& light_source) {
  light_sources_.push_back(light_source);
  return light_sources_.size() - 1;
}

void LightSetup::change(std::size_t number, const PaintedLight& light_source) {
  if (number < light_sources_.size()) light_sources_[number] = light_source;
}

void LightSetup::remove(std::size_t number) {
  if (number < light_sources_.size())
    light_sources_.erase(light_sources_.begin() + static_cast<std::ptrdiff_t>(number));
}

std::optional<std::size_t> LightSetup::light_source_at(double x, double y) const {
  for (std::size_t i = light_sources_.size(); i-- > 0;)
    if (is_on_light_source(light_sources_[i], domain_, x, y)) return i;
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
  if (setup.has_environment()) {
    EnvironmentLight seen = setup.projector()->project(*setup.environment(), setup.turn(), run);
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
  const bool is_all_new = !has_same_map(before, setup) || before.ambient() != setup.ambient() ||
                          (setup.has_map() && before.map_gain() != setup.map_gain()) ||
                          !has_same_map(turned_, before);
  turn_map(setup, run);
  setup_ = setup;
  std::optional<Box> changed;
  if (is_all_new) changed = everything();
  const std::size_t light_sources = std::max(before.light_sources().size(), setup.light_sources().size());
  for (std::size_t i = 0; i < light_sources && !is_all_new; ++i) {
    const PaintedLight* old = i < before.light_sources().size() ? &before.light_sources()[i] : nullptr;
    const PaintedLight* now = i < setup.light_sources().size() ? &setup.light_sources()[i] : nullptr;
    if (old && now && *old == *now) continue;
    for (const PaintedLight* light_source : {old, now})
      if (light_source) changed = united(changed, light_source_box(*light_source, setup.domain()));
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
      std::ranges::fill(texels, static_cast<float>(setup_.ambient()));
      if (!has_map) continue;
      const auto behind = std::as_const(behind_.radiance).row(y).subspan(first, count);
      for (std::size_t i = 0; i < count; ++i) texels[i] += static_cast<float>(setup_.map_gain()) * behind[i];
    }
    for (const PaintedLight& light_source : setup_.light_sources())
      add_light_source(light_source, {box.x0, rows.begin(), box.x1, rows.end()}, light_);
  });
}

}  // namespace refield
