// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "estimate/aligned_memory.h"

namespace refield {

/// Non-negative least squares in normal form: min ½ xᵀ G x − hᵀ x subject to x ≥ 0 (Matusik et al. 2004, eq.
/// 7). Active set method (Lawson and Hanson 1974) with a warm start: the caller's feasible x says which
/// variables are free at first, which in a growing kernel tree is nearly always right (about two
/// factorisations a call).
class NnlsSolver {
 public:
  /// G [size × size], symmetric positive semi-definite, leading dimension `stride`; h [size]; x [size],
  /// feasible on entry (x ≥ 0) and optimal on return. Variables that are dependent on others stay 0. Never
  /// fails: at the limit of iterations x is feasible and no worse than on entry, and false is returned.
  bool solve(const double* G, int stride, const double* h, int size, double* x);

 private:
  bool factorise_and_solve(const double* G, int stride, const double* h);
  std::vector<int> free_;  // variables not held at zero
  std::vector<char> barred_;
  std::vector<double, AlignedAllocator<double>> factor_;
  std::vector<double> solution_;
};

/// Value of the least-squares residual ‖b‖² − 2 hᵀx + xᵀGx.
double squared_residual(const double* G, int stride, const double* h, int size, const double* x,
                        double b_squared);

}  // namespace refield
