// SPDX-License-Identifier: Apache-2.0
#include "acquire/drm_atomic.h"

#include <xf86drm.h>
#include <xf86drmMode.h>

#include <cerrno>
#include <memory>
#include <string_view>

namespace refield {

namespace {

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

}  // namespace

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

}  // namespace refield
