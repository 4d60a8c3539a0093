// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/nnls.h"
#include "core/base/linear_algebra.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <limits>

#include "core/base/rng.h"

namespace refield {
namespace {

using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

struct Problem {
  RowMatrix G;
  Eigen::VectorXd h;
  double b_squared;
};

/// Positive columns, as sums of light are: the hard case, since all columns point much the same way.
Problem random_problem(int rows, int columns, std::uint64_t seed) {
  Rng rng(seed);
  Eigen::MatrixXd A(rows, columns);
  for (int i = 0; i < rows; ++i)
    for (int k = 0; k < columns; ++k) A(i, k) = rng.uniform();
  Eigen::VectorXd x(columns), b(rows);
  for (int k = 0; k < columns; ++k) x(k) = std::max(0.0, rng.normal());
  for (int i = 0; i < rows; ++i) b(i) = 0.3 * rng.normal();
  b += A * x;
  return {A.transpose() * A, A.transpose() * b, b.squaredNorm()};
}

double objective(const Problem& p, const Eigen::VectorXd& x) {
  return x.dot(p.G * x) - 2.0 * p.h.dot(x);
}

/// The best of all 2^n choices of free variables.
double best_by_enumeration(const Problem& p) {
  const int n = static_cast<int>(p.h.size());
  double best = 0.0;
  for (int choice = 1; choice < (1 << n); ++choice) {
    std::vector<int> free;
    for (int k = 0; k < n; ++k)
      if (choice >> k & 1) free.push_back(k);
    const Eigen::VectorXd x = solve_symmetric(p.G(free, free), p.h(free));
    if (x.minCoeff() < 0.0) continue;
    Eigen::VectorXd whole = Eigen::VectorXd::Zero(n);
    whole(free) = x;
    best = std::min(best, objective(p, whole));
  }
  return best;
}

Eigen::VectorXd solve(const Problem& p, Eigen::VectorXd x) {
  NnlsSolver solver;
  EXPECT_TRUE(solver.solve(p.G.data(), static_cast<int>(p.G.cols()), p.h.data(), static_cast<int>(p.h.size()),
                           x.data()));
  return x;
}

TEST(Nnls, FindsTheOptimumOfAllActiveSets) {
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    const Problem p = random_problem(12, 7, seed);
    const Eigen::VectorXd x = solve(p, Eigen::VectorXd::Zero(7));
    EXPECT_GE(x.minCoeff(), 0.0);
    EXPECT_NEAR(objective(p, x), best_by_enumeration(p), 1e-9 * p.b_squared) << "seed " << seed;
  }
}

TEST(Nnls, SatisfiesTheOptimalityConditions) {
  const Problem p = random_problem(180, 40, 3);
  const Eigen::VectorXd x = solve(p, Eigen::VectorXd::Zero(40));
  const Eigen::VectorXd gradient = p.G * x - p.h;
  const double scale = p.h.cwiseAbs().maxCoeff();
  int held = 0;
  for (int k = 0; k < 40; ++k) {
    if (x(k) > 0.0) {
      EXPECT_NEAR(gradient(k), 0.0, 1e-8 * scale);
    } else {
      ++held;
      EXPECT_GE(gradient(k), -1e-8 * scale);
    }
  }
  EXPECT_GT(held, 0) << "the problem exercises no constraint";
}

TEST(Nnls, WarmAndColdStartsMeet) {
  const Problem p = random_problem(60, 20, 9);
  const Eigen::VectorXd cold = solve(p, Eigen::VectorXd::Zero(20));
  Rng rng(4);
  for (int trial = 0; trial < 20; ++trial) {
    Eigen::VectorXd start(20);
    for (int k = 0; k < 20; ++k) start(k) = rng.uniform() < 0.5 ? 0.0 : rng.uniform();
    EXPECT_LT((solve(p, start) - cold).norm(), 1e-7 * cold.norm());
  }
}

TEST(Nnls, DependentColumnsLeaveAFiniteFeasibleAnswer) {
  Problem p = random_problem(30, 6, 5);
  // Column 5 becomes a copy of column 0.
  p.G.col(5) = p.G.col(0);
  p.G.row(5) = p.G.row(0);
  p.h(5) = p.h(0);
  Problem without = p;
  without.G = p.G.topLeftCorner(5, 5);
  without.h = p.h.head(5);
  for (const double start : {0.0, 1.0}) {
    const Eigen::VectorXd x = solve(p, Eigen::VectorXd::Constant(6, start));
    EXPECT_TRUE(x.allFinite());
    EXPECT_GE(x.minCoeff(), 0.0);
    EXPECT_NEAR(objective(p, x), best_by_enumeration(without), 1e-7 * p.b_squared);
  }
}

TEST(Nnls, ZeroRightHandSideGivesZero) {
  Problem p = random_problem(10, 4, 1);
  p.h.setZero();
  EXPECT_EQ(solve(p, Eigen::VectorXd::Ones(4)).maxCoeff(), 0.0);
}

TEST(Nnls, ResidualIsThatOfTheFit) {
  const Problem p = random_problem(25, 5, 11);
  const Eigen::VectorXd x = solve(p, Eigen::VectorXd::Zero(5));
  EXPECT_NEAR(squared_residual(p.G.data(), 5, p.h.data(), 5, x.data(), p.b_squared),
              p.b_squared + objective(p, x), 1e-12 * p.b_squared);
}

TEST(Nnls, StaysNonNegativeWhereTheSolutionIsNextToNothing) {
  // From weights of one the way to solutions of 1e-13 loses all digits: rounding must not carry any below
  // zero.
  Rng rng(5);
  for (int trial = 0; trial < 5000; ++trial) {
    Eigen::MatrixXd A(12, 6);
    Eigen::VectorXd b(12);
    for (double& a : A.reshaped()) a = rng.normal();
    for (double& v : b) v = 1e-13 * std::abs(rng.normal());
    const Problem p{A.transpose() * A, A.transpose() * b, b.squaredNorm()};
    ASSERT_GE(solve(p, Eigen::VectorXd::Ones(6)).minCoeff(), 0.0) << "trial " << trial;
  }
}

}  // namespace
}  // namespace refield
