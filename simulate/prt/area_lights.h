// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/config_file.h"
#include "core/base/run_context.h"
#include "core/field/mesh.h"
#include "simulate/geometry/scene_description.h"

namespace refield::prt {

/// An area light of any shape that moves. Both sides of its triangles shine.
struct AreaLight {
  Mesh shape;     ///< the middle of its bounding box at the origin; colours: radiance of the vertices
  Motion motion;  ///< of its middle, without turns
  /// Where its own +Y (the front of a plane) looks all along; it keeps its turn where there is none.
  std::optional<Eigen::Vector3f> towards;

  /// How its shape stands at a position.
  Eigen::Isometry3f pose(const Eigen::Vector3f& position) const;
};

struct AreaLights {
  std::vector<AreaLight> lights;

  /// When the last one has come to its last stop, seconds.
  double duration() const;
  /// All of them at a time, as one mesh; colours are radiance.
  Mesh at(double time) const;
};

/// A table that describes one; files are relative to `folder`. Throws InputError or what read_mesh_file()
/// does.
AreaLight read_area_light(ConfigSection& section, const fs::path& folder, const RunContext& run);

/// Reads a description (TOML, docs/reference/scene-files.md). Throws InputError or what read_mesh_file()
/// does.
AreaLights read_area_lights(const fs::path& path, const RunContext& run = {});

}  // namespace refield::prt
