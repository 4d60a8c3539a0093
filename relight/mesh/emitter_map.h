// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

#include "core/field/mesh.h"
#include "core/light/light_map.h"

namespace refield {

/// Cube map of `resolution` texels per face of what shines, as seen from `middle`: the colours of `emitters`
/// are radiance, both sides shine, the nearest is seen (Fujita and Kanai 2004, section 3.2). Each texel is
/// the mean over its solid angle of many lines of sight, so that lights keep their power as they move across
/// texels. No correction for the solid angle of texels is done here: fields with Measure::solid_angle weigh
/// them, exactly, where the paper's weight ∆A ∕ √(x² + y² + 1) is off by up to a factor of three and does not
/// add up to the sphere.
LightMap emitter_map(const Mesh& emitters, const Eigen::Vector3f& middle, int resolution);

}  // namespace refield
