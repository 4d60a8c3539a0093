// SPDX-License-Identifier: Apache-2.0
#include "acquire/devices/tethered_camera.h"

#include <gphoto2/gphoto2.h>
#include <unistd.h>

#include <cmath>
#include <fstream>
#include <thread>

#include "acquire/capture/exposure_plan.h"
#include "acquire/hdr/bracket_files.h"
#include "core/base/files.h"
#include "core/base/number_text.h"

namespace refield {

namespace {

constexpr Seconds settle_patience{2.0};  // some cameras answer with the old value for a moment
constexpr Seconds busy_patience{20.0};   // mirror lock-up ends after a second or two, writing to a card later
constexpr Seconds gphoto_slice{0.1};     // of waiting: how soon a stop is noticed
constexpr int download_attempts = 3;
constexpr int photograph_attempts = 3;
constexpr int photographs_per_battery_check = 50;
constexpr double low_battery_percent = 15.0;
// Half of a third of a stop: nominal times such as 1/60 for 1/64 pass, another step does not.
constexpr double sixth_of_a_stop = 0.1225;

bool has_word(const std::string& text, std::initializer_list<const char*> words) {
  return std::ranges::any_of(words, [&](const char* word) { return text.find(word) != std::string::npos; });
}

std::string seconds_text(Seconds time) {
  return formatted("%.6g s", time.count());
}

/// The number that "f/5.6", "5.6", "100", "ISO 100" or "80%" states.
std::optional<double> number_in(const std::string& text) {
  const auto first = text.find_first_of("0123456789");
  if (first == std::string::npos) return std::nullopt;
  const std::string before = lower_case(text.substr(0, first));
  if (!before.empty() && before != "f/" && before != "f" && before != "iso ") return std::nullopt;
  char* end = nullptr;
  const double value = std::strtod(text.c_str() + first, &end);
  return *end == 0 || std::string(end) == "%" ? std::optional(value) : std::nullopt;
}

bool names_same(const std::string& choice, const std::string& wanted) {
  if (lower_case(choice) == lower_case(wanted)) return true;
  const auto a = number_in(choice), b = number_in(wanted);
  return a && b && *a == *b;
}

/// What libgphoto2 reported: its code and all that it said.
struct GphotoFailure {
  int code;
  std::string text;
};

enum class Trouble { gone, busy, full, unfocused, powerless, other };

Trouble trouble_of(const GphotoFailure& failure) {
  const std::string text = lower_case(failure.text);
  if (has_word(text, {"focus"})) return Trouble::unfocused;
  if (has_word(text, {"battery", "power"})) return Trouble::powerless;
  switch (failure.code) {
    case GP_ERROR_NO_SPACE:
    case GP_ERROR_NO_MEMORY:  // what the PTP driver makes of a store that runs full
      return Trouble::full;
    case GP_ERROR_CAMERA_BUSY:
      return Trouble::busy;
    case GP_ERROR_IO:
    case GP_ERROR_IO_INIT:
    case GP_ERROR_IO_READ:
    case GP_ERROR_IO_WRITE:
    case GP_ERROR_IO_USB_FIND:
    case GP_ERROR_IO_USB_CLAIM:
    case GP_ERROR_TIMEOUT:
    case GP_ERROR_MODEL_NOT_FOUND:
      return Trouble::gone;
    default:
      break;
  }
  if (has_word(text, {"full", "space"})) return Trouble::full;
  return has_word(text, {"busy", "mirror"}) ? Trouble::busy : Trouble::other;
}

template <auto free_it>
struct Freed {
  template <class T>
  void operator()(T* object) const {
    free_it(object);
  }
};
using CameraListHandle = std::unique_ptr<CameraList, Freed<gp_list_unref>>;
using AbilitiesHandle = std::unique_ptr<CameraAbilitiesList, Freed<gp_abilities_list_free>>;
using PortsHandle = std::unique_ptr<GPPortInfoList, Freed<gp_port_info_list_free>>;
using FileHandle = std::unique_ptr<CameraFile, Freed<gp_file_unref>>;
using WidgetHandle = std::unique_ptr<CameraWidget, Freed<gp_widget_unref>>;

/// An open camera.
class Connection {
 public:
  /// Throws GphotoFailure.
  explicit Connection(const GphotoIdentity& identity) {
    try {
      open(identity);
    } catch (...) {
      close();
      throw;
    }
  }
  ~Connection() { close(); }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  ::Camera* camera() const { return camera_; }
  GPContext* context() const { return context_; }

