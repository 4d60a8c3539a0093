// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <span>
#include <vector>

#include "bench/studies/dynamic/parameterisation.h"
#include "simulate/dynamic/object_transport.h"
#include "simulate/geometry/mesh_file.h"

namespace refield::dynamic {

/// prt::vertex_areas() [vertices].
inline Eigen::VectorXf areas_of(const Mesh& mesh) {
  const std::vector<float> areas = prt::vertex_areas(mesh.positions, mesh.triangles);
  return Eigen::Map<const Eigen::VectorXf>(areas.data(), static_cast<Eigen::Index>(areas.size()));
}

enum class BasisKind { spherical_harmonics, haar_wavelets, cosines };

/// Functions over the surface' own parameters (section 5.1; parameterisation.h), the coarsest first:
///  - spherical_harmonics: by index, at the vertex' place on the unit sphere; at most 256. A plane is laid
///    around the sphere.
///  - haar_wavelets: over (u, v): the mean, then level by level all horizontal, vertical, diagonal details
///  - cosines: cos πku cos πlv by ascending k² + l²
/// [vertices × functions], for vertices at surface_places(). Throws InputError for other numbers of functions
/// than 1 … 256.
Eigen::MatrixXf fixed_functions(BasisKind kind, std::span<const SurfacePlace> places, int functions);
SurfaceBasis fixed_basis(BasisKind kind, const Mesh& mesh, int functions);

/// Functions Ψ as they are, with the weights of the paper, A⁻¹ Ψᵀ L with A = ΨᵀΨ, vertices counting one each
/// (Iwasaki et al., eqs. 6 and 7), in float. Throws SolverError where A has no inverse.
SurfaceBasis basis_by_inverse(const Eigen::MatrixXf& functions);
/// Condition of A; infinite: singular.
double condition_of(const Eigen::MatrixXf& functions);

}  // namespace refield::dynamic
