// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/vector_kernels.h"

#include <algorithm>
#include <cmath>

// Highway compiles the part between BEFORE and AFTER once for each instruction set and picks one at run time.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "estimate/fit/vector_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace refield::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using Floats = hn::CappedTag<float, column_padding>;

using Doubles = hn::CappedTag<double, column_padding_doubles>;

#if HWY_HAVE_SCALABLE || HWY_TARGET == HWY_SCALAR
template <class D, class V>
void store_sums(D d, V s0, V s1, V s2, V s3, hn::TFromD<D>* out) {
  out[0] = hn::GetLane(hn::SumOfLanes(d, s0));
  out[1] = hn::GetLane(hn::SumOfLanes(d, s1));
  out[2] = hn::GetLane(hn::SumOfLanes(d, s2));
  out[3] = hn::GetLane(hn::SumOfLanes(d, s3));
}
#else
/// Adds halves of a vector until one of 128 bits is left.
template <class D, class V>
auto fold_blocks(D d, V v) {
  if constexpr (hn::MaxLanes(d) * sizeof(hn::TFromD<D>) <= 16) {
    return v;
  } else {
    const hn::Half<D> half;
    return fold_blocks(half, hn::Add(hn::LowerHalf(half, v), hn::UpperHalf(half, v)));
  }
}

/// Sums of the lanes of four vectors together: a third of the instructions of one after another.
template <class D, class V>
void store_sums(D d, V s0, V s1, V s2, V s3, hn::TFromD<D>* out) {
  const auto s01 = hn::Add(hn::InterleaveLower(d, s0, s1), hn::InterleaveUpper(d, s0, s1));
  const auto s23 = hn::Add(hn::InterleaveLower(d, s2, s3), hn::InterleaveUpper(d, s2, s3));
  if constexpr (sizeof(hn::TFromD<D>) == 8) {
    const hn::CappedTag<double, 2> block;
    hn::StoreU(fold_blocks(d, s01), block, out);
    hn::StoreU(fold_blocks(d, s23), block, out + 2);
  } else {
    const hn::Repartition<std::uint64_t, D> pairs;
    const auto p01 = hn::BitCast(pairs, s01), p23 = hn::BitCast(pairs, s23);
    const auto s0123 = hn::Add(hn::BitCast(d, hn::InterleaveLower(pairs, p01, p23)),
                               hn::BitCast(d, hn::InterleaveUpper(pairs, p01, p23)));
    hn::StoreU(fold_blocks(d, s0123), hn::CappedTag<float, 4>(), out);
  }
}
#endif

/// Four products at a time: each load of `vector` serves four multiply-adds.
template <class D, class T>
void dots_of(D d, const T* HWY_RESTRICT vector, const T* const* HWY_RESTRICT others, std::size_t count,
             std::size_t n, T* HWY_RESTRICT out) {
  std::size_t k = 0;
  for (; k + 4 <= count; k += 4) {
    auto s0 = hn::Zero(d), s1 = hn::Zero(d), s2 = hn::Zero(d), s3 = hn::Zero(d);
    for (std::size_t j = 0; j < n; j += hn::Lanes(d)) {
      const auto v = hn::Load(d, vector + j);
      s0 = hn::MulAdd(v, hn::Load(d, others[k] + j), s0);
      s1 = hn::MulAdd(v, hn::Load(d, others[k + 1] + j), s1);
      s2 = hn::MulAdd(v, hn::Load(d, others[k + 2] + j), s2);
      s3 = hn::MulAdd(v, hn::Load(d, others[k + 3] + j), s3);
    }
    store_sums(d, s0, s1, s2, s3, out + k);
  }
  for (; k < count; ++k) {
    auto s = hn::Zero(d);
    for (std::size_t j = 0; j < n; j += hn::Lanes(d))
      s = hn::MulAdd(hn::Load(d, vector + j), hn::Load(d, others[k] + j), s);
    out[k] = hn::GetLane(hn::SumOfLanes(d, s));
  }
}

template <class D, class T>
void subtract_from(D d, T* HWY_RESTRICT vector, const T* const* HWY_RESTRICT others,
                   const T* HWY_RESTRICT coefficients, std::size_t count, std::size_t n) {
  for (std::size_t j = 0; j < n; j += hn::Lanes(d)) {
    auto v = hn::Load(d, vector + j);
    for (std::size_t k = 0; k < count; ++k)
      v = hn::NegMulAdd(hn::Set(d, coefficients[k]), hn::Load(d, others[k] + j), v);
    hn::Store(v, d, vector + j);
  }
}

void dots_float(const float* vector, const float* const* others, std::size_t count, std::size_t n,
                float* out) {
  dots_of(Floats(), vector, others, count, n, out);
}

void dots_double(const double* vector, const double* const* others, std::size_t count, std::size_t n,
                 double* out) {
  dots_of(Doubles(), vector, others, count, n, out);
}

void subtract_float(float* vector, const float* const* others, const float* coefficients, std::size_t count,
                    std::size_t n) {
  subtract_from(Floats(), vector, others, coefficients, count, n);
}

void subtract_double(double* vector, const double* const* others, const double* coefficients,
                     std::size_t count, std::size_t n) {
  subtract_from(Doubles(), vector, others, coefficients, count, n);
}

/// (d − c) − (b − a) at lanes from j on.
template <class D>
auto corner_sum(D d, const std::array<const double*, 4>& corners, std::size_t j) {
  const hn::Rebind<float, D> floats;
  const auto upper = hn::Sub(hn::LoadU(d, corners[1] + j), hn::LoadU(d, corners[0] + j));
  const auto lower = hn::Sub(hn::LoadU(d, corners[3] + j), hn::LoadU(d, corners[2] + j));
  return hn::DemoteTo(floats, hn::Sub(lower, upper));
}

