// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <CLI/CLI.hpp>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/camera.h"
#include "core/reflectance_field.h"

namespace refield::cli {

/// From where a field over a mesh is shown; what is absent is as the field's own camera has it, or frames the
/// mesh.
struct CameraOptions {
  std::vector<float> position, target;  ///< three numbers or none
  std::optional<float> fov;             ///< degrees, vertical
  std::string size;                     ///< WIDTHxHEIGHT or empty
  bool turntable = false;               ///< goes once around the target
};

void add_camera_options(CLI::App& verb, CameraOptions& options);

/// The cameras of FieldPictures. Throws InputError for a camera that cannot be, and for camera options with a
/// field that has no mesh.
std::vector<PinholeCamera> cameras_of(const CameraOptions& options, const ReflectanceField& field,
                                      const std::filesystem::path& path, int frames);

}  // namespace refield::cli
