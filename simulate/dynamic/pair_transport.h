// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "simulate/dynamic/direct_light.h"
#include "simulate/dynamic/field_light.h"

namespace refield::dynamic {

/// How one object, the source, lights another, the target, as they stand in a frame: the same for all
/// bounces.
struct PairTransport {
  std::vector<ShellGrid::Corners> corners;  ///< [vertices of the target], of the source's grid
  /// [n² × vertices · K]: ObjectTransport::receiving of the target in the source's axes, what hides the
  /// source taken off.
  Eigen::MatrixXf receiving;

  /// Adds what a vertex gets; `radiance` [3 n² × points of the source's grid], colours one after another,
  /// `light` the K rows of the vertex.
  void add(std::size_t vertex, const Eigen::MatrixXf& radiance, Eigen::Ref<TermLight> light) const;
};

/// How all other objects light one, [objects]; its own place there stays as it is. `positions`: the target's
/// vertices, in its own axes. An object that stands before a source takes off what it covers, by products of
/// harmonics (Zhou et al. 2005, section 4). Runs on all cores.
void place_pairs(std::span<const PlacedObject> objects, std::size_t target,
                 std::span<const Eigen::Vector3f> positions, const HarmonicProduct& product,
                 std::span<PairTransport> pairs);

/// Corners of which the grid's points hold no light, because they lie inside of the object, give their share
/// to the others.
void leave_out_inside(const std::vector<bool>& outside, ShellGrid::Corners& corners);

/// Whether an object stands before another as seen from around: it does if the other's sphere encloses its
/// middle, since walls and floors are behind what stands in a room; else if it is nearer.
bool stands_before(const Eigen::Vector3f& from, const Eigen::Vector3f& middle, float radius,
                   const Eigen::Vector3f& other_middle, float other_radius);

}  // namespace refield::dynamic
