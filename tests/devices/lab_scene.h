// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <map>
#include <vector>

#include "acquire/illuminator.h"
#include "core/base/rng.h"
#include "core/field/reflectance_field.h"
#include "core/image/image.h"
#include "simulate/tabletop/recipe.h"

namespace refield::test {

/// The scene of a recipe, as a sensor sees it under a monitor. Keeps a log with a line for each frame:
/// checksum of its samples, checksum of the pattern shown while it was exposed (or "mixed"), exposure in
/// microseconds, time stamp.
class LabScene {
 public:
  /// `truth` is a folder of 'refield simulate'. With `steady` noise follows from pattern and settings alone:
  /// then two sessions under the same lights must be equal to the byte.
  LabScene(const std::filesystem::path& truth, const std::filesystem::path& recipe, const char* log,
           bool steady);
  ~LabScene();
  LabScene(const LabScene&) = delete;
  LabScene& operator=(const LabScene&) = delete;

  const LightDomain& domain() const { return transport_.basis.domain; }
  int columns() const { return transport_.width; }

  /// Samples of a frame that saw `first` and then `second`.
  std::vector<std::uint16_t> expose(const DriveImage& first, const DriveImage& second, TimePoint start,
                                    Seconds exposure, double gain);

 private:
  const Image& scene_under(const DriveImage& drive);
  bool steady_;
  Recipe recipe_;
  ReflectanceField transport_;
  Image ambient_;
  std::FILE* log_;
  Rng random_{2004};
  std::map<std::uint32_t, Image> scenes_;
};

}  // namespace refield::test
