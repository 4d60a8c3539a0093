// SPDX-License-Identifier: Apache-2.0
#include "acquire/devices/tethered_camera.h"

#include <arv.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <thread>

#include "acquire/devices/pixel_formats.h"
#include "core/base/number_text.h"

namespace refield {

namespace {

// Sensors need a frame or two to take on what they are set to; the offset of the camera's clock needs one
// frame that arrives without delay on a busy machine.
constexpr int genicam_frames_after_start = 10;
// For reading out and sending a frame and for noticing it: on a machine with ten busy processes per core, the
// quickest of 40 frames of a camera with 250 frames per second was noticed after 7 ms.
constexpr Seconds least_allowance{0.02};
constexpr int genicam_buffers = 8;
constexpr Seconds genicam_usual_interval{1.0 / 30.0};
constexpr Seconds genicam_look_again{0.25};
constexpr Seconds control_patience{10};  // a camera frees itself from a program that died after three seconds
constexpr Seconds slice{0.1};            // of waiting: how soon a stop or a lost camera is noticed

struct Unref {
  void operator()(void* object) const { g_object_unref(object); }
};
template <class T>
using Ref = std::unique_ptr<T, Unref>;

struct GiveBack {
  ArvStream* stream = nullptr;
  void operator()(ArvBuffer* buffer) const { arv_stream_push_buffer(stream, buffer); }
};
using BufferHandle = std::unique_ptr<ArvBuffer, GiveBack>;

struct FreeList {
  void operator()(void* list) const { g_free(list); }
};

/// The errors of Aravis that say that the camera does not answer, or no longer obeys.
bool is_lost(const GError& error) {
  return error.domain == ARV_DEVICE_ERROR &&
         (error.code == ARV_DEVICE_ERROR_NOT_CONNECTED || error.code == ARV_DEVICE_ERROR_TIMEOUT ||
          error.code == ARV_DEVICE_ERROR_NOT_CONTROLLER || error.code == ARV_DEVICE_ERROR_TRANSFER_ERROR ||
          error.code == ARV_DEVICE_ERROR_NOT_FOUND ||
          error.code == ARV_DEVICE_ERROR_PROTOCOL_ERROR_ACCESS_DENIED);
}

/// Calls `action` with a place for Aravis' error, and throws that as a DeviceError: ENODEV when the camera is
/// gone, EINVAL when it refuses.
template <class Action>
auto ask(const std::string& camera, const std::string& what, const Action& action) {
  GError* error = nullptr;
  const auto check = [&] {
    if (!error) return;
    const int number = is_lost(*error) ? ENODEV : EINVAL;
    const std::string text = what + ": " + error->message;
    g_error_free(error);
    throw DeviceError(camera, number, text);
  };
  if constexpr (std::is_void_v<decltype(action(&error))>) {
    action(&error);
    check();
  } else {
    auto result = action(&error);
    check();
    return result;
  }
}

std::string or_empty(const char* text) {
  return text ? text : "";
}

std::string short_text(double value) {
  return formatted("%.7g", value);
}

std::string list_of_genicam(const std::vector<GenicamIdentity>& cameras) {
  if (cameras.empty())
    return "no GenICam camera answers; check cable, power and that camera and computer have addresses of the "
           "same network (docs/guide/genicam.md)";
  std::string text = "there are";
  for (const GenicamIdentity& camera : cameras)
    text += " " + camera.serial + " (" + camera.vendor + " " + camera.model + " at " + camera.address + ")";
  return text;
}

/// Whether `text` has the form of an IPv4 address, which is asked for directly: a camera in another network
/// does not answer a broadcast.
bool is_address(const std::string& text) {
  return std::ranges::count(text, '.') == 3 && text.find_first_not_of("0123456789.") == std::string::npos;
}

GenicamIdentity find_genicam_camera(const std::string& text) {
  if (is_address(text)) return {text, text, "", "", "", "GigEVision"};
  const auto cameras = find_genicam_cameras();
  std::vector<GenicamIdentity> found;
  for (const GenicamIdentity& camera : cameras)
    if (text == camera.serial || text == camera.id || text == camera.model || text == camera.address)
      found.push_back(camera);
  if (found.size() == 1) return found.front();
  throw InputError("camera 'genicam:", text,
                   "': ", found.empty() ? "no camera has this name" : "several cameras have this name", "; ",
                   list_of_genicam(cameras));
}

ArvGcFeatureNode* feature_node(ArvCamera* camera, const std::string& name) {
  ArvGcNode* node = arv_device_get_feature(arv_camera_get_device(camera), name.c_str());
  if (!ARV_IS_GC_FEATURE_NODE(node)) return nullptr;
  auto* feature = ARV_GC_FEATURE_NODE(node);
  return arv_gc_feature_node_is_available(feature, nullptr) ? feature : nullptr;
}

/// The feature as it stands; nullopt when the camera lacks it.
std::optional<GenicamFeature> feature_of(ArvCamera* camera, const std::string& name) {
  ArvGcFeatureNode* node = feature_node(camera, name);
  if (!node) return std::nullopt;
  const char* value = arv_gc_feature_node_get_value_as_string(node, nullptr);
  if (!value) return std::nullopt;
  GenicamFeature feature{name, value, ""};
  const auto range = [&](const std::string& low, const std::string& high, const char* unit) {
    feature.limits = low + " to " + high + (unit && *unit ? std::string(" ") + unit : "");
  };
  if (ARV_IS_GC_ENUMERATION(node)) {  // first, since it is an integer, too
    guint count = 0;
    const std::unique_ptr<const char*[], FreeList> names(
        arv_gc_enumeration_dup_available_string_values(ARV_GC_ENUMERATION(node), &count, nullptr));
    for (guint i = 0; names && i < count; ++i) feature.limits += (i ? ", " : "") + std::string(names[i]);
  } else if (ARV_IS_GC_BOOLEAN(node)) {
    feature.limits = "false, true";
  } else if (ARV_IS_GC_FLOAT(node)) {
    auto* number = ARV_GC_FLOAT(node);
    range(short_text(arv_gc_float_get_min(number, nullptr)),
          short_text(arv_gc_float_get_max(number, nullptr)), arv_gc_float_get_unit(number));
  } else if (ARV_IS_GC_INTEGER(node)) {
    auto* number = ARV_GC_INTEGER(node);
    range(std::to_string(arv_gc_integer_get_min(number, nullptr)),
          std::to_string(arv_gc_integer_get_max(number, nullptr)), arv_gc_integer_get_unit(number));
  }
  return feature;
}

/// Whether a feature that was set to `wanted` reads as if it were: numbers may be rounded by 1 %.
bool reads_as(const std::string& now, const std::string& wanted) {
  if (now == wanted) return true;
  const auto number = [](const std::string& text) {
    char* end = nullptr;
    const double value = std::strtod(text.c_str(), &end);
    return !text.empty() && *end == 0 ? std::optional(value) : std::nullopt;
  };
  const auto a = number(now), b = number(wanted);
  return a && b && std::abs(*a - *b) <= 0.01 * std::abs(*b);
}

/// What lets a camera change pictures on its own, or bends the response.
struct GenicamMode {
  const char* feature;
  const char* off;
  bool spoils_captures;  ///< no session can be trusted with it
};

constexpr std::array genicam_modes = {
    GenicamMode{"ExposureAuto", "Off", true},    GenicamMode{"GainAuto", "Off", true},
    GenicamMode{"BlackLevelAuto", "Off", true},  GenicamMode{"BalanceWhiteAuto", "Off", true},
    GenicamMode{"FocusAuto", "Off", true},       GenicamMode{"IrisAuto", "Off", true},
    GenicamMode{"GainAutoBalance", "Off", true}, GenicamMode{"BlackLevelAutoBalance", "Off", true},
    GenicamMode{"ExposureMode", "Timed", true},  GenicamMode{"Gamma", "1", false},
    GenicamMode{"GammaEnable", "false", false},  GenicamMode{"LUTEnable", "false", false},
    GenicamMode{"SharpnessAuto", "Off", false},  GenicamMode{"SharpeningEnable", "false", false},
    GenicamMode{"SaturationAuto", "Off", false}, GenicamMode{"ColorTransformationEnable", "false", false},
};

/// An open camera that streams; everything that is lost when it is unplugged.
class OpenGenicam {
 public:
  /// `format` and `window` receive what the camera was set to, and are what it is set to when it comes back.
  OpenGenicam(const GenicamIdentity& identity, GenicamCameraOptions& options, const RunContext& run)
      : options_(options), run_(run), name_("genicam:" + identity.address) {
    open(identity);
    arv_camera_set_range_check_policy(camera(), ARV_RANGE_CHECK_POLICY_ENABLE);
    arv_camera_set_access_check_policy(camera(), ARV_ACCESS_CHECK_POLICY_ENABLE);
    g_signal_connect(arv_camera_get_device(camera()), "control-lost", G_CALLBACK(on_control_lost), &lost_);
    // A program that died may have left it streaming, to itself.
    arv_camera_stop_acquisition(camera(), nullptr);
    arv_camera_set_acquisition_mode(camera(), ARV_ACQUISITION_MODE_CONTINUOUS, nullptr);
    for (const auto& [feature, value] : options.controls) set_feature(feature, value);
    switch_off_automatic_modes();
    choose_format();
    choose_window();
    choose_rate_and_trigger();
    read_limits();
    start();
  }
  ~OpenGenicam() {
    if (!lost_ && camera_) arv_camera_stop_acquisition(camera(), nullptr);
  }
  OpenGenicam(const OpenGenicam&) = delete;
  OpenGenicam& operator=(const OpenGenicam&) = delete;

