// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/camera_script.h"

#include <cstdio>

#include "core/errors.h"

namespace refield {

void move_camera(OrbitCamera& camera, const ScriptCommand& command) {
  using Verb = ScriptCommand::Verb;
  const auto& n = command.numbers;
  if (command.verb == Verb::approach && !(n[0] > 0.0)) throw InputError("give a factor above zero");
  if (command.verb == Verb::orbit) camera.orbit(n[0], n[1]);
  if (command.verb == Verb::approach) camera.approach(n[0]);
  if (command.verb == Verb::pan) camera.pan(n[0], n[1]);
}

std::string canvas_text(const Canvas& canvas, int width, int height) {
  char text[160];
  std::snprintf(text, sizeof text, R"({"x": %.3f, "y": %.3f, "scale": %.9f, "width": %d, "height": %d})",
                canvas.origin().x, canvas.origin().y, canvas.scale(), width, height);
  return text;
}

std::string camera_text(const PinholeCamera& camera) {
  const Eigen::Vector3f &p = camera.position, &t = camera.target;
  char text[200];
  std::snprintf(text, sizeof text,
                R"("camera": {"position": [%.7g, %.7g, %.7g], "target": [%.7g, %.7g, %.7g], "fov": %.7g})",
                p.x(), p.y(), p.z(), t.x(), t.y(), t.z(), camera.vertical_field_of_view_degrees);
  return text;
}

}  // namespace refield
