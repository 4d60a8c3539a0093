// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <vector>

#include "simulate/dynamic/brdf_factors.h"

namespace refield::dynamic {

/// `count` unit directions, evenly within `radius` radians of a unit direction (golden angle).
std::vector<Eigen::Vector3f> disc_of_directions(const Eigen::Vector3f& middle, double radius, int count);

/// What factors miss of the radiance reflected under a round area light of angular radius `radius`, above the
/// horizon: relative RMSE over all directions of sight (by the cosine) and positions of the area light
/// (evenly). What a picture shows of their error, which is less than BrdfFactors::error(): the area light
/// evens out what is finer than it.
double area_light_error(const Brdf& brdf, const BrdfFactors& factors, double radius);

}  // namespace refield::dynamic
