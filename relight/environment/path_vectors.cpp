// SPDX-License-Identifier: Apache-2.0
#include "relight/environment/path_vectors.h"

// Highway compiles the part between BEFORE and AFTER once for each instruction set and picks one at run time.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "relight/environment/path_vectors.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace refield::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// atan(r) for |r| < 0.06, by its series.
template <class D, class V>
HWY_INLINE V small_angle(D d, V r) {
  const V r2 = hn::Mul(r, r);
  V sum = hn::NegMulAdd(r2, hn::Set(d, 1.0 / 9.0), hn::Set(d, 1.0 / 7.0));
  sum = hn::NegMulAdd(r2, sum, hn::Set(d, 0.2));
  sum = hn::NegMulAdd(r2, sum, hn::Set(d, 1.0 / 3.0));
  sum = hn::NegMulAdd(r2, sum, hn::Set(d, 1.0));
  return hn::Mul(r, sum);
}

/// z_a x_b − x_a z_b, of the differences, which are short: products alone would lose half of the digits.
template <class D, class V>
HWY_INLINE V cross(D, V xa, V za, V xb, V zb) {
  return hn::MulSub(za, hn::Sub(xb, xa), hn::Mul(xa, hn::Sub(zb, za)));
}

/// From level a to level b.
template <class D, class V>
HWY_INLINE V azimuth_between(D d, V xa, V za, V xb, V zb) {
  return small_angle(d, hn::Div(cross(d, xa, za, xb, zb), hn::MulAdd(xa, xb, hn::Mul(za, zb))));
}

void measure_pieces_vectorised(const PathPieceEnds& ends, std::size_t count, double* HWY_RESTRICT azimuth,
                               double* HWY_RESTRICT above) {
  const hn::CappedTag<double, 8> d;
  const auto two = hn::Set(d, 2.0), one = hn::Set(d, 1.0);
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
    const auto ax = hn::Load(d, ends.ax + i), ay = hn::Load(d, ends.ay + i), az = hn::Load(d, ends.az + i);
    const auto bx = hn::Load(d, ends.bx + i), by = hn::Load(d, ends.by + i), bz = hn::Load(d, ends.bz + i);
    const auto across = cross(d, ax, az, bx, bz);
    const auto along = hn::MulAdd(ax, bx, hn::Mul(az, bz));
    const auto height = hn::Add(ay, by);
    const auto dot = hn::MulAdd(ay, by, hn::Add(one, along));
    const auto lax = hn::Load(d, ends.a_level_x + i), laz = hn::Load(d, ends.a_level_z + i),
               lbx = hn::Load(d, ends.b_level_x + i), lbz = hn::Load(d, ends.b_level_z + i);
    const auto phi = azimuth_between(d, lax, laz, lbx, lbz);
    // The triangle with the north pole (van Oosterom and Strackee 1983, eq. 8), or what the one with the
    // south pole leaves.
    const auto triangle = hn::Mul(two, small_angle(d, hn::Div(across, hn::Add(dot, hn::Abs(height)))));
    hn::Store(phi, d, azimuth + i);
    hn::Store(hn::IfThenElse(hn::Ge(height, hn::Zero(d)), triangle, hn::MulSub(two, phi, triangle)), d,
              above + i);
  }
}

void measure_piece_vectors_vectorised(const PathPieceEnds& ends, const PieceRows& rows, std::size_t count,
                                      PieceVectors& vectors) {
  const hn::CappedTag<double, 8> d;
  using V = hn::Vec<decltype(d)>;
  const auto one = hn::Set(d, 1.0), half = hn::Set(d, 0.5);
  /// End of a piece: the azimuth's direction turned by a quarter, and the angle down from the row's edge.
  struct End {
    V x, z, below;
  };
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
    const auto sine = hn::Load(d, rows.sine + i), cosine = hn::Load(d, rows.cosine + i);
    const auto end_of = [&](V x, V y, V z, V level_x, V level_z) {
      const auto scale = hn::Div(one, hn::Sqrt(hn::MulAdd(level_x, level_x, hn::Mul(level_z, level_z))));
      const auto level = hn::Sqrt(hn::MulAdd(x, x, hn::Mul(z, z)));
      const auto below = small_angle(d, hn::Div(hn::MulSub(level, sine, hn::Mul(y, cosine)),
                                                hn::MulAdd(y, sine, hn::Mul(level, cosine))));
      return End{hn::Neg(hn::Mul(level_z, scale)), hn::Mul(level_x, scale), below};
    };
    const auto ax = hn::Load(d, ends.ax + i), ay = hn::Load(d, ends.ay + i), az = hn::Load(d, ends.az + i);
    const auto bx = hn::Load(d, ends.bx + i), by = hn::Load(d, ends.by + i), bz = hn::Load(d, ends.bz + i);
    const auto lax = hn::Load(d, ends.a_level_x + i), laz = hn::Load(d, ends.a_level_z + i),
               lbx = hn::Load(d, ends.b_level_x + i), lbz = hn::Load(d, ends.b_level_z + i);
    const End a = end_of(ax, ay, az, lax, laz), b = end_of(bx, by, bz, lbx, lbz);
    const auto azimuth = azimuth_between(d, lax, laz, lbx, lbz);
    const auto across_x = hn::Sub(b.x, a.x), across_z = hn::Sub(b.z, a.z);
    // The piece's length over its sine, by h = sin²(length ∕ 2).
    const auto dx = hn::Sub(bx, ax), dy = hn::Sub(by, ay), dz = hn::Sub(bz, az);
    const auto h = hn::Mul(hn::Set(d, 0.25), hn::MulAdd(dx, dx, hn::MulAdd(dy, dy, hn::Mul(dz, dz))));
    auto stretch = hn::MulAdd(h, hn::Set(d, 128.0 / 315.0), hn::Set(d, 16.0 / 35.0));
    stretch = hn::MulAdd(h, stretch, hn::Set(d, 8.0 / 15.0));
    stretch = hn::MulAdd(h, stretch, hn::Set(d, 2.0 / 3.0));
    stretch = hn::MulAdd(h, stretch, one);
    // The triangle with the north pole, less what of it is north of the texel.
    const auto from_pole = hn::Load(d, rows.from_pole + i);
    const auto inside = [&](V normal, V across, V side_a, V side_b) {
      const auto sides = hn::MulAdd(from_pole, across, hn::MulSub(b.below, side_b, hn::Mul(a.below, side_a)));
      return hn::NegMulAdd(hn::Load(d, rows.outward + i), across,
                           hn::Mul(half, hn::MulAdd(stretch, normal, sides)));
    };
    hn::Store(azimuth, d, vectors.azimuth + i);
    hn::Store(across_x, d, vectors.across_x + i);
    hn::Store(across_z, d, vectors.across_z + i);
    hn::Store(inside(hn::MulSub(ay, dz, hn::Mul(az, dy)), across_x, a.x, b.x), d, vectors.x + i);
    hn::Store(hn::NegMulAdd(hn::Load(d, rows.upward + i), azimuth,
                            hn::Mul(half, hn::Mul(stretch, hn::MulSub(az, dx, hn::Mul(ax, dz))))),
              d, vectors.y + i);
    hn::Store(inside(hn::MulSub(ax, dy, hn::Mul(ay, dx)), across_z, a.z, b.z), d, vectors.z + i);
  }
}

