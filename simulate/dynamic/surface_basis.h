// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/field/mesh.h"
#include "simulate/dynamic/brdf_factors.h"
#include "simulate/geometry/mesh_rays.h"

namespace refield::dynamic {

/// The direction that all of a mesh faces; none where it is not flat.
std::optional<Eigen::Vector3f> facing_of(const Mesh& mesh);

/// Where light may come from: `count` points for each of `distances` (> 1), in radii of the bounding_ball(),
/// spread over spheres; for a flat mesh evenly over a square of twice
/// its radius, on the side that it faces, (distance − 1) radii above (Iwasaki et al., figure 2, have one
/// distance).
std::vector<Eigen::Vector3f> point_lights(const Mesh& mesh, int count, std::span<const float> distances);

/// L_k(x) = V h_k(ω) cosθ/r² of all vertices and of each of the BRDF's K terms under point lights of
/// intensity one, shadows of the mesh on itself included: [vertices · K × lights], row v·K + k. Runs on all
/// cores; throws Interrupted.
Eigen::MatrixXf light_terms(const Mesh& mesh, const prt::MeshRays& rays, const BrdfFactors& factors,
                            std::span<const Eigen::Vector3f> lights, const RunContext& run = {});

/// Functions Ψ over a mesh' vertices, by which light on the surface is told: L ≈ functions · w,
/// w = to_weights · L.
struct SurfaceBasis {
  Eigen::MatrixXf functions;   ///< [vertices × N], unitless
  Eigen::MatrixXf to_weights;  ///< [N × vertices]
};

/// An orthonormal basis of what functions [vertices × N] span over vertices of given areas; functions of
/// which the ones before leave no more than a thousandth are dropped. Weights are integrals, never larger
/// than L. Deviation from the paper, which inverts ΨᵀΨ (Iwasaki et al., eqs. 6 and 7;
/// docs/method/dynamic-bases.md). Throws InputError where shapes do not fit.
SurfaceBasis surface_basis(const Eigen::MatrixXf& functions, const Eigen::VectorXf& areas);

struct PrincipalOptions {
  int lights = 128;  ///< point lights at each distance, at least 1
  /// In radii of the bounding sphere, > 1 (point_lights()). The paper has them on the sphere itself, one
  /// distance; several serve light from near and far.
  std::vector<float> distances = {1.4f, 2.0f, 4.0f};
};

/// Principal components of the light that point lights around a mesh bring to its vertices (section 5.2): the
/// `functions` first left singular vectors of L_k, a column for each light and each of the BRDF's terms,
/// vertices weighted by area, lights by what they bring. The mean is not taken off: it would be one more
/// function. Fewer where the lights span less. Randomised (Halko, Martinsson and Tropp 2011), from a fixed
/// seed. Holds vertices × lights × terms × 8 bytes. Throws InputError for options out of range, Interrupted.
SurfaceBasis principal_basis(const Mesh& mesh, const prt::MeshRays& rays, const BrdfFactors& factors,
                             int functions, const PrincipalOptions& options = {}, const RunContext& run = {});

}  // namespace refield::dynamic