  void check(int code, const std::string& what) {
    if (code >= GP_OK) return;
    std::string text = what + ": " + gp_result_as_string(code);
    if (!said_.empty()) text += " (" + said_ + ")";
    said_.clear();
    throw GphotoFailure{code, text};
  }
  void forget_messages() { said_.clear(); }

 private:
  static void hear(GPContext*, const char* text, void* self) {
    std::string line = text ? text : "";
    std::ranges::replace(line, '\n', ' ');
    std::string& said = static_cast<Connection*>(self)->said_;
    said += (said.empty() ? "" : "; ") + line;
  }
  void open(const GphotoIdentity& identity) {
    context_ = gp_context_new();
    gp_context_set_error_func(context_, hear, this);
    CameraAbilitiesList* drivers = nullptr;
    check(gp_abilities_list_new(&drivers), "camera drivers");
    const AbilitiesHandle owned_drivers(drivers);
    check(gp_abilities_list_load(drivers, context_), "camera drivers");
    GPPortInfoList* ports = nullptr;
    check(gp_port_info_list_new(&ports), "ports");
    const PortsHandle owned_ports(ports);
    check(gp_port_info_list_load(ports), "ports");
    const int driver = gp_abilities_list_lookup_model(drivers, identity.model.c_str());
    check(driver, "the driver of the camera");
    const int port = gp_port_info_list_lookup_path(ports, identity.port.c_str());
    check(port, "port " + identity.port);
    CameraAbilities abilities;
    GPPortInfo info;
    check(gp_abilities_list_get_abilities(drivers, driver, &abilities), "the driver of the camera");
    check(gp_port_info_list_get_info(ports, port, &info), "port " + identity.port);
    check(gp_camera_new(&camera_), "the camera");
    check(gp_camera_set_abilities(camera_, abilities), "the driver of the camera");
    check(gp_camera_set_port_info(camera_, info), "port " + identity.port);
    check(gp_camera_init(camera_, context_), "cannot be opened");
    if (!(abilities.operations & GP_OPERATION_CAPTURE_IMAGE))
      throw GphotoFailure{GP_ERROR_NOT_SUPPORTED, "this model cannot be triggered over its cable"};
  }
  void close() {
    if (camera_) {
      gp_camera_exit(camera_, context_);
      gp_camera_unref(camera_);
    }
    if (context_) gp_context_unref(context_);
  }
  ::Camera* camera_ = nullptr;
  GPContext* context_ = nullptr;
  std::string said_;
};

/// nullopt when the camera lacks the setting. Throws GphotoFailure when it does not answer.
WidgetHandle find_widget(Connection& open, const std::string& name) {
  CameraWidget* widget = nullptr;
  const int code = gp_camera_get_single_config(open.camera(), name.c_str(), &widget, open.context());
  if (code < GP_OK && trouble_of({code, ""}) == Trouble::gone)
    open.check(code, "setting " + name + " cannot be read");
  open.forget_messages();
  return WidgetHandle(code < GP_OK ? nullptr : widget);
}

std::optional<GphotoSetting> read_setting(Connection& open, const std::string& name) {
  const WidgetHandle widget = find_widget(open, name);
  if (!widget) return std::nullopt;
  GphotoSetting setting{name, "", {}, true};
  CameraWidgetType type{};
  int read_only = 0;
  gp_widget_get_type(widget.get(), &type);
  gp_widget_get_readonly(widget.get(), &read_only);
  setting.is_writable = !read_only;
  if (type == GP_WIDGET_RANGE) {
    float value = 0.0f;
    gp_widget_get_value(widget.get(), &value);
    setting.value = formatted("%g", value);
  } else if (type == GP_WIDGET_TOGGLE || type == GP_WIDGET_DATE) {
    int value = 0;
    gp_widget_get_value(widget.get(), &value);
    setting.value = std::to_string(value);
  } else {
    const char* value = nullptr;
    gp_widget_get_value(widget.get(), &value);
    setting.value = value ? value : "";
  }
  if (type == GP_WIDGET_RADIO || type == GP_WIDGET_MENU)
    for (int i = 0; i < gp_widget_count_choices(widget.get()); ++i) {
      const char* choice = nullptr;
      if (gp_widget_get_choice(widget.get(), i, &choice) == GP_OK) setting.choices.emplace_back(choice);
    }
  return setting;
}

/// Sets and reads back. Throws InputError for what the camera lacks, GphotoFailure when it refuses.
void write_setting(Connection& open, const std::string& camera, const std::string& name, std::string wanted) {
  const auto before = read_setting(open, name);
  if (!before)
    throw InputError("camera '", camera, "' has no setting '", name,
                     "'; 'refield acquire devices' lists its settings");
  if (!before->choices.empty()) {
    const auto choice = std::ranges::find_if(
        before->choices, [&](const std::string& offered) { return names_same(offered, wanted); });
    if (choice == before->choices.end())
      throw InputError("camera '", camera, "': ", name, " cannot be '", wanted, "'; its choices are ",
                       listed(before->choices));
    wanted = *choice;
  }
  if (names_same(before->value, wanted)) return;
  if (!before->is_writable)
    throw InputError("camera '" + camera + "': " + name + " is '" + before->value +
                     "' and cannot be changed over the cable; set it to '" + wanted + "' on the camera");
  const WidgetHandle widget = find_widget(open, name);
  CameraWidgetType type{};
  if (widget) gp_widget_get_type(widget.get(), &type);
  int code = GP_ERROR;
  if (widget && type == GP_WIDGET_RANGE) {
    const float value = std::strtof(wanted.c_str(), nullptr);
    code = gp_widget_set_value(widget.get(), &value);
  } else if (widget && type == GP_WIDGET_TOGGLE) {
    const int value = wanted == "true" || wanted == "1";
    wanted = std::to_string(value);
    code = gp_widget_set_value(widget.get(), &value);
  } else if (widget) {
    code = gp_widget_set_value(widget.get(), wanted.c_str());
  }
  open.check(code, name + " = " + wanted + " was refused");
  open.check(gp_camera_set_single_config(open.camera(), name.c_str(), widget.get(), open.context()),
             name + " = " + wanted + " was refused");
  const auto start = std::chrono::steady_clock::now();
  while (true) {
    const auto now = read_setting(open, name);
    if (now && names_same(now->value, wanted)) return;
    if (seconds_since(start) > settle_patience.count())
      throw DeviceError(
          camera, EINVAL, name, " reads '", now ? now->value : "", "' after it was set to '", wanted,
          "'; the mode dial or the lens may decide it: set the dial to M and the lens to manual focus");
    std::this_thread::sleep_for(gphoto_slice);
  }
}

std::string serial_of(Connection& open) {
  for (const char* name : {"serialnumber", "eosserialnumber"})
    if (const auto serial = read_setting(open, name); serial && !serial->value.empty()) return serial->value;
  return "";
}

std::string list_of_gphoto(const std::vector<GphotoIdentity>& cameras) {
  if (cameras.empty())
    return "no camera answers; check the cable, that the camera is switched on and that no other program has "
           "opened it (docs/guide/dslr.md)";
  std::string text = "there are";
  for (const GphotoIdentity& camera : cameras) text += " " + camera.model + " (" + camera.port + ")";
  return text;
}

/// The camera that `text` names. Throws InputError.
GphotoIdentity find_gphoto_camera(const std::string& text) {
  const auto cameras = find_gphoto_cameras();
  std::vector<GphotoIdentity> found;
  for (const GphotoIdentity& camera : cameras)
    if (text.empty() || text == camera.model || text == camera.port) found.push_back(camera);
  for (const GphotoIdentity& camera : cameras)
    if (found.empty()) try {
        if (abilities_of(camera).serial == text) found.push_back(camera);
      } catch (const DeviceError&) {  // in use by another program
      }
  if (found.size() == 1) return found.front();
  throw InputError("camera 'gphoto:", text,
                   "': ", found.empty() ? "no camera has this name" : "several cameras have this name", "; ",
                   list_of_gphoto(cameras));
}

DeviceError opening_error(const std::string& camera, const GphotoFailure& failure) {
  if (failure.code == GP_ERROR_IO_USB_CLAIM)
    return {camera, EBUSY,
            failure.text +
                "; another program holds the camera: unmount it in the file manager, or end "
                "gvfs-gphoto2-volume-monitor"};
  return {camera, ENODEV, failure.text};
}

constexpr const char* shutter_names[] = {"shutterspeed2", "shutterspeed"};  // Nikon rounds the second
constexpr const char* aperture_names[] = {"aperture", "f-number"};
constexpr const char* format_names[] = {"imageformat", "imagequality"};
constexpr const char* mode_names[] = {"expprogram", "autoexposuremode"};

/// Shutter time that a choice such as "1/60", "0.0125s", "0.3" or "2\"" names; nullopt for "bulb" and others
/// that name none.
std::optional<Seconds> shutter_time(const std::string& choice) {
  char* end = nullptr;
  double seconds = std::strtod(choice.c_str(), &end);
  if (end == choice.c_str()) return std::nullopt;
  if (*end == '/') {
    const char* denominator = end + 1;
    const double below = std::strtod(denominator, &end);
    if (end == denominator || !(below > 0.0)) return std::nullopt;
    seconds /= below;
  }
  if (*end == 's' || *end == '"') ++end;
  if (*end != 0 || !(seconds > 0.0 && std::isfinite(seconds))) return std::nullopt;
  return Seconds(seconds);
}

struct Shutter {
  Seconds time;
  std::string choice;
};

class GphotoCamera final : public TetheredCamera {
 public:
  GphotoCamera(GphotoCameraOptions given, RunContext context)
      : options_(std::move(given)), run_(std::move(context)) {
    identity_ = find_gphoto_camera(options_.device);
    description_.name = identity_.model;
    try {
      open_ = std::make_unique<Connection>(identity_);
      identity_.serial = serial_of(*open_);
      apply_settings();
    } catch (const GphotoFailure& failure) {
      throw opening_error(identity_.model, failure);
    }
    learn_shape();
  }

