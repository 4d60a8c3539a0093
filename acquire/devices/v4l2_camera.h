// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>

#include "acquire/devices/tethered_camera.h"
#include "core/base/run_context.h"

namespace refield {

/// `device` is a node, bus or card name, see find_v4l2_camera(); `format` a code such as "RGGB". Without
/// `unit_gain` the gain control stays as it is, and only gain 1 is taken.
struct V4l2CameraOptions : CameraOptions {
  int width = 0;  ///< 0: what the driver is set to
  int height = 0;
  std::map<std::string, std::int64_t> controls;  ///< by v4l2-ctl's names; all are read back
  Seconds fixed_exposure{0};                     ///< of a camera without an exposure control
};

/// A camera through Linux's V4L2, with memory-mapped streaming.
///
/// RawFrame::exposure_start never lies after the true start of exposure: a driver that stamps the end of the
/// frame is taken to have read it out for a whole frame interval, after the longest exposure that may have
/// been in effect. Sequence numbers go on across restarts and replugging. Damaged frames, frames handed over
/// twice and the first frames after a start are left out.
///
/// next_frame() throws DeviceError when an unplugged camera does not come back, when no frame comes in time,
/// or when stamps are not of the monotonic clock.
///
/// Throws InputError for options that the camera cannot do, DeviceError when it refuses. `run` receives notes
/// about damaged frames and an unplugged camera, and stops waiting.
std::unique_ptr<TetheredCamera> open_camera(V4l2CameraOptions options, RunContext run = {});

}  // namespace refield
