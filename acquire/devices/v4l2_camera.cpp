// SPDX-License-Identifier: Apache-2.0
#include "acquire/devices/tethered_camera.h"

#include <linux/videodev2.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>

#include "acquire/devices/pixel_formats.h"
#include "acquire/devices/v4l2_device.h"

namespace refield {

namespace {

/// A control that lets the camera change pictures on its own.
struct AutomaticMode {
  std::uint32_t id;
  std::int64_t off;
  const char* what;
  bool spoils_captures;  ///< no session can be trusted with it
};

constexpr std::array automatic_modes = {
    AutomaticMode{V4L2_CID_EXPOSURE_AUTO, V4L2_EXPOSURE_MANUAL, "exposure", true},
    AutomaticMode{V4L2_CID_AUTOGAIN, 0, "gain", true},
    AutomaticMode{V4L2_CID_ISO_SENSITIVITY_AUTO, V4L2_ISO_SENSITIVITY_MANUAL, "ISO sensitivity", true},
    AutomaticMode{V4L2_CID_AUTO_WHITE_BALANCE, 0, "white balance", true},
    AutomaticMode{V4L2_CID_AUTOBRIGHTNESS, 0, "brightness", true},
    AutomaticMode{V4L2_CID_WIDE_DYNAMIC_RANGE, 0, "tone mapping", true},
    AutomaticMode{V4L2_CID_FOCUS_AUTO, 0, "focus", true},
    AutomaticMode{V4L2_CID_EXPOSURE_AUTO_PRIORITY, 0, "frame rate", false},
    AutomaticMode{V4L2_CID_HUE_AUTO, 0, "hue", false},
    AutomaticMode{V4L2_CID_CHROMA_AGC, 0, "chroma gain", false},
    AutomaticMode{V4L2_CID_BACKLIGHT_COMPENSATION, 0, "backlight compensation", false},
    AutomaticMode{V4L2_CID_IMAGE_STABILIZATION, 0, "image stabilisation", false},
    AutomaticMode{V4L2_CID_POWER_LINE_FREQUENCY, V4L2_CID_POWER_LINE_FREQUENCY_DISABLED, "flicker reduction",
                  false},
};

std::string range_text(const V4l2ControlInfo& control) {
  if (!control.menu.empty()) {
    std::string text = "its choices are";
    for (const std::string& choice : control.menu) text += " " + choice;
    return text;
  }
  return "its range is " + std::to_string(control.lowest) + " to " + std::to_string(control.highest) +
         " in steps of " + std::to_string(control.step);
}

/// Controls of a V4L2 camera for measuring: whatever the camera would choose by itself is switched off, and
/// every setting is read back.
class V4l2Settings {
 public:
  /// Switches automatic modes off, then makes the `wanted` settings (by v4l2-ctl's names). Throws InputError
  /// for a control that is not there or a value out of its range, DeviceError when the camera keeps choosing
  /// its exposure, gain or white balance, or reads back another value than was set.
  V4l2Settings(const V4l2Device& device, const std::map<std::string, std::int64_t>& wanted);

  /// Sentences about automatic modes that would not be switched off but may do no harm.
  const std::vector<std::string>& warnings() const { return warnings_; }

  /// Range of the exposure control; nullopt when there is none.
  const std::optional<V4l2ControlInfo>& exposure() const { return exposure_; }
  const std::optional<V4l2ControlInfo>& gain() const { return gain_; }

  /// Sets a control and returns what it reads back.
  std::int64_t set(const V4l2ControlInfo& control, std::int64_t value) const;

