// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/field/reflectance_field.h"

namespace refield::test {

/// Radiosity without shadows or bounces over the texels of a small cube map: white light of radiance one
/// gives every vertex one, before its colour, but for the discretisation.
ReflectanceField unshadowed_field(Mesh mesh, int resolution = 4);

}  // namespace refield::test