std::size_t count_inside_vectorised(const DirectionLine& line, std::size_t first, std::size_t last,
                                    const TexelBounds& bounds, std::int32_t* HWY_RESTRICT inside) {
  const hn::CappedTag<double, DirectionLine::max_lanes> d;
  const hn::Rebind<std::int32_t, decltype(d)> narrow;
  const auto scale = hn::Set(d, line.scale);
  const auto coordinate = [&](const double* across, std::size_t i, int axis) {
    return hn::MulAdd(scale, hn::LoadU(d, across + i), hn::Set(d, line.offset[axis]));
  };
  const auto sure = hn::Set(d, bounds.number), unsure = hn::Set(d, ~bounds.number);
  for (std::size_t i = first; i < last; i += hn::Lanes(d)) {
    const auto x = coordinate(line.across_x, i, 0), y = coordinate(line.across_y, i, 1),
               z = coordinate(line.across_z, i, 2);
    const auto length = hn::MulAdd(x, x, hn::MulAdd(y, y, hn::Mul(z, z)));
    const auto height = hn::Mul(y, hn::Abs(y));
    const auto within = [&](double north, double south) {
      return hn::And(hn::Le(height, hn::Mul(hn::Set(d, north), length)),
                     hn::Ge(height, hn::Mul(hn::Set(d, south), length)));
    };
    const auto right_of_left =
        hn::MulSub(hn::Set(d, bounds.left_z), x, hn::Mul(hn::Set(d, bounds.left_x), z));
    const auto right_of_right =
        hn::MulSub(hn::Set(d, bounds.right_z), x, hn::Mul(hn::Set(d, bounds.right_x), z));
    const auto holds =
        hn::And(within(bounds.north, bounds.south),
                hn::And(hn::Ge(right_of_left, hn::Zero(d)), hn::Lt(right_of_right, hn::Zero(d))));
    const auto safe = within(bounds.safe_north, bounds.safe_south);
    hn::StoreU(hn::DemoteTo(narrow, hn::IfThenElse(safe, sure, unsure)), narrow, inside + i);
    const std::intptr_t leaves = hn::FindFirstTrue(d, hn::Not(holds));
    if (leaves >= 0) return HWY_MIN(i + static_cast<std::size_t>(leaves), last) - first;
  }
  return last - first;
}

}  // namespace refield::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace refield {

HWY_EXPORT(measure_pieces_vectorised);
HWY_EXPORT(measure_piece_vectors_vectorised);
HWY_EXPORT(count_inside_vectorised);

void measure_pieces(const PathPieceEnds& ends, std::size_t count, double* azimuth, double* above) {
  HWY_DYNAMIC_DISPATCH(measure_pieces_vectorised)(ends, count, azimuth, above);
}

void measure_piece_vectors(const PathPieceEnds& ends, const PieceRows& rows, std::size_t count,
                           PieceVectors& vectors) {
  HWY_DYNAMIC_DISPATCH(measure_piece_vectors_vectorised)(ends, rows, count, vectors);
}

std::size_t count_inside(const DirectionLine& line, std::size_t first, std::size_t last,
                         const TexelBounds& bounds, std::int32_t* inside) {
  return HWY_DYNAMIC_DISPATCH(count_inside_vectorised)(line, first, last, bounds, inside);
}

}  // namespace refield
#endif