 private:
  const V4l2ControlInfo* find(std::uint32_t id) const;
  void switch_off_automatic_modes(const std::map<std::string, std::int64_t>& wanted);
  void make(const std::map<std::string, std::int64_t>& wanted);
  const V4l2Device& device_;
  std::vector<V4l2ControlInfo> controls_;
  std::vector<std::string> warnings_;
  std::optional<V4l2ControlInfo> exposure_, gain_;
};

V4l2Settings::V4l2Settings(const V4l2Device& device, const std::map<std::string, std::int64_t>& wanted)
    : device_(device), controls_(controls_of(device)) {
  switch_off_automatic_modes(wanted);
  make(wanted);
  if (const auto* control = find(V4L2_CID_EXPOSURE_ABSOLUTE)) exposure_ = *control;
  for (std::uint32_t id : {V4L2_CID_ANALOGUE_GAIN, V4L2_CID_GAIN})
    if (const auto* control = find(id); control && !gain_) gain_ = *control;
}

const V4l2ControlInfo* V4l2Settings::find(std::uint32_t id) const {
  const auto found = std::ranges::find(controls_, id, &V4l2ControlInfo::id);
  return found == controls_.end() ? nullptr : &*found;
}

void V4l2Settings::switch_off_automatic_modes(const std::map<std::string, std::int64_t>& wanted) {
  for (const AutomaticMode& mode : automatic_modes) {
    const V4l2ControlInfo* control = find(mode.id);
    if (!control || wanted.contains(control->name)) continue;
    v4l2_control setting{mode.id, static_cast<__s32>(mode.off)};
    device_.try_call(VIDIOC_S_CTRL, &setting);
    v4l2_control now{mode.id, 0};
    device_.call(VIDIOC_G_CTRL, &now, "does not report its control " + control->name);
    if (now.value == mode.off) continue;
    const std::string sentence = std::string("keeps choosing its ") + mode.what + " by itself (control " +
                                 control->name + " stays at " + std::to_string(now.value) + ")";
    if (mode.spoils_captures)
      throw DeviceError(device_.node().string(), EINVAL,
                        sentence +
                            "; photographs would not be comparable: use another camera, or set the control "
                            "in the rig file");
    warnings_.push_back(device_.node().string() + ": " + sentence);
  }
}

void V4l2Settings::make(const std::map<std::string, std::int64_t>& wanted) {
  for (const auto& [name, value] : wanted) {
    const auto control = std::ranges::find(controls_, name, &V4l2ControlInfo::name);
    const std::string prefix = device_.node().string() + ": control " + name;
    if (control == controls_.end())
      throw InputError(prefix + " is not there; 'refield acquire devices' lists controls");
    if (value < control->lowest || value > control->highest)
      throw InputError(prefix + " = " + std::to_string(value) + ": " + range_text(*control));
    if (const std::int64_t now = set(*control, value); now != value)
      throw DeviceError(device_.node().string(), EINVAL,
                        "control " + name + " reads " + std::to_string(now) + " after it was set to " +
                            std::to_string(value) + "; " + range_text(*control));
  }
}

std::int64_t V4l2Settings::set(const V4l2ControlInfo& control, std::int64_t value) const {
  v4l2_control setting{control.id, static_cast<__s32>(value)};
  device_.call(VIDIOC_S_CTRL, &setting, "refuses control " + control.name + " = " + std::to_string(value));
  v4l2_control now{control.id, 0};
  device_.call(VIDIOC_G_CTRL, &now, "does not report its control " + control.name);
  return now.value;
}

constexpr Seconds exposure_step{100e-6};  // of V4L2_CID_EXPOSURE_ABSOLUTE
constexpr int frames_after_start = 2;     // sensors need a frame or two to take on what they are set to
constexpr int frames_after_replug = 6;    // and that many until they are no longer as they were plugged in
constexpr int max_restarts_in_a_row = 3;
constexpr Seconds usual_interval{1.0 / 30.0};

MonotonicClock::duration rounded_up(Seconds s) {
  return std::chrono::ceil<MonotonicClock::duration>(s);
}

/// The best format for measuring of those that the camera offers and this program reads.
std::uint32_t best_format(const V4l2Device& device) {
  const auto offered = formats_of(device);
  for (const PixelFormat& format : v4l2_formats())
    if (std::ranges::find(offered, format.fourcc, &V4l2FormatInfo::fourcc) != offered.end())
      return format.fourcc;
  std::string names;
  for (const V4l2FormatInfo& format : offered) names += " " + fourcc_text(format.fourcc);
  throw InputError(device.node().string() + ": offers no format that this program reads, only" + names);
}

/// Everything that is lost when the camera is unplugged.
struct OpenCamera {
  V4l2Device device;
  V4l2Settings settings;
  V4l2Stream stream;

  OpenCamera(const V4l2Identity& identity, const V4l2CameraOptions& options, const RunContext& run)
      : device(identity.node),
        settings(device, options.controls),
        stream(device,
               {options.format.empty() ? best_format(device) : fourcc_from_text(options.format),
                options.width, options.height, options.rate},
               run) {}
};

class V4l2Camera final : public StreamingCamera {
 public:
  V4l2Camera(V4l2CameraOptions wanted, RunContext context)
      : options_(std::move(wanted)), run_(std::move(context)), identity_(find_v4l2_camera(options_.device)) {
    reopen();
    const std::string name = identity_.node.string();
    const std::uint32_t fourcc = open_->stream.format().fourcc;
    const auto known = find_v4l2_format(fourcc);
    if (!known)
      throw InputError(name + ": format " + fourcc_text(fourcc) +
                       " is not among those that this program reads; 'refield acquire devices' marks them");
    format_ = *known;
    window_ = options_.window.value_or(
        FrameWindow{0, 0, open_->stream.format().width, open_->stream.format().height});
    if (!open_->settings.exposure() && options_.fixed_exposure.count() <= 0.0)
      throw InputError(name +
                       ": has no exposure control that states times; give the exposure that the camera is "
                       "set to as fixed_exposure, in seconds");
    exposure_ = exposure_before_ =
        open_->settings.exposure() ? exposure_step * static_cast<double>(open_->settings.exposure()->value)
                                   : options_.fixed_exposure;
    for (const std::string& warning : open_->settings.warnings()) tell(warning);
    if (!format_.is_raw())
      tell(name + ": " + fourcc_text(fourcc) +
           " frames are processed by the camera (tone curve, colours); its response must be calibrated");
  }

