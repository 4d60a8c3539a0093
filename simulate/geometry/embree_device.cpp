// SPDX-License-Identifier: Apache-2.0
#include "simulate/geometry/embree_device.h"

#include <embree3/rtcore.h>

#include <memory>
#include <string>

#include "core/base/errors.h"

namespace refield {

namespace {

void on_embree_error(void*, RTCError code, const char* text) {
  throw InputError("ray tracing library: error " + std::to_string(code) + ": " + (text ? text : ""));
}

RTCDevice new_device() {
  const RTCDevice device = rtcNewDevice(nullptr);
  if (!device)
    throw InputError("ray tracing library: cannot start (error " +
                     std::to_string(rtcGetDeviceError(nullptr)) + ")");
  rtcSetDeviceErrorFunction(device, on_embree_error, nullptr);
  return device;
}

}  // namespace

RTCDeviceTy* embree_device() {
  struct Release {
    void operator()(RTCDevice device) const { rtcReleaseDevice(device); }
  };
  static const std::unique_ptr<RTCDeviceTy, Release> device(new_device());
  return device.get();
}

}  // namespace refield