  CameraDescription describe() const override { return description_; }

  TimePoint set_exposure(Seconds exposure, double gain) override {
    if (gain != 1.0)
      throw InputError("camera '", description_.name, "' has gain 1 alone, not ", gain,
                       "; give iso in [controls] instead");
    shutter_ = shutter_of(exposure);
    const auto set = [&] { write_setting(*open_, description_.name, shutter_name_, shutter_.choice); };
    try {
      set();
    } catch (const GphotoFailure& failure) {
      int attempt = 1;
      mend(failure, attempt, std::chrono::steady_clock::now());  // a reconnection sets the time, too
      try {
        set();
      } catch (const GphotoFailure& again) {
        fail(EIO, again.text, "; run the same command with --resume");
      }
    }
    return monotonic_now();
  }

  void begin_after(TimePoint instant) override { earliest_ = instant; }

  RawFrame next_frame(Seconds) override try {
    return take();
  } catch (const GphotoFailure& failure) {  // of what is asked beside the photograph itself
    fail(EIO, failure.text, "; run the same command with --resume");
  }

 private:
  GphotoCameraOptions options_;
  RunContext run_;
  GphotoIdentity identity_;
  std::unique_ptr<Connection> open_;
  TemporaryFolder downloads_;
  CameraDescription description_;
  std::string shutter_name_;
  std::vector<Shutter> shutters_;  // in growing order
  Shutter shutter_{};
  std::optional<double> iso_, aperture_;  // as set; nullopt: not known
  bool keeps_on_card_ = false;
  bool told_of_second_file_ = false, told_of_missing_exif_ = false;
  TimePoint earliest_{};
  std::uint64_t sequence_ = 0;

