// SPDX-License-Identifier: Apache-2.0
#include "tests/devices/lab.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <sstream>

#include "acquire/devices/v4l2_device.h"

namespace refield::test {

void run(const std::string& command) {
  EXPECT_EQ(std::system(command.c_str()), 0) << command;
}

void write_file(const std::string& path, const std::string& text) {
  std::ofstream file(path);
  file << text;
  file.close();
  EXPECT_TRUE(file.good()) << path;
}

std::string read_file(const std::string& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

std::string vivid_node() {
  return find_v4l2_camera("platform:vivid-000").node;
}

void set_vivid(const std::string& control, int value) {
  run("v4l2-ctl -d " + vivid_node() + " -c " + control + "=" + std::to_string(value));
}

V4l2CameraOptions vivid_options(const std::string& format) {
  V4l2CameraOptions options;
  options.device = "platform:vivid-000";
  options.format = format;
  options.width = 320;
  options.height = 180;
  options.rate = 30;
  options.fixed_exposure = Seconds(0.01);  // vivid has no exposure control
  options.replug_patience = Seconds(600);
  return options;
}

}  // namespace refield::test
