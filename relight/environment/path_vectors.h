// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <cstdint>

namespace refield {

/// Short pieces of great circles on the sphere of an environment map, one coordinate after another: ends are
/// unit directions.
struct PathPieceEnds {
  static constexpr std::size_t capacity = 256;  ///< a multiple of any vector's lanes
  alignas(64) double ax[capacity] = {}, ay[capacity] = {}, az[capacity] = {};
  alignas(64) double bx[capacity] = {}, by[capacity] = {}, bz[capacity] = {};
  /// (x, z) of what tells the azimuths of the ends, of any length.
  alignas(64) double a_level_x[capacity] = {}, a_level_z[capacity] = {};
  alignas(64) double b_level_x[capacity] = {}, b_level_z[capacity] = {};
};

/// For the first `count` pieces, the azimuth φ from start to end and ∫ (1 − sin(latitude)) dφ. Where the
/// tangent of a piece's azimuth is below 0.06, both are right to rounding.
/// `azimuth`, `above` [capacity], aligned to 64 bytes: numbers behind the last piece are overwritten.
void measure_pieces(const PathPieceEnds& ends, std::size_t count, double* azimuth, double* above);

/// Values at the upper edge of the texel that a piece lies in.
struct PieceRows {
  alignas(64) double sine[PathPieceEnds::capacity] = {}, cosine[PathPieceEnds::capacity] = {};  ///< latitude
  alignas(64) double from_pole[PathPieceEnds::capacity] = {};                                   ///< angle
  /// ∫ sin dsin and ∫ cos dsin over the latitudes from the edge to the north pole.
  alignas(64) double upward[PathPieceEnds::capacity] = {}, outward[PathPieceEnds::capacity] = {};
};

/// Integrals along pieces, see PreparedEnvironment::vectors_along().
struct PieceVectors {
  alignas(64) double azimuth[PathPieceEnds::capacity];
  /// ∫ e dφ, e the horizontal direction of the azimuth.
  alignas(64) double across_x[PathPieceEnds::capacity], across_z[PathPieceEnds::capacity];
  /// ∫ ω dω over what lies between the piece and the edge.
  alignas(64) double x[PathPieceEnds::capacity], y[PathPieceEnds::capacity], z[PathPieceEnds::capacity];
};

/// The first `count` pieces, of texels of less than 0.05 in height and width. Numbers behind the last piece
/// are overwritten.
void measure_piece_vectors(const PathPieceEnds& ends, const PieceRows& rows, std::size_t count,
                           PieceVectors& vectors);

/// The bounds of an environment map's texel, for directions of any length.
struct TexelBounds {
  std::int32_t number = 0;          ///< row · width + column
  double north = 0.0, south = 0.0;  ///< signed squares of the sines of latitude
  double left_x = 0.0, left_z = 0.0, right_x = 0.0, right_z = 0.0;  ///< of directions on the edges
  double safe_north = 0.0, safe_south = 0.0;  ///< between, great circles to other such directions stay inside
};

/// Directions scale · across[i] + offset for successive i, one coordinate after another.
struct DirectionLine {
  const double *across_x, *across_y, *across_z;  ///< max_lanes numbers more may be read behind the last
  double scale;
  double offset[3];

  static constexpr std::size_t max_lanes = 8;
};

/// Finds how many directions from `first` to `last` − 1 lie in a texel before one that does not. `inside`
/// [last + DirectionLine::max_lanes] gets the texel's number for them, its complement where great circles to
/// others in the texel may leave it; behind them, numbers are overwritten.
std::size_t count_inside(const DirectionLine& line, std::size_t first, std::size_t last,
                         const TexelBounds& bounds, std::int32_t* inside);

}  // namespace refield
