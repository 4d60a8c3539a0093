// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <filesystem>
#include <string>

#include "core/capture_session.h"
#include "core/image_io.h"
#include "core/reflectance_field.h"
#include "core/run_context.h"
#include "simulate/light_transport.h"
#include "simulate/recipe.h"

namespace refield {

struct SimulateOptions {
  int quality = 2;             ///< of tracing, 1 to 3; see TraceOptions
  bool keep_transport = true;  ///< write the transport itself: too large for large images
  Precision precision = Precision::single;
  double noise = 0.0;             ///< relative standard deviation of Gaussian noise on every photograph
  std::string provenance = "{}";  ///< JSON text, kept in the transport's file

  /// Throws InputError naming the option and its range.
  void check() const;
};

struct SimulateSummary {
  int width = 0, height = 0;
  int lights = 0;
  double entries_per_pixel = 0.0;
  std::uint64_t transport_bytes = 0;  ///< of the file; 0 where it was not kept
  std::uint64_t rays = 0;
  double light_seconds = 0.0;  ///< making light maps
  double trace_seconds = 0.0;  ///< tracing, and photographs by B = T L
  double write_seconds = 0.0;
};

/// Memory in bytes that simulate_session will hold at most, roughly; and the size that a kept transport will
/// have.
struct SimulatePlan {
  std::uint64_t memory_bytes = 0;
  std::uint64_t transport_bytes = 0;
  std::uint64_t disk_bytes = 0;
};
SimulatePlan plan_simulate(const Recipe& recipe, const SimulateOptions& options);

/// Traces the recipe's scene once, row by row, into its transport T, and writes a complete capture session:
/// light maps, the photographs B = T L (exact but for `noise`: no ambient light, no sensor), session.toml,
/// ambient.exr (what the camera sees of the room light, for a virtual rig; it is not part of the session),
/// kinds.png (what each pixel shows, see scene_kinds()) and, where kept, transport.rfield. A row of T is
/// multiplied with all lights as soon as it is traced, so T need not fit into memory. Throws Interrupted when
/// asked to stop.
SimulateSummary simulate_session(const Recipe& recipe, const SimulateOptions& options,
                                 const std::filesystem::path& folder, const RunContext& run = {});

/// The transport and the ambient image alone, in memory: for tests and small experiments.
struct TracedScene {
  ReflectanceField transport;
  Image ambient;  ///< [height × width × 3]
};
TracedScene trace_scene(const SceneDescription& scene, const TraceOptions& options,
                        const RunContext& run = {});

inline constexpr const char* transport_file_name = "transport.rfield";
inline constexpr const char* ambient_file_name = "ambient.exr";
inline constexpr const char* kinds_file_name = "kinds.png";

}  // namespace refield
