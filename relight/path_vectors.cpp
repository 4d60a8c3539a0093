// SPDX-License-Identifier: Apache-2.0
#include "relight/path_vectors.h"

// Highway compiles the part between BEFORE and AFTER once for each instruction set and picks one at run time.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "relight/path_vectors.cpp"
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

void measure_pieces_vectorised(const PathPieceEnds& ends, std::size_t count, double* HWY_RESTRICT azimuth,
                               double* HWY_RESTRICT above) {
  const hn::CappedTag<double, 8> d;
  const auto two = hn::Set(d, 2.0), one = hn::Set(d, 1.0);
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
    const auto ax = hn::Load(d, ends.ax + i), ay = hn::Load(d, ends.ay + i), az = hn::Load(d, ends.az + i);
    const auto bx = hn::Load(d, ends.bx + i), by = hn::Load(d, ends.by + i), bz = hn::Load(d, ends.bz + i);
    // Of the differences, which are short: a × b would lose half of the digits.
    const auto across = hn::Sub(hn::Mul(az, hn::Sub(bx, ax)), hn::Mul(ax, hn::Sub(bz, az)));
    const auto along = hn::MulAdd(ax, bx, hn::Mul(az, bz));
    const auto height = hn::Add(ay, by);
    const auto dot = hn::MulAdd(ay, by, hn::Add(one, along));
    const auto phi = small_angle(d, hn::Div(across, along));
    // The triangle with the north pole (van Oosterom and Strackee 1983, eq. 8), or what the one with the
    // south pole leaves.
    const auto triangle = hn::Mul(two, small_angle(d, hn::Div(across, hn::Add(dot, hn::Abs(height)))));
    hn::Store(phi, d, azimuth + i);
    hn::Store(hn::IfThenElse(hn::Ge(height, hn::Zero(d)), triangle, hn::MulSub(two, phi, triangle)), d,
              above + i);
  }
}

}  // namespace refield::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace refield {

HWY_EXPORT(measure_pieces_vectorised);

void measure_pieces(const PathPieceEnds& ends, std::size_t count, double* azimuth, double* above) {
  HWY_DYNAMIC_DISPATCH(measure_pieces_vectorised)(ends, count, azimuth, above);
}

}  // namespace refield
#endif