  bool lost() const { return lost_; }
  /// It will not be talked to any more.
  void give_up() { lost_ = true; }
  const std::string& name() const { return name_; }
  const CameraDescription& description() const { return description_; }
  const PixelFormat& format() const { return format_; }

  /// Throws DeviceError ENODEV unless the camera answers.
  void require_answer() const {
    ask(name_, "does not answer", [&](GError** e) { return arv_camera_get_payload(camera(), e); });
  }

  Seconds set_exposure(Seconds exposure) const {
    constexpr double ns = 1e9, us_per_ns = 1e-3;
    // Whole nanoseconds: of 87.999999 µs some cameras would make 87.
    const double us = std::round(exposure.count() * ns) * us_per_ns;
    ask(name_, "refuses an exposure of " + short_text(exposure.count()) + " s",
        [&](GError** e) { arv_camera_set_exposure_time(camera(), us, e); });
    return made_exposure();
  }
  Seconds made_exposure() const {
    return Seconds(1e-6 * ask(name_, "does not report its exposure",
                              [&](GError** e) { return arv_camera_get_exposure_time(camera(), e); }));
  }

  bool has_gain() const { return gain_is_db_ || options_.unit_gain > 0.0; }
  /// Of the gain feature.
  double gain_value(double gain) const {
    return gain_is_db_ ? 20.0 * std::log10(gain) : gain * options_.unit_gain;
  }
  std::pair<double, double> gain_range() const {
    double low = 0.0, high = 0.0;
    arv_camera_get_gain_bounds(camera(), &low, &high, nullptr);
    return {gain_of(low), gain_of(high)};
  }
  double set_gain(double gain) const {
    ask(name_, "refuses a gain of " + short_text(gain),
        [&](GError** e) { arv_camera_set_gain(camera(), gain_value(gain), e); });
    return gain_of(
        ask(name_, "does not report its gain", [&](GError** e) { return arv_camera_get_gain(camera(), e); }));
  }

