// SPDX-License-Identifier: Apache-2.0
#include "acquire/devices/drm_monitor.h"

#include <drm_fourcc.h>
#include <fcntl.h>
#include <poll.h>
#include <sys/mman.h>
#include <unistd.h>
#include <xf86drm.h>
#include <xf86drmMode.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <string_view>
#include <thread>

#include "core/base/number_text.h"

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

using Property = std::unique_ptr<drmModePropertyRes, decltype(&drmModeFreeProperty)>;

/// Calls use(property, value) for each property of an object.
template <class Use>
void for_each_property(int descriptor, std::uint32_t object, std::uint32_t type, const Use& use) {
  const std::unique_ptr<drmModeObjectProperties, decltype(&drmModeFreeObjectProperties)> properties(
      drmModeObjectGetProperties(descriptor, object, type), drmModeFreeObjectProperties);
  for (std::uint32_t i = 0; properties && i < properties->count_props; ++i) {
    const Property property(drmModeGetProperty(descriptor, properties->props[i]), drmModeFreeProperty);
    if (property) use(*property, properties->prop_values[i]);
  }
}

class Commit {
 public:
  explicit Commit(int descriptor)
      : descriptor_(descriptor), request_(drmModeAtomicAlloc(), drmModeAtomicFree) {}

  /// Properties that the driver does not have are left out.
  void put(std::uint32_t object, std::uint32_t type, std::string_view name, std::uint64_t value) {
    for_each_property(descriptor_, object, type, [&](const drmModePropertyRes& property, std::uint64_t) {
      if (name == property.name) drmModeAtomicAddProperty(request_.get(), object, property.prop_id, value);
    });
  }
  void put_choice(std::uint32_t object, std::uint32_t type, std::string_view name, std::string_view choice) {
    for_each_property(descriptor_, object, type, [&](const drmModePropertyRes& property, std::uint64_t) {
      if (name != property.name) return;
      for (int i = 0; i < property.count_enums; ++i)
        if (choice == property.enums[i].name)
          drmModeAtomicAddProperty(request_.get(), object, property.prop_id, property.enums[i].value);
    });
  }
  int make(std::uint32_t flags, void* event) {
    return drmModeAtomicCommit(descriptor_, request_.get(), flags, event) == 0 ? 0 : errno;
  }

 private:
  int descriptor_;
  std::unique_ptr<drmModeAtomicReq, decltype(&drmModeAtomicFree)> request_;
};

constexpr Seconds longest_flip{2.0};
constexpr int poll_ms = 100;

template <class T>
using Owned = std::unique_ptr<T, void (*)(T*)>;

Owned<drmModeConnector> connector_now(int descriptor, std::uint32_t id, bool probe) {
  return {probe ? drmModeGetConnector(descriptor, id) : drmModeGetConnectorCurrent(descriptor, id),
          drmModeFreeConnector};
}

void note_flip(int /*descriptor*/, unsigned /*sequence*/, unsigned seconds, unsigned microseconds,
               unsigned /*crtc*/, void* event) {
  *static_cast<std::optional<TimePoint>*>(event) =
      TimePoint(std::chrono::seconds(seconds) + std::chrono::microseconds(microseconds));
}

}  // namespace

