// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "acquire/devices/tethered_camera.h"
#include "core/base/run_context.h"

namespace refield {

/// DSLRs and system cameras on a USB cable through libgphoto2. False: this program was built without it;
/// everything that talks to a camera then throws InputError and says so.
bool has_gphoto();

struct GphotoIdentity {
  std::string model;
  std::string port;    ///< "usb:001,007"; changes when the cable is plugged in again
  std::string serial;  ///< empty: not stated, or not asked for yet
};

/// A setting by libgphoto2's name.
struct GphotoSetting {
  std::string name, value;
  std::vector<std::string> choices;  ///< all that the camera takes; empty: free text or a number
  bool is_writable = true;
};

/// What a camera can do.
struct GphotoAbilities {
  std::string serial;
  std::vector<GphotoSetting> settings;  ///< those that matter for measuring
};

/// Cameras that are connected; their serial numbers are not asked for. Empty without libgphoto2.
std::vector<GphotoIdentity> find_gphoto_cameras();

/// Opens the camera for a moment. Throws DeviceError when it cannot be opened.
GphotoAbilities abilities_of(const GphotoIdentity& camera);

/// `device` is a serial number, a model or a port; empty: the only camera. `format`, `rate` and `unit_gain`
/// are not used. `window` is cut out of the photographs; of Bayer samples, its corner is at even pixels.
struct GphotoCameraOptions : CameraOptions {
  std::map<std::string, std::string> controls;  ///< settings by libgphoto2's names; all are read back
};

/// A DSLR, which takes one photograph for each frame. Its shutter times are those that it lists, gain is 1
/// (ISO is a setting), and exposure times, ISO and aperture that its files state must be those that were set.
///
/// RawFrame::exposure_start is the instant before the photograph was asked for: never later than the true
/// one. The photograph is downloaded before next_frame() returns, so its exposure has ended before the caller
/// can show another pattern.
///
/// A failed download or a damaged file is tried again, then the photograph is taken again; a busy camera is
/// waited for; a camera that is gone is waited for and gets all its settings anew. Everything else throws
/// DeviceError with a remedy.
///
/// Takes a photograph, to learn size and layout. Throws InputError for settings that the camera lacks,
/// DeviceError when it cannot be opened or refuses. `run` receives notes and stops waiting. The time-out of
/// next_frame() is the camera's own.
std::unique_ptr<TetheredCamera> open_camera(GphotoCameraOptions options, RunContext run = {});

}  // namespace refield