  void trigger() const {
    ask(name_, "refuses its software trigger", [&](GError** e) { arv_camera_software_trigger(camera(), e); });
  }

  /// Null after `timeout`. The stream has the buffer back when the handle ends.
  BufferHandle take(Seconds timeout) const {
    return {arv_stream_timeout_pop_buffer(stream_.get(), static_cast<guint64>(timeout.count() * 1e6)),
            {stream_.get()}};
  }

  /// Samples of a complete frame. Throws DeviceError EIO when it is not as the camera was set.
  std::vector<std::uint16_t> samples_of(ArvBuffer* buffer) const {
    std::size_t size = 0;
    const auto* data = static_cast<const std::uint8_t*>(arv_buffer_get_data(buffer, &size));
    if (arv_buffer_get_image_width(buffer) != description_.width ||
        arv_buffer_get_image_height(buffer) != description_.height ||
        arv_buffer_get_image_pixel_format(buffer) != format_code_)
      throw DeviceError(name_, EIO,
                        "sent a frame of another size or pixel format than it was set to; check that no "
                        "other program changes its settings");
    int padding = 0, rows = 0;
    arv_buffer_get_image_padding(buffer, &padding, &rows);
    return unpack_frame({data, size}, format_, description_.width, description_.height,
                        line_bytes(format_, description_.width) + static_cast<std::size_t>(padding),
                        {0, 0, description_.width, description_.height}, {}, name_);
  }

