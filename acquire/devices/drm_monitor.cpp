// SPDX-License-Identifier: Apache-2.0
#include "acquire/devices/monitors.h"

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
#include <cstring>
#include <span>
#include <thread>

#include "core/base/number_text.h"

namespace refield {

namespace {

constexpr double refresh_tolerance_hz = 0.51;  // "@60" means 59.94, too

template <class T>
using Owned = std::unique_ptr<T, void (*)(T*)>;

double refresh_of(const drmModeModeInfo& mode) {
  return mode.htotal && mode.vtotal ? 1000.0 * mode.clock / (static_cast<double>(mode.htotal) * mode.vtotal)
                                    : mode.vrefresh;
}

std::string driver_of(int descriptor) {
  const Owned<drmVersion> version(drmGetVersion(descriptor), drmFreeVersion);
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
  const Owned<drmModeRes> resources(drmModeGetResources(descriptor), drmModeFreeResources);
  const std::string driver = driver_of(descriptor);
  for (int i = 0; resources && i < resources->count_connectors; ++i) {
    const Owned<drmModeConnector> connector(drmModeGetConnector(descriptor, resources->connectors[i]),
                                            drmModeFreeConnector);
    if (!connector || connector->connector_type == DRM_MODE_CONNECTOR_WRITEBACK) continue;
    found.push_back(info_of(*connector));
    found.back().card = card;
    found.back().driver = driver;
  }
  ::close(descriptor);
}

constexpr Seconds longest_flip{2.0};
constexpr int poll_ms = 100;
/// A monitor is dark while it follows a new mode: one to two seconds on HDMI and DisplayPort.
constexpr Seconds mode_change{2.0};

void note_flip(int /*descriptor*/, unsigned /*sequence*/, unsigned seconds, unsigned microseconds,
               unsigned /*crtc*/, void* event) {
  *static_cast<std::optional<TimePoint>*>(event) =
      TimePoint(std::chrono::seconds(seconds) + std::chrono::microseconds(microseconds));
}

/// Sets a property of an object to 0 or to the choice of that name, where the driver has it.
void set_property(int descriptor, std::uint32_t object, std::uint32_t type, std::string_view name,
                  std::string_view choice = {}) {
  const Owned<drmModeObjectProperties> properties(drmModeObjectGetProperties(descriptor, object, type),
                                                  drmModeFreeObjectProperties);
  for (std::uint32_t i = 0; properties && i < properties->count_props; ++i) {
    const Owned<drmModePropertyRes> property(drmModeGetProperty(descriptor, properties->props[i]),
                                             drmModeFreeProperty);
    if (!property || name != property->name) continue;
    std::optional<std::uint64_t> value;
    if (choice.empty()) value = 0;
    for (int k = 0; k < property->count_enums; ++k)
      if (choice == property->enums[k].name) value = property->enums[k].value;
    if (value) drmModeObjectSetProperty(descriptor, object, type, property->prop_id, *value);
  }
}

/// A frame buffer of 8-bit XRGB in the card's memory that the processor can write ("dumb buffer").
struct FrameBuffer {
  std::uint32_t id = 0;
  std::size_t bytes_per_line = 0;
  std::span<std::uint8_t> bytes;
};

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
  throw InputError("monitor '", card.empty() ? "" : card + " ", name,
                   "': the connector does not exist; connectors:", list);
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
  throw InputError(connector.name, ": has no mode '", text, "'; it has", list);
}

/// One connector in one mode, whose frame buffers this program flips, by the calls that drivers with and
/// without atomic commits have.
struct DrmMonitor::State {
  DrmConnectorInfo connector;
  std::size_t mode;
  int width, height;  // of light maps
  int scale;
  int descriptor;
  std::uint32_t crtc = 0;  // the display controller
  std::array<FrameBuffer, 2> buffers;
  std::size_t back = 1;
  std::optional<TimePoint> flipped;  // the kernel holds its address while a flip is on its way

  explicit State(const DrmMonitorOptions& options)
      : connector(find_drm_connector(options.card, options.connector)),
        mode(find_drm_mode(connector, options.mode)),
        width(options.width > 0 ? options.width : screen().width),
        height(options.height > 0 ? options.height : screen().height),
        scale(largest_scale()),
        descriptor(::open(connector.card.c_str(), O_RDWR | O_CLOEXEC)) {
    if (descriptor < 0) fail(errno, "cannot be opened");
    try {
      take_display();
      for (FrameBuffer& buffer : buffers) make(buffer);
      light_up();
    } catch (...) {
      close();
      throw;
    }
    std::this_thread::sleep_for(mode_change);
  }
  ~State() { close(); }
  State(const State&) = delete;
  State& operator=(const State&) = delete;

  /// The kernel frees the rest and gives the display back to its console; but a mapped buffer would keep it
  /// ours.
  void close() const {
    for (const FrameBuffer& buffer : buffers)
      if (!buffer.bytes.empty()) ::munmap(buffer.bytes.data(), buffer.bytes.size());
    drmDropMaster(descriptor);  // at once, whoever else still holds the descriptor
    ::close(descriptor);
  }

  [[noreturn]] void fail(int error_number, const std::string& what) const {
    throw DeviceError(connector.name + " of " + connector.card.string(), error_number, what);
  }

  const DrmModeInfo& screen() const { return connector.modes[mode]; }

  int largest_scale() const {
    const int result = std::min(screen().width / width, screen().height / height);
    if (result >= 1) return result;
    throw InputError(connector.name, ": light maps of ", width, "×", height,
                     " texels are larger than its mode ", screen().text());
  }