  template <class... Parts>
  [[noreturn]] void fail(int number, const Parts&... text) const {
    throw DeviceError(description_.name, number, concatenated(text...));
  }

  std::optional<GphotoSetting> first_of(std::span<const char* const> names) {
    for (const char* name : names)
      if (auto setting = read_setting(*open_, name)) return setting;
    return std::nullopt;
  }

  bool is_given(const std::string& name) const { return options_.controls.contains(name); }

  /// Makes the camera choose nothing by itself, then makes the wanted settings.
  void apply_settings() {
    if (const auto mode = first_of(mode_names); mode && lower_case(mode->value).substr(0, 1) != "m") {
      const auto manual = std::ranges::find_if(mode->choices, [](const std::string& choice) {
        return choice == "M" || lower_case(choice) == "manual";
      });
      if (manual == mode->choices.end() || !mode->is_writable)
        throw InputError("camera '" + description_.name + "' is in mode '" + mode->value +
                         "' and would choose exposures by itself; turn its mode dial to M (manual)");
      write_setting(*open_, description_.name, mode->name, *manual);
    }
    prefer("autoiso", {"off"});
    prefer("isoauto", {"off"});
    prefer("focusmode", {"manual", "mf"});
    prefer("capturetarget", {"internal ram", "sdram"});
    for (const char* name : format_names) prefer_raw(name);
    for (const auto& [name, value] : options_.controls) {
      if (std::ranges::find(shutter_names, name) != std::end(shutter_names))
        throw InputError("[controls] ", name,
                         ": exposure times are planned; give them in [exposures] as 'seconds'");
      write_setting(*open_, description_.name, name, value);
    }
    const auto target = options_.controls.find("capturetarget");
    keeps_on_card_ = target != options_.controls.end() && has_word(lower_case(target->second), {"card"});
    if (const auto speed = read_setting(*open_, "iso")) {
      iso_ = number_in(speed->value);
      if (!iso_)
        throw InputError("camera '" + description_.name + "': iso is '" + speed->value +
                         "'; give a number in [controls], the lowest if possible: " + listed(speed->choices));
    }
    if (const auto stop = first_of(aperture_names)) aperture_ = number_in(stop->value);
    read_shutters();
    check_battery();
  }

