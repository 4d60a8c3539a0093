// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/light_painter.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/errors.h"
#include "core/run_context.h"
#include "relight/sequence.h"

namespace refield {

namespace {

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

std::size_t LightSetup::add(const Lamp& lamp) {
  lamps_.push_back(lamp);
  return lamps_.size() - 1;
}

void LightSetup::change(std::size_t number, const Lamp& lamp) {
  if (number < lamps_.size()) lamps_[number] = lamp;
}

void LightSetup::remove(std::size_t number) {
  if (number < lamps_.size()) lamps_.erase(lamps_.begin() + static_cast<std::ptrdiff_t>(number));
}

std::optional<std::size_t> LightSetup::lamp_at(double x, double y) const {
  for (std::size_t i = lamps_.size(); i-- > 0;)
    if (is_on_lamp(lamps_[i], domain_, x, y)) return i;
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
  const std::size_t lamps = std::max(before.lamps().size(), setup.lamps().size());
  for (std::size_t i = 0; i < lamps && !is_all_new; ++i) {
    const Lamp* old = i < before.lamps().size() ? &before.lamps()[i] : nullptr;
    const Lamp* now = i < setup.lamps().size() ? &setup.lamps()[i] : nullptr;
    if (old && now && *old == *now) continue;
    for (const Lamp* lamp : {old, now})
      if (lamp) changed = united(changed, lamp_box(*lamp, setup.domain()));
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
    for (const Lamp& lamp : setup_.lamps())
      add_lamp(lamp, {box.x0, rows.begin(), box.x1, rows.end()}, light_);
  });
}

}  // namespace refield
