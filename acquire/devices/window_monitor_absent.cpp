// SPDX-License-Identifier: Apache-2.0
// Stands in for window_monitor.cpp where SDL2 was not there when the program was configured.
#include <cerrno>

#include "acquire/devices/window_monitor.h"
#include "core/base/errors.h"

namespace refield {

namespace {

[[noreturn]] void fail() {
  throw DeviceError(
      "window monitor", ENOSYS,
      "this program was built without SDL2; install libsdl2-dev and build it again, or use a KMS monitor");
}

}  // namespace

struct WindowMonitor::State {};

bool has_window_monitor() {
  return false;
}

std::vector<WindowDisplay> window_displays() {
  fail();
}

WindowMonitor::WindowMonitor(const WindowMonitorOptions&) {
  fail();
}
WindowMonitor::~WindowMonitor() = default;

IlluminatorDescription WindowMonitor::describe() const {
  fail();
}
std::vector<WindowKey> WindowMonitor::keys() {
  fail();
}
int WindowMonitor::pixels_per_texel() const {
  fail();
}
bool WindowMonitor::waits_for_blanking() const {
  fail();
}
TimePoint WindowMonitor::show(const DriveImage&) {
  fail();
}

}  // namespace refield
