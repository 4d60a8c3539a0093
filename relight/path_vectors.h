// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>

namespace refield {

/// Short pieces of great circles on the sphere of an environment map, one coordinate after another: ends are
/// unit directions.
struct PathPieceEnds {
  static constexpr std::size_t capacity = 256;  ///< a multiple of any vector's lanes
  alignas(64) double ax[capacity] = {}, ay[capacity] = {}, az[capacity] = {};
  alignas(64) double bx[capacity] = {}, by[capacity] = {}, bz[capacity] = {};
};

/// For the first `count` pieces, the azimuth φ from start to end and ∫ (1 − sin(latitude)) dφ. Where the
/// tangent of a piece's azimuth is below 0.06, both are right to rounding.
/// `azimuth`, `above` [capacity], aligned to 64 bytes: numbers behind the last piece are overwritten.
void measure_pieces(const PathPieceEnds& ends, std::size_t count, double* azimuth, double* above);

}  // namespace refield
