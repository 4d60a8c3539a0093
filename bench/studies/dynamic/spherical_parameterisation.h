// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <vector>

#include "core/field/mesh.h"

namespace refield::dynamic {

/// A place on the unit sphere for each vertex of a closed, connected mesh without handles, neighbours next to
/// each other. It begins with the directions from the middle; where triangles are folded over, all vertices
/// move, again and again, to the middle of their neighbours, back on the sphere, and all together so that
/// their mean is the origin (Alexa 2000, "Merging polyhedral shapes with scattered features"), until none is
/// or `sweeps` are done. Where that does not unfold it (the middle lies outside, say), it begins anew with a
/// plane drawing (Tutte 1963: every vertex in the middle of its neighbours, one triangle as the frame) laid
/// on the sphere. Vertices at one position move as one. Open meshes and such with handles may keep folds; so
/// may long limbs, which end as specks below what doubles tell apart.
std::vector<Eigen::Vector3d> spherical_parameterisation(const Mesh& mesh, int sweeps = 2000);

/// Share of the triangles that are folded over, or have no area, on the sphere.
double folded_share(const Mesh& mesh, const std::vector<Eigen::Vector3d>& places);

}  // namespace refield::dynamic
