// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <functional>
#include <vector>

#include "core/light_map.h"
#include "relight/field_pictures.h"

namespace refield {

/// A light, read or computed when its turn comes; lights may be asked for from several threads at a time.
using LightSource = std::function<LightMap()>;

/// One image to be made: a light and the file that the relit scene goes to. The file's extension chooses the
/// format: .exr (scene-linear, float) or .png (sRGB, 8 bits).
struct RelightJob {
  LightSource light;
  std::filesystem::path output;
};

/// Relights `field` for each job and writes the images, several at a time, with progress. A file appears when
/// it is complete. `exposure` scales what goes into PNG files. Throws InputError for an output that is
/// neither EXR nor PNG (before any work) and for a light that does not fit the field, Interrupted between
/// images.
void relight_to_files(const FieldPictures& field, const std::vector<RelightJob>& jobs, double exposure = 1.0);

}  // namespace refield
