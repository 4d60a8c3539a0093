// SPDX-License-Identifier: Apache-2.0
#include "acquire/devices/tethered_camera.h"

#include <linux/videodev2.h>
#include <poll.h>
#include <sys/mman.h>

#include <algorithm>
#include <cerrno>
#include <cmath>

#include "acquire/devices/pixel_formats.h"
#include "acquire/devices/v4l2_device.h"
#include "core/base/number_text.h"

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
  V4l2Settings(const V4l2Device& device, const std::map<std::string, std::int64_t>& wanted)
      : device_(device), controls_(controls_of(device)) {
    switch_off_automatic_modes(wanted);
    make(wanted);
    if (const auto* control = find(V4L2_CID_EXPOSURE_ABSOLUTE)) exposure_ = *control;
    for (std::uint32_t id : {V4L2_CID_ANALOGUE_GAIN, V4L2_CID_GAIN})
      if (const auto* control = find(id); control && !gain_) gain_ = *control;
  }

  /// Sentences about automatic modes that would not be switched off but may do no harm.
  const std::vector<std::string>& warnings() const { return warnings_; }

  /// Range of the exposure control; nullopt when there is none.
  const std::optional<V4l2ControlInfo>& exposure() const { return exposure_; }
  const std::optional<V4l2ControlInfo>& gain() const { return gain_; }

  /// Sets a control and returns what it reads back.
  std::int64_t set(const V4l2ControlInfo& control, std::int64_t value) const {
    v4l2_control setting{control.id, static_cast<__s32>(value)};
    device_.call(VIDIOC_S_CTRL, &setting, "refuses control " + control.name + " = " + std::to_string(value));
    v4l2_control now{control.id, 0};
    device_.call(VIDIOC_G_CTRL, &now, "does not report its control " + control.name);
    return now.value;
  }

 private:
  const V4l2ControlInfo* find(std::uint32_t id) const {
    const auto found = std::ranges::find(controls_, id, &V4l2ControlInfo::id);
    return found == controls_.end() ? nullptr : &*found;
  }

  void switch_off_automatic_modes(const std::map<std::string, std::int64_t>& wanted) {
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
        throw DeviceError(device_.node().string(), EINVAL, sentence,
                          "; photographs would not be comparable: use another camera, or set the control "
                          "in the rig file");
      warnings_.push_back(device_.node().string() + ": " + sentence);
    }
  }

  void make(const std::map<std::string, std::int64_t>& wanted) {
    for (const auto& [name, value] : wanted) {
      const auto control = std::ranges::find(controls_, name, &V4l2ControlInfo::name);
      const std::string prefix = device_.node().string() + ": control " + name;
      if (control == controls_.end())
        throw InputError(prefix, " is not there; 'refield acquire devices' lists controls");
      if (value < control->lowest || value > control->highest)
        throw InputError(prefix, " = ", value, ": ", range_text(*control));
      if (const std::int64_t now = set(*control, value); now != value)
        throw DeviceError(device_.node().string(), EINVAL, "control ", name, " reads ", now,
                          " after it was set to ", value, "; ", range_text(*control));
    }
  }

  const V4l2Device& device_;
  std::vector<V4l2ControlInfo> controls_;
  std::vector<std::string> warnings_;
  std::optional<V4l2ControlInfo> exposure_, gain_;
};

constexpr auto capture_type = static_cast<__u32>(V4L2_BUF_TYPE_VIDEO_CAPTURE);
constexpr int max_stop_checks_ms = 200;  // how soon Ctrl-C is heard while no frame comes

v4l2_buffer mapped_buffer(std::uint32_t index) {
  v4l2_buffer buffer{};
  buffer.type = capture_type;
  buffer.memory = V4L2_MEMORY_MMAP;
  buffer.index = index;
  return buffer;
}

bool is_bt709(const v4l2_pix_format& pixels) {
  if (pixels.ycbcr_enc != V4L2_YCBCR_ENC_DEFAULT) return pixels.ycbcr_enc == V4L2_YCBCR_ENC_709;
  return V4L2_MAP_YCBCR_ENC_DEFAULT(pixels.colorspace) == V4L2_YCBCR_ENC_709;
}

