// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "acquire/camera.h"
#include "core/base/errors.h"
#include "core/base/run_context.h"

namespace refield {

/// A window of a frame, pixels.
struct FrameWindow {
  int x = 0;
  int y = 0;
  int width = 0;
  int height = 0;
};

/// What every camera on a cable is asked for.
struct CameraOptions {
  std::string device;                 ///< names the camera; how, is said where it is looked for
  std::string format;                 ///< of the pixels; empty: the one that is best for measuring
  double rate = 0.0;                  ///< frames per second; 0: what the camera is set to
  std::optional<FrameWindow> window;  ///< part of the frame to keep; the whole without it
  /// Value of the gain control that stands for gain 1; other gains are multiples of it. 0: see the camera.
  double unit_gain = 0.0;
  Seconds replug_patience{30};  ///< how long an unplugged camera is waited for
};

/// What went wrong on the way and was mended; frames in it are lost, never wrong.
struct CameraTroubles {
  std::uint64_t damaged = 0;   ///< frames that the driver marked as damaged, or that were torn or incomplete
  std::uint64_t restarts = 0;  ///< streaming broke and was started anew
  std::uint64_t replugs = 0;   ///< the camera was gone and came back
};

/// A camera on a cable, which may be pulled. Made by open_camera() of its kind's options.
class TetheredCamera : public Camera {
 public:
  const CameraTroubles& troubles() const { return troubles_; }

 protected:
  /// Calls `open` every quarter of a second until it returns true or `patience` has passed. InputError and
  /// DeviceError of `open` mean that the camera is not ready yet. Throws `gone` where it does not come back.
  void wait_for_replug(const DeviceError& gone, const std::string& name, Seconds patience,
                       const RunContext& run, const std::function<bool()>& open);

  CameraTroubles troubles_;
};

/// Now, on the clock of RawFrame::exposure_start.
TimePoint monotonic_now();

/// Shutter time that a choice such as "1/60", "0.0125s", "0.3" or "2\"" names; nullopt for "bulb" and others
/// that name none.
std::optional<Seconds> shutter_time(const std::string& choice);

/// Maps time stamps of a camera's own clock to the host's, of which nothing is known but that no frame
/// arrives before its exposure has ended. Arrival less exposure less stamp bounds the offset of the clocks
/// from above; the least of all frames is kept, and raised by more than any quartz drifts, so that it follows
/// the drift and a late arrival does not count. How long a frame is read out and sent at least is not known
/// to it: the caller allows for it.
class CameraClock {
 public:
  /// Start of the exposure of the frame with this stamp, in nanoseconds, also where the camera stamps the end
  /// of exposures. `shortest` and `longest` are equal unless it is not certain what the exposure was.
  TimePoint start_of(std::int64_t stamp_ns, TimePoint arrival, Seconds shortest, Seconds longest);

 private:
  std::optional<std::int64_t> offset_ns_;
  std::int64_t last_stamp_ns_ = 0;
  TimePoint last_arrival_{};
};

/// Consecutive numbers from frame ids, which wrap at 65535 in GigE Vision and skip 0.
class FrameCounter {
 public:
  /// Returns the number of the complete frame with this id. Ids that go back by more than half a round begin
  /// anew.
  std::uint64_t number_of(std::uint64_t id);
  /// The next number, for a frame that came incomplete. Its id is not believed: one that goes back, even by a
  /// little, would be taken for 65535 frames lost.
  std::uint64_t number_of_incomplete();
  /// The next id may be any: the camera was started again.
  void restart() { last_id_.reset(); }

 private:
  std::optional<std::uint64_t> last_id_;  // of a complete frame
  std::uint64_t number_ = 0;
  std::uint64_t incomplete_ = 0;  // numbers given since then
};

}  // namespace refield
