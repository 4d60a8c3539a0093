// SPDX-License-Identifier: Apache-2.0
#include "simulate/geometry/place_mesh.h"

#include <Eigen/Geometry>

#include "core/base/errors.h"

namespace refield::prt {

namespace {

Eigen::AlignedBox3f bounds_of(const Mesh& mesh) {
  Eigen::AlignedBox3f bounds;
  for (const auto& position : mesh.positions) bounds.extend(position);
  return bounds;
}

}  // namespace

void place(Mesh& mesh, const Placement& placement) {
  const Eigen::Matrix3f turn = placement.turn.matrix().cast<float>();
  const Eigen::Matrix3f matrix = turn * placement.stretch.asDiagonal();
  const Eigen::Matrix3f for_normals = turn * placement.stretch.cwiseInverse().asDiagonal();
  for (auto& position : mesh.positions) position = matrix * position;
  for (auto& normal : mesh.normals) normal = (for_normals * normal).normalized();
  Eigen::AlignedBox3f bounds = bounds_of(mesh);

  const float scale = placement.size ? *placement.size / bounds.sizes().maxCoeff() : 1.0f;
  const Eigen::Vector3f middle = bounds.center();
  Eigen::Vector3f shift = Eigen::Vector3f::Zero();  // after scaling
  if (placement.position)
    shift = *placement.position - scale * middle;
  else if (placement.on_ground)
    shift = -scale * middle;
  if (placement.on_ground) shift.y() = -scale * bounds.min().y();
  for (auto& position : mesh.positions) position = scale * position + shift;
  if (!bounds_of(mesh).sizes().allFinite())
    throw InputError("the mesh is placed beyond what float can hold; give another size or position");
}

void append(const Mesh& mesh, const Eigen::Isometry3f& pose, Mesh& all) {
  const auto first = static_cast<std::uint32_t>(all.positions.size());
  for (const auto& position : mesh.positions) all.positions.push_back(pose * position);
  for (const auto& normal : mesh.normals) all.normals.push_back(pose.linear() * normal);
  all.colours.insert(all.colours.end(), mesh.colours.begin(), mesh.colours.end());
  for (const auto& [a, b, c] : mesh.triangles) all.triangles.push_back({first + a, first + b, first + c});
}

}  // namespace refield::prt
