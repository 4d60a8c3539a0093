// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/field/reflectance_field.h"
#include "core/image/image.h"
#include "core/image/image_io.h"
#include "core/session/capture_session.h"
#include "simulate/tabletop/light_transport.h"
#include "simulate/tabletop/recipe.h"

namespace refield {

/// What each light adds up to in each box of a hierarchy, for many lights at a time.
class LightSums {
 public:
  LightSums(const LightHierarchy& hierarchy, std::size_t lights);

  std::size_t lights() const { return lights_; }

  /// Sets the sums of one light. Different lights may be set at the same time.
  void set(std::size_t place, const LightMap& light);

  /// Sums of all lights over a node: [3 × lights], channel by channel.
  const float* of(std::uint32_t node) const {
    return sums_.data() + static_cast<std::size_t>(node) * 3 * lights_;
  }

  static std::uint64_t bytes(const LightHierarchy& hierarchy, std::size_t lights) {
    return std::uint64_t{hierarchy.size()} * 3 * lights * sizeof(float);
  }

 private:
  const LightHierarchy& hierarchy_;
  std::size_t lights_;
  std::vector<float> sums_;  // [nodes × 3 × lights]
};

/// One pixel under all lights, [3 × lights]: a row of B = T L.
void apply_row(const std::vector<TransportEntry>& entries, const LightSums& sums, float* out);

/// Traces the image in bands of rows, in order, on all cores, with progress. `take` gets each band's first
/// row and its pixels, row by row, while nothing else runs. Returns the number of rays. Throws Interrupted
/// between bands.
std::uint64_t trace_rows(const TabletopScene& scene, const LightHierarchy& hierarchy,
                         const TraceOptions& options,
                         const std::function<void(int first_row, std::vector<PixelTransport>& pixels)>& take,
                         const RunContext& run);

/// Collects bands into a reflectance field whose basis holds the boxes that occur.
class FieldBuilder {
 public:
  FieldBuilder(const LightHierarchy& hierarchy, int width, int height);
  void append(const std::vector<PixelTransport>& pixels);
  ReflectanceField finish();

 private:
  const LightHierarchy& hierarchy_;
  ReflectanceField field_;  // columns are nodes until finish()
};

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
/// light maps, the photographs B = T L (exact but for `noise`: no ambient light and nothing of the sensor but
/// its colour mixing, which the transport's file has, too), session.toml,
/// ambient.exr (what the camera sees of the room light, for a virtual rig; it is not part of the session),
/// and, where kept, transport.rfield. A row of T is
/// multiplied with all lights as soon as it is traced, so T need not fit into memory. Throws Interrupted when
/// asked to stop.
SimulateSummary simulate_session(const Recipe& recipe, const SimulateOptions& options, const fs::path& folder,
                                 const RunContext& run = {});

/// The transport and the ambient image alone, in memory: for tests and small experiments.
struct TracedScene {
  ReflectanceField transport;
  Image ambient;  ///< [height × width × 3]
};
TracedScene trace_scene(const SceneDescription& scene, const TraceOptions& options,
                        const RunContext& run = {});

inline constexpr const char* transport_file_name = "transport.rfield";
inline constexpr const char* ambient_file_name = "ambient.exr";

}  // namespace refield
