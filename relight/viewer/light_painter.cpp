// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/light_painter.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/errors.h"
#include "relight/sequence.h"

namespace refield {

std::optional<Box> united(const std::optional<Box>& a, const std::optional<Box>& b) {
  if (!a) return b;
  if (!b) return a;
  return Box{std::min(a->x0, b->x0), std::min(a->y0, b->y0), std::max(a->x1, b->x1), std::max(a->y1, b->y1)};
}

LightPainter::LightPainter(const LightDomain& domain)
    : domain_(domain), light_{Image(domain.width, domain.height, 3), domain.parameterisation} {
  compose(everything());
}

void LightPainter::set_ambient(double radiance) {
  if (radiance == ambient_) return;
  ambient_ = radiance;
  compose(everything());
}

void LightPainter::set_map(std::optional<LightMap> map) {
  if (map && map->domain() != domain_)
    throw InputError("a light map of " + shape_text(map->radiance) + " does not fit the field's of " +
                     std::to_string(domain_.width) + "×" + std::to_string(domain_.height));
  map_ = std::move(map);
  projector_.reset();
  turn_map();
  compose(everything());
}

void LightPainter::set_surroundings(LightMap surroundings,
                                    std::shared_ptr<const EnvironmentProjector> projector) {
  map_ = std::move(surroundings);
  projector_ = std::move(projector);
  turn_map();
  compose(everything());
}

void LightPainter::set_map_gain(double gain) {
  if (gain == map_gain_) return;
  map_gain_ = gain;
  if (map_) compose(everything());
}

void LightPainter::set_turns(double turns) {
  if (turns == turns_) return;
  if (domain_.parameterisation == Parameterisation::cube && !projector_)
    throw InputError("cube light maps cannot be turned here; turn the panorama that the cube was made of");
  turns_ = turns - std::floor(turns);
  if (!map_) return;
  turn_map();
  compose(everything());
}

void LightPainter::turn_map() {
  share_ = {};
  if (!map_) {
    turned_ = {};
    return;
  }
  if (projector_) {
    EnvironmentLight seen = projector_->project(*map_, {.yaw = 360.0 * turns_});
    turned_ = std::move(seen.light);
    share_ = seen.share;
    return;
  }
  if (turns_ == 0.0) {
    turned_ = *map_;
    return;
  }
  // A monitor's map is shifted in the same way.
  map_->parameterisation = Parameterisation::lat_long;
  turned_ = rotated(*map_, turns_);
  turned_.parameterisation = map_->parameterisation = domain_.parameterisation;
}

std::size_t LightPainter::add(const Lamp& lamp) {
  lamps_.push_back(lamp);
  compose(lamp_box(lamp, domain_));
  return lamps_.size() - 1;
}

void LightPainter::change(std::size_t number, const Lamp& lamp) {
  if (number >= lamps_.size() || lamps_[number] == lamp) return;
  const auto before = lamp_box(lamps_[number], domain_);
  lamps_[number] = lamp;
  compose(united(before, lamp_box(lamp, domain_)));
}

void LightPainter::remove(std::size_t number) {
  if (number >= lamps_.size()) return;
  const auto before = lamp_box(lamps_[number], domain_);
  lamps_.erase(lamps_.begin() + static_cast<std::ptrdiff_t>(number));
  compose(before);
}

void LightPainter::remove_all() {
  lamps_.clear();
  compose(everything());
}

std::optional<std::size_t> LightPainter::lamp_at(double x, double y) const {
  for (std::size_t i = lamps_.size(); i-- > 0;)
    if (is_on_lamp(lamps_[i], domain_, x, y)) return i;
  return std::nullopt;
}

std::optional<Box> LightPainter::take_changed() {
  return std::exchange(changed_, std::nullopt);
}

void LightPainter::compose(const std::optional<Box>& box) {
  if (!box) return;
  tbb::parallel_for(tbb::blocked_range<int>(box->y0, box->y1, 16), [&](const auto& rows) {
    const auto first = static_cast<std::size_t>(box->x0) * 3,
               count = static_cast<std::size_t>(box->width()) * 3;
    for (int y = rows.begin(); y != rows.end(); ++y) {
      const auto texels = light_.radiance.row(y).subspan(first, count);
      std::ranges::fill(texels, static_cast<float>(ambient_));
      if (!map_) continue;
      const auto behind = std::as_const(turned_.radiance).row(y).subspan(first, count);
      for (std::size_t i = 0; i < count; ++i) texels[i] += static_cast<float>(map_gain_) * behind[i];
    }
    for (const Lamp& lamp : lamps_) add_lamp(lamp, {box->x0, rows.begin(), box->x1, rows.end()}, light_);
  });
  changed_ = united(changed_, box);
}

}  // namespace refield
