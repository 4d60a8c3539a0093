// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/nnls.h"

#include <algorithm>
#include <cmath>

#include "estimate/fit/vector_kernels.h"

namespace refield {

namespace {
/// A variable that keeps less than this part of its squared norm beside the free ones is rounding noise: the
/// columns were summed in float32.
constexpr double pivot_tolerance = 1e-9;
/// A gradient this small, relative to h, is zero to rounding.
constexpr double gradient_tolerance = 1e-9;

std::size_t padded(std::size_t n) {
  return (n + column_padding_doubles - 1) / column_padding_doubles * column_padding_doubles;
}
}  // namespace

void NnlsSolver::start(int max_size) {
  free_.clear();
  is_free_.assign(max_size, 0);
  row_stride_ = padded(max_size);
  if (root_.size() < max_size * row_stride_) root_.resize(max_size * row_stride_);
  rows_.resize(max_size);
  for (int k = 0; k < max_size; ++k) rows_[k] = row(k);
  for (auto* vector : {&column_, &part_, &minus_y_, &solution_}) vector->resize(row_stride_);
}

bool NnlsSolver::add(int variable, const double* G, int stride, const double* h) {
  const std::size_t m = free_.size(), n = padded(m);
  const double* g = G + static_cast<std::size_t>(variable) * stride;
  for (std::size_t k = 0; k < m; ++k) column_[k] = g[free_[k]];
  std::fill(column_.begin() + m, column_.begin() + n, 0.0);
  // The new variable's part beside the free ones, as in a Cholesky factor: l = W g, pivot = g_vv − ‖l‖².
  dots(column_.data(), rows_.data(), m, n, part_.data());
  double pivot = g[variable], y = h[variable];
  for (std::size_t k = 0; k < m; ++k) {
    pivot -= part_[k] * part_[k];
    y += part_[k] * minus_y_[k];
  }
  if (!(pivot > pivot_tolerance * g[variable])) return false;
  const double inverse = 1.0 / std::sqrt(pivot);
  for (std::size_t k = 0; k < m; ++k) part_[k] *= inverse;
  double* w = row(m);
  std::fill_n(w, row_stride_, 0.0);
  subtract_combination(w, rows_.data(), part_.data(), m, n);
  w[m] = inverse;
  minus_y_[m] = -y * inverse;
  free_.push_back(variable);
  is_free_[variable] = 1;
  return true;
}

void NnlsSolver::remove(std::size_t position) {
  const std::size_t m = free_.size(), n = padded(m), last = m - 1;
  // Reflects the rows so that the variable's column is left in the last row alone, which goes with it.
  double norm2 = 0.0;
  for (std::size_t k = 0; k < m; ++k) {
    part_[k] = row(k)[position];
    norm2 += part_[k] * part_[k];
  }
  const double norm = std::sqrt(norm2), end = part_[last];
  part_[last] += end < 0.0 ? -norm : norm;
  const double minus_scale = -1.0 / (norm * (norm + std::abs(end)));  // −2 / ‖v‖²
  double y = 0.0;
  for (std::size_t k = 0; k < m; ++k) y += part_[k] * minus_y_[k];
  for (std::size_t k = 0; k < last; ++k) minus_y_[k] += minus_scale * part_[k] * y;
  std::fill_n(column_.data(), n, 0.0);
  subtract_combination(column_.data(), rows_.data(), part_.data(), m, n);  // −vᵀ W
  const double* reflected = column_.data();
  for (std::size_t k = 0; k < last; ++k) {
    double* w = row(k);
    const double factor = minus_scale * part_[k];
    subtract_combination(w, &reflected, &factor, 1, n);
    w[position] = w[last];
    w[last] = 0.0;
  }
  is_free_[free_[position]] = 0;
  free_[position] = free_[last];
  free_.pop_back();
}

void NnlsSolver::drop(int i) {
  if (!is_free_[i]) return;
  remove(static_cast<std::size_t>(std::ranges::find(free_, i) - free_.begin()));
}

void NnlsSolver::solve_free() {
  const std::size_t n = padded(free_.size());
  std::fill_n(solution_.data(), n, 0.0);
  subtract_combination(solution_.data(), rows_.data(), minus_y_.data(), free_.size(), n);
}

bool NnlsSolver::step_to_solution(double* x) {
  double step = 1.0;
  bool blocks = false;  // a step may round to 1 and yet end below zero
  for (std::size_t i = 0; i < free_.size(); ++i)
    if (solution_[i] <= 0.0) {
      const double from = x[free_[i]];
      step = std::min(step, from / (from - solution_[i]));
      blocks = true;
    }
  if (!blocks) {
    for (std::size_t i = 0; i < free_.size(); ++i) x[free_[i]] = solution_[i];
    return true;
  }
  for (std::size_t i = free_.size(); i-- > 0;) {  // downwards, since the last takes a removed one's place
    double& value = x[free_[i]];
    const double moved = value + step * (solution_[i] - value);
    // Rounding may carry a small one below zero even where its solution is not.
    const bool blocked =
        moved <= 0.0 || (solution_[i] <= 0.0 && moved <= 1e-14 * (value + std::abs(solution_[i])));
    value = blocked ? 0.0 : moved;
    if (blocked) remove(i);
  }
  return false;
}

bool NnlsSolver::proceed(const double* G, int stride, const double* h, int size, double* x) {
  barred_.assign(size, 0);
  double largest_h = 0.0;
  const auto free_or_bar = [&](int i) {
    if (add(i, G, stride, h)) return;
    // The barred variable's part goes to no one: the objective may rise for a moment, the next solution
    // repairs it.
    barred_[i] = 1;
    x[i] = 0.0;
  };
  for (int i = 0; i < size; ++i) {
    largest_h = std::max(largest_h, std::abs(h[i]));
    if (x[i] > 0.0 && !is_free_[i]) free_or_bar(i);
  }
  const int limit = 3 * size + 10;
  for (int iteration = 0; iteration < limit; ++iteration) {
    solve_free();
    if (!step_to_solution(x)) continue;
    // Free the variable that would lower the objective most steeply.
    int entering = -1;
    double steepest = gradient_tolerance * largest_h;
    for (int i = 0; i < size; ++i) {
      if (x[i] > 0.0 || barred_[i]) continue;
      const double* g = G + static_cast<std::size_t>(i) * stride;
      double gradient = h[i];
      for (const int k : free_) gradient -= g[k] * x[k];
      if (gradient > steepest) {
        steepest = gradient;
        entering = i;
      }
    }
    if (entering < 0) return true;
    free_or_bar(entering);
  }
  return false;
}

double squared_residual(const double* G, int stride, const double* h, int size, const double* x,
                        double b_squared) {
  double value = b_squared;
  for (int i = 0; i < size; ++i) {
    if (x[i] == 0.0) continue;
    const double* g = G + static_cast<std::size_t>(i) * stride;
    double gx = 0.0;
    for (int k = 0; k < size; ++k) gx += g[k] * x[k];
    value += x[i] * (gx - 2.0 * h[i]);
  }
  return std::max(value, 0.0);
}

}  // namespace refield
