// SPDX-License-Identifier: Apache-2.0
#include "estimate/nnls.h"

#include <algorithm>
#include <cmath>

#include "estimate/vector_kernels.h"

namespace refield {

namespace {
/// Pivots below this part of the diagonal are rounding noise: the columns were summed in float32.
constexpr double dependence_tolerance = 1e-9;
/// A gradient this small, relative to h, is zero to rounding.
constexpr double gradient_tolerance = 1e-9;
}  // namespace

bool NnlsSolver::factorise_and_solve(const double* G, int stride, const double* h) {
  const std::size_t m = free_.size();
  const std::size_t rows = (m + cholesky_padding - 1) / cholesky_padding * cholesky_padding;
  factor_.resize(rows * m);
  solution_.resize(m);
  for (std::size_t j = 0; j < m; ++j) {
    const double* g = G + static_cast<std::size_t>(free_[j]) * stride;
    double* column = factor_.data() + j * rows;
    for (std::size_t i = j; i < m; ++i) column[i] = g[free_[i]];
  }
  const int dependent = factorise_cholesky(factor_.data(), m, rows, dependence_tolerance);
  if (dependent >= 0) {
    barred_[free_[dependent]] = 1;
    free_.erase(free_.begin() + dependent);
    return false;
  }
  // Two triangular solves; the diagonal holds its own inverse.
  for (std::size_t i = 0; i < m; ++i) solution_[i] = h[free_[i]];
  for (std::size_t j = 0; j < m; ++j) {
    const double* column = factor_.data() + j * rows;
    const double value = solution_[j] *= column[j];
    for (std::size_t i = j + 1; i < m; ++i) solution_[i] -= column[i] * value;
  }
  for (std::size_t j = m; j-- > 0;) {
    const double* column = factor_.data() + j * rows;
    double value = solution_[j];
    for (std::size_t i = j + 1; i < m; ++i) value -= column[i] * solution_[i];
    solution_[j] = value * column[j];
  }
  return true;
}

bool NnlsSolver::solve(const double* G, int stride, const double* h, int size, double* x) {
  free_.clear();
  barred_.assign(size, 0);
  double largest_h = 0.0;
  for (int i = 0; i < size; ++i) {
    largest_h = std::max(largest_h, std::abs(h[i]));
    if (x[i] > 0.0) free_.push_back(i);
  }
  const int limit = 3 * size + 10;
  for (int iteration = 0; iteration < limit; ++iteration) {
    if (!factorise_and_solve(G, stride, h)) {
      // The barred variable's part goes to nobody: the objective may rise for a moment, the next solve
      // repairs it.
      for (int i = 0; i < size; ++i)
        if (barred_[i]) x[i] = 0.0;
      continue;
    }
    // Walk from x towards the solution as far as all stay non-negative; who reaches zero is held there.
    double step = 1.0;
    bool blocks = false;  // a step may round to 1 and yet end below zero
    for (std::size_t i = 0; i < free_.size(); ++i)
      if (solution_[i] <= 0.0) {
        const double from = x[free_[i]];
        step = std::min(step, from / (from - solution_[i]));
        blocks = true;
      }
    if (blocks) {
      std::size_t kept = 0;
      for (std::size_t i = 0; i < free_.size(); ++i) {
        double& value = x[free_[i]];
        const double moved = value + step * (solution_[i] - value);
        // Rounding may carry a small one below zero even where its solution is not.
        const bool blocked =
            moved <= 0.0 || (solution_[i] <= 0.0 && moved <= 1e-14 * (value + std::abs(solution_[i])));
        value = blocked ? 0.0 : moved;
        if (!blocked) free_[kept++] = free_[i];
      }
      free_.resize(kept);
      continue;
    }
    for (std::size_t i = 0; i < free_.size(); ++i) x[free_[i]] = solution_[i];
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
    free_.insert(std::ranges::lower_bound(free_, entering), entering);
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