bool is_full_range(const v4l2_pix_format& pixels) {
  if (pixels.quantization != V4L2_QUANTIZATION_DEFAULT)
    return pixels.quantization == V4L2_QUANTIZATION_FULL_RANGE;
  return pixels.colorspace == V4L2_COLORSPACE_JPEG;
}

/// Frame interval of an input that follows its source's timings, such as HDMI; 0 where it does not.
Seconds interval_of_timings(const V4l2Device& device) {
  v4l2_dv_timings timings{};
  if (device.try_call(VIDIOC_G_DV_TIMINGS, &timings) != 0 || timings.bt.pixelclock == 0) return Seconds(0);
  const double total =
      static_cast<double>(V4L2_DV_BT_FRAME_WIDTH(&timings.bt)) * V4L2_DV_BT_FRAME_HEIGHT(&timings.bt);
  return Seconds(total / static_cast<double>(timings.bt.pixelclock));
}

/// What the driver made of the format that was asked for.
struct V4l2StreamFormat {
  std::uint32_t fourcc = 0;
  int width = 0;
  int height = 0;
  std::size_t bytes_per_line = 0;
  bool bt709 = false;       ///< of YUV formats: luma weights of BT.709, else of BT.601
  bool full_range = false;  ///< of YUV formats
  Seconds frame_interval{0};
};

/// One buffer as the driver filled it. `bytes` are valid until it is given back.
struct V4l2Filled {
  std::uint32_t index = 0;
  std::span<const std::uint8_t> bytes;
  TimePoint stamp{};
  bool is_end_of_frame = false;  ///< the stamp tells when the frame's last byte came, not when exposure began
  bool is_monotonic = false;     ///< the stamp is of CLOCK_MONOTONIC
  bool is_damaged = false;       ///< V4L2_BUF_FLAG_ERROR
  std::uint32_t sequence = 0;    ///< as the driver counts, wrapping at 2^32
};

/// Memory-mapped streaming from a V4L2 node, which must outlive it.
class V4l2Stream {
 public:
  /// Sets format, size and rate (0: as the driver is set) and starts. Throws InputError when the driver chose
  /// another format or size than was asked for, DeviceError when it refuses.
  V4l2Stream(const V4l2Device& device, std::uint32_t fourcc, const V4l2CameraOptions& options, RunContext run)
      : device_(device), run_(std::move(run)) {
    choose_format(fourcc, options.width, options.height);
    choose_rate(options.rate);
    try {
      map_buffers();
      start();
    } catch (...) {
      unmap_buffers();
      throw;
    }
  }
  ~V4l2Stream() {
    auto type = capture_type;
    device_.try_call(VIDIOC_STREAMOFF, &type);
    unmap_buffers();
  }
  V4l2Stream(const V4l2Stream&) = delete;
  V4l2Stream& operator=(const V4l2Stream&) = delete;

  const V4l2StreamFormat& format() const { return format_; }

