// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/field/mesh.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/light/monitor_placement.h"

namespace refield {

struct WindowOptions {
  int width = 1440;  ///< pixels
  int height = 900;
  std::vector<MonitorPlacement> monitors{};  ///< in place of the field's; empty: those of the field
};

/// Opens a window on a field, with a light map to begin with, and returns when it is closed. Throws
/// DeviceError where there is no display or no OpenGL 3.3 and what the readers of field and light throw.
void run_viewer(const fs::path& field, const std::optional<fs::path>& light, const WindowOptions& options,
                const RunContext& run);

/// An object or an area light.
struct SceneThing {
  std::string name;
  bool is_area_light = false;
  bool moves = false;     ///< by itself
  bool can_turn = false;  ///< by hand; area lights that look at a point cannot
};

/// What a hand did to a thing, beside what its own motion does.
struct Handling {
  Eigen::Vector3f shift = Eigen::Vector3f::Zero();  ///< from where its motion has it
  double turn_degrees = 0.0;                        ///< about the vertical through its middle
  double gain = 1.0;                                ///< of an area light's radiance
  bool operator==(const Handling&) const = default;
};

/// A lit scene as an eye sees it.
struct SceneFrame {
  Mesh mesh;                                ///< all things in place, one after another
  std::vector<std::uint32_t> first_vertex;  ///< [things + 1], in the mesh
  std::vector<Eigen::Array3f> radiance;     ///< [vertices], towards the eye
};

/// When, as moved by whom, how often reflected, and seen from where.
struct SceneMoment {
  double time = 0.0;                   ///< seconds
  std::span<const Handling> handling;  ///< [things]
  int bounces = 3;
  Eigen::Vector3f eye = Eigen::Vector3f::Zero();
};

/// A scene of things that move, as the viewer takes it from whoever computes its light.
struct MovingScene {
  std::string name;
  std::vector<SceneThing> things;
  double duration = 0.0;  ///< of its own motion, seconds; 0: it stands still
  PinholeCamera camera;   ///< to begin with
  /// Where the middle of a thing is by its own motion.
  std::function<Eigen::Vector3f(std::size_t thing, double time)> middle;
  /// Puts all in place and lights it.
  std::function<void(const SceneMoment& moment, SceneFrame& frame)> light;
};

/// Opens a window on a scene of which objects and light sources move, by themselves and by hand. `read` runs
/// in a thread of its own, with a message in the window where it takes long; what it throws is thrown.
void run_scene_viewer(const std::string& name, const std::function<MovingScene()>& read,
                      const WindowOptions& options, const RunContext& run);

}  // namespace refield