  /// Sets the first choice that contains one of the words, unless the user has given another.
  void prefer(const std::string& name, std::initializer_list<const char*> words) {
    if (is_given(name)) return;
    const auto setting = read_setting(*open_, name);
    if (!setting || has_word(lower_case(setting->value), words)) return;
    for (const std::string& choice : setting->choices)
      if (setting->is_writable && has_word(lower_case(choice), words))
        return write_setting(*open_, description_.name, name, choice);
    if (name == "focusmode")
      run_.note(description_.name + ": focusmode is '" + setting->value +
                "'; switch the lens to manual focus, so that no photograph waits for focus");
  }

  void prefer_raw(const std::string& name) {
    if (is_given(name)) return;
    const auto setting = read_setting(*open_, name);
    if (!setting) return;
    const auto is_raw = [](const std::string& choice) {
      const std::string text = lower_case(choice);
      return has_word(text, {"raw", "nef"}) && !has_word(text, {"+", "jpeg", "jpg"});
    };
    if (is_raw(setting->value)) return;
    const auto raw = std::ranges::find_if(setting->choices, is_raw);
    if (raw != setting->choices.end()) write_setting(*open_, description_.name, name, *raw);
  }

  void read_shutters() {
    const auto setting = first_of(shutter_names);
    if (!setting || setting->choices.empty())
      throw InputError("camera '", description_.name,
                       "' offers no shutter times over the cable; turn its mode dial to M (manual)");
    shutter_name_ = setting->name;
    shutters_.clear();
    for (const std::string& choice : setting->choices)
      if (const auto time = shutter_time(choice)) shutters_.push_back({*time, choice});
    if (shutters_.empty())
      throw InputError("camera '", description_.name, "': ", shutter_name_, " has no times, only ",
                       listed(setting->choices));
    std::ranges::sort(shutters_, {}, &Shutter::time);
    if (shutter_.choice.empty()) {
      const auto now = std::ranges::find(shutters_, setting->value, &Shutter::choice);
      shutter_ = now != shutters_.end() ? *now : shutters_[shutters_.size() / 2];
    }
    write_setting(*open_, description_.name, shutter_name_, shutter_.choice);
  }

