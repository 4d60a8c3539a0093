// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/light/light_map.h"
#include "simulate/prt/transfer_samples.h"

namespace refield::prt {

/// Replaces the values of a square of side × side (a power of two), row by row, by their coefficients in the
/// orthonormal two-dimensional Haar basis (non-standard decomposition), or back. The mean's comes first; the
/// three wavelets of side 2^k are interleaved as usual: horizontal, vertical and diagonal details of a level
/// stand in the quadrants right of, below and diagonally beside all coarser ones.
void haar_transform(std::span<float> values, int side);
void inverse_haar_transform(std::span<float> values, int side);

/// All-frequency relighting by the largest wavelets of the light (Ng, Ramamoorthi and Hanrahan 2003), the
/// peer that clustering is compared with: transfer in Haar wavelets over the faces of a cube map, small
/// coefficients dropped and the others rounded to 8 bits, by columns; of each new light the wavelets that
/// matter most are summed. For diffuse scenes of at most 65 536 outputs.
class WaveletTransfer {
 public:
  /// `resolution`: of a face, a power of two. `threshold`: a coefficient is dropped below so much of the
  /// largest of its output. Traces a ray for each output and texel. Throws InputError for outputs of several
  /// channels, for too many of them and for other resolutions, Interrupted.
  WaveletTransfer(const TransferSamples& transfer, int resolution, double threshold);

  /// Outputs [groups × 16] under a cube map, by its `terms` largest wavelets. A wavelet counts by what it has
  /// of the light (all channels) times the side of its square, as transfer's own coefficients grow with that
  /// (the paper's area weighting).
  std::vector<Eigen::Array3f> relight(const LightMap& light, int terms) const;

  std::size_t bytes() const;
  /// Of these, what grows with the outputs.
  std::size_t entry_bytes() const;
  /// Coefficients that were kept, of all outputs.
  std::size_t entries() const { return weight_.size(); }

 private:
  struct Entry {
    std::uint32_t wavelet;
    std::uint16_t output;
    std::int8_t weight;
  };
  std::vector<Entry> entries_of(const TransferSamples& transfer, std::size_t group, double threshold);

  int resolution_;
  std::vector<float> scale_;           // [outputs]: one step of their weights
  std::vector<std::uint64_t> start_;   // [wavelets + 1]
  std::vector<std::uint16_t> output_;  // [entries], by wavelet
  std::vector<std::int8_t> weight_;
};

}  // namespace refield::prt
