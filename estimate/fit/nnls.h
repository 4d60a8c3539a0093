// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/aligned_memory.h"

namespace refield {

/// Non-negative least squares in normal form: min ½ xᵀ G x − hᵀ x subject to x ≥ 0 (Matusik et al. 2004, eq.
/// 7). Active set method (Lawson and Hanson 1974) with a warm start: the caller's feasible x says which
/// variables are free at first, which in a growing kernel tree is nearly always right.
///
/// Keeps a root W of the inverse of the free variables' Gram matrix G_F, Wᵀ W = G_F⁻¹. To free a variable
/// adds a row to it (its first such root is the inverse of the Cholesky factor), to hold one takes a row away
/// after a Householder reflection; either costs two products with W, where a factorisation costs |F|/6 of
/// them, and both are as stable as the factorisation. So systems that grow variable by variable are solved
/// anew for next to nothing: see proceed().
class NnlsSolver {
 public:
  /// G [size × size], symmetric positive semi-definite, leading dimension `stride`; h [size]; x [size],
  /// feasible on entry (x ≥ 0) and optimal on return. Variables that are dependent on others stay 0. Never
  /// fails: at the limit of iterations x is feasible and no worse than on entry, and false is returned.
  bool solve(const double* G, int stride, const double* h, int size, double* x) {
    start(size);
    return proceed(G, stride, h, size, x);
  }

  /// Forgets the last system; the next has at most `most` variables.
  void start(int most);
  /// Variable i is about to change its products with others.
  void drop(int i);
  /// As solve(), but goes on from where the last call ended: x is as it was left, except that variables may
  /// have been added, or changed after drop(). Of all others G and h are the same.
  bool proceed(const double* G, int stride, const double* h, int size, double* x);

 private:
  bool add(int variable, const double* G, int stride, const double* h);
  void remove(std::size_t position);
  void solve_free();
  /// Moves x towards the solution as far as all stay non-negative; false when someone was held at zero.
  bool step_to_solution(double* x);
  double* row(std::size_t k) { return root_.data() + k * row_stride_; }

  std::vector<int> free_;  // variables not held at zero
  std::vector<char> is_free_, barred_;
  std::size_t row_stride_ = 0;
  AlignedDoubles root_;                     // W, [free × row_stride]; zero behind the last free variable
  std::vector<const double*> rows_;         // of W
  AlignedDoubles column_, part_, minus_y_;  // minus_y = −W h; scratch
  AlignedDoubles solution_;                 // of the free variables
};

/// Value of the least-squares residual ‖b‖² − 2 hᵀx + xᵀGx.
double squared_residual(const double* G, int stride, const double* h, int size, const double* x,
                        double b_squared);

}  // namespace refield