  void check_battery() {
    const auto battery = read_setting(*open_, "batterylevel");
    if (!battery) return;
    const auto percent = number_in(battery->value);
    if (has_word(lower_case(battery->value), {"low"}) || (percent && *percent <= low_battery_percent))
      run_.note(description_.name + ": the battery is at '" + battery->value +
                "'; replace it soon, or use a mains adapter");
  }

  void pause(Seconds length) const {
    const auto start = std::chrono::steady_clock::now();
    while (seconds_since(start) < length.count()) {
      run_.throw_if_stopped();
      std::this_thread::sleep_for(std::min(gphoto_slice, length));
    }
  }

  /// Waits for the camera to come back, with all its settings.
  void reconnect(const GphotoFailure& failure) {
    const DeviceError gone(
        description_.name, ENODEV,
        "was disconnected or switched off (" + failure.text + "), and did not come back within " +
            seconds_text(options_.replug_patience) +
            "; check cable, battery and automatic power-off, then run the same command with --resume");
    open_.reset();
    wait_for_replug(gone, description_.name, options_.replug_patience, run_, [&] {
      for (const GphotoIdentity& camera : find_gphoto_cameras()) try {
          open_.reset();
          if (camera.model != identity_.model) continue;
          open_ = std::make_unique<Connection>(camera);
          if (serial_of(*open_) != identity_.serial) continue;
          identity_.port = camera.port;
          apply_settings();
          return true;
        } catch (const GphotoFailure&) {  // not ready yet
        }
      open_.reset();
      return false;
    });
  }

  std::string download(const CameraFilePath& path) {
    for (int attempt = 1;; ++attempt) {
      CameraFile* file = nullptr;
      open_->check(gp_file_new(&file), "memory for a file");
      const FileHandle owned(file);
      const int code = gp_camera_file_get(open_->camera(), path.folder, path.name, GP_FILE_TYPE_NORMAL, file,
                                          open_->context());
      const char* data = nullptr;
      unsigned long size = 0;
      if (code >= GP_OK && gp_file_get_data_and_size(file, &data, &size) >= GP_OK && size > 0)
        return {data, size};
      const bool is_last = attempt == download_attempts || trouble_of({code, ""}) == Trouble::gone;
      if (is_last) open_->check(code < GP_OK ? code : int{GP_ERROR_CORRUPTED_DATA}, "the download failed");
      open_->forget_messages();
      ++troubles_.damaged;
      run_.note(description_.name, ": a download failed; it is tried again");
    }
  }

  /// Reads what else the camera has to say, which some need before the next photograph.
  void take_events(const CameraFilePath& taken) {
    constexpr int max_events = 64, milliseconds = 1;
    for (int i = 0; i < max_events; ++i) {
      CameraEventType type{};
      void* data = nullptr;
      if (gp_camera_wait_for_event(open_->camera(), milliseconds, &type, &data, open_->context()) < GP_OK)
        break;
      const std::unique_ptr<void, Freed<std::free>> owned(data);
      if (type == GP_EVENT_TIMEOUT) break;
      if (type != GP_EVENT_FILE_ADDED || told_of_second_file_) continue;
      const auto* path = static_cast<const CameraFilePath*>(data);
      if (std::string(path->name) == taken.name) continue;
      told_of_second_file_ = true;
      run_.note(description_.name + ": makes a second file, " + path->name + ", beside " + taken.name +
                ", which is not used; choose one image format");
    }
    open_->forget_messages();
  }

  /// One photograph. Throws GphotoFailure, FormatError or DeviceError.
  BracketFile shoot(TimePoint& start) {
    CameraFilePath path;
    start = monotonic_now();
    open_->check(gp_camera_capture(open_->camera(), GP_CAPTURE_IMAGE, &path, open_->context()),
                 "the photograph failed");
    const std::string bytes = download(path);
    // Left on a camera that is full the next time, at worst.
    if (!keeps_on_card_) gp_camera_file_delete(open_->camera(), path.folder, path.name, open_->context());
    take_events(path);
    const fs::path file = downloads_.path() / ("photograph" + lower_case(fs::path(path.name).extension()));
    {
      std::ofstream out(file, std::ios::binary);
      out.write(bytes.data(), static_cast<std::streamsize>(bytes.size())).flush();
      if (!out) throw DeviceError(file.string(), errno, "cannot be written; free some space");
    }
    return read_bracket_file(file);
  }

