// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <map>
#include <memory>
#include <utility>

#include "acquire/camera.h"
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

/// A camera that streams, and whose settings are made again when it comes back.
class StreamingCamera : public TetheredCamera {
 public:
  TimePoint set_exposure(Seconds exposure, double gain) final;

 protected:
  virtual void require_open() const = 0;
  /// Throws InputError outside the camera's range.
  virtual void check_settings(Seconds exposure, double gain) const = 0;
  /// Sets `exposure_`, `gain_` and `settings_made_` to what is in effect.
  virtual void make_settings(Seconds exposure, double gain) = 0;
  /// Waits for the camera, and makes the settings that were asked for.
  virtual void reconnect(const DeviceError& gone) = 0;
  void make_settings_again();
  /// Throws InputError, which names the range.
  void require_range(const std::string& what, double value, double low, double high, double rounding) const;

  Seconds exposure_{0};  ///< in effect from settings_made_ on, as read back
  double gain_ = 1.0;
  TimePoint settings_made_{};

 private:
  std::optional<std::pair<Seconds, double>> asked_;
};

/// Now, on the clock of RawFrame::exposure_start.
TimePoint monotonic_now();

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

/// GenICam cameras (GigE Vision, USB3 Vision) through Aravis.
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

/// DSLRs and system cameras on a USB cable through libgphoto2.
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