 private:
  ArvCamera* camera() const { return camera_.get(); }
  double gain_of(double value) const {
    return gain_is_db_ ? std::pow(10.0, value / 20.0) : value / options_.unit_gain;
  }
  static void on_control_lost(ArvDevice*, void* lost) { *static_cast<std::atomic<bool>*>(lost) = true; }

  /// Opens the camera and takes control of it, waiting for it to let go of a program that died.
  void open(const GenicamIdentity& identity) {
    const std::string& device = identity.protocol == "GigEVision" ? identity.address : identity.id;
    const auto begun = std::chrono::steady_clock::now();
    while (true) {
      camera_.reset();
      camera_.reset(ask(name_,
                        "cannot be opened; check cable, power and address ('refield acquire devices' lists "
                        "the cameras that answer)",
                        [&](GError** e) { return arv_camera_new(device.c_str(), e); }));
      ArvDevice* opened = arv_camera_get_device(camera());
      if (!ARV_IS_GV_DEVICE(opened) || arv_gv_device_is_controller(ARV_GV_DEVICE(opened))) break;
      if (seconds_since(begun) > control_patience.count())
        throw DeviceError(name_, EBUSY, "is controlled by another program: close that program, and resume");
      run_.throw_if_stopped();
      std::this_thread::sleep_for(genicam_look_again);
    }
    description_.name = or_empty(arv_camera_get_vendor_name(camera(), nullptr)) + " " +
                        or_empty(arv_camera_get_model_name(camera(), nullptr)) + " (" +
                        or_empty(arv_camera_get_device_serial_number(camera(), nullptr)) + ")";
  }

  void set_feature(const std::string& name, const std::string& value) const {
    ArvGcFeatureNode* node = feature_node(camera(), name);
    if (!node)
      throw InputError(name_, ": feature ", name,
                       " is not there or not available now; 'refield acquire devices' lists features, "
                       "'arv-tool-0.8 features' all of them");
    GError* error = nullptr;
    arv_gc_feature_node_set_value_from_string(node, value.c_str(), &error);
    const std::string why = error ? std::string(": ") + error->message : "";
    const bool gone = error && is_lost(*error);
    g_clear_error(&error);
    if (gone) throw DeviceError(name_, ENODEV, "does not answer", why);
    const auto now = feature_of(camera(), name);
    if (now && reads_as(now->value, value)) return;
    throw InputError(name_, ": feature ", name, " = ", value, " is refused; it reads ",
                     now ? now->value + ", and its limits are " + now->limits : "nothing", why);
  }

  void switch_off_automatic_modes() const {
    for (const GenicamMode& mode : genicam_modes) {
      const auto now = feature_of(camera(), mode.feature);
      if (!now || options_.controls.contains(mode.feature) || reads_as(now->value, mode.off)) continue;
      try {
        set_feature(mode.feature, mode.off);
      } catch (const InputError& refused) {
        if (mode.spoils_captures)
          throw DeviceError(name_, EINVAL, "keeps choosing by itself (", refused.what(),
                            "); photographs would not be comparable: use another camera, or set the "
                            "feature under [controls]");
        run_.note(refused.what(), "; its response must be calibrated");
      }
    }
  }

  void choose_format() {
    guint count = 0;
    const std::unique_ptr<const char*[], FreeList> offered(ask(
        name_, "does not report its pixel formats",
        [&](GError** e) { return arv_camera_dup_available_pixel_formats_as_strings(camera(), &count, e); }));
    std::string names;
    const auto worth = [](const PixelFormat& format) {  // raw first, then bits, then samples that lie whole
      return 100 * format.is_raw() + 2 * format.bits +
             (format.packing == SamplePacking::words || format.packing == SamplePacking::bytes);
    };
    std::optional<PixelFormat> best;
    std::string best_name;
    for (guint i = 0; i < count; ++i) {
      const std::string name = offered[i];
      names += " " + name;
      const auto format = find_genicam_format(name);
      if (!options_.format.empty() ? name != options_.format
                                   : !format || (best && worth(*format) <= worth(*best)))
        continue;
      best = format;
      best_name = name;
    }
    if (!best)
      throw InputError(name_, ": ",
                       options_.format.empty() ? "offers no pixel format that this program reads"
                       : best_name.empty()     ? "does not offer the pixel format " + options_.format
                                               : "this program does not read the pixel format " + best_name,
                       "; the camera offers", names);
    ask(name_, "refuses the pixel format " + best_name,
        [&](GError** e) { arv_camera_set_pixel_format_from_string(camera(), best_name.c_str(), e); });
    format_code_ = arv_camera_get_pixel_format(camera(), nullptr);
    if (or_empty(arv_camera_get_pixel_format_as_string(camera(), nullptr)) != best_name)
      throw DeviceError(name_, EINVAL, "does not keep the pixel format ", best_name);
    format_ = *best;
    options_.format = best_name;
    if (!format_.is_raw())
      run_.note(name_, ": ", best_name,
                " frames are processed by the camera (colours); its response must be calibrated");
  }