  CameraDescription describe() const override {
    require_open();
    CameraDescription camera{identity_.card + " (" + identity_.bus + ")",
                             window_.width,
                             window_.height,
                             format_.layout,
                             format_.bits,
                             options_.fixed_exposure,
                             options_.fixed_exposure,
                             interval()};
    if (const auto& control = open_->settings.exposure()) {
      camera.shortest_exposure =
          exposure_step * static_cast<double>(std::max<std::int64_t>(control->lowest, 1));
      camera.longest_exposure = exposure_step * static_cast<double>(control->highest);
      camera.exposure_step = exposure_step * static_cast<double>(std::max<std::int64_t>(control->step, 1));
    }
    return camera;
  }

  RawFrame next_frame(Seconds timeout) override {
    require_open();
    auto deadline = std::chrono::steady_clock::now() + timeout;
    // One look even after the deadline: it may be the program that was stopped for so long.
    int restarts = 0;
    for (bool is_last = false; !is_last;) try {
        const Seconds left = deadline - std::chrono::steady_clock::now();
        is_last = left.count() <= 0.0;
        const auto filled = open_->stream.take(std::max(left, Seconds(0)));
        if (!filled) continue;
        auto frame = frame_of(*filled);
        open_->stream.give_back(*filled);
        if (frame) return std::move(*frame);
      } catch (const DeviceError& error) {
        if (error.error_number() == EIO) {
          restart(error, ++restarts);
        } else if (error.error_number() == ENODEV) {
          reconnect(error);
          deadline =
              std::chrono::steady_clock::now() + timeout + frames_after_replug * (exposure_ + interval());
          is_last = false;
        } else {
          throw;
        }
      }
    throw DeviceError(identity_.node.string(), ETIMEDOUT,
                      "no frame came within " + std::to_string(timeout.count()) +
                          " s; check cable, trigger and that no other program uses the camera");
  }

 private:
  V4l2CameraOptions options_;
  RunContext run_;
  V4l2Identity identity_;
  std::unique_ptr<OpenCamera> open_;
  PixelFormat format_{};
  FrameWindow window_;

  Seconds exposure_before_{0};  // may still be in effect for a while after settings_made_
  int to_skip_ = frames_after_start;
  int unsettled_ = 0;  // frames to leave out after replugging
  std::optional<std::uint32_t> driver_sequence_;
  std::uint64_t sequence_ = 0;
  TimePoint last_stamp_{};

  void tell(const std::string& sentence) const { run_.note(sentence); }

  Seconds interval() const {
    const Seconds stated = open_->stream.format().frame_interval;
    return stated.count() > 0.0 ? stated : usual_interval;
  }

  /// Opens the camera with all settings, frames in flight forgotten.
  void reopen() {
    open_.reset();  // the node must be free first
    open_ = std::make_unique<OpenCamera>(identity_, options_, run_);
    frames_start_anew();
    make_settings_again();
  }

  void frames_start_anew() {
    driver_sequence_.reset();
    to_skip_ = frames_after_start;
  }

  void require_open() const override {
    if (!open_)
      throw DeviceError(identity_.card + " (" + identity_.bus + ")", ENODEV,
                        "was disconnected; connect it again and resume");
  }

  void make_settings(Seconds wanted, double wanted_gain) override {
    exposure_before_ = std::max(exposure_, exposure_before_);
    if (const auto& control = open_->settings.exposure()) {
      const std::int64_t steps = std::llround(wanted / exposure_step);
      exposure_ = exposure_step * static_cast<double>(open_->settings.set(*control, steps));
    }
    gain_ = 1.0;
    if (options_.unit_gain > 0.0) {
      const auto& control = open_->settings.gain();
      const std::int64_t made = open_->settings.set(*control, std::llround(wanted_gain * options_.unit_gain));
      gain_ = static_cast<double>(made) / options_.unit_gain;
    }
    settings_made_ = monotonic_now();
  }

