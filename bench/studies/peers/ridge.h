// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "bench/studies/peers/gram.h"
#include "bench/studies/peers/light_texels.h"
#include "bench/studies/peers/peer_data.h"

namespace refield::peers {

/// A linear predictor in its dual form: a pixel under light l shows Σ_j α_j ⟨L_j, Σ l⟩, with α of the pixel
/// and channel, and Σ one of a few covariances over the light map. n numbers per pixel and channel, where
/// texel weights would be as many as texels; the training lights are kept beside them.
struct DualModel {
  LightDomain domain;
  int width = 0;
  int height = 0;
  std::array<Eigen::MatrixXf, 3> lights;     ///< of each channel, [texels × images]
  std::vector<TexelCovariance> covariances;  ///< one at least
  std::vector<std::uint8_t> covariance_of;   ///< [3 · pixels]
  Eigen::MatrixXf alpha;                     ///< [images × (3 · pixels)]

  /// [height × width × 3]; predictions below zero are cut off, since light is not negative.
  Image relight(const LightMap& light) const;
  double bytes_per_pixel() const;
};

/// Regression on texels with n × n systems (images are fewer than texels). Pixel by pixel the three channels
/// share the penalty, rank and length scale. A sample that was not measured is left out, exactly.
/// Sources: ridge: Hoerl and Kennard 1970, penalty by Golub, Heath and Wahba 1979; smooth ridge: Gaussian
/// process regression, Rasmussen and Williams 2006, eqs. 2.25 and 5.8.
DualModel fit_dual(const PeerData& data, DualMethod method);

}  // namespace refield::peers
