// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>

namespace refield {

/// The objects of KMS that a picture passes: plane, controller (CRTC), connector.
struct DrmPipeline {
  std::uint32_t connector = 0;
  std::uint32_t crtc = 0;
  std::uint32_t plane = 0;
  std::uint32_t mode_blob = 0;
  int width = 0;
  int height = 0;
};

/// The primary plane of the controller with that index; 0: there is none.
std::uint32_t primary_plane(int descriptor, std::uint32_t crtc_index);

/// Atomic commits; both return 0 or errno. The first sets the mode with a frame buffer over the whole screen,
/// colour tables off, full range of levels; the second flips to another buffer and has an event with `event`
/// sent.
int commit_mode(int descriptor, const DrmPipeline& pipeline, std::uint32_t frame_buffer);
int commit_flip(int descriptor, const DrmPipeline& pipeline, std::uint32_t frame_buffer, void* event);

}  // namespace refield
