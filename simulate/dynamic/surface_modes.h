// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

#include "core/mesh.h"
#include "core/run_context.h"
#include "simulate/dynamic/brdf_factors.h"
#include "simulate/dynamic/surface_basis.h"
#include "simulate/prt/mesh_rays.h"

namespace refield::dynamic {

/// Patterns of light over an object, by which it shines on others. What a vertex v reflects of the light that
/// it gets is told by L_k(v), one number for each of the K terms of its material (Iwasaki et al., eq. 4); row
/// v·K + k of the matrices is that number.
struct SurfaceModes {
  using Rows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  Rows functions;              ///< [vertices · K × modes]; empty once an object's transport is computed
  Eigen::MatrixXf to_weights;  ///< [modes × vertices · K]
  Eigen::VectorXf strength;    ///< [modes]: how large weights are under typical light; relative
  Eigen::Index count() const { return strength.size(); }
};

/// The paper's (eq. 5): each term's L_k by the same N functions, with weights of its own: N · K modes.
SurfaceModes separate_modes(const SurfaceBasis& basis, int terms);

/// All terms together: principal components of the vectors (L_1 … L_K over all vertices), areas as weights,
/// under point lights around the object. One weight a mode tells all terms, which go together since they
/// come of the same light, and the frames in which vertices tell directions do not matter.
SurfaceModes joint_modes(const Mesh& mesh, const prt::MeshRays& rays, const BrdfFactors& factors, int modes,
                         const RunContext& run);

}  // namespace refield::dynamic
