// SPDX-License-Identifier: Apache-2.0
#include "relight/relighter.h"

#include "core/errors.h"

namespace refield {

Relighter::Relighter(const ReflectanceField& field) : field_(field), image_(field.width, field.height, 3) {}

const Image& Relighter::relight(const LightMap& light) {
  field_.transfer.apply(field_.basis.project(light), image_.values);
  return image_;
}

const Image& Relighter::update(const LightMap& light, const Box& changed) {
  if (!changed.inside(domain().width, domain().height))
    throw InputError("the changed part of the light reaches outside the light map");
  return relight(light);
}

}  // namespace refield
