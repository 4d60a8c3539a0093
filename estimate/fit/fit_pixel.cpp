// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/fit_pixel.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace refield {

namespace {
/// Directions that keep less than this part of their squared norm after projection are rounding noise of
/// float32 sums.
constexpr double dependence_tolerance = 1e-6;
/// A fit this close to the samples (relative, squared) has reached the precision of float32 columns.
constexpr double exact_fit = 1e-10;
}  // namespace

void MaskedSamples::assign(const PixelSamples& samples, std::size_t stride, int images) {
  values.assign(3 * stride, 0.0f);
  complete = true;
  for (int c = 0; c < 3; ++c) {
    squared[c] = 0.0;
    count[c] = 0;
    for (int j = 0; j < images; ++j) {
      const float b = samples[c][j];
      if (std::isnan(b)) {
        complete = false;
        continue;
      }
      values[c * stride + j] = b;
      ++count[c];
      squared[c] += static_cast<double>(b) * b;
    }
  }
  if (complete) return;
  measured.assign(3 * stride, 0.0f);
  for (int c = 0; c < 3; ++c)
    for (int j = 0; j < images; ++j) measured[c * stride + j] = std::isnan(samples[c][j]) ? 0.0f : 1.0f;
}

PixelFitter::PixelFitter(KernelCache& cache, const EstimateOptions& options)
    : cache_(cache),
      options_(options),
      max_leaves_(std::min(options.max_kernels(), cache.table().images())),
      stride_(cache.table().stride()),
      coordinate_stride_(padded_length(max_leaves_)),
      basis_(std::size_t{3} * max_leaves_ * stride_),
      leaf_coordinates_(std::size_t{3} * max_leaves_ * max_leaves_),
      gram_(std::size_t{3} * max_leaves_ * max_leaves_),
      scratch_(stride_),
      trial_gram_(static_cast<std::size_t>(max_leaves_) * max_leaves_),
      trial_h_(max_leaves_),
      trial_x_(max_leaves_),
      pointers_(max_leaves_ + 1),
      products_(max_leaves_ + 1) {
  for (int c = 0; c < 3; ++c)
    for (auto* vector : {&samples_in_basis_[c], &fit_in_basis_[c], &with_samples_[c], &weights_[c]})
      vector->resize(max_leaves_);
}

PixelKernels PixelFitter::fit(const PixelSamples& samples, const Observer& observer) {
  start(samples);
  solve();
  if (observer) report(observer, 0);
  const double squared = samples_.squared_sum();
  while (static_cast<int>(leaves_.size()) < max_leaves_ && squared_residual() > exact_fit * squared) {
    const int best = options_.mode == EstimateMode::paper ? best_by_solving() : best_by_gain();
    if (best < 0) break;
    split_leaf(best);
    solve();
    if (observer) report(observer, static_cast<int>(leaves_.size()) - 1);
  }
  PixelKernels kernels = leaves_as_kernels();
  kernels.squared_samples = squared;
  return kernels;
}

double PixelFitter::squared_residual() const {
  // In the basis: ‖b‖² − 2 yᵀz + ‖z‖².
  double sum = 0.0;
  for (int c = 0; c < 3; ++c) {
    double inside = samples_.squared[c];
    for (int k = 0; k < rank_; ++k)
      inside += fit_in_basis_[c][k] * (fit_in_basis_[c][k] - 2.0 * samples_in_basis_[c][k]);
    sum += std::max(inside, 0.0);
  }
  return sum;
}

PixelKernels PixelFitter::leaves_as_kernels() const {
  PixelKernels kernels;
  kernels.squared_residual = squared_residual();
  for (std::size_t l = 0; l < leaves_.size(); ++l) {
    if (weights_[0][l] <= 0.0 && weights_[1][l] <= 0.0 && weights_[2][l] <= 0.0) continue;
    kernels.boxes.push_back(leaves_[l].box);
    for (int c = 0; c < 3; ++c) kernels.weights.push_back(static_cast<float>(weights_[c][l]));
  }
  return kernels;
}