  FrameWindow window() const {
    FrameWindow now;
    ask(name_, "does not report its window",
        [&](GError** e) { arv_camera_get_region(camera(), &now.x, &now.y, &now.width, &now.height, e); });
    return now;
  }

  void choose_window() {
    if (options_.window) {
      const FrameWindow wanted = *options_.window;
      const bool can_move = arv_camera_is_region_offset_available(camera(), nullptr);
      // What it reads says whether it took it.
      arv_camera_set_region(camera(), can_move ? wanted.x : -1, can_move ? wanted.y : -1, wanted.width,
                            wanted.height, nullptr);
      const FrameWindow now = window();
      if (now.x != wanted.x || now.y != wanted.y || now.width != wanted.width || now.height != wanted.height)
        throw InputError(name_, ": the camera makes window ", text_of(now), " of ", text_of(wanted),
                         "; width is a multiple of ", arv_camera_get_width_increment(camera(), nullptr),
                         ", height of ", arv_camera_get_height_increment(camera(), nullptr),
                         ", and both end with the sensor");
    }
    options_.window = window();
    description_.width = options_.window->width;
    description_.height = options_.window->height;
    const bool is_packed =
        format_.packing == SamplePacking::lsb_first || format_.packing == SamplePacking::gige_packed;
    if (is_packed && description_.width * format_.bits % 8)
      throw InputError(name_, ": a line of ", description_.width, " pixels of ", options_.format,
                       " is no whole number of bytes; choose a width that is a multiple of 4");
    if (is_bayer(format_.layout) && (options_.window->x % 2 || options_.window->y % 2))
      throw InputError(name_, ": window ", text_of(*options_.window),
                       ": pixels share colours in pairs; begin it at even numbers");
  }
  static std::string text_of(const FrameWindow& window) {
    return std::to_string(window.x) + ", " + std::to_string(window.y) + ", " + std::to_string(window.width) +
           ", " + std::to_string(window.height);
  }

  void choose_rate_and_trigger() {
    arv_camera_clear_triggers(camera(), nullptr);
    if (options_.rate > 0.0) {
      ask(name_, "refuses a frame rate of " + short_text(options_.rate),
          [&](GError** e) { arv_camera_set_frame_rate(camera(), options_.rate, e); });
      const double now = arv_camera_get_frame_rate(camera(), nullptr);
      if (std::abs(now - options_.rate) > 0.01 * options_.rate) {
        double low = 0.0, high = 0.0;
        arv_camera_get_frame_rate_bounds(camera(), &low, &high, nullptr);
        throw InputError(name_, ": makes ", short_text(now), " frames per second, not ",
                         short_text(options_.rate), "; its range is ", short_text(low), " to ",
                         short_text(high));
      }
    }
    const double rate = arv_camera_get_frame_rate(camera(), nullptr);
    description_.frame_interval = rate > 0.0 ? Seconds(1.0 / rate) : genicam_usual_interval;
    if (options_.trigger.empty()) return;
    GError* error = nullptr;
    arv_camera_set_trigger(camera(), options_.trigger.c_str(), &error);
    const std::string why = error ? std::string(": ") + error->message : "";
    g_clear_error(&error);
    if (or_empty(arv_camera_get_trigger_source(camera(), nullptr)) == options_.trigger) return;
    const auto sources = feature_of(camera(), "TriggerSource");
    throw InputError(name_, ": trigger ", options_.trigger, " is refused", why, "; the camera offers ",
                     sources ? sources->limits : "none");
  }

