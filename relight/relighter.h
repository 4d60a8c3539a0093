// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/box.h"
#include "core/image.h"
#include "core/light_map.h"
#include "core/reflectance_field.h"

namespace refield {

/// Shows one reflectance field under one light after another. Keeps the light and the image between calls,
/// so that a change of part of the light costs only what it touches. Not for several threads at once; its own
/// work runs on all cores.
class Relighter {
 public:
  /// `field` must outlive the relighter.
  explicit Relighter(const ReflectanceField& field);

  const LightDomain& domain() const { return field_.basis.domain; }

  /// The scene under `light`, [height × width × 3]; valid until the next call. Throws InputError when the
  /// light does not fit domain().
  const Image& relight(const LightMap& light);

  /// The same after `light` changed inside `changed` alone since the last call, in less time the less of it
  /// changed. Throws InputError when the light does not fit domain() or `changed` lies outside it.
  const Image& update(const LightMap& light, const Box& changed);

 private:
  const ReflectanceField& field_;
  Image image_;
};

}  // namespace refield
