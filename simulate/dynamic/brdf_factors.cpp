// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/brdf_factors.h"

#include <tbb/parallel_for.h>

#include <array>
#include <numbers>

#include "core/base/linear_algebra.h"

namespace refield::dynamic {

namespace {

/// cos mφ and sin mφ for all orders that occur.
struct Turns {
  std::array<float, highest_fourier_order + 1> cosine, sine;

  Turns(const Eigen::Vector3f& direction, int highest) {
    cosine[0] = 1.0f;
    sine[0] = 0.0f;
    const float across = direction.head<2>().norm();
    // At the pole there is no azimuth, and all orders but 0 have the value 0.
    const float c = across > 0.0f ? direction.x() / across : 1.0f;
    const float s = across > 0.0f ? direction.y() / across : 0.0f;
    for (std::size_t m = 1; m <= static_cast<std::size_t>(highest); ++m) {
      cosine[m] = cosine[m - 1] * c - sine[m - 1] * s;
      sine[m] = sine[m - 1] * c + cosine[m - 1] * s;
    }
  }
};

/// Values of all radial terms between two nodes, times their turns.
template <class Value>
void interpolate(const std::vector<Value>& table, const std::vector<int>& order, int nodes, int highest,
                 const Eigen::Vector3f& direction, std::span<Value> values) {
  const Turns turns(direction, highest);
  const float place = node_place(direction, nodes);
  const int first = std::min(static_cast<int>(place), nodes - 2);
  const float share = place - static_cast<float>(first);
  const Value* near = table.data() + static_cast<std::size_t>(first) * order.size();
  const Value* far = near + order.size();
  std::size_t k = 0;
  for (std::size_t r = 0; r < order.size(); ++r) {
    const Value value = near[r] + share * (far[r] - near[r]);
    const auto m = static_cast<std::size_t>(order[r]);
    values[k++] = value * turns.cosine[m];
    if (m > 0) values[k++] = value * turns.sine[m];
  }
}

}  // namespace

BrdfFactors::BrdfFactors(const std::vector<RadialTerm>& radial, double error) : error_(error) {
  if (radial.empty()) return;
  nodes_ = static_cast<int>(radial.front().incoming.size());
  for (const RadialTerm& term : radial) {
    order_.push_back(term.order);
    terms_ += term.order == 0 ? 1 : 2;
    highest_order_ = std::max(highest_order_, term.order);
  }
  for (std::size_t node = 0; node < static_cast<std::size_t>(nodes_); ++node)
    for (const RadialTerm& term : radial) {
      incoming_.push_back(term.incoming[node]);
      outgoing_.push_back(term.outgoing[node]);
    }
}

void BrdfFactors::incoming(const Eigen::Vector3f& in, std::span<float> h) const {
  if (in.z() > 0.0f && terms_ > 0)
    interpolate(incoming_, order_, nodes_, highest_order_, in, h);
  else
    std::ranges::fill(h, 0.0f);
}

void BrdfFactors::outgoing(const Eigen::Vector3f& out, std::span<Eigen::Array3f> g) const {
  if (out.z() > 0.0f && terms_ > 0)
    interpolate(outgoing_, order_, nodes_, highest_order_, out, g);
  else
    std::ranges::fill(g, Eigen::Array3f::Zero());
}

Eigen::Array3f BrdfFactors::operator()(const Eigen::Vector3f& in, const Eigen::Vector3f& out) const {
  std::vector<float> h(static_cast<std::size_t>(terms_));
  std::vector<Eigen::Array3f> g(h.size());
  incoming(in, h);
  outgoing(out, g);
  Eigen::Array3f sum = Eigen::Array3f::Zero();
  for (std::size_t k = 0; k < h.size(); ++k) sum += h[k] * g[k];
  return sum;
}

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
  const SymmetricEigen solver = symmetric_eigen(gram);
  std::vector<Candidate> candidates;
  for (Eigen::Index i = orders.nodes - 1; i >= 0 && solver.values[i] > 0.0; --i)
    candidates.push_back({m, circle(m) * std::sqrt(solver.values[i]), solver.vectors.col(i)});
  return candidates;
}

/// Candidates of all orders, the largest first.
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
  const int largest = options.largest > 0 ? options.largest : FactorOptions::max_terms;
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

BrdfFactors factor(const Brdf& brdf, const FactorOptions& options, const RunContext& run) {
  const FourierOrders orders = fourier_orders(brdf, run);
  const Selection selection = select(all_candidates(orders, run), orders.energy, options);
  std::vector<RadialTerm> radial(selection.chosen.size());
  tbb::parallel_for(std::size_t{0}, radial.size(),
                    [&](std::size_t r) { radial[r] = functions_of(orders, selection.chosen[r]); });
  return {radial, selection.error};
}