void PixelFitter::start(const PixelSamples& samples) {
  samples_.assign(samples, stride_, cache_.table().images());
  leaves_.clear();
  candidates_.clear();
  live_.clear();
  unused_.clear();
  rank_ = 0;
  const LightDomain& domain = cache_.table().domain();
  leaves_.push_back({{0, 0, domain.width, domain.height}, {}});
  std::vector<float> root(3 * max_leaves_);
  append_direction(cache_.column(leaves_[0].box), root);
  for (int c = 0; c < 3; ++c) {
    leaf_coordinates(0, c)[0] = root[c * max_leaves_];
    weights_[c][0] = 0.0;
  }
  update_gram(0);
  if (max_leaves_ > 1) add_candidates(0);
}

void PixelFitter::append_direction(const std::array<const float*, 3>& direction,
                                   std::vector<float>& coordinates) {
  for (int c = 0; c < 3; ++c) {
    float* q = basis(c, rank_);
    const float* d = direction[c];
    if (samples_.complete)
      std::copy_n(d, stride_, q);
    else
      std::transform(d, d + stride_, samples_.measured.data() + c * stride_, q, std::multiplies<>());
    float* coordinate = coordinates.data() + static_cast<std::size_t>(c) * max_leaves_;
    std::fill_n(coordinate, max_leaves_, 0.0f);
    for (int k = 0; k < rank_; ++k) pointers_[k] = basis(c, k);
    coordinate[rank_] = orthonormalise(q, pointers_.data(), rank_, stride_, coordinate);
    float y = 0.0f;
    const float* b = samples_.values.data() + c * stride_;
    dots(q, &b, 1, stride_, &y);
    samples_in_basis_[c][rank_] = y;
  }
  ++rank_;
}

void PixelFitter::add_candidates(int leaf) {
  for (Split& split : cache_.splits(leaves_[leaf].box)) {
    int slot;
    if (unused_.empty()) {
      slot = static_cast<int>(candidates_.size());
      candidates_.emplace_back();
      candidate_coordinates_.resize(candidates_.size() * 3 * coordinate_stride_);
    } else {
      slot = unused_.back();
      unused_.pop_back();
    }
    Candidate& candidate = candidates_[slot];
    candidate.split = &split;
    candidate.leaf = leaf;
    for (int c = 0; c < 3; ++c) {
      cache_.make(split, c);
      const float* d = split.direction[c];
      pointers_[0] = samples_.values.data() + c * stride_;
      for (int k = 0; k < rank_; ++k) pointers_[k + 1] = basis(c, k);
      dots(d, pointers_.data(), rank_ + 1, stride_, products_.data());
      candidate.with_samples[c] = products_[0];
      float norm2 = split.norm2[c];
      if (!samples_.complete) {
        std::transform(d, d + stride_, samples_.measured.data() + c * stride_, scratch_.data(),
                       std::multiplies<>());
        dots(scratch_.data(), &d, 1, stride_, &norm2);
      }
      float* coordinate = coordinates(slot, c);
      for (int k = 0; k < rank_; ++k) {
        coordinate[k] = products_[k + 1];
        norm2 -= coordinate[k] * coordinate[k];
      }
      std::fill(coordinate + rank_, coordinate + coordinate_stride_, 0.0f);
      candidate.residual_norm2[c] = norm2;
    }
    live_.push_back(slot);
    leaves_[leaf].candidates.push_back(slot);
  }
  pointers_.resize(std::max(pointers_.size(), live_.size()));
  products_.resize(pointers_.size());
}

void PixelFitter::update_candidates() {
  const int k = rank_ - 1;
  for (int c = 0; c < 3; ++c) {
    for (std::size_t i = 0; i < live_.size(); ++i) pointers_[i] = candidates_[live_[i]].split->direction[c];
    dots(basis(c, k), pointers_.data(), live_.size(), stride_, products_.data());
    for (std::size_t i = 0; i < live_.size(); ++i) {
      coordinates(live_[i], c)[k] = products_[i];
      candidates_[live_[i]].residual_norm2[c] -= products_[i] * products_[i];
    }
  }
}

