// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "simulate/dynamic/brdf_factors.h"

namespace refield::dynamic {

/// A function of the angle from an axis, by samples spread evenly over its cosine in [−1, 1]; linear between.
class ZonalTable {
 public:
  ZonalTable() = default;
  /// At least two samples.
  explicit ZonalTable(std::vector<float> samples) : samples_(std::move(samples)) {}
  float operator()(float cosine) const;

 private:
  std::vector<float> samples_;
};

/// Where something seen as a round disc ends, as harmonics below an order tell it: they blur its edge, and
/// what is smaller than they resolve never reaches one. The disc of equal solid angle says which value
/// stands at the edge, and so the blurred function still tells what is covered and what is not.
class CapEdges {
 public:
  explicit CapEdges(int order);
  struct Edge {
    float value;
    float slope;  ///< by which it falls outwards, a radian; may be zero
  };
  /// Of a disc that covers `share` of all directions, in [0, 1].
  Edge at(float share) const;

 private:
  std::vector<Edge> edges_;  // evenly over the root of the share
};

/// Weight of a material's first term for light at an angle from the normal, h_0 cosθ: itself, and as
/// harmonics below an order tell it. That term does not depend on the azimuth and never changes its sign, as
/// the largest of a distribution that is nowhere negative; here it is never negative.
struct FirstTerm {
  ZonalTable exact, by_harmonics;
  float sign = 1.0f;   ///< of h_0
  float least = 0.0f;  ///< a small share of its most
};
FirstTerm first_term(const BrdfFactors& factors, int order);

}  // namespace refield::dynamic
