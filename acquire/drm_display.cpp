// SPDX-License-Identifier: Apache-2.0
#include "acquire/drm_display.h"

#include <fcntl.h>
#include <unistd.h>
#include <xf86drm.h>
#include <xf86drmMode.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <memory>

#include "core/errors.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

constexpr double refresh_tolerance_hz = 0.51;  // "@60" means 59.94, too

double refresh_of(const drmModeModeInfo& mode) {
  return mode.htotal && mode.vtotal ? 1000.0 * mode.clock / (static_cast<double>(mode.htotal) * mode.vtotal)
                                    : mode.vrefresh;
}

std::string driver_of(int descriptor) {
  const std::unique_ptr<drmVersion, decltype(&drmFreeVersion)> version(drmGetVersion(descriptor),
                                                                       drmFreeVersion);
  return version ? version->name : "";
}

DrmConnectorInfo info_of(const drmModeConnector& connector) {
  const char* type = drmModeGetConnectorTypeName(connector.connector_type);
  DrmConnectorInfo info;
  info.name = std::string(type ? type : "Unknown") + "-" + std::to_string(connector.connector_type_id);
  info.id = connector.connector_id;
  info.is_connected = connector.connection == DRM_MODE_CONNECTED;
  for (int i = 0; i < connector.count_modes; ++i) {
    const drmModeModeInfo& mode = connector.modes[i];
    info.modes.push_back(
        {mode.hdisplay, mode.vdisplay, refresh_of(mode), (mode.type & DRM_MODE_TYPE_PREFERRED) != 0});
  }
  return info;
}

void add_connectors_of(const fs::path& card, std::vector<DrmConnectorInfo>& found) {
  const int descriptor = ::open(card.c_str(), O_RDWR | O_CLOEXEC);
  if (descriptor < 0) return;
  const std::unique_ptr<drmModeRes, decltype(&drmModeFreeResources)> resources(
      drmModeGetResources(descriptor), drmModeFreeResources);
  const std::string driver = driver_of(descriptor);
  for (int i = 0; resources && i < resources->count_connectors; ++i) {
    const std::unique_ptr<drmModeConnector, decltype(&drmModeFreeConnector)> connector(
        drmModeGetConnector(descriptor, resources->connectors[i]), drmModeFreeConnector);
    if (!connector || connector->connector_type == DRM_MODE_CONNECTOR_WRITEBACK) continue;
    found.push_back(info_of(*connector));
    found.back().card = card;
    found.back().driver = driver;
  }
  ::close(descriptor);
}

}  // namespace

std::string DrmModeInfo::text() const {
  char text[64];
  std::snprintf(text, sizeof text, "%dx%d@%.2f", width, height, refresh_hz);
  return text;
}

std::vector<DrmConnectorInfo> find_drm_connectors() {
  std::vector<fs::path> cards;
  std::error_code none;
  for (const auto& entry : fs::directory_iterator("/dev/dri", none))
    if (entry.path().filename().string().starts_with("card")) cards.push_back(entry.path());
  std::ranges::sort(cards);
  std::vector<DrmConnectorInfo> found;
  for (const fs::path& card : cards) add_connectors_of(card, found);
  return found;
}

DrmConnectorInfo find_drm_connector(const std::string& card, const std::string& name) {
  const auto connectors = find_drm_connectors();
  std::string list = connectors.empty() ? " none (check that you may open /dev/dri/card*, group video)" : "";
  for (const DrmConnectorInfo& connector : connectors) {
    const bool is_meant =
        (card.empty() || connector.card == card) && (name.empty() || connector.name == name);
    list += " " + connector.name + " of " + connector.card.string() +
            (connector.is_connected ? "" : " (no monitor)");
    if (!is_meant || (name.empty() && !connector.is_connected)) continue;
    if (!connector.is_connected)
      throw DeviceError(connector.name, ENODEV, "no monitor is plugged in, or it is switched off");
    return connector;
  }
  throw InputError("monitor '" + (card.empty() ? "" : card + " ") + name +
                   "': the connector does not exist; connectors:" + list);
}

std::size_t find_drm_mode(const DrmConnectorInfo& connector, const std::string& text) {
  int width = 0, height = 0;
  double refresh = 0.0;
  const int parts = std::sscanf(text.c_str(), "%dx%d@%lf", &width, &height, &refresh);
  std::string list;
  for (std::size_t i = 0; i < connector.modes.size(); ++i) {
    const DrmModeInfo& mode = connector.modes[i];
    const bool matches = text.empty()
                             ? mode.is_preferred
                             : parts >= 2 && mode.width == width && mode.height == height &&
                                   (parts < 3 || std::abs(mode.refresh_hz - refresh) < refresh_tolerance_hz);
    if (matches) return i;
    list += " " + mode.text();
  }
  if (text.empty() && !connector.modes.empty()) return 0;
  throw InputError(connector.name + ": has no mode '" + text + "'; it has" + list);
}

}  // namespace refield