void PixelFitter::split_leaf(int chosen) {
  const int first = candidates_[chosen].leaf;
  const int second = static_cast<int>(leaves_.size());
  const Split split = *candidates_[chosen].split;
  std::erase_if(live_, [&](int slot) { return candidates_[slot].leaf == first; });
  unused_.insert(unused_.end(), leaves_[first].candidates.begin(), leaves_[first].candidates.end());

  std::vector<float> direction(3 * max_leaves_);
  append_direction(split.direction, direction);
  for (int c = 0; c < 3; ++c) {
    double* parent = leaf_coordinates(first, c);
    double* other = leaf_coordinates(second, c);
    parent[rank_ - 1] = 0.0;
    for (int k = 0; k < rank_; ++k) {
      const double half = direction[c * max_leaves_ + k] + static_cast<double>(split.fraction[c]) * parent[k];
      other[k] = parent[k] - half;
      parent[k] = half;
    }
    for (int l = 0; l < second; ++l)
      if (l != first) leaf_coordinates(l, c)[rank_ - 1] = 0.0;
    weights_[c][second] = weights_[c][first];
  }
  leaves_[first] = {split.first, {}};
  leaves_.push_back({split.second, {}});
  update_gram(first);
  update_gram(second);
  if (static_cast<int>(leaves_.size()) == max_leaves_) return;
  update_candidates();
  add_candidates(first);
  add_candidates(second);
}

void PixelFitter::update_gram(int leaf) {
  for (int c = 0; c < 3; ++c) {
    double* G = gram(c);
    const double* a = leaf_coordinates(leaf, c);
    for (std::size_t l = 0; l < leaves_.size(); ++l) {
      const double* other = leaf_coordinates(static_cast<int>(l), c);
      double product = 0.0;
      for (int k = 0; k < rank_; ++k) product += a[k] * other[k];
      G[static_cast<std::size_t>(leaf) * max_leaves_ + l] = product;
      G[l * max_leaves_ + leaf] = product;
    }
    double h = 0.0;
    for (int k = 0; k < rank_; ++k) h += a[k] * samples_in_basis_[c][k];
    with_samples_[c][leaf] = h;
  }
}

void PixelFitter::solve() {
  const int count = static_cast<int>(leaves_.size());
  for (int c = 0; c < 3; ++c) {
    nnls_.solve(gram(c), max_leaves_, with_samples_[c].data(), count, weights_[c].data());
    std::fill_n(fit_in_basis_[c].begin(), rank_, 0.0);
    for (int l = 0; l < count; ++l) {
      const double x = weights_[c][l];
      if (x == 0.0) continue;
      const double* a = leaf_coordinates(l, c);
      for (int k = 0; k < rank_; ++k) fit_in_basis_[c][k] += x * a[k];
    }
  }
}

int PixelFitter::best_by_gain() {
  gains_.assign(live_.size(), 0.0f);
  fit_coordinates_.assign(coordinate_stride_, 0.0f);
  for (int c = 0; c < 3; ++c) {
    for (int k = 0; k < rank_; ++k) fit_coordinates_[k] = static_cast<float>(fit_in_basis_[c][k]);
    for (std::size_t i = 0; i < live_.size(); ++i) pointers_[i] = coordinates(live_[i], c);
    dots(fit_coordinates_.data(), pointers_.data(), live_.size(), padded_length(rank_), products_.data());
    for (std::size_t i = 0; i < live_.size(); ++i) {
      const Candidate& candidate = candidates_[live_[i]];
      if (!(candidate.residual_norm2[c] > dependence_tolerance * candidate.split->norm2[c])) continue;
      const float correlation = candidate.with_samples[c] - products_[i];
      gains_[i] += correlation * correlation / candidate.residual_norm2[c];
    }
  }
  const auto best = std::ranges::max_element(gains_);
  return best == gains_.end() || !(*best > 0.0f) ? -1 : live_[best - gains_.begin()];
}

double PixelFitter::residual_bound(int slot) const {
  // The unconstrained fit on the enlarged space: no non-negative fit can be closer.
  const Candidate& candidate = candidates_[slot];
  double residual = 0.0;
  for (int c = 0; c < 3; ++c) {
    double squared = samples_.squared[c];
    double correlation = candidate.with_samples[c];
    const float* coordinate = coordinates(slot, c);
    for (int k = 0; k < rank_; ++k) {
      squared -= samples_in_basis_[c][k] * samples_in_basis_[c][k];
      correlation -= coordinate[k] * samples_in_basis_[c][k];
    }
    if (candidate.residual_norm2[c] > dependence_tolerance * candidate.split->norm2[c])
      squared -= correlation * correlation / candidate.residual_norm2[c];
    residual += std::max(squared, 0.0);
  }
  return residual;
}

