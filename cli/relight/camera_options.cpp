// SPDX-License-Identifier: Apache-2.0
#include "cli/relight/camera_options.h"

#include "cli/picture_size.h"
#include "core/errors.h"
#include "relight/field_pictures.h"

namespace refield::cli {

namespace {

bool are_given(const CameraOptions& options) {
  return !options.position.empty() || !options.target.empty() || options.fov || !options.size.empty() ||
         options.turntable;
}

Eigen::Vector3f vector_of(const std::vector<float>& numbers) {
  return {numbers[0], numbers[1], numbers[2]};
}

}  // namespace

void add_camera_options(CLI::App& verb, CameraOptions& options) {
  const char* group =
      "Camera (mesh fields only; default: the camera of the scene, else a front view of the whole mesh)";
  const auto add_point = [&](const char* name, std::vector<float>& point, const char* what) {
    verb.add_option(name, point, what)->delimiter(',')->expected(3)->type_name("X,Y,Z")->group(group);
  };
  add_point("--camera-position", options.position,
            "Position of the camera in scene coordinates (+X right, +Y up, +Z forward)");
  add_point("--camera-target", options.target,
            "Point in scene coordinates that is in the centre of the image");
  verb.add_option("--fov", options.fov, "Vertical field of view in degrees")->group(group);
  verb.add_option("--size", options.size, "Size of the image in pixels")
      ->type_name("WIDTHxHEIGHT")
      ->group(group);
  verb.add_flag("--turntable", options.turntable,
                "Move the camera on a full circle around the target over --frames images")
      ->group(group);
}

std::vector<PinholeCamera> cameras_of(const CameraOptions& options, const ReflectanceField& field,
                                      const std::filesystem::path& path, int frames) {
  if (field.mesh.empty()) {
    if (are_given(options))
      throw InputError(path.string() +
                       ": was captured by a fixed camera and has no mesh, so the view cannot change; remove "
                       "--camera-position, --camera-target, --fov, --size and --turntable");
    return {};
  }
  PinholeCamera camera = standard_camera(field);
  if (!options.size.empty()) {
    const PictureSize size = read_picture_size(options.size, {1, 1});
    camera.width = size.width;
    camera.height = size.height;
    if (!field.camera) camera = framing_camera(field.mesh, camera.width, camera.height);
  }
  if (!options.position.empty()) camera.position = vector_of(options.position);
  if (!options.target.empty()) camera.target = vector_of(options.target);
  if (options.fov) camera.vertical_field_of_view_degrees = *options.fov;
  camera.check();
  return options.turntable ? turntable(camera, frames) : std::vector{camera};
}

}  // namespace refield::cli
