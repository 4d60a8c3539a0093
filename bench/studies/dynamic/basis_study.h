// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "core/field/mesh.h"
#include "simulate/dynamic/object_transport.h"

namespace refield::dynamic_chart {

/// A surface and the terms of the light on it that bases are to tell.
struct StudySurface {
  std::string name;
  Mesh mesh;
  dynamic::BrdfFactors factors;
};

/// Functions over it, the first ones first.
struct StudyBasis {
  std::string name;
  Eigen::MatrixXf functions;  ///< [vertices × the most that are looked at]
};

/// Harmonics, wavelets, cosines and principal components of 384 point lights, once at several distances and
/// once on (5 % above) the bounding sphere as the paper has them. Throws Interrupted.
std::vector<StudyBasis> bases_of(const StudySurface& surface, const prt::MeshRays& rays, int functions);

/// L_k [vertices × terms] of a square area light, half the surface' radius wide, away from the middle, in
/// radii; it faces the middle, above a flat surface straight down.
Eigen::MatrixXf area_light_terms(const StudySurface& surface, const prt::MeshRays& rays,
                                 const Eigen::Vector3f& away);
/// Of such area lights at random places that are none of the point lights'.
std::vector<Eigen::MatrixXf> area_light_terms(const StudySurface& surface, const prt::MeshRays& rays,
                                              int area_lights);

/// Of one basis with that many functions.
struct BasisRow {
  std::string surface, basis;
  int functions;
  Eigen::Index kept;  ///< by orthonormal weights
  double condition;   ///< of the matrix of eq. 7
  double error;       ///< orthonormal weights: relative RMSE by area, median of the area lights
  std::optional<double> inverse_error;  ///< weights by the inverse; none where there is no inverse
};

std::vector<BasisRow> study(const StudySurface& surface, const std::vector<StudyBasis>& bases,
                            const std::vector<Eigen::MatrixXf>& light, const std::vector<int>& functions);

}  // namespace refield::dynamic_chart