  void read_limits() {
    double low = 0.0, high = 0.0;
    ask(name_, "does not report the range of its exposure",
        [&](GError** e) { arv_camera_get_exposure_time_bounds(camera(), &low, &high, e); });
    description_.layout = format_.layout;
    description_.bits = format_.bits;
    description_.shortest_exposure = Seconds(low * 1e-6);
    description_.longest_exposure = Seconds(high * 1e-6);
    // Many cameras keep whole microseconds alone and do not say so.
    description_.exposure_step = Seconds(1e-6);
    if (ArvGcFeatureNode* gain = feature_node(camera(), "Gain"); gain && options_.unit_gain <= 0.0)
      gain_is_db_ = ARV_IS_GC_FLOAT(gain) && or_empty(arv_gc_float_get_unit(ARV_GC_FLOAT(gain))) == "dB";
  }

  void start() {
    stream_.reset(ask(name_, "cannot open its stream",
                      [&](GError** e) { return arv_camera_create_stream(camera(), nullptr, nullptr, e); }));
    const auto bytes =
        static_cast<std::size_t>(ask(name_, "does not report its frames' size",
                                     [&](GError** e) { return arv_camera_get_payload(camera(), e); }));
    if (ARV_IS_GV_STREAM(stream_.get())) set_up_network(bytes);
    for (int i = 0; i < genicam_buffers; ++i)
      arv_stream_push_buffer(stream_.get(), arv_buffer_new(bytes, nullptr));
    ask(name_, "does not start", [&](GError** e) { arv_camera_start_acquisition(camera(), e); });
  }

  /// Room in the socket for two frames, since this process may be kept waiting; and how long packets are
  /// waited for that were asked for again.
  void set_up_network(std::size_t frame_bytes) const {
    const std::size_t wanted = std::clamp<std::size_t>(2 * frame_bytes, 4u << 20, 256u << 20);
    const double retention_us = std::clamp(4e6 * description_.frame_interval.count(), 20'000.0, 200'000.0);
    g_object_set(stream_.get(), "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED, "socket-buffer-size",
                 static_cast<int>(wanted), "frame-retention", static_cast<guint>(retention_us), nullptr);
    std::size_t limit = 0;
    if (std::ifstream("/proc/sys/net/core/rmem_max") >> limit && limit < 2 * frame_bytes)
      run_.note(name_, ": the system limits the receive buffer of a socket to ", limit / 1024,
                " KiB, less than two frames of ", frame_bytes / 1024,
                " KiB, so packets may be lost; 'sudo sysctl -w net.core.rmem_max=", wanted,
                "' raises the limit");
  }

  GenicamCameraOptions& options_;
  const RunContext& run_;
  std::string name_;
  std::atomic<bool> lost_{false};  // outlives the camera, whose threads write it
  Ref<ArvCamera> camera_;
  Ref<ArvStream> stream_;
  CameraDescription description_;
  PixelFormat format_{};
  ArvPixelFormat format_code_ = 0;
  bool gain_is_db_ = false;
};

class GenicamCamera final : public StreamingCamera {
 public:
  GenicamCamera(GenicamCameraOptions wanted, RunContext context)
      : options_(std::move(wanted)),
        run_(std::move(context)),
        identity_(find_genicam_camera(options_.device)) {
    reopen();
    exposure_ = shortest_ = longest_ = open_->made_exposure();
  }

  CameraDescription describe() const override {
    require_open();
    return description_;
  }

  void begin_after(TimePoint earliest) override { begin_ = earliest; }

  RawFrame next_frame(Seconds timeout) override {
    require_open();
    TimePoint begun = monotonic_now();
    TimePoint heard = begun;
    // The frames after a start come on top.
    const auto with_start = [&] { return timeout + to_skip_ * (longest_ + description_.frame_interval); };
    Seconds limit = with_start();
    // One look even after the deadline: it may be the program that was stopped for so long.
    for (bool is_last = false; !is_last;) try {
        run_.throw_if_stopped();
        if (open_->lost()) throw DeviceError(open_->name(), ENODEV, "was lost");
        trigger_if_due();
        is_last = monotonic_now() - begun >= limit;
        const BufferHandle buffer = open_->take(std::min(slice, timeout));
        if (!buffer) {
          // A camera that says nothing may be gone.
          const Seconds quiet = exposure_ + 4 * description_.frame_interval + Seconds(1);
          if (monotonic_now() - heard < quiet) continue;
          open_->require_answer();
          heard = monotonic_now();
          continue;
        }
        heard = monotonic_now();
        is_triggered_ = false;
        auto frame = frame_of(buffer.get());
        if (frame) return std::move(*frame);
        if (is_hardware()) return unusable();
      } catch (const DeviceError& error) {
        if (error.error_number() != ENODEV) throw;
        reconnect(error);
        begun = heard = monotonic_now();
        limit = with_start();
        is_last = false;
      }
    throw DeviceError(open_->name(), ETIMEDOUT, "no frame came within ", short_text(timeout.count()),
                      " s; check cable, trigger and that no firewall drops its packets");
  }

