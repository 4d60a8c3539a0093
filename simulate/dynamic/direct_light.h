// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <span>
#include <vector>

#include "simulate/dynamic/brdf_factors.h"
#include "simulate/dynamic/dynamic_scene.h"

namespace refield::dynamic {

/// A point that stands for a piece of an area light. Both its sides shine.
struct AreaPoint {
  Eigen::Vector3f position, normal;
  Eigen::Array3f power;  ///< radiance × area of the piece
  float area;
};

/// `count` points, each the middle of a piece of an area light (colours: radiance); pieces have equal area
/// times brightness, are about as wide as long, and stay the same wherever an area light goes. None where
/// nothing shines.
std::vector<AreaPoint> area_points(const Mesh& area_lights, int count);

/// L_k of an object's vertices (Iwasaki et al., eq. 4), row v·K + k, RGB.
using TermLight = Eigen::Matrix<float, Eigen::Dynamic, 3, Eigen::RowMajor>;

/// What area lights bring to an object's vertices.
struct DirectLight {
  TermLight terms;
  std::vector<Eigen::Array3f>
      to_eye;  ///< [vertices], radiance by the material itself, not its factors; colours not in it
};

/// Light that comes straight from area lights, ∫ L V h_k cosθ dω as a sum over their points, each seen or not
/// by a ray: shadows of all objects, wherever they are. Nearer than a point's piece is wide, light stays
/// finite. `eye` in the scene's axes. Runs on all cores.
DirectLight direct_light(const MovingObject& object, const Pose& pose, const BrdfFactors& factors,
                         const SceneRays& rays, std::span<const AreaPoint> area_lights,
                         const Eigen::Vector3f& eye);

}  // namespace refield::dynamic
