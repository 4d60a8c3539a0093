// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

namespace refield {

/// Where the time of one frame went.
struct FrameTime {
  double total_ms = 0.0;  ///< from one frame's start to the next one's, waiting for the user left out
  double relight_ms = 0.0;
  double tone_ms = 0.0;
  double draw_ms = 0.0;   ///< textures, panels, OpenGL until the frame is shown
  double view_ms = 0.0;   ///< of fields over a mesh: finding what the camera sees, and its picture
  double light_ms = 0.0;  ///< making the light map: turning or projecting a map, painting lamps
  double wait_ms = 0.0;   ///< of the frame: relighting, or waiting for it where it is done in the background
};

/// Means over a series of frames.
struct FrameStatistics {
  std::size_t frames = 0;
  std::size_t relit = 0;  ///< frames with a newly relit image; light_ms and relight_ms are their means
  double per_second = 0.0;
  double percentile_95_ms = 0.0;
  double longest_ms = 0.0;
  FrameTime mean;
};
FrameStatistics frame_statistics(const std::vector<FrameTime>& frames);

/// "60 frames, 41.2 per second (95 % within 30.1 ms, longest 33.0 ms): light map 2.1 ms and relighting 8.0 ms
/// in 58 of them, tone mapping 3.1 ms, drawing 9.9 ms"
std::string text_of(const FrameStatistics& statistics);

}  // namespace refield
