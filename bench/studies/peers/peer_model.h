// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <variant>

#include "bench/studies/peers/cells.h"
#include "bench/studies/peers/haar_pursuit.h"
#include "bench/studies/peers/ridge.h"
#include "core/field/reflectance_field.h"

namespace refield::peers {

/// What any method leaves behind once it has seen its images. The reflectance field stands for ours, the
/// paper's and the single rectangle.
using Model = std::variant<ReflectanceField, DualModel, HaarModel, CellModel>;

/// The scene under `light`, [height × width × 3].
Image relight(const Model& model, const LightMap& light);

/// What relighting must keep, spread over the pixels: weights and indices as they lie in memory, and what all
/// pixels share.
double bytes_per_pixel(const Model& model);

/// Numbers of basis functions that a pixel has a weight for, on average.
double functions_per_pixel(const Model& model);

}  // namespace refield::peers
