// SPDX-License-Identifier: Apache-2.0
#include "tests/devices/screen_reader.h"

#include <drm_fourcc.h>
#include <poll.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <xf86drm.h>
#include <xf86drmMode.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>

namespace refield::test {

namespace fs = std::filesystem;

struct ScreenReader::Borrowed {
  int process = -1;     // pidfd
  int descriptor = -1;  // the same open file as the process has
  std::uint32_t connector = 0, crtc = 0, frame_buffer = 0, handle = 0;
  std::size_t bytes_per_line = 0, size = 0;
  int width = 0, height = 0;
  void* memory = MAP_FAILED;
  bool attached = false;
  std::map<std::string, std::uint32_t> property;  // of the connector

  ~Borrowed() {
    if (memory != MAP_FAILED) ::munmap(memory, size);
    if (descriptor >= 0) ::close(descriptor);
    if (process >= 0) ::close(process);
  }
  bool is_alive() const {
    pollfd dead{process, POLLIN, 0};
    return ::poll(&dead, 1, 0) == 0;
  }

  bool find_display() {
    drmModeRes* resources = drmModeGetResources(descriptor);
    if (!resources) return false;
    for (int i = 0; i < resources->count_crtcs && crtc == 0; ++i) {
      drmModeCrtc* candidate = drmModeGetCrtc(descriptor, resources->crtcs[i]);
      if (candidate && candidate->mode_valid) {
        crtc = candidate->crtc_id;
        width = candidate->mode.hdisplay;
        height = candidate->mode.vdisplay;
      }
      drmModeFreeCrtc(candidate);
    }
    for (int i = 0; i < resources->count_connectors; ++i) {
      drmModeConnector* candidate = drmModeGetConnectorCurrent(descriptor, resources->connectors[i]);
      if (candidate && candidate->connector_type == DRM_MODE_CONNECTOR_WRITEBACK)
        connector = candidate->connector_id;
      drmModeFreeConnector(candidate);
    }
    drmModeFreeResources(resources);
    return crtc != 0 && connector != 0;
  }

  bool make_buffer() {
    drm_mode_create_dumb create{};
    create.width = static_cast<__u32>(width);
    create.height = static_cast<__u32>(height);
    create.bpp = 32;
    if (drmIoctl(descriptor, DRM_IOCTL_MODE_CREATE_DUMB, &create) != 0) return false;
    handle = create.handle;
    bytes_per_line = create.pitch;
    size = create.size;
    const std::uint32_t handles[4] = {handle}, pitches[4] = {create.pitch}, offsets[4] = {};
    if (drmModeAddFB2(descriptor, create.width, create.height, DRM_FORMAT_XRGB8888, handles, pitches, offsets,
                      &frame_buffer, 0) != 0)
      return false;
    drm_mode_map_dumb map{};
    map.handle = handle;
    if (drmIoctl(descriptor, DRM_IOCTL_MODE_MAP_DUMB, &map) != 0) return false;
    memory = ::mmap(nullptr, size, PROT_READ, MAP_SHARED, descriptor, static_cast<off_t>(map.offset));
    return memory != MAP_FAILED;
  }

  void learn_properties() {
    drmModeObjectProperties* list =
        drmModeObjectGetProperties(descriptor, connector, DRM_MODE_OBJECT_CONNECTOR);
    for (std::uint32_t i = 0; list && i < list->count_props; ++i) {
      drmModePropertyRes* one = drmModeGetProperty(descriptor, list->props[i]);
      property[one->name] = one->prop_id;
      drmModeFreeProperty(one);
    }
    drmModeFreeObjectProperties(list);
  }

  bool write_back() {
    std::int32_t fence = -1;
    drmModeAtomicReq* request = drmModeAtomicAlloc();
    drmModeAtomicAddProperty(request, connector, property["CRTC_ID"], crtc);
    drmModeAtomicAddProperty(request, connector, property["WRITEBACK_FB_ID"], frame_buffer);
    drmModeAtomicAddProperty(request, connector, property["WRITEBACK_OUT_FENCE_PTR"],
                             reinterpret_cast<std::uint64_t>(&fence));
    const int status =
        drmModeAtomicCommit(descriptor, request, attached ? 0 : DRM_MODE_ATOMIC_ALLOW_MODESET, nullptr);
    drmModeAtomicFree(request);
    if (status != 0 || fence < 0) return false;
    attached = true;
    pollfd done{fence, POLLIN, 0};
    const bool signalled = ::poll(&done, 1, 2000) == 1;
    ::close(fence);
    return signalled;
  }
};

namespace {

std::string first_line(const fs::path& path) {
  std::string line;
  std::getline(std::ifstream(path) >> std::ws, line);
  return line;
}

/// Process and number of its descriptor of `card`.
std::optional<std::pair<int, int>> find_holder(const std::string& program, const std::string& card) {
  std::error_code none;
  for (const auto& process : fs::directory_iterator("/proc", none)) {
    if (first_line(process.path() / "comm") != program) continue;
    for (const auto& open : fs::directory_iterator(process.path() / "fd", none))
      if (fs::read_symlink(open.path(), none) == card)
        return std::pair(std::stoi(process.path().filename()), std::stoi(open.path().filename()));
  }
  return std::nullopt;
}

}  // namespace

ScreenReader::ScreenReader(std::string program, std::string card, int width, int height)
    : program_(std::move(program)), card_(std::move(card)), width_(width), height_(height) {}
ScreenReader::~ScreenReader() {
  let_go();
}

void ScreenReader::let_go() {
  delete borrowed_;
  borrowed_ = nullptr;
}

bool ScreenReader::borrow() {
  const auto holder = find_holder(program_, card_);
  if (!holder) return false;
  borrowed_ = new Borrowed;
  borrowed_->process = static_cast<int>(::syscall(SYS_pidfd_open, holder->first, 0));
  if (borrowed_->process >= 0)
    borrowed_->descriptor =
        static_cast<int>(::syscall(SYS_pidfd_getfd, borrowed_->process, holder->second, 0));
  const bool ready = borrowed_->descriptor >= 0 &&
                     drmSetClientCap(borrowed_->descriptor, DRM_CLIENT_CAP_ATOMIC, 1) == 0 &&
                     drmSetClientCap(borrowed_->descriptor, DRM_CLIENT_CAP_WRITEBACK_CONNECTORS, 1) == 0 &&
                     borrowed_->find_display() && borrowed_->width == width_ &&
                     borrowed_->height == height_ && borrowed_->make_buffer();
  if (ready) borrowed_->learn_properties();
  if (!ready) let_go();
  return ready;
}

std::optional<Screen> ScreenReader::read() {
  if (borrowed_ && !borrowed_->is_alive()) let_go();
  if (!borrowed_ && !borrow()) return std::nullopt;
  if (!borrowed_->write_back()) {
    let_go();
    return std::nullopt;
  }
  Screen screen{borrowed_->width, borrowed_->height, {}};
  screen.pixels.resize(static_cast<std::size_t>(screen.width) * screen.height);
  for (int y = 0; y < screen.height; ++y)
    std::memcpy(screen.pixels.data() + static_cast<std::size_t>(y) * screen.width,
                static_cast<const char*>(borrowed_->memory) + borrowed_->bytes_per_line * y,
                4 * static_cast<std::size_t>(screen.width));
  return screen;
}

}  // namespace refield::test
