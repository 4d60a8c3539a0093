// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <cstdint>

namespace refield::dynamic {

/// What a ray of a neighbour is for a glossy vertex.
struct RayShare {
  std::uint16_t place;   ///< row of the table of h_k
  std::uint16_t weight;  ///< of 65 535
};

/// sums[3 × width] += Σ_i weight_i sent[seen_i]_c h[place_i], one colour after another. `sent`: RGB and a
/// number that is not used; `h` [places × width]; width: a multiple of 16. With vectors of the processor's
/// width. Limit: an entry takes 3 fused products and 5 loads per vector of `h`.
void add_ray_shares(const std::uint32_t* seen, const RayShare* shares, std::size_t count, const float* sent,
                    const float* h, std::size_t width, float* sums);

}  // namespace refield::dynamic
