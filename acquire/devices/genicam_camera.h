// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "acquire/devices/tethered_camera.h"
#include "core/base/run_context.h"

namespace refield {

/// GenICam cameras (GigE Vision, USB3 Vision) through Aravis. False: this program was built without it;
/// everything that talks to a camera then throws InputError and says so.
bool has_genicam();

struct GenicamIdentity {
  std::string address;  ///< "192.168.0.7"; of USB cameras the id
  std::string id, vendor, model, serial;
  std::string protocol;  ///< "GigEVision" or "USB3Vision"
};

/// A feature of the camera's own description, by the names of the GenICam standard features (SFNC).
struct GenicamFeature {
  std::string name, value;
  std::string limits;  ///< "10 to 1e+07 us", or the choices
};

/// What a camera can do.
struct GenicamAbilities {
  std::vector<std::string> formats;      ///< by the names of the Pixel Format Naming Convention
  std::vector<GenicamFeature> features;  ///< those that matter for measuring
};

/// Cameras that answer within a second, in the order of their serial numbers. Empty without Aravis.
std::vector<GenicamIdentity> find_genicam_cameras();

/// Throws DeviceError when the camera cannot be reached.
GenicamAbilities abilities_of(const GenicamIdentity& camera);

/// `device` is an address, a serial number, an id or a model name. `format` is a name such as "BayerRG12p".
/// `window` is what the sensor reads out. Where the feature Gain is in decibels, gain 1 is 0 dB; elsewhere
/// gains need `unit_gain`, and without it the gain stays as it is and only gain 1 is taken.
struct GenicamCameraOptions : CameraOptions {
  std::map<std::string, std::string> controls;  ///< features by name; all are read back
  std::string trigger;  ///< empty: the camera runs freely; "Software", or its line such as "Line1"
};

/// A GenICam camera. Whatever it would choose by itself is switched off, and every setting is read back.
///
/// RawFrame::exposure_start never lies after the true start of exposure, as long as no more than a frame
/// interval, or 20 ms where that is longer, passes until a frame is read out, sent and noticed. With software
/// triggers it is the later of that and the trigger, which waits for what begin_after() was told. Incomplete
/// frames are left out: a camera that runs freely sends the next, a software trigger is sent again, and after
/// a hardware trigger a frame with the earliest of time stamps is returned, so that whoever pulled the line
/// does so again. An unplugged camera is waited for and gets all its settings anew; sequence numbers go on.
///
/// Throws InputError for options that the camera cannot do, DeviceError when it cannot be reached or refuses.
/// `run` receives notes and stops waiting.
std::unique_ptr<TetheredCamera> open_camera(GenicamCameraOptions options, RunContext run = {});

}  // namespace refield