  Owned<drmModeConnector> connector_now(bool probe) const {
    return {probe ? drmModeGetConnector(descriptor, connector.id)
                  : drmModeGetConnectorCurrent(descriptor, connector.id),
            drmModeFreeConnector};
  }

  void take_display() {
    if (!drmIsMaster(descriptor) && drmSetMaster(descriptor) != 0)
      fail(EBUSY,
           "another program, such as a desktop, uses the display; use a text console, or window = true");
    std::uint64_t monotonic = 0;
    if (drmGetCap(descriptor, DRM_CAP_TIMESTAMP_MONOTONIC, &monotonic) != 0 || monotonic != 1)
      fail(ENOTSUP, "does not stamp flips with the monotonic clock; frames cannot be paired with patterns");
    const Owned<drmModeRes> resources(drmModeGetResources(descriptor), drmModeFreeResources);
    const auto now = connector_now(true);
    if (!resources || !now || mode >= static_cast<std::size_t>(now->count_modes))
      fail(errno, "cannot be asked");
    std::uint32_t possible = 0;
    for (int i = 0; i < now->count_encoders; ++i) {
      const Owned<drmModeEncoder> encoder(drmModeGetEncoder(descriptor, now->encoders[i]),
                                          drmModeFreeEncoder);
      if (encoder) possible |= encoder->possible_crtcs;
    }
    int index = 0;
    while (index < resources->count_crtcs && !(possible >> index & 1u)) ++index;
    if (index == resources->count_crtcs) fail(ENODEV, "no display controller can drive it");
    crtc = resources->crtcs[index];
  }

  void make(FrameBuffer& buffer) const {
    drm_mode_create_dumb create{};
    create.width = static_cast<__u32>(screen().width);
    create.height = static_cast<__u32>(screen().height);
    create.bpp = 32;
    if (drmIoctl(descriptor, DRM_IOCTL_MODE_CREATE_DUMB, &create) != 0) fail(errno, "refuses a frame buffer");
    const std::uint32_t handles[4] = {create.handle};
    const std::uint32_t pitches[4] = {create.pitch};
    const std::uint32_t offsets[4] = {};
    if (drmModeAddFB2(descriptor, create.width, create.height, DRM_FORMAT_XRGB8888, handles, pitches, offsets,
                      &buffer.id, 0) != 0)
      fail(errno, "refuses a frame buffer of 8-bit XRGB");
    drm_mode_map_dumb map{};
    map.handle = create.handle;
    if (drmIoctl(descriptor, DRM_IOCTL_MODE_MAP_DUMB, &map) != 0)
      fail(errno, "does not share a frame buffer");
    void* memory = ::mmap(nullptr, create.size, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor,
                          static_cast<off_t>(map.offset));
    if (memory == MAP_FAILED) fail(errno, "cannot map a frame buffer");
    buffer.bytes_per_line = create.pitch;
    buffer.bytes = {static_cast<std::uint8_t*>(memory), create.size};
    std::ranges::fill(buffer.bytes, std::uint8_t{0});
  }

  /// Sets the mode with the first buffer over the whole screen, colour tables off, full range of levels.
  void light_up() {
    const auto now = connector_now(false);
    if (drmModeSetCrtc(descriptor, crtc, buffers[0].id, 0, 0, &connector.id, 1, &now->modes[mode]) != 0)
      fail(errno, "refuses the mode " + screen().text());
    set_property(descriptor, connector.id, DRM_MODE_OBJECT_CONNECTOR, "Broadcast RGB", "Full");
    for (const char* table : {"DEGAMMA_LUT", "CTM", "GAMMA_LUT"})
      set_property(descriptor, crtc, DRM_MODE_OBJECT_CRTC, table);
  }

  void require_monitor() const {
    const auto now = connector_now(false);
    if (!now || now->connection == DRM_MODE_DISCONNECTED)
      fail(ENODEV, "the monitor was unplugged or switched off; plug it in again and resume");
  }

  /// Puts the back buffer on the screen; returns when it is there, with the flip's time stamp.
  TimePoint flip() {
    flipped.reset();
    const auto deadline = std::chrono::steady_clock::now() + longest_flip;
    while (drmModePageFlip(descriptor, crtc, buffers[back].id, DRM_MODE_PAGE_FLIP_EVENT, &flipped) != 0) {
      // A change that is still on its way is waited for.
      if (errno != EBUSY || std::chrono::steady_clock::now() > deadline) fail(errno, "refuses a flip");
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    drmEventContext context{};
    context.version = 3;
    context.page_flip_handler2 = note_flip;
    while (!flipped && std::chrono::steady_clock::now() < deadline) {
      pollfd waiting{descriptor, POLLIN, 0};
      if (::poll(&waiting, 1, poll_ms) > 0 && drmHandleEvent(descriptor, &context) != 0)
        fail(errno, "gives no events");
    }
    if (!flipped)
      fail(ETIMEDOUT, "did not confirm a page flip within 2 s; check that the monitor is not in standby");
    back = 1 - back;
    return *flipped;
  }

  /// Writes the pattern's lines into the middle of the back buffer.
  void draw(const DriveImage& image) const {
    const FrameBuffer& buffer = buffers[back];
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
  state.require_monitor();
  state.draw(image);
  const TimePoint flipped = state.flip();
  state.require_monitor();
  return flipped;
}

}  // namespace refield
