// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

#include "simulate/dynamic/object_transport.h"
#include "simulate/dynamic/scene_rays.h"

namespace refield::dynamic {

inline constexpr int max_harmonics = harmonics_of(8);
/// n² harmonics, as many as TransportOptions::order allows, without a heap.
using Harmonics = Eigen::Matrix<float, Eigen::Dynamic, 1, 0, max_harmonics, 1>;

/// An object where it stands.
struct PlacedObject {
  const ObjectTransport* transport;
  Pose pose;
};

/// Another object as one, the target, sees it; all in the target's axes.
struct SeenObject {
  const ObjectTransport* transport;
  Pose from_target;
  Eigen::Vector3f middle;
  Eigen::MatrixXf turn, turn_back;  ///< harmonics from the object's axes, and to them
};
SeenObject seen_object(const PlacedObject& object, const Pose& target);

/// Share of each direction that an object covers (its occlusion field, Zhou et al. 2005), in the target's
/// axes; `corners`, of the object's grid, say where.
Harmonics covered_by(const SeenObject& object, const ShellGrid::Corners& corners);

}  // namespace refield::dynamic
