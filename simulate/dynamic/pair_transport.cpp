// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/pair_transport.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>

namespace refield::dynamic {

namespace {

using Eigen::Index;

/// Below the first share of the source's light an object is left out, from the second on it counts wholly:
/// between them it comes in smoothly.
constexpr float slight = 0.01f, full = 0.03f;

/// What one vertex of the target sees of the others: where to look it up, how much of each direction they
/// cover, and the matrix that takes from a function what is hidden, made when it is first needed.
class View {
 public:
  View(std::span<const SeenObject> others, const HarmonicProduct& product)
      : others_(others),
        product_(product),
        corners_(others.size()),
        covered_(others.size()),
        hidden_(others.size()) {}

  void look(const Eigen::Vector3f& position, std::size_t target, bool occlusion) {
    position_ = position;
    for (std::size_t o = 0; o < others_.size(); ++o) {
      if (o == target) continue;
      const ObjectTransport& object = *others_[o].transport;
      corners_[o] = object.grid.around(others_[o].from_target * position);
      leave_out_inside(object.outside, corners_[o]);
      if (!occlusion) continue;
      covered_[o] = covered_by(others_[o], corners_[o]);
      hidden_[o].resize(0, 0);
    }
  }

  const ShellGrid::Corners& corners(std::size_t object) const { return corners_[object]; }

  /// Takes from `receiving` [n² × K] what `occluder` hides of `source`; false where that is next to nothing.
  bool hide(std::size_t occluder, std::size_t source, Eigen::MatrixXf& receiving) {
    const SeenObject &front = others_[occluder], &back = others_[source];
    const float lit = covered_[source].squaredNorm();
    if (!(lit > 0.0f) ||
        !stands_before(position_, front.middle, front.transport->radius, back.middle, back.transport->radius))
      return false;
    const float share = covered_[source].dot(covered_[occluder]) / lit;
    if (share < slight) return false;
    Eigen::MatrixXf& hidden = hidden_[occluder];
    if (hidden.size() == 0)
      hidden = product_.matrix({covered_[occluder].data(), static_cast<std::size_t>(receiving.rows())});
    receiving -= std::min((share - slight) / (full - slight), 1.0f) * (hidden * receiving).eval();
    return true;
  }

 private:
  std::span<const SeenObject> others_;
  const HarmonicProduct& product_;
  Eigen::Vector3f position_ = Eigen::Vector3f::Zero();
  std::vector<ShellGrid::Corners> corners_;  // [objects]
  std::vector<Harmonics> covered_;           // [objects]
  std::vector<Eigen::MatrixXf> hidden_;      // [objects], n² × n²; empty: not made yet
};

}  // namespace

void leave_out_inside(const std::vector<bool>& outside, ShellGrid::Corners& corners) {
  float all = 0.0f, kept = 0.0f;
  for (std::size_t i = 0; i < corners.point.size(); ++i) {
    all += corners.weight[i];
    if (outside[corners.point[i]])
      kept += corners.weight[i];
    else
      corners.weight[i] = 0.0f;
  }
  // A place with next to nothing outside of the object is in it: nothing comes there, smoothly.
  constexpr float min_share = 0.05f;
  const float factor = all / std::max(kept, min_share * std::max(all, 1e-30f));
  for (float& weight : corners.weight) weight *= factor;
}

bool stands_before(const Eigen::Vector3f& from, const Eigen::Vector3f& middle, float radius,
                   const Eigen::Vector3f& other_middle, float other_radius) {
  const float apart = (middle - other_middle).norm();
  const bool within = apart < other_radius, around = apart < radius;
  if (within != around) return within;
  if (within && around) return radius < other_radius;
  return (from - middle).norm() - radius < (from - other_middle).norm() - other_radius;
}

void place_pairs(std::span<const PlacedObject> objects, std::size_t target,
                 std::span<const Eigen::Vector3f> positions, const HarmonicProduct& product,
                 std::span<PairTransport> pairs) {
  const ObjectTransport& target_transport = *objects[target].transport;
  const Index terms = target_transport.terms();
  std::vector<SeenObject> others;
  for (const PlacedObject& object : objects) others.push_back(seen_object(object, objects[target].pose));
  for (std::size_t source = 0; source < objects.size(); ++source) {
    if (source == target) continue;
    pairs[source].corners.resize(positions.size());
    pairs[source].receiving.resize(target_transport.receiving.rows(), target_transport.receiving.cols());
  }
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, positions.size(), 64), [&](const auto& range) {
    const auto first = static_cast<Index>(range.begin()) * terms;
    const auto count = static_cast<Index>(range.size()) * terms;
    for (std::size_t source = 0; source < objects.size(); ++source)
      if (source != target)
        pairs[source].receiving.middleCols(first, count).noalias() =
            others[source].turn_back * target_transport.receiving.middleCols(first, count);
    View view(others, product);
    const bool hides = objects.size() > 2;
    Eigen::MatrixXf receiving;
    for (std::size_t v = range.begin(); v < range.end(); ++v) {
      view.look(positions[v], target, hides);
      const auto column = static_cast<Index>(v) * terms;
      for (std::size_t source = 0; source < objects.size(); ++source) {
        if (source == target) continue;
        pairs[source].corners[v] = view.corners(source);
        bool hidden = false;
        receiving = target_transport.receiving.middleCols(column, terms);
        for (std::size_t other = 0; other < objects.size() && hides; ++other)
          if (other != source && other != target) hidden |= view.hide(other, source, receiving);
        if (hidden)
          pairs[source].receiving.middleCols(column, terms).noalias() = others[source].turn_back * receiving;
      }
    }
  });
}

void PairTransport::add(std::size_t vertex, const Eigen::MatrixXf& radiance,
                        Eigen::Ref<TermLight> light) const {
  const ShellGrid::Corners& from = corners[vertex];
  const Index count = receiving.rows(), terms = light.rows();
  Eigen::Matrix<float, Eigen::Dynamic, 1, 0, 3 * max_harmonics, 1> arriving;
  arriving.setZero(3 * count);
  for (std::size_t i = 0; i < from.point.size(); ++i)
    if (from.weight[i] != 0.0f)  // points that no one looks up hold nothing, not even zero
      arriving += from.weight[i] * radiance.col(from.point[i]);
  const auto taken = receiving.middleCols(static_cast<Index>(vertex) * terms, terms);
  for (Index k = 0; k < terms; ++k)
    for (Index c = 0; c < 3; ++c) light(k, c) += taken.col(k).dot(arriving.segment(c * count, count));
}

}  // namespace refield::dynamic
