// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>
#include <vector>

#include "core/image.h"
#include "core/reflectance_field.h"
#include "core/run_context.h"
#include "simulate/light_transport.h"

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
std::uint64_t trace_rows(const Scene& scene, const LightHierarchy& hierarchy, const TraceOptions& options,
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

}  // namespace refield
