// SPDX-License-Identifier: Apache-2.0
#include "acquire/drm_device.h"

#include <drm_fourcc.h>
#include <fcntl.h>
#include <poll.h>
#include <sys/mman.h>
#include <unistd.h>
#include <xf86drm.h>
#include <xf86drmMode.h>

#include <cerrno>
#include <memory>

#include "core/errors.h"

namespace refield {

namespace {

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

}  // namespace refield