 private:
  GenicamCameraOptions options_;
  RunContext run_;
  GenicamIdentity identity_;
  std::unique_ptr<OpenGenicam> open_;
  CameraDescription description_;

  Seconds shortest_{0}, longest_{0};  // that may be in effect for a while after settings_made_

  CameraClock clock_;
  FrameCounter counter_;
  std::uint64_t last_number_ = 0;
  int to_skip_ = genicam_frames_after_start;
  std::int64_t last_stamp_ = 0;
  // Software triggers: whether one is on its way, and when the last was sent. Once one was taken for lost,
  // its frame may still come, and the time of the last says nothing any more.
  bool is_triggered_ = false, lost_trigger_ = false;
  TimePoint triggered_{};
  TimePoint begin_{};  // what begin_after() was told

  bool is_software() const { return options_.trigger == "Software"; }
  bool is_hardware() const { return !options_.trigger.empty() && !is_software(); }

  void reopen() {
    open_.reset();
    open_ = std::make_unique<OpenGenicam>(identity_, options_, run_);
    description_ = open_->description();
    clock_ = {};
    counter_.restart();
    last_stamp_ = 0;
    to_skip_ = genicam_frames_after_start;
    is_triggered_ = lost_trigger_ = false;
    make_settings_again();
  }

  void require_open() const override {
    if (!open_)
      throw DeviceError("genicam:" + options_.device, ENODEV,
                        "was disconnected; connect it again and resume");
  }

  void make_settings(Seconds wanted, double wanted_gain) override {
    exposure_ = open_->set_exposure(wanted);
    shortest_ = std::min(exposure_, shortest_);
    longest_ = std::max(exposure_, longest_);
    gain_ = open_->has_gain() ? open_->set_gain(wanted_gain) : 1.0;
    settings_made_ = monotonic_now();
  }

  void check_settings(Seconds wanted, double wanted_gain) const override {
    constexpr double rounding = 1e-6;
    require_range("an exposure in seconds", wanted.count(), description_.shortest_exposure.count(),
                  description_.longest_exposure.count(), rounding * wanted.count());
    if (!open_->has_gain())
      return require_range("a gain, without unit_gain in the rig file,", wanted_gain, 1.0, 1.0, 0.0);
    const auto [least, most] = open_->gain_range();
    require_range("a gain", wanted_gain, least, most, rounding * wanted_gain);
  }

  /// When the first packet of a frame came. Aravis notes it by the wall clock, which may be set meanwhile.
  static TimePoint arrival_of(ArvBuffer* buffer) {
    const gint64 age_ns =
        1000 * g_get_real_time() - static_cast<gint64>(arv_buffer_get_system_timestamp(buffer));
    constexpr gint64 longest_ns = 60'000'000'000;  // frames wait while this program merges photographs
    const TimePoint now = monotonic_now();
    return age_ns < 0 || age_ns > longest_ns ? now : now - std::chrono::nanoseconds(age_ns);
  }

  /// The frame in a buffer; nullopt when it cannot be used.
  std::optional<RawFrame> frame_of(ArvBuffer* buffer) {
    if (arv_buffer_get_status(buffer) != ARV_BUFFER_STATUS_SUCCESS) {
      last_number_ = counter_.number_of_incomplete();
      if (++troubles_.damaged == 1)
        run_.note(open_->name() +
                  ": an incomplete frame was discarded, and more will be without a note; packets are lost on "
                  "the way (docs/guide/genicam.md)");
      return std::nullopt;
    }
    const std::uint64_t number = last_number_ = counter_.number_of(arv_buffer_get_frame_id(buffer));
    const TimePoint arrival = arrival_of(buffer);
    const auto stamp = static_cast<std::int64_t>(arv_buffer_get_timestamp(buffer));
    if (stamp <= 0)
      throw DeviceError(open_->name(), EINVAL, "does not stamp frames; they cannot be paired with patterns");
    if (stamp == last_stamp_) return std::nullopt;  // handed over twice
    last_stamp_ = stamp;
    const Seconds interval = description_.frame_interval;
    if (arrival - settings_made_ > longest_ + 4 * interval) shortest_ = longest_ = exposure_;
    TimePoint start = clock_.start_of(stamp, arrival, shortest_, longest_) -
                      std::chrono::ceil<std::chrono::nanoseconds>(std::max(interval, least_allowance));
    if (is_software() && !lost_trigger_) start = std::max(start, triggered_);
    if (to_skip_ > 0) {
      --to_skip_;
      return std::nullopt;
    }
    try {
      return RawFrame{description_.width,
                      description_.height,
                      description_.layout,
                      open_->samples_of(buffer),
                      start,
                      exposure_,
                      gain_,
                      number};
    } catch (const DeviceError& torn) {
      ++troubles_.damaged;
      run_.note(torn.what());
      return std::nullopt;
    }
  }