namespace {

constexpr int min_nodes = 48, max_nodes = 256, min_azimuths = 96, max_azimuths = 256;

/// Radians over which the BRDF changes: of a lobe its standard deviation.
double width_of(const Brdf& brdf) {
  switch (brdf.lobe) {
    case Lobe::none:
      return 1.0;
    case Lobe::phong:
      return 1.0 / std::sqrt(std::max(1.0f, brdf.exponent));
    case Lobe::ggx:
      return std::min(0.7 * brdf.roughness, 0.04);  // the horizon asks for some
  }
  return 1.0;
}

/// At the horizon itself f is zero by definition; just above it is what functions tend to.
constexpr double lowest_height = 1e-4;

/// Unit vector of a node, at azimuth 0.
Eigen::Vector3f direction_of(int node, int nodes) {
  const double root = static_cast<double>(node) / (nodes - 1);
  const double z = std::max(1.0 - root * root, lowest_height);
  return Eigen::Vector3d(std::sqrt((1.0 - z) * (1.0 + z)), 0.0, z).cast<float>();
}

/// cosθ dω of each node by the radian of azimuth; with r² = 1 − cosθ it is (1 − r²) 2r dr. None at both ends,
/// so that what microfacets grow to at the horizon itself does not count.
Eigen::VectorXd weights_of(int nodes) {
  const Eigen::ArrayXd root = Eigen::ArrayXd::LinSpaced(nodes, 0.0, 1.0);
  return (1.0 - root.square()) * 2.0 * root / (nodes - 1);
}

/// Azimuths between the two directions, from 0 to π, and what share of that interval each stands for.
struct Azimuths {
  std::vector<Eigen::Vector2f> directions;
  Eigen::VectorXd angle, share;
};

/// At the middles of even steps of u in Δφ = π (u − sin 2πu/2π): dense about the mirror direction, where
/// lobes at grazing angles are narrower than anywhere else, and as exact for smooth functions as even steps
/// are, as what is summed goes on smoothly beyond both ends.
Azimuths azimuths_of(int count) {
  Azimuths azimuths{{}, Eigen::VectorXd(count), Eigen::VectorXd(count)};
  for (int a = 0; a < count; ++a) {
    const double u = (a + 0.5) / count, turn = 2.0 * std::numbers::pi * u;
    azimuths.angle[a] = std::numbers::pi * u - 0.5 * std::sin(turn);
    azimuths.share[a] = (1.0 - std::cos(turn)) / count;
    azimuths.directions.push_back(
        Eigen::Vector2d(std::cos(azimuths.angle[a]), std::sin(azimuths.angle[a])).cast<float>());
  }
  return azimuths;
}

/// Takes samples to cosine coefficients, [orders × azimuths].
Eigen::MatrixXf cosine_transform(int orders, const Azimuths& azimuths) {
  Eigen::MatrixXf transform(orders, azimuths.angle.size());
  for (int m = 0; m < orders; ++m)
    transform.row(m) = ((m == 0 ? 1.0 : 2.0) * azimuths.share.array() * (m * azimuths.angle.array()).cos())
                           .matrix()
                           .transpose()
                           .cast<float>();
  return transform;
}

/// f from one θ to all θ_o, [azimuths × 3 · nodes].
Eigen::MatrixXf samples_from(const Brdf& brdf, int node, int nodes,
                             const std::vector<Eigen::Vector2f>& azimuths) {
  const Eigen::Vector3f in = direction_of(node, nodes);
  Eigen::MatrixXf samples(azimuths.size(), 3 * nodes);
  for (int j = 0; j < nodes; ++j) {
    const Eigen::Vector3f out = direction_of(j, nodes);
    for (std::size_t a = 0; a < azimuths.size(); ++a)
      samples.block<1, 3>(static_cast<Eigen::Index>(a), 3 * j) =
          brdf(in, {out.x() * azimuths[a].x(), out.x() * azimuths[a].y(), out.z()}).matrix().transpose();
  }
  return samples;
}

}  // namespace

FourierOrders fourier_orders(const Brdf& brdf, const RunContext& run) {
  const double width = width_of(brdf);
  FourierOrders result;
  const int nodes = result.nodes = std::clamp(static_cast<int>(4.0 / width), min_nodes, max_nodes);
  const int azimuth_count = std::clamp(static_cast<int>(16.0 / width), min_azimuths, max_azimuths);
  const int orders = std::clamp(static_cast<int>(3.0 / width), 8, highest_fourier_order) + 1;
  result.weight = weights_of(nodes);
  const Azimuths azimuths = azimuths_of(azimuth_count);
  const Eigen::MatrixXf transform = cosine_transform(orders, azimuths);
  result.f.assign(static_cast<std::size_t>(orders), Eigen::MatrixXf(nodes, 3 * nodes));
  Eigen::VectorXd energies(nodes);
  tbb::parallel_for(0, nodes, [&](int i) {
    run.throw_if_stopped();
    const Eigen::MatrixXf samples = samples_from(brdf, i, nodes, azimuths.directions);
    const Eigen::MatrixXf coefficients = transform * samples;
    for (int m = 0; m < orders; ++m) result.f[static_cast<std::size_t>(m)].row(i) = coefficients.row(m);
    double energy = 0.0;
    for (int j = 0; j < nodes; ++j)
      energy += result.weight[j] *
                azimuths.share.dot(samples.middleCols<3>(3 * j).rowwise().squaredNorm().cast<double>());
    energies[i] = 4.0 * std::numbers::pi * std::numbers::pi * result.weight[i] * energy;
  });
  result.energy = energies.sum();
  return result;
}

}  // namespace refield::dynamic