int PixelFitter::best_by_solving() {
  std::vector<std::pair<double, int>> order;
  order.reserve(live_.size());
  for (const int slot : live_) order.emplace_back(residual_bound(slot), slot);
  std::ranges::sort(order);
  int best = -1;
  double best_residual = std::numeric_limits<double>::infinity();
  for (const auto& [bound, slot] : order) {
    if (bound >= best_residual) break;
    const double residual = residual_after(candidates_[slot], best_residual);
    if (residual < best_residual) {
      best_residual = residual;
      best = slot;
    }
  }
  return best;
}

double PixelFitter::residual_after(const Candidate& candidate, double give_up_above) {
  const int slot = static_cast<int>(&candidate - candidates_.data());
  const int count = static_cast<int>(leaves_.size());
  const int first = candidate.leaf;
  const int second = count;
  const int n = max_leaves_;
  double residual = 0.0;
  for (int c = 0; c < 3; ++c) {
    // Gram matrix with the leaf replaced by its halves a₁ = d + f p and a₂ = p − a₁, from coordinates.
    const double* G = gram(c);
    const double* parent = leaf_coordinates(first, c);
    const float* d = coordinates(slot, c);
    const double f = candidate.split->fraction[c];
    double* T = trial_gram_.data();
    for (int i = 0; i < count; ++i)
      std::copy_n(G + static_cast<std::size_t>(i) * n, count, T + static_cast<std::size_t>(i) * n);
    for (int l = 0; l < count; ++l) {
      const double* a = leaf_coordinates(l, c);
      double product = 0.0;
      for (int k = 0; k < rank_; ++k) product += d[k] * a[k];
      product += f * G[static_cast<std::size_t>(first) * n + l];
      T[static_cast<std::size_t>(first) * n + l] = T[static_cast<std::size_t>(l) * n + first] = product;
      const double rest = G[static_cast<std::size_t>(first) * n + l] - product;
      T[static_cast<std::size_t>(second) * n + l] = T[static_cast<std::size_t>(l) * n + second] = rest;
    }
    const double parent2 = G[static_cast<std::size_t>(first) * n + first];
    const double with_parent = T[static_cast<std::size_t>(first) * n + first];  // ⟨a₁,p⟩, overwritten below
    double half2 = std::max<double>(candidate.residual_norm2[c], 0.0);
    for (int k = 0; k < rank_; ++k) {
      const double a = d[k] + f * parent[k];
      half2 += a * a;
    }
    T[static_cast<std::size_t>(first) * n + first] = half2;
    T[static_cast<std::size_t>(first) * n + second] = T[static_cast<std::size_t>(second) * n + first] =
        with_parent - half2;
    T[static_cast<std::size_t>(second) * n + second] = parent2 - 2.0 * with_parent + half2;
    std::copy_n(with_samples_[c].begin(), count, trial_h_.begin());
    trial_h_[first] = candidate.with_samples[c] + f * with_samples_[c][first];
    trial_h_[second] = with_samples_[c][first] - trial_h_[first];
    std::copy_n(weights_[c].begin(), count, trial_x_.begin());
    trial_x_[second] = trial_x_[first];
    nnls_.solve(T, n, trial_h_.data(), count + 1, trial_x_.data());
    residual +=
        refield::squared_residual(T, n, trial_h_.data(), count + 1, trial_x_.data(), samples_.squared[c]);
    if (residual >= give_up_above) return residual;
  }
  return residual;
}

void PixelFitter::report(const Observer& observer, int subdivisions) const {
  std::vector<Box> boxes;
  std::vector<float> weights;
  for (std::size_t l = 0; l < leaves_.size(); ++l) {
    boxes.push_back(leaves_[l].box);
    for (int c = 0; c < 3; ++c) weights.push_back(static_cast<float>(weights_[c][l]));
  }
  observer(subdivisions, boxes, weights);
}

}  // namespace refield