  /// What whoever pulls the trigger line gets for an incomplete frame: pairing finds it too early.
  RawFrame unusable() const {
    const std::size_t samples = std::size_t{1} * description_.width * description_.height *
                                (description_.layout == PixelLayout::rgb ? 3 : 1);
    return {description_.width,
            description_.height,
            description_.layout,
            std::vector<std::uint16_t>(samples),
            TimePoint{},
            exposure_,
            gain_,
            last_number_};
  }

  void reconnect(const DeviceError& gone) override {
    open_->give_up();
    if (options_.replug_patience.count() > 0.0) open_.reset();
    const CameraDescription before = description_;
    wait_for_replug(gone, before.name, options_.replug_patience, run_, [&] {
      if (!is_address(options_.device)) identity_ = find_genicam_camera(options_.device);
      reopen();
      if (description_.name == before.name) return true;
      open_.reset();  // another camera has taken its address
      description_ = before;
      return false;
    });
  }

  /// Sends a software trigger unless one is on its way; one whose frame has not come is taken for lost.
  void trigger_if_due() {
    if (!is_software()) return;
    const Seconds overdue = exposure_ + 4 * description_.frame_interval + Seconds(0.5);
    if (is_triggered_ && monotonic_now() - triggered_ < overdue) return;
    lost_trigger_ = lost_trigger_ || is_triggered_;
    std::this_thread::sleep_for(std::min<Seconds>(begin_ - monotonic_now(), slice));
    const TimePoint now = monotonic_now();
    if (now < begin_) return;
    open_->trigger();
    is_triggered_ = true;
    triggered_ = now;
  }
};

}  // namespace

std::vector<GenicamIdentity> find_genicam_cameras() {
  arv_update_device_list();
  std::vector<GenicamIdentity> cameras;
  for (unsigned i = 0; i < arv_get_n_devices(); ++i)
    cameras.push_back({or_empty(arv_get_device_address(i)), or_empty(arv_get_device_id(i)),
                       or_empty(arv_get_device_vendor(i)), or_empty(arv_get_device_model(i)),
                       or_empty(arv_get_device_serial_nbr(i)), or_empty(arv_get_device_protocol(i))});
  std::ranges::sort(cameras, {}, &GenicamIdentity::serial);
  return cameras;
}

GenicamAbilities abilities_of(const GenicamIdentity& identity) {
  const Ref<ArvCamera> camera(ask("genicam:" + identity.serial, "cannot be opened", [&](GError** e) {
    return arv_camera_new(identity.protocol == "GigEVision" ? identity.address.c_str() : identity.id.c_str(),
                          e);
  }));
  GenicamAbilities abilities;
  guint count = 0;
  const std::unique_ptr<const char*[], FreeList> formats(
      arv_camera_dup_available_pixel_formats_as_strings(camera.get(), &count, nullptr));
  for (guint i = 0; formats && i < count; ++i) abilities.formats.emplace_back(formats[i]);
  std::vector<std::string> names = {
      "Width",   "Height",     "ExposureTime",  "ExposureTimeAbs",      "Gain",
      "GainRaw", "BlackLevel", "BlackLevelRaw", "AcquisitionFrameRate", "TriggerSource"};
  for (const GenicamMode& mode : genicam_modes) names.emplace_back(mode.feature);
  for (const std::string& name : names)
    if (auto feature = feature_of(camera.get(), name)) abilities.features.push_back(std::move(*feature));
  return abilities;
}

std::unique_ptr<TetheredCamera> open_camera(GenicamCameraOptions options, RunContext run) {
  return std::make_unique<GenicamCamera>(std::move(options), std::move(run));
}

}  // namespace refield