  void check_settings(Seconds wanted, double wanted_gain) const override {
    const CameraDescription camera = describe();
    require_range("an exposure in seconds", wanted.count(), camera.shortest_exposure.count(),
                  camera.longest_exposure.count(), 0.5 * exposure_step.count());
    if (options_.unit_gain <= 0.0)
      return require_range("a gain, without unit_gain in the rig file,", wanted_gain, 1.0, 1.0, 0.0);
    const auto& control = open_->settings.gain();
    if (!control) throw InputError(camera.name + ": has no gain control; leave out unit_gain");
    require_range("a gain", wanted_gain, static_cast<double>(control->lowest) / options_.unit_gain,
                  static_cast<double>(control->highest) / options_.unit_gain, 0.0);
  }

  /// See the class: never after the true start.
  TimePoint start_of_exposure(const V4l2Filled& filled) const {
    if (!filled.is_end_of_frame) return filled.stamp;
    const TimePoint old_gone = settings_made_ + rounded_up(exposure_before_ + 4 * interval());
    const Seconds longest = filled.stamp < old_gone ? std::max(exposure_, exposure_before_) : exposure_;
    return filled.stamp - rounded_up(longest + interval());
  }

  /// Drivers count to 2^32 and start again when they are opened again.
  void count(std::uint32_t number) {
    const std::uint32_t step = driver_sequence_ ? number - *driver_sequence_ : 1;
    constexpr std::uint32_t half_way_round = 1u << 31;
    sequence_ += step < half_way_round ? step : 1;
    driver_sequence_ = number;
  }

  /// A camera that was plugged in again began with settings of its own, and takes ours on in its time. No one
  /// above knows that it was away.
  bool is_unsettled(const V4l2Filled& filled) {
    if (unsettled_ == 0) return false;
    if (start_of_exposure(filled) >= settings_made_) --unsettled_;
    return true;
  }

  /// The frame in a buffer; nullopt when it cannot be used.
  std::optional<RawFrame> frame_of(const V4l2Filled& filled) {
    count(filled.sequence);
    if (!filled.is_monotonic)
      throw DeviceError(
          identity_.node.string(), EINVAL,
          "does not stamp frames with the monotonic clock; frames cannot be paired with patterns");
    if (to_skip_ > 0) {
      --to_skip_;
      return std::nullopt;
    }
    if (filled.stamp <= last_stamp_) return std::nullopt;  // handed over twice
    if (filled.is_damaged || !open_->stream.has_signal()) {
      ++troubles_.damaged;
      tell(identity_.node.string() +
           (filled.is_damaged ? ": a damaged frame was discarded" : ": no signal; a frame was discarded"));
      return std::nullopt;
    }
    last_stamp_ = filled.stamp;
    if (is_unsettled(filled)) return std::nullopt;
    const V4l2StreamFormat& stream = open_->stream.format();
    try {
      return RawFrame{window_.width,
                      window_.height,
                      format_.layout,
                      unpack_frame(filled.bytes, format_, stream.width, stream.height, stream.bytes_per_line,
                                   window_, {stream.bt709, stream.full_range}, identity_.node.string()),
                      start_of_exposure(filled),
                      exposure_,
                      gain_,
                      sequence_};
    } catch (const DeviceError& torn) {
      ++troubles_.damaged;
      tell(torn.what());
      return std::nullopt;
    }
  }

  void restart(const DeviceError& broken, int restarts) {
    if (restarts > max_restarts_in_a_row) throw DeviceError(broken);
    ++troubles_.restarts;
    tell(std::string(broken.what()) + "; it is started again");
    open_->stream.restart();
    frames_start_anew();
  }

  /// Waits until the camera is plugged in again: the same card at the same place.
  void reconnect(const DeviceError& gone) override {
    // Or the node stays taken, and the camera comes back under another number.
    if (options_.replug_patience.count() > 0.0) open_.reset();
    wait_for_replug(gone, identity_.card + " (" + identity_.bus + ")", options_.replug_patience, run_, [&] {
      for (const V4l2Identity& camera : find_v4l2_cameras()) {
        if (camera.bus != identity_.bus || camera.card != identity_.card) continue;
        identity_ = camera;
        reopen();
        unsettled_ = frames_after_replug;
        return true;
      }
      return false;
    });
  }
};

}  // namespace

std::unique_ptr<TetheredCamera> open_camera(V4l2CameraOptions options, RunContext run) {
  return std::make_unique<V4l2Camera>(std::move(options), std::move(run));
}

}  // namespace refield