  /// A photograph, whatever goes wrong on the way that can be mended.
  BracketFile photograph(TimePoint& start) {
    const auto first = std::chrono::steady_clock::now();
    for (int attempt = 1;;) {
      run_.throw_if_stopped();
      try {
        return shoot(start);
      } catch (const FormatError& error) {
        if (attempt++ == photograph_attempts)
          fail(EIO, "sends files that cannot be read (", error.what(),
               "); use another cable or image format, then run the same command with --resume");
        ++troubles_.damaged;
        run_.note(description_.name, ": a damaged file was discarded");
      } catch (const GphotoFailure& failure) {
        mend(failure, attempt, first);
      }
    }
  }

  void mend(const GphotoFailure& failure, int& attempt, std::chrono::steady_clock::time_point first) {
    switch (trouble_of(failure)) {
      case Trouble::gone:
        reconnect(failure);
        return;
      case Trouble::busy:
        if (seconds_since(first) > busy_patience.count())
          fail(EBUSY, failure.text,
               "; the camera stays busy: switch off mirror lock-up, self-timer and open menus, "
               "then run the same command with --resume");
        pause(Seconds(0.5));
        return;
      case Trouble::full:
        fail(EIO, failure.text,
             "; its card is full: insert an empty card, or leave out capturetarget, then run the "
             "same command with --resume");
      case Trouble::unfocused:
        fail(EIO, failure.text,
             "; the camera could not focus: switch the lens to manual focus, focus, then run the "
             "same command with --resume");
      case Trouble::powerless:
        fail(EIO, failure.text,
             "; the battery is empty: replace it without moving the camera, then run the same "
             "command with --resume");
      case Trouble::other:
        if (attempt++ == photograph_attempts) fail(EIO, failure.text, "; run the same command with --resume");
        ++troubles_.damaged;
        run_.note(description_.name, ": ", failure.text, "; the photograph is taken again");
    }
  }

  /// What the file says of its exposure must be what was set.
  void check_metadata(const BracketFile& file) {
    const auto differs = [](double a, double b) {
      return std::abs(std::log(a / b)) > std::log1p(sixth_of_a_stop);
    };
    if (!file.exposure && !std::exchange(told_of_missing_exif_, true))
      run_.note(description_.name, ": its files state no exposure time, so it cannot be checked");
    if (file.exposure && differs(file.exposure->count(), shutter_.time.count()))
      fail(EINVAL, "was set to ", shutter_.choice, " (", seconds_text(shutter_.time),
           "), but its file states ", seconds_text(*file.exposure),
           "; turn the mode dial to M and switch off bracketing and automatic modes");
    if (file.settings.iso && iso_ && differs(*file.settings.iso, *iso_))
      fail(EINVAL, "was set to ISO ", *iso_, ", but its file states ISO ", *file.settings.iso,
           "; switch off automatic ISO");
    if (file.settings.f_number && aperture_ &&
        differs(*file.settings.f_number * *file.settings.f_number, *aperture_ * *aperture_))
      fail(EINVAL, "was set to f/", *aperture_, ", but its file states f/", *file.settings.f_number,
           "; turn the mode dial to M");
  }

  RawFrame cut(RawFrame frame) const {
    if (!options_.window) return frame;
    const FrameWindow& window = *options_.window;
    const bool odd = is_bayer(frame.layout) && (window.x % 2 || window.y % 2);
    if (odd || window.width < 1 || window.height < 1 || window.x + window.width > frame.width ||
        window.y + window.height > frame.height)
      throw InputError("camera '", description_.name, "': the window does not fit its photographs of ",
                       frame.width, "×", frame.height, " pixels; of RAW files, left and top must be even");
    const int channels = frame.layout == PixelLayout::rgb ? 3 : 1;
    std::vector<std::uint16_t> samples;
    samples.reserve(std::size_t{1} * window.width * window.height * channels);
    for (int y = 0; y < window.height; ++y) {
      const auto row =
          frame.samples.begin() + (std::ptrdiff_t{window.y + y} * frame.width + window.x) * channels;
      samples.insert(samples.end(), row, row + std::ptrdiff_t{window.width} * channels);
    }
    frame.width = window.width;
    frame.height = window.height;
    frame.samples = std::move(samples);
    return frame;
  }