std::string DrmModeInfo::text() const {
  return formatted("%dx%d@%.2f", width, height, refresh_hz);
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

std::uint32_t primary_plane(int descriptor, std::uint32_t crtc_index) {
  const std::unique_ptr<drmModePlaneRes, decltype(&drmModeFreePlaneResources)> planes(
      drmModeGetPlaneResources(descriptor), drmModeFreePlaneResources);
  for (std::uint32_t i = 0; planes && i < planes->count_planes; ++i) {
    const std::unique_ptr<drmModePlane, decltype(&drmModeFreePlane)> plane(
        drmModeGetPlane(descriptor, planes->planes[i]), drmModeFreePlane);
    if (!plane || !(plane->possible_crtcs >> crtc_index & 1u)) continue;
    bool is_primary = false;
    for_each_property(descriptor, plane->plane_id, DRM_MODE_OBJECT_PLANE,
                      [&](const drmModePropertyRes& property, std::uint64_t value) {
                        is_primary |=
                            std::string_view(property.name) == "type" && value == DRM_PLANE_TYPE_PRIMARY;
                      });
    if (is_primary) return plane->plane_id;
  }
  return 0;
}

int commit_mode(int descriptor, const DrmPipeline& pipeline, std::uint32_t frame_buffer) {
  Commit commit(descriptor);
  commit.put(pipeline.connector, DRM_MODE_OBJECT_CONNECTOR, "CRTC_ID", pipeline.crtc);
  commit.put_choice(pipeline.connector, DRM_MODE_OBJECT_CONNECTOR, "Broadcast RGB", "Full");
  commit.put(pipeline.crtc, DRM_MODE_OBJECT_CRTC, "MODE_ID", pipeline.mode_blob);
  commit.put(pipeline.crtc, DRM_MODE_OBJECT_CRTC, "ACTIVE", 1);
  for (const char* table : {"DEGAMMA_LUT", "CTM", "GAMMA_LUT"})
    commit.put(pipeline.crtc, DRM_MODE_OBJECT_CRTC, table, 0);
  const auto width = static_cast<std::uint64_t>(pipeline.width);
  const auto height = static_cast<std::uint64_t>(pipeline.height);
  const auto put_plane = [&](std::string_view name, std::uint64_t value) {
    commit.put(pipeline.plane, DRM_MODE_OBJECT_PLANE, name, value);
  };
  put_plane("FB_ID", frame_buffer);
  put_plane("CRTC_ID", pipeline.crtc);
  for (const char* origin : {"SRC_X", "SRC_Y", "CRTC_X", "CRTC_Y"}) put_plane(origin, 0);
  put_plane("SRC_W", width << 16);  // sixteen bits of fraction
  put_plane("SRC_H", height << 16);
  put_plane("CRTC_W", width);
  put_plane("CRTC_H", height);
  return commit.make(DRM_MODE_ATOMIC_ALLOW_MODESET, nullptr);
}

int commit_flip(int descriptor, const DrmPipeline& pipeline, std::uint32_t frame_buffer, void* event) {
  Commit commit(descriptor);
  commit.put(pipeline.plane, DRM_MODE_OBJECT_PLANE, "FB_ID", frame_buffer);
  // Not "nonblocking": a commit that is still on its way is waited for instead of refused.
  return commit.make(DRM_MODE_PAGE_FLIP_EVENT, event);
}

DrmDevice::DrmDevice(const DrmConnectorInfo& connector, std::size_t mode)
    : connector_(connector), mode_(mode), descriptor_(::open(connector.card.c_str(), O_RDWR | O_CLOEXEC)) {
  if (descriptor_ < 0) fail(errno, "cannot be opened");
  try {
    if (!drmIsMaster(descriptor_) && drmSetMaster(descriptor_) != 0)
      fail(EBUSY,
           "another program, such as a desktop, uses the display; use a text console, or window = true");
    std::uint64_t monotonic = 0;
    if (drmGetCap(descriptor_, DRM_CAP_TIMESTAMP_MONOTONIC, &monotonic) != 0 || monotonic != 1)
      fail(ENOTSUP, "does not stamp flips with the monotonic clock; frames cannot be paired with patterns");
    drmSetClientCap(descriptor_, DRM_CLIENT_CAP_UNIVERSAL_PLANES, 1);
    atomic_ = drmSetClientCap(descriptor_, DRM_CLIENT_CAP_ATOMIC, 1) == 0;
    choose_objects();
  } catch (...) {
    ::close(descriptor_);
    throw;
  }
}

// The kernel frees the rest and gives the display back to its console; but a mapped buffer would keep it
// ours.
DrmDevice::~DrmDevice() {
  for (const DrmBuffer& buffer : buffers_) ::munmap(buffer.bytes.data(), buffer.bytes.size());
  drmDropMaster(descriptor_);  // at once, whoever else still holds the descriptor
  ::close(descriptor_);
}

void DrmDevice::fail(int error_number, const std::string& what) const {
  throw DeviceError(connector_.name + " of " + connector_.card.string(), error_number, what);
}

void DrmDevice::choose_objects() {
  const Owned<drmModeRes> resources(drmModeGetResources(descriptor_), drmModeFreeResources);
  const auto connector = connector_now(descriptor_, connector_.id, true);
  if (!resources || !connector || mode_ >= static_cast<std::size_t>(connector->count_modes))
    fail(errno, "cannot be asked");
  std::uint32_t possible = 0;
  for (int i = 0; i < connector->count_encoders; ++i) {
    const Owned<drmModeEncoder> encoder(drmModeGetEncoder(descriptor_, connector->encoders[i]),
                                        drmModeFreeEncoder);
    if (encoder) possible |= encoder->possible_crtcs;
  }
  int index = 0;
  while (index < resources->count_crtcs && !(possible >> index & 1u)) ++index;
  if (index == resources->count_crtcs) fail(ENODEV, "no display controller can drive it");
  const DrmModeInfo& mode = connector_.modes[mode_];
  pipeline_ = {connector_.id, resources->crtcs[index], 0, 0, mode.width, mode.height};
  if (!atomic_) return;
  pipeline_.plane = primary_plane(descriptor_, static_cast<std::uint32_t>(index));
  atomic_ =
      pipeline_.plane != 0 && drmModeCreatePropertyBlob(descriptor_, &connector->modes[mode_],
                                                        sizeof(drmModeModeInfo), &pipeline_.mode_blob) == 0;
}

DrmBuffer DrmDevice::make_buffer(int width, int height) {
  drm_mode_create_dumb create{};
  create.width = static_cast<__u32>(width);
  create.height = static_cast<__u32>(height);
  create.bpp = 32;
  if (drmIoctl(descriptor_, DRM_IOCTL_MODE_CREATE_DUMB, &create) != 0) fail(errno, "refuses a frame buffer");
  DrmBuffer buffer{create.handle, 0, create.pitch, {}};
  const std::uint32_t handles[4] = {create.handle};
  const std::uint32_t pitches[4] = {create.pitch};
  const std::uint32_t offsets[4] = {};
  if (drmModeAddFB2(descriptor_, create.width, create.height, DRM_FORMAT_XRGB8888, handles, pitches, offsets,
                    &buffer.frame_buffer, 0) != 0)
    fail(errno, "refuses a frame buffer of 8-bit XRGB");
  drm_mode_map_dumb map{};
  map.handle = create.handle;
  if (drmIoctl(descriptor_, DRM_IOCTL_MODE_MAP_DUMB, &map) != 0) fail(errno, "does not share a frame buffer");
  void* memory = ::mmap(nullptr, create.size, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor_,
                        static_cast<off_t>(map.offset));
  if (memory == MAP_FAILED) fail(errno, "cannot map a frame buffer");
  buffer.bytes = {static_cast<std::uint8_t*>(memory), create.size};
  buffers_.push_back(buffer);
  return buffer;
}

void DrmDevice::light_up(const DrmBuffer& buffer) {
  int error = 0;
  if (atomic_) {
    error = commit_mode(descriptor_, pipeline_, buffer.frame_buffer);
  } else {
    const auto connector = connector_now(descriptor_, connector_.id, false);
    if (drmModeSetCrtc(descriptor_, pipeline_.crtc, buffer.frame_buffer, 0, 0, &connector_.id, 1,
                       &connector->modes[mode_]) != 0)
      error = errno;
  }
  if (error) fail(error, "refuses the mode " + connector_.modes[mode_].text());
}

void DrmDevice::require_monitor() const {
  const auto connector = connector_now(descriptor_, connector_.id, false);
  if (!connector || connector->connection == DRM_MODE_DISCONNECTED)
    fail(ENODEV, "the monitor was unplugged or switched off; plug it in again and resume");
}

TimePoint DrmDevice::flip(const DrmBuffer& buffer) {
  flipped_.reset();
  int error = 0;
  if (atomic_)
    error = commit_flip(descriptor_, pipeline_, buffer.frame_buffer, &flipped_);
  else if (drmModePageFlip(descriptor_, pipeline_.crtc, buffer.frame_buffer, DRM_MODE_PAGE_FLIP_EVENT,
                           &flipped_) != 0)
    error = errno;
  if (error) fail(error, "refuses a flip");

  drmEventContext context{};
  context.version = 3;
  context.page_flip_handler2 = note_flip;
  const auto deadline = std::chrono::steady_clock::now() + longest_flip;
  while (!flipped_ && std::chrono::steady_clock::now() < deadline) {
    pollfd waiting{descriptor_, POLLIN, 0};
    if (::poll(&waiting, 1, poll_ms) > 0 && drmHandleEvent(descriptor_, &context) != 0)
      fail(errno, "gives no events");
  }
  if (!flipped_)
    fail(ETIMEDOUT, "did not confirm a page flip within 2 s; check that the monitor is not in standby");
  return *flipped_;
}

/// A monitor is dark while it follows a new mode: one to two seconds on HDMI and DisplayPort.
constexpr Seconds mode_change{2.0};

struct DrmMonitor::State {
  DrmConnectorInfo connector;
  std::size_t mode;
  int width, height;  // of light maps
  int scale;
  DrmDevice device;
  std::array<DrmBuffer, 2> buffers;
  std::size_t back = 1;

  explicit State(const DrmMonitorOptions& options)
      : connector(find_drm_connector(options.card, options.connector)),
        mode(find_drm_mode(connector, options.mode)),
        width(options.width > 0 ? options.width : screen().width),
        height(options.height > 0 ? options.height : screen().height),
        scale(largest_scale()),
        device(connector, mode) {
    for (DrmBuffer& buffer : buffers) {
      buffer = device.make_buffer(screen().width, screen().height);
      std::ranges::fill(buffer.bytes, std::uint8_t{0});
    }
    device.light_up(buffers[0]);
    std::this_thread::sleep_for(mode_change);
  }

  const DrmModeInfo& screen() const { return connector.modes[mode]; }

  int largest_scale() const {
    const int result = std::min(screen().width / width, screen().height / height);
    if (result >= 1) return result;
    throw InputError(connector.name + ": light maps of " + std::to_string(width) + "×" +
                     std::to_string(height) + " texels are larger than its mode " + screen().text());
  }

  /// Writes the pattern's lines into the middle of a buffer.
  void draw(const DriveImage& image, const DrmBuffer& buffer) const {
    const std::size_t left = static_cast<std::size_t>(screen().width - width * scale) / 2;
    const std::size_t top = static_cast<std::size_t>(screen().height - height * scale) / 2;
    const std::size_t line_bytes = std::size_t{4} * width * scale;
    for (int y = 0; y < height; ++y) {
      const std::uint8_t* levels = image.levels.data() + std::size_t{3} * width * y;
      std::uint8_t* first = buffer.bytes.data() +
                            (top + static_cast<std::size_t>(y) * scale) * buffer.bytes_per_line + 4 * left;
      std::uint8_t* out = first;
      for (int x = 0; x < width; ++x, levels += 3)
        for (int i = 0; i < scale; ++i, out += 4) {  // XRGB in little-endian words
          out[0] = levels[2];
          out[1] = levels[1];
          out[2] = levels[0];
        }
      for (int i = 1; i < scale; ++i) std::memcpy(first + i * buffer.bytes_per_line, first, line_bytes);
    }
  }
};

DrmMonitor::DrmMonitor(const DrmMonitorOptions& options) : state_(std::make_unique<State>(options)) {}
DrmMonitor::~DrmMonitor() = default;

IlluminatorDescription DrmMonitor::describe() const {
  return {state_->connector.name + " (" + state_->connector.driver + ") " + state_->screen().text(),
          state_->width, state_->height, Seconds(0), Seconds(0)};
}

int DrmMonitor::pixels_per_texel() const {
  return state_->scale;
}

TimePoint DrmMonitor::show(const DriveImage& image) {
  State& state = *state_;
  require_size(image, state.width, state.height, state.connector.name);
  state.device.require_monitor();
  state.draw(image, state.buffers[state.back]);
  const TimePoint flipped = state.device.flip(state.buffers[state.back]);
  state.device.require_monitor();
  state.back = 1 - state.back;
  return flipped;
}

}  // namespace refield
