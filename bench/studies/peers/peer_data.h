// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <vector>

#include "core/image/metrics.h"
#include "core/light/light_map.h"
#include "core/session/capture_session.h"

namespace refield::peers {

/// Photographs of a scene under known lights, as the peer methods take them: all of them in memory.
struct PeerData {
  LightDomain domain;
  int width = 0;  ///< of the photographs
  int height = 0;
  std::vector<LightMap> lights;  ///< [images]
  /// [images × (3 · pixels)], relative radiance: column 3 · pixel + channel. NaN: not measured.
  Eigen::MatrixXf observed;
  Mask mask;

  int images() const { return static_cast<int>(lights.size()); }
  int pixels() const { return width * height; }
  bool counts(int pixel) const { return mask.empty() || mask[pixel] != 0; }
};

/// Reads the first `images` training frames of a session. Samples that were clipped in every exposure (sigma
/// infinite) or lie at or above `clip_level` count as not measured. Throws InputError when there are fewer
/// frames, sizes differ or a sample is not finite.
PeerData read_peer_data(const CaptureSession& session, int images, float clip_level);

}  // namespace refield::peers
