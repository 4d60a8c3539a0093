// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

#include "bench/studies/peers/peer_data.h"
#include "core/field/reflectance_field.h"

namespace refield::peers {

/// Transport as a few Haar wavelets over the light map for each pixel, signed.
struct HaarModel {
  LightDomain domain;
  int width = 0;
  int height = 0;
  SparseTransfer transfer;  ///< columns are Haar coefficients

  /// [height × width × 3]; predictions below zero are cut off.
  Image relight(const LightMap& light) const;
  double bytes_per_pixel() const;
};

/// Matching pursuit over all Haar wavelets: the wavelet that explains most of the three channels' residuals
/// joins, until `wavelets` are found; then all weights are solved for together by least squares, and the
/// extended Bayesian information criterion says how many of them stay. Sources: wavelets of transport, Peers
/// and Dutré 2003 and Ng, Ramamoorthi and Hanrahan 2003; matching pursuit, Mallat and Zhang 1993; criterion,
/// Chen and Chen 2008. The refit and the criterion are additions: without them the method does worse.
HaarModel fit_haar(const PeerData& data, int wavelets);

/// What pursuit needs of the lights, shared by all pixels.
class HaarDictionary {
 public:
  explicit HaarDictionary(const PeerData& data);
  Eigen::Index atoms() const { return columns_[0].cols(); }
  /// A wavelet's coefficient in each light, [images].
  auto column(int channel, Eigen::Index atom) const { return columns_[channel].col(atom); }
  const Eigen::MatrixXf& columns(int channel) const { return columns_[channel]; }

 private:
  std::array<Eigen::MatrixXf, 3> columns_;  // [images × wavelets]
};

}  // namespace refield::peers