float corner_sum(const std::array<const double*, 4>& corners, std::size_t j) {
  return static_cast<float>((corners[3][j] - corners[2][j]) - (corners[1][j] - corners[0][j]));
}

void corner_sums_vectorised(const std::array<const double*, 4>& corners, std::size_t n,
                            float* HWY_RESTRICT out) {
  const Doubles d;
  const hn::Rebind<float, Doubles> floats;
  std::size_t j = 0;
  for (; j + hn::Lanes(d) <= n; j += hn::Lanes(d)) hn::StoreU(corner_sum(d, corners, j), floats, out + j);
  for (; j < n; ++j) out[j] = corner_sum(corners, j);
}

void corner_products_vectorised(const std::array<const double*, 4>& corners, std::size_t n,
                                const float* HWY_RESTRICT vector, float& with_vector, float& squared) {
  const Doubles d;
  const hn::Rebind<float, Doubles> floats;
  auto product = hn::Zero(floats), square = hn::Zero(floats);
  std::size_t j = 0;
  for (; j + hn::Lanes(d) <= n; j += hn::Lanes(d)) {
    const auto a = corner_sum(d, corners, j);
    product = hn::MulAdd(a, hn::LoadU(floats, vector + j), product);
    square = hn::MulAdd(a, a, square);
  }
  with_vector = hn::GetLane(hn::SumOfLanes(floats, product));
  squared = hn::GetLane(hn::SumOfLanes(floats, square));
  for (; j < n; ++j) {
    const float a = corner_sum(corners, j);
    with_vector += a * vector[j];
    squared += a * a;
  }
}

void add_gains_vectorised(const float* HWY_RESTRICT correlation, const float* HWY_RESTRICT norm2,
                          const float* HWY_RESTRICT min_norm2, std::size_t n, float* HWY_RESTRICT gain) {
  const Floats d;
  for (std::size_t j = 0; j < n; j += hn::Lanes(d)) {
    const auto positive = hn::Max(hn::Load(d, correlation + j), hn::Zero(d));
    const auto divisor = hn::Load(d, norm2 + j);
    const auto value = hn::Div(hn::Mul(positive, positive), divisor);
    const auto valid = hn::Gt(divisor, hn::Load(d, min_norm2 + j));
    hn::Store(hn::Add(hn::Load(d, gain + j), hn::IfThenElseZero(valid, value)), d, gain + j);
  }
}

}  // namespace refield::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace refield {

HWY_EXPORT(dots_float);
HWY_EXPORT(dots_double);
HWY_EXPORT(subtract_float);
HWY_EXPORT(subtract_double);
HWY_EXPORT(add_gains_vectorised);
HWY_EXPORT(corner_sums_vectorised);
HWY_EXPORT(corner_products_vectorised);

void dots(const float* vector, const float* const* others, std::size_t count, std::size_t n, float* out) {
  HWY_DYNAMIC_DISPATCH(dots_float)(vector, others, count, n, out);
}

void dots(const double* vector, const double* const* others, std::size_t count, std::size_t n, double* out) {
  HWY_DYNAMIC_DISPATCH(dots_double)(vector, others, count, n, out);
}

void subtract_combination(float* vector, const float* const* others, const float* coefficients,
                          std::size_t count, std::size_t n) {
  HWY_DYNAMIC_DISPATCH(subtract_float)(vector, others, coefficients, count, n);
}

void subtract_combination(double* vector, const double* const* others, const double* coefficients,
                          std::size_t count, std::size_t n) {
  HWY_DYNAMIC_DISPATCH(subtract_double)(vector, others, coefficients, count, n);
}

void corner_sums(const std::array<const double*, 4>& corners, std::size_t n, float* out) {
  HWY_DYNAMIC_DISPATCH(corner_sums_vectorised)(corners, n, out);
}

void corner_products(const std::array<const double*, 4>& corners, std::size_t n, const float* vector,
                     float& with_vector, float& squared) {
  HWY_DYNAMIC_DISPATCH(corner_products_vectorised)(corners, n, vector, with_vector, squared);
}

void add_gains(const float* correlation, const float* norm2, const float* least, std::size_t n, float* gain) {
  HWY_DYNAMIC_DISPATCH(add_gains_vectorised)(correlation, norm2, least, n, gain);
}

float orthonormalise(float* vector, const float* const* basis, std::size_t count, std::size_t n,
                     float* coordinates) {
  /// Directions that keep less than this part of their squared norm after projection are rounding noise.
  constexpr float dependence_tolerance = 1e-6f;
  /// Those that keep more than this are orthogonal to working precision after one pass.
  constexpr float kept_at_once = 0.1f;
  const float* self = vector;
  float before = 0.0f, after = 0.0f;
  dots(vector, &self, 1, n, &before);
  dots(vector, basis, count, n, coordinates);
  subtract_combination(vector, basis, coordinates, count, n);
  dots(vector, &self, 1, n, &after);
  if (after < kept_at_once * before && count > 0) {
    // Gram-Schmidt twice is enough (Kahan, Parlett).
    std::vector<float> again(count);
    dots(vector, basis, count, n, again.data());
    subtract_combination(vector, basis, again.data(), count, n);
    std::transform(again.begin(), again.end(), coordinates, coordinates, std::plus<>());
    dots(vector, &self, 1, n, &after);
  }
  const bool independent = after > dependence_tolerance * before;
  const float norm = independent ? std::sqrt(after) : 0.0f;
  const float scale = independent ? 1.0f / norm : 0.0f;
  std::transform(vector, vector + n, vector, [scale](float v) { return v * scale; });
  return norm;
}

}  // namespace refield
#endif
