// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace refield {

struct DrmModeInfo {
  int width = 0;
  int height = 0;
  double refresh_hz = 0.0;
  bool is_preferred = false;

  std::string text() const;  ///< "1920x1080@60.00"
};

/// A place where a monitor can be plugged in.
struct DrmConnectorInfo {
  std::filesystem::path card;  ///< /dev/dri/card0
  std::string driver;
  std::string name;  ///< "HDMI-A-1"
  std::uint32_t id = 0;
  bool is_connected = false;
  std::vector<DrmModeInfo> modes;
};

/// Connectors of this machine's displays. Cards that may not be opened are left out.
std::vector<DrmConnectorInfo> find_drm_connectors();

/// The connector that `name` ("HDMI-A-1") or `card` and `name` name; empty: the first one with a monitor.
/// Throws InputError when there is none, listing those that are there, and DeviceError when no monitor is
/// plugged in.
DrmConnectorInfo find_drm_connector(const std::string& card, const std::string& name);

/// Place in `connector.modes` of `text`: "1920x1080", "1920x1080@60", or empty for the preferred one. Throws
/// InputError listing the modes.
std::size_t find_drm_mode(const DrmConnectorInfo& connector, const std::string& text);

}  // namespace refield
