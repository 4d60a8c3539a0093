// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Geometry>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/field/mesh.h"
#include "simulate/dynamic/brdf.h"
#include "simulate/dynamic/scene_rays.h"
#include "simulate/geometry/scene_description.h"
#include "simulate/prt/area_lights.h"

namespace refield::dynamic {

/// A rigid object of one material.
struct MovingObject {
  std::string name;
  Mesh mesh;  ///< the middle of its bounding box at the origin; colours multiply what leaves
  Brdf brdf;
  Motion motion;
};

struct DynamicScene {
  std::vector<MovingObject> objects;
  prt::AreaLights lights;
  std::optional<PinholeCamera> camera;

  double duration() const;
  std::vector<Pose> poses(double time) const;
};

/// Reads a scene's description (TOML, docs/reference/scene-files.md). Throws InputError or FormatError,
/// naming the file.
DynamicScene read_dynamic_scene(const std::filesystem::path& path, const RunContext& run);

/// All objects in place, joined into one mesh, object after object.
Mesh joined_mesh(const DynamicScene& scene, std::span<const Pose> poses);

}  // namespace refield::dynamic