  void learn_shape() {
    TimePoint start;
    const BracketFile file = photograph(start);
    if (file.bits == 0)
      throw InputError("camera '", description_.name, "' makes files with floating-point samples");
    check_metadata(file);
    description_.bits = file.bits;
    if (file.raw_levels) {
      description_.bits = 1;
      while (std::exp2(description_.bits) - 1.0 < file.raw_levels->saturation) ++description_.bits;
    }
    const RawFrame frame = cut(file.frame);
    description_.width = frame.width;
    description_.height = frame.height;
    description_.layout = frame.layout;
    for (const Shutter& each : shutters_) description_.exposures.push_back(each.time);
    description_.shortest_exposure = shutters_.front().time;
    description_.longest_exposure = shutters_.back().time;
    description_.takes_photographs = true;
    if (!file.is_raw)
      run_.note(description_.name,
                ": makes JPEG files, which have a tone curve and 8 bits; choose RAW where the camera has it, "
                "else the calibration file must hold the response");
    const auto balance = read_setting(*open_, "whitebalance");
    if (!file.is_raw && balance && has_word(lower_case(balance->value), {"auto"}))
      run_.note(description_.name,
                ": whitebalance is automatic and changes the colours of JPEG files; give it in [controls]");
  }

  Shutter shutter_of(Seconds exposure) const {
    const Seconds nearest = settable_exposure(exposure, description_);
    if (std::abs(nearest / exposure - 1.0) > 0.01)
      throw InputError("camera '", description_.name, "' has no shutter time of ", seconds_text(exposure),
                       "; the nearest is ", seconds_text(nearest));
    return *std::ranges::find(shutters_, nearest, &Shutter::time);
  }

  RawFrame take() {
    const TimePoint now = monotonic_now();
    if (earliest_ > now) pause(earliest_ - now);
    TimePoint start;
    BracketFile file = photograph(start);
    check_metadata(file);
    RawFrame frame = cut(std::move(file.frame));
    const auto top = static_cast<std::uint16_t>((1u << description_.bits) - 1);
    if (std::ranges::any_of(frame.samples, [&](std::uint16_t sample) { return sample > top; }))
      fail(EINVAL, "made a file with samples of more than ", description_.bits,
           " bits; do not change its image format during a session");
    frame.exposure_start = start;
    frame.exposure = shutter_.time;
    frame.gain = 1.0;
    frame.sequence = ++sequence_;
    if (sequence_ % photographs_per_battery_check == 0) check_battery();
    return frame;
  }
};

}  // namespace

std::vector<GphotoIdentity> find_gphoto_cameras() {
  std::vector<GphotoIdentity> found;
  CameraList* list = nullptr;
  if (gp_list_new(&list) < GP_OK) return found;
  const CameraListHandle owned(list);
  GPContext* context = gp_context_new();
  const int count = gp_camera_autodetect(list, context);
  gp_context_unref(context);
  for (int i = 0; i < count; ++i) {
    const char *model = nullptr, *port = nullptr;
    gp_list_get_name(list, i, &model);
    gp_list_get_value(list, i, &port);
    if (model && port) found.push_back({model, port, ""});
  }
  return found;
}

GphotoAbilities abilities_of(const GphotoIdentity& camera) try {
  Connection open(camera);
  GphotoAbilities abilities;
  abilities.serial = serial_of(open);
  for (const char* name : {"shutterspeed", "shutterspeed2", "aperture", "f-number", "iso", "whitebalance",
                           "imageformat", "imagequality", "imagesize", "capturetarget", "expprogram",
                           "autoexposuremode", "focusmode", "batterylevel"})
    if (auto setting = read_setting(open, name)) abilities.settings.push_back(std::move(*setting));
  return abilities;
} catch (const GphotoFailure& failure) {
  throw opening_error(camera.model, failure);
}

std::unique_ptr<TetheredCamera> open_camera(GphotoCameraOptions options, RunContext run) {
  return std::make_unique<GphotoCamera>(std::move(options), std::move(run));
}

}  // namespace refield
