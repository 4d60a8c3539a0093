// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

#include "simulate/scene_description.h"

namespace refield {

/// Base colour of a material at a point of the object's own frame: textures are solid, carved out of space.
Rgb base_colour(const MaterialDescription& material, const Eigen::Vector3f& position);

/// Smooth lattice noise in [0, 1], one feature a unit (value noise; Perlin's quintic fade).
float value_noise(const Eigen::Vector3f& position);

/// Sum of octaves of value noise with halving amplitudes, in [0, 1]: about 1/f.
float fractal_noise(const Eigen::Vector3f& position, int octaves);

}  // namespace refield