  /// The next filled buffer; nullopt after `timeout`. Throws DeviceError when streaming broke (EIO: restart()
  /// may mend it) or the device was unplugged (ENODEV), Interrupted when asked to stop.
  std::optional<V4l2Filled> take(Seconds timeout) {
    if (!wait_until_filled(timeout)) return std::nullopt;
    v4l2_buffer buffer = mapped_buffer(0);
    const int error = device_.try_call(VIDIOC_DQBUF, &buffer);
    if (error == EAGAIN) return std::nullopt;
    if (error == EIO || error == EINVAL || error == EPIPE) device_.fail(EIO, "stopped streaming");
    if (error != 0) device_.fail(error, "gives no frame");
    const auto used = std::min<std::size_t>(buffer.bytesused, buffers_.at(buffer.index).size());
    const auto stamp =
        std::chrono::seconds(buffer.timestamp.tv_sec) + std::chrono::microseconds(buffer.timestamp.tv_usec);
    return V4l2Filled{buffer.index,
                      std::span<const std::uint8_t>(buffers_[buffer.index]).first(used),
                      TimePoint(stamp),
                      (buffer.flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK) == V4L2_BUF_FLAG_TSTAMP_SRC_EOF,
                      (buffer.flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC,
                      (buffer.flags & V4L2_BUF_FLAG_ERROR) != 0,
                      buffer.sequence};
  }

  void give_back(const V4l2Filled& filled) {
    v4l2_buffer buffer = mapped_buffer(filled.index);
    const int error = device_.try_call(VIDIOC_QBUF, &buffer);
    if (error != 0) device_.fail(error == ENODEV ? ENODEV : EIO, "does not take a buffer back");
  }

  /// False while an input such as HDMI has no source; frames then show nothing.
  bool has_signal() const {
    v4l2_input input{};
    int index = 0;
    if (device_.try_call(VIDIOC_G_INPUT, &index) != 0) return true;
    input.index = static_cast<__u32>(index);
    if (device_.try_call(VIDIOC_ENUMINPUT, &input) != 0) return true;
    return (input.status & (V4L2_IN_ST_NO_POWER | V4L2_IN_ST_NO_SIGNAL | V4L2_IN_ST_NO_SYNC)) == 0;
  }

  /// Stops and starts again, all buffers empty.
  void restart() {
    auto type = capture_type;
    device_.call(VIDIOC_STREAMOFF, &type, "does not stop streaming");
    start();
  }

 private:
  void choose_format(std::uint32_t fourcc, int width, int height) {
    v4l2_format format{};
    format.type = capture_type;
    device_.call(VIDIOC_G_FMT, &format, "does not report its format");
    v4l2_pix_format& pixels = format.fmt.pix;
    pixels.pixelformat = fourcc;
    if (width > 0) pixels.width = static_cast<__u32>(width);
    if (height > 0) pixels.height = static_cast<__u32>(height);
    pixels.field = V4L2_FIELD_NONE;
    pixels.bytesperline = 0;
    device_.call(VIDIOC_S_FMT, &format,
                 "refuses the format " + fourcc_text(pixels.pixelformat) + " " + size_text(width, height));
    format_ = {pixels.pixelformat,
               static_cast<int>(pixels.width),
               static_cast<int>(pixels.height),
               pixels.bytesperline,
               is_bt709(pixels),
               is_full_range(pixels),
               Seconds(0)};
    const std::string remedy = "; 'refield acquire devices' lists formats and sizes";
    if (pixels.pixelformat != fourcc)
      throw InputError(device_.node(), ": gives ", fourcc_text(pixels.pixelformat), " in place of ",
                       fourcc_text(fourcc), remedy);
    if ((width > 0 && format_.width != width) || (height > 0 && format_.height != height))
      throw InputError(device_.node(), ": gives ", size_text(format_.width, format_.height),
                       " pixels in place of ", size_text(width, height), remedy);
    if (pixels.field != V4L2_FIELD_NONE)
      throw InputError(device_.node(), ": sends interlaced fields; choose a progressive mode");
  }

  void choose_rate(double rate) {
    v4l2_streamparm parameters{};
    parameters.type = capture_type;
    v4l2_fract& interval = parameters.parm.capture.timeperframe;
    const bool tells = device_.try_call(VIDIOC_G_PARM, &parameters) == 0;
    if (rate > 0.0) {
      interval = {1000, static_cast<__u32>(std::lround(1000.0 * rate))};
      device_.call(VIDIOC_S_PARM, &parameters, "refuses a frame rate of " + std::to_string(rate) + " Hz");
      const double made = static_cast<double>(interval.denominator) / std::max<__u32>(interval.numerator, 1);
      if (std::abs(made - rate) > 0.02 * rate)
        throw InputError(device_.node(), ": runs at ", made, " Hz in place of ", rate,
                         "; 'refield acquire devices' lists rates");
    }
    if (tells && interval.denominator > 0)
      format_.frame_interval = Seconds(static_cast<double>(interval.numerator) / interval.denominator);
    if (const Seconds source = interval_of_timings(device_); source.count() > 0.0 && rate <= 0.0)
      format_.frame_interval = source;
  }

  void map_buffers() {
    v4l2_requestbuffers request{};
    request.type = capture_type;
    request.memory = V4L2_MEMORY_MMAP;
    request.count = 4;
    device_.call(VIDIOC_REQBUFS, &request, "refuses memory-mapped buffers");
    for (__u32 i = 0; i < request.count; ++i) {
      v4l2_buffer buffer = mapped_buffer(i);
      device_.call(VIDIOC_QUERYBUF, &buffer, "does not show buffer " + std::to_string(i));
      void* memory = ::mmap(nullptr, buffer.length, PROT_READ | PROT_WRITE, MAP_SHARED, device_.descriptor(),
                            buffer.m.offset);
      if (memory == MAP_FAILED) device_.fail(errno, "cannot map buffer " + std::to_string(i));
      buffers_.emplace_back(static_cast<std::uint8_t*>(memory), buffer.length);
    }
  }

  void unmap_buffers() noexcept {
    for (const auto& buffer : buffers_) ::munmap(buffer.data(), buffer.size());
    buffers_.clear();
    v4l2_requestbuffers none{};
    none.type = capture_type;
    none.memory = V4L2_MEMORY_MMAP;
    device_.try_call(VIDIOC_REQBUFS, &none);
  }

  void start() {
    for (std::uint32_t i = 0; i < buffers_.size(); ++i) {
      v4l2_buffer buffer = mapped_buffer(i);
      device_.call(VIDIOC_QBUF, &buffer, "does not take buffer " + std::to_string(i));
    }
    auto type = capture_type;
    device_.call(VIDIOC_STREAMON, &type, "does not start streaming");
  }

  bool wait_until_filled(Seconds timeout) const {
    const auto deadline = std::chrono::steady_clock::now() + timeout;
    while (true) {
      run_.throw_if_stopped();
      const auto left =
          std::chrono::ceil<std::chrono::milliseconds>(deadline - std::chrono::steady_clock::now());
      pollfd waiting{device_.descriptor(), POLLIN, 0};
      const int wait_ms = static_cast<int>(std::clamp<std::int64_t>(left.count(), 0, max_stop_checks_ms));
      const int ready = ::poll(&waiting, 1, wait_ms);
      if (ready < 0 && errno != EINTR) device_.fail(errno, "cannot be waited for");
      // POLLERR and POLLHUP, too: VIDIOC_DQBUF tells what is wrong.
      if (ready > 0) return true;
      // Looked at least once: after a pause of the whole program a frame may be there.
      if (left.count() <= 0) return false;
    }
  }

  const V4l2Device& device_;
  RunContext run_;
  V4l2StreamFormat format_;
  std::vector<std::span<std::uint8_t>> buffers_;
};

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
  throw InputError(device.node(), ": offers no format that this program reads, only", names);
}

/// Everything that is lost when the camera is unplugged.
struct OpenCamera {
  V4l2Device device;
  V4l2Settings settings;
  V4l2Stream stream;

  OpenCamera(const V4l2Identity& identity, const V4l2CameraOptions& options, const RunContext& run)
      : device(identity.node),
        settings(device, options.controls),
        stream(device, options.format.empty() ? best_format(device) : fourcc_from_text(options.format),
               options, run) {}
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
      throw InputError(name, ": format ", fourcc_text(fourcc),
                       " is not among those that this program reads; 'refield acquire devices' marks them");
    format_ = *known;
    window_ = options_.window.value_or(
        FrameWindow{0, 0, open_->stream.format().width, open_->stream.format().height});
    if (!open_->settings.exposure() && options_.fixed_exposure.count() <= 0.0)
      throw InputError(name,
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
    throw DeviceError(identity_.node.string(), ETIMEDOUT, "no frame came within ", timeout.count(),
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
    if (!control) throw InputError(camera.name, ": has no gain control; leave out unit_gain");
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
