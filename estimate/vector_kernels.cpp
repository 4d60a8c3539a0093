// SPDX-License-Identifier: Apache-2.0
#include "estimate/vector_kernels.h"

#include <algorithm>
#include <cmath>
#include <functional>

// Highway compiles the part between BEFORE and AFTER once for each instruction set and picks one at run time.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "estimate/vector_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace refield::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using Floats = hn::CappedTag<float, column_padding>;

/// Four products at a time: each load of `vector` serves four multiply-adds.
void dots_vectorised(const float* HWY_RESTRICT vector, const float* const* HWY_RESTRICT others,
                     std::size_t count, std::size_t n, float* HWY_RESTRICT out) {
  const Floats d;
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
    out[k] = hn::GetLane(hn::SumOfLanes(d, s0));
    out[k + 1] = hn::GetLane(hn::SumOfLanes(d, s1));
    out[k + 2] = hn::GetLane(hn::SumOfLanes(d, s2));
    out[k + 3] = hn::GetLane(hn::SumOfLanes(d, s3));
  }
  for (; k < count; ++k) {
    auto s = hn::Zero(d);
    for (std::size_t j = 0; j < n; j += hn::Lanes(d))
      s = hn::MulAdd(hn::Load(d, vector + j), hn::Load(d, others[k] + j), s);
    out[k] = hn::GetLane(hn::SumOfLanes(d, s));
  }
}

void add_gains_vectorised(const float* HWY_RESTRICT correlation, const float* HWY_RESTRICT norm2,
                          const float* HWY_RESTRICT least, std::size_t n, float* HWY_RESTRICT gain) {
  const Floats d;
  for (std::size_t j = 0; j < n; j += hn::Lanes(d)) {
    const auto positive = hn::Max(hn::Load(d, correlation + j), hn::Zero(d));
    const auto divisor = hn::Load(d, norm2 + j);
    const auto value = hn::Div(hn::Mul(positive, positive), divisor);
    const auto valid = hn::Gt(divisor, hn::Load(d, least + j));
    hn::Store(hn::Add(hn::Load(d, gain + j), hn::IfThenElseZero(valid, value)), d, gain + j);
  }
}

void subtract_vectorised(float* HWY_RESTRICT vector, const float* const* HWY_RESTRICT others,
                         const float* HWY_RESTRICT coefficients, std::size_t count, std::size_t n) {
  const Floats d;
  for (std::size_t j = 0; j < n; j += hn::Lanes(d)) {
    auto v = hn::Load(d, vector + j);
    for (std::size_t k = 0; k < count; ++k)
      v = hn::NegMulAdd(hn::Set(d, coefficients[k]), hn::Load(d, others[k] + j), v);
    hn::Store(v, d, vector + j);
  }
}

int cholesky_vectorised(double* HWY_RESTRICT A, std::size_t size, std::size_t stride, double least_pivot) {
  const hn::CappedTag<double, cholesky_padding> d;
  const std::size_t lanes = hn::Lanes(d);
  double diagonal[3 * 256];
  for (std::size_t j = 0; j < size; ++j) diagonal[j] = A[j * stride + j];
  for (std::size_t k = 0; k < size; ++k) {
    double* pivot_column = A + k * stride;
    const double pivot = pivot_column[k];
    if (!(pivot > least_pivot * diagonal[k])) return static_cast<int>(k);
    const double inverse = 1.0 / std::sqrt(pivot);
    const auto scale = hn::Set(d, inverse);
    for (std::size_t i = (k + 1) / lanes * lanes; i < size; i += lanes)
      hn::Store(hn::Mul(hn::Load(d, pivot_column + i), scale), d, pivot_column + i);
    pivot_column[k] = inverse;
    for (std::size_t j = k + 1; j < size; ++j) {
      double* column = A + j * stride;
      const auto factor = hn::Set(d, pivot_column[j]);
      for (std::size_t i = j / lanes * lanes; i < size; i += lanes)
        hn::Store(hn::NegMulAdd(factor, hn::Load(d, pivot_column + i), hn::Load(d, column + i)), d,
                  column + i);
    }
  }
  return -1;
}

}  // namespace refield::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace refield {

HWY_EXPORT(dots_vectorised);
HWY_EXPORT(add_gains_vectorised);
HWY_EXPORT(subtract_vectorised);
HWY_EXPORT(cholesky_vectorised);

void dots(const float* vector, const float* const* others, std::size_t count, std::size_t n, float* out) {
  HWY_DYNAMIC_DISPATCH(dots_vectorised)(vector, others, count, n, out);
}

void subtract_combination(float* vector, const float* const* others, const float* coefficients,
                          std::size_t count, std::size_t n) {
  HWY_DYNAMIC_DISPATCH(subtract_vectorised)(vector, others, coefficients, count, n);
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

int factorise_cholesky(double* A, std::size_t size, std::size_t stride, double least_pivot) {
  return HWY_DYNAMIC_DISPATCH(cholesky_vectorised)(A, size, stride, least_pivot);
}

}  // namespace refield
#endif
