// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/brdf_factors.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "simulate/dynamic/fourier_orders.h"

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

}  // namespace refield::dynamic
