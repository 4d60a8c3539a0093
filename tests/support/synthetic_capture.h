// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <vector>

#include "core/field/reflectance_field.h"
#include "core/session/capture_session.h"

namespace refield::test {

/// Coloured light maps with edges at all scales: rectangles of random size, place and colour over each other.
std::vector<LightMap> random_lights(int count, int width, int height, std::uint64_t seed);

/// A field whose every pixel is a sum of the given boxes with random weights from 0.5 to 1.5.
ReflectanceField field_of_boxes(int width, int height, LightDomain light, const std::vector<Box>& boxes,
                                std::uint64_t seed);

/// Writes a complete capture session: photographs are field.relight(light), with relative Gaussian noise.
CaptureSession write_capture(const std::filesystem::path& folder, const ReflectanceField& field,
                             const std::vector<LightMap>& lights, double noise = 0.0);

/// The smallest capture that can be estimated: 12 random light maps of 8×6 texels over a scene of ten random
/// boxes, seen by 6×5 pixels.
struct SmallCapture {
  static constexpr LightDomain domain{8, 6, Parameterisation::monitor};
  static constexpr int images = 12;
  explicit SmallCapture(std::uint64_t seed);

  ReflectanceField truth;
  std::vector<LightMap> lights;
};

}  // namespace refield::test
