// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

#include "acquire/devices/tethered_camera.h"

namespace refield::test {

/// Runs a shell command and fails the test when its status is not 0.
void run(const std::string& command);
void write_file(const std::string& path, const std::string& text);
std::string read_file(const std::string& path);

/// Node of vivid's first camera, and one of its controls set through v4l2-ctl, as another program would.
std::string vivid_node();
void set_vivid(const std::string& control, int value = 1);

/// Options of vivid's camera at 320×180, the smallest size of its webcam.
V4l2CameraOptions vivid_options(const std::string& format = "GREY");

}  // namespace refield::test
