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
      "Camera (fields over a mesh; default: as the scene has it, else all of the mesh from in front)";
  const auto add_point = [&](const char* name, std::vector<float>& point, const char* what) {
    verb.add_option(name, point, what)->delimiter(',')->expected(3)->type_name("X,Y,Z")->group(group);
  };
  add_point("--camera-position", options.position, "In the scene's axes: +X right, +Y up, +Z ahead");
  add_point("--camera-target", options.target, "What is in the middle of the picture");
  verb.add_option("--fov", options.fov, "Vertical field of view, degrees")->group(group);
  verb.add_option("--size", options.size, "Of the picture in pixels")
      ->type_name("WIDTHxHEIGHT")
      ->group(group);
  verb.add_flag("--turntable", options.turntable,
                "Go a full circle around the target over --frames, under one light or one that moves")
      ->group(group);
}

std::vector<PinholeCamera> cameras_of(const CameraOptions& options, const ReflectanceField& field,
                                      const std::filesystem::path& path, int frames) {
  if (field.mesh.empty()) {
    if (are_given(options))
      throw InputError(
          path.string() +
          ": was photographed by a camera that stood still, and has no mesh to be seen from "
          "elsewhere; leave --camera-position, --camera-target, --fov, --size and --turntable out");
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
