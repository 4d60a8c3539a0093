// SPDX-License-Identifier: Apache-2.0
#include <cstdio>

#include "acquire/devices/gpio_trigger.h"
#include "acquire/devices/monitors.h"
#include "acquire/devices/pixel_formats.h"
#include "acquire/devices/tethered_camera.h"
#include "acquire/devices/v4l2_device.h"
#include "cli/acquire/session_rig.h"
#include "cli/common/options.h"
#include "cli/verbs.h"
#include "core/base/files.h"
#include "core/base/json.h"

namespace refield::cli {

namespace {

Json json_of(const V4l2FormatInfo& format) {
  const auto known = find_v4l2_format(format.fourcc);
  Json sizes = Json::array();
  for (const V4l2FrameSize& size : format.sizes)
    sizes.push_back({{"width", size.width}, {"height", size.height}, {"rates", size.rates}});
  return {{"format", fourcc_text(format.fourcc)},
          {"description", format.name},
          {"supported", known.has_value()},
          {"raw", known && known->is_raw()},
          {"layout", known ? Json(layout_name(known->layout)) : Json()},
          {"bits", known ? Json(known->bits) : Json()},
          {"sizes", sizes}};
}

Json json_of(const V4l2ControlInfo& control) {
  Json result = {{"name", control.name},           {"value", control.value},
                 {"default", control.standard},    {"lowest", control.lowest},
                 {"highest", control.highest},     {"step", control.step},
                 {"writable", control.is_writable}};
  if (!control.menu.empty()) result["choices"] = control.menu;
  return result;
}

Json cameras() {
  Json list = Json::array();
  for (const V4l2Identity& camera : find_v4l2_cameras()) try {
      const V4l2Device device(camera.node);
      Json formats = Json::array(), controls = Json::array();
      for (const V4l2FormatInfo& format : formats_of(device)) formats.push_back(json_of(format));
      for (const V4l2ControlInfo& control : controls_of(device)) controls.push_back(json_of(control));
      list.push_back({{"node", camera.node.string()},
                      {"card", camera.card},
                      {"bus", camera.bus},
                      {"driver", camera.driver},
                      {"formats", formats},
                      {"controls", controls}});
    } catch (const DeviceError&) {  // unplugged meanwhile
    }
  return list;
}

Json genicam_cameras() {
  Json list = Json::array();
  for (const GenicamIdentity& camera : find_genicam_cameras()) {
    Json entry = {{"device", "genicam:" + camera.serial},
                  {"vendor", camera.vendor},
                  {"model", camera.model},
                  {"serial", camera.serial},
                  {"address", camera.address},
                  {"protocol", camera.protocol}};
    try {
      const GenicamAbilities abilities = abilities_of(camera);
      Json formats = Json::array(), features = Json::array();
      for (const std::string& format : abilities.formats)
        formats.push_back({{"format", format}, {"supported", find_genicam_format(format).has_value()}});
      for (const GenicamFeature& feature : abilities.features)
        features.push_back({{"name", feature.name}, {"value", feature.value}, {"limits", feature.limits}});
      entry["formats"] = formats;
      entry["features"] = features;
    } catch (const DeviceError& error) {
      entry["error"] = error.what();
    }
    list.push_back(entry);
  }
  return list;
}

Json gphoto_cameras() {
  Json list = Json::array();
  for (const GphotoIdentity& camera : find_gphoto_cameras()) {
    Json entry = {{"device", "gphoto:" + camera.model}, {"model", camera.model}, {"port", camera.port}};
    try {
      const GphotoAbilities abilities = abilities_of(camera);
      entry["serial"] = abilities.serial;
      Json settings = Json::array();
      for (const GphotoSetting& setting : abilities.settings)
        settings.push_back({{"name", setting.name},
                            {"value", setting.value},
                            {"writable", setting.is_writable},
                            {"choices", setting.choices}});
      entry["settings"] = settings;
    } catch (const DeviceError& error) {
      entry["error"] = error.what();
    }
    list.push_back(entry);
  }
  return list;
}

Json monitors() {
  Json list = Json::array();
  for (const DrmConnectorInfo& connector : find_drm_connectors()) {
    Json modes = Json::array();
    for (const DrmModeInfo& mode : connector.modes)
      modes.push_back({{"mode", mode.text()}, {"preferred", mode.is_preferred}});
    list.push_back({{"connector", connector.name},
                    {"card", connector.card.string()},
                    {"driver", connector.driver},
                    {"connected", connector.is_connected},
                    {"modes", modes}});
  }
  return list;
}

/// Of the desktop, where there is one.
Json window_displays_of_desktop() {
  Json list = Json::array();
  try {
    for (const WindowDisplay& display : window_displays())
      list.push_back({{"display", list.size()},
                      {"name", display.name},
                      {"width", display.width},
                      {"height", display.height},
                      {"refresh_hz", display.refresh_hz}});
  } catch (const DeviceError&) {  // no desktop
  }
  return list;
}

Json gpio_chips() {
  Json list = Json::array();
  for (const GpioChipInfo& chip : find_gpio_chips())
    list.push_back({{"chip", chip.path},
                    {"name", chip.name},
                    {"label", chip.label},
                    {"lines", chip.lines},
                    {"named_lines", chip.named_lines}});
  return list;
}

/// What a person can do where devices are missing.
void print_remedies(const Json& devices) {
  if (devices["cameras"].empty() && devices["genicam_cameras"].empty() && devices["gphoto_cameras"].empty())
    std::printf(
        "No camera was found. Check that it is connected and that you may open /dev/video* (group video); of "
        "a GenICam camera, that its address is of the computer's network (docs/guide/genicam.md); of a DSLR, "
        "that it is switched on and that no file manager has opened it (docs/guide/dslr.md).\n");
  if (devices["monitors"].empty())
    std::printf("No display connector was found. Check that you may open /dev/dri/card* (group video).\n");
}

void write_rig_file(const fs::path& file, const Common& common) {
  std::error_code error;
  if (fs::exists(fs::symlink_status(file, error)))
    throw InputError(file, ": already exists; give another name or remove the file");
  write_text_atomically(file, session_template());
  if (common.json) return print_json({{"rig", file.string()}});
  std::printf(
      "%s: edit [camera] and [monitor], then\n"
      "  refield acquire lights --starter -o lights\n"
      "  refield acquire calibrate %s\n"
      "  refield acquire run %s\n",
      file.c_str(), file.c_str(), file.c_str());
}

}  // namespace

void add_acquire_devices(CLI::App& group, const Common& common, Action& action) {
  CLI::App* verb = group.add_subcommand(
      "devices",
      "List cameras, monitors, displays and GPIO chips with their modes.\n"
      "\n"
      "Prints cameras (V4L2) with formats, sizes, rates and controls, GenICam cameras with formats and "
      "features, DSLRs with settings, monitors (KMS) with modes, the displays of the desktop and GPIO chips, "
      "with the names that rig files use (docs/reference/devices.md). With -o, writes a rig file with all "
      "keys, units and default values for 'refield acquire calibrate' and 'refield acquire run' instead; "
      "edit it before use. A manual capture (docs/guide/capture.md) does not need one.\n"
      "\n"
      "Examples:\n"
      "  refield acquire devices\n"
      "  refield acquire devices -o rig.toml");
  const auto file = std::make_shared<fs::path>();
  verb->add_option("-o,--output", *file, "Rig file to write (.toml)");
  verb->callback([file, &common, &action] {
    action = [file, &common] {
      if (!file->empty()) return write_rig_file(*file, common);
      const Json devices = {{"cameras", cameras()},
                            {"genicam_cameras", genicam_cameras()},
                            {"gphoto_cameras", gphoto_cameras()},
                            {"monitors", monitors()},
                            {"window_displays", window_displays_of_desktop()},
                            {"gpio_chips", gpio_chips()}};
      if (common.json) return print_json(devices);
      print_figures(devices);
      print_remedies(devices);
    };
  });
}

}  // namespace refield::cli
