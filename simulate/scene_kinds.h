// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/pixel_kinds.h"
#include "core/run_context.h"
#include "simulate/scene.h"

namespace refield {

/// Sorts the camera's pixels by what they show (kind_names in core/pixel_kinds.h), from the first surfaces
/// that 4 × 4 rays through a pixel meet:
///  - refraction: three quarters or more are mirror or glass, or the monitor itself;
///  - diffuse (with translucent), glossy (with metal): the same for these materials ...
///  - hard_shadow: ... but from 5 to 95 % of the monitor points that face the surface are hidden from it,
///    so that the edge of something lies across its light;
///  - mixed: no sort of material reaches three quarters, as on the outlines of things.
/// Pixels whose rays mostly meet nothing are of no kind.
PixelKinds scene_kinds(const Scene& scene, const RunContext& run = {});

}  // namespace refield
