// SPDX-License-Identifier: Apache-2.0
#include <tbb/parallel_for.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <numbers>
#include <string>

#include "core/errors.h"
#include "core/run_context.h"
#include "simulate/dynamic/brdf_factors.h"
#include "simulate/dynamic/fourier_orders.h"

namespace refield::dynamic {

namespace {

/// ∫ cos² mφ dφ.
double circle(int order) {
  return order == 0 ? 2.0 * std::numbers::pi : std::numbers::pi;
}

/// One singular value of one Fourier order; a pair of terms shares it.
struct Candidate {
  int order;
  double singular_value;
  Eigen::VectorXd vector;  ///< [nodes], of the incoming side, unit, times √weight

  int terms() const { return order == 0 ? 1 : 2; }
  double energy() const { return terms() * singular_value * singular_value; }
};

/// Samples are in float: singular values below so much of the largest one are their rounding.
constexpr double rounding = 1e-6;

/// Singular values of the incoming side from the eigenvalues of A Aᵀ, A being f_m times the roots of both
/// weights: it is as small as the nodes are, whatever the channels.
std::vector<Candidate> candidates_of(const FourierOrders& orders, int m) {
  const Eigen::VectorXd root = orders.weight.cwiseSqrt();
  Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(orders.nodes, orders.nodes);
  const Eigen::MatrixXf& f = orders.f[static_cast<std::size_t>(m)];
  for (int c = 0; c < 3; ++c) {
    const Eigen::MatrixXd a =
        root.asDiagonal() * f(Eigen::all, Eigen::seqN(c, orders.nodes, 3)).cast<double>() * root.asDiagonal();
    gram.noalias() += a * a.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(gram);
  std::vector<Candidate> candidates;
  for (Eigen::Index i = orders.nodes - 1; i >= 0 && solver.eigenvalues()[i] > 0.0; --i)
    candidates.push_back({m, circle(m) * std::sqrt(solver.eigenvalues()[i]), solver.eigenvectors().col(i)});
  return candidates;
}

/// Of all orders, the largest first.
std::vector<Candidate> all_candidates(const FourierOrders& orders, const RunContext& run) {
  std::vector<std::vector<Candidate>> by_order(orders.f.size());
  tbb::parallel_for(std::size_t{0}, by_order.size(), [&](std::size_t m) {
    run.throw_if_stopped();
    by_order[m] = candidates_of(orders, static_cast<int>(m));
  });
  std::vector<Candidate> candidates;
  for (auto& some : by_order) std::ranges::move(some, std::back_inserter(candidates));
  std::ranges::stable_sort(candidates, std::ranges::greater(), &Candidate::singular_value);
  while (!candidates.empty() &&
         candidates.back().singular_value < rounding * candidates.front().singular_value)
    candidates.pop_back();
  return candidates;
}

struct Selection {
  std::vector<Candidate> chosen;
  double error = 0.0;
};

Selection select(const std::vector<Candidate>& candidates, double energy, const FactorOptions& options) {
  const int largest = options.largest > 0 ? options.largest : FactorOptions::most_terms;
  Selection selection;
  int terms = 0;
  double left = energy;
  for (const Candidate& candidate : candidates) {
    if (left <= options.error * options.error * energy) break;
    if (terms + candidate.terms() > largest) continue;
    terms += candidate.terms();
    left -= candidate.energy();
    selection.chosen.push_back(candidate);
  }
  selection.error = energy > 0.0 ? std::sqrt(std::max(0.0, left) / energy) : 0.0;
  return selection;
}

/// Between evenly spaced values, by cubics through them (Catmull and Rom).
template <class Value>
std::vector<Value> refined(const std::vector<Value>& values, int parts) {
  const auto count = static_cast<std::ptrdiff_t>(values.size());
  const auto at = [&](std::ptrdiff_t i) -> Value {
    const auto value = [&](std::ptrdiff_t k) { return values[static_cast<std::size_t>(k)]; };
    if (i < 0) return 2.0f * value(0) - value(1);
    if (i >= count) return 2.0f * value(count - 1) - value(count - 2);
    return value(i);
  };
  std::vector<Value> fine;
  for (std::ptrdiff_t i = 0; i + 1 < count; ++i) {
    const Value a = at(i - 1), b = at(i), c = at(i + 1), d = at(i + 2);
    for (int part = 0; part < parts; ++part) {
      const float t = static_cast<float>(part) / static_cast<float>(parts);
      fine.push_back(
          b + 0.5f * t * (c - a + t * (2.0f * a - 5.0f * b + 4.0f * c - d + t * (3.0f * (b - c) + d - a))));
    }
  }
  fine.push_back(values.back());
  return fine;
}

constexpr int parts_of_a_node = 4;

/// Functions at all nodes, also where the weight is zero, from integrals over the other side.
RadialTerm functions_of(const FourierOrders& orders, const Candidate& candidate) {
  const Eigen::MatrixXd f = orders.f[static_cast<std::size_t>(candidate.order)].cast<double>();
  Eigen::VectorXd from = candidate.vector.cwiseProduct(orders.weight.cwiseSqrt());
  if (from.sum() < 0.0) from = -from;  // of the two signs always the same
  const double scale = std::sqrt(circle(candidate.order));
  const Eigen::VectorXd outgoing = f.transpose() * from * (scale / candidate.singular_value);
  Eigen::VectorXd weighted(outgoing.size());
  for (int j = 0; j < orders.nodes; ++j)
    weighted.segment<3>(3 * j) = orders.weight[j] * outgoing.segment<3>(3 * j);
  const Eigen::VectorXd incoming = f * weighted * circle(candidate.order);
  RadialTerm term{candidate.order, {}, {}};
  for (int j = 0; j < orders.nodes; ++j) {
    term.incoming.push_back(static_cast<float>(incoming[j]));
    term.outgoing.push_back(outgoing.segment<3>(3 * j).cast<float>());
  }
  term.incoming = refined(term.incoming, parts_of_a_node);
  term.outgoing = refined(term.outgoing, parts_of_a_node);
  return term;
}

}  // namespace

void FactorOptions::check() const {
  if (largest < 0 || largest > most_terms)
    throw InputError("number of BRDF terms " + std::to_string(largest) + ": give one from 1 to " +
                     std::to_string(most_terms) + ", or 0 for as many as the error bound requires");
  if (!(error >= 0.0 && error < 1.0))
    throw InputError("error of the BRDF's terms " + std::to_string(error) +
                     ": give a share from 0 to less than 1");
}

BrdfFactors factor(const Brdf& brdf, const FactorOptions& options, const RunContext& run) {
  brdf.check();
  options.check();
  const FourierOrders orders = fourier_orders(brdf, run);
  const Selection selection = select(all_candidates(orders, run), orders.energy, options);
  std::vector<RadialTerm> radial(selection.chosen.size());
  tbb::parallel_for(std::size_t{0}, radial.size(),
                    [&](std::size_t r) { radial[r] = functions_of(orders, selection.chosen[r]); });
  return {radial, selection.error};
}

}  // namespace refield::dynamic
