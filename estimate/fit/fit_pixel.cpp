// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/fit_pixel.h"

#include <cmath>
#include <tuple>

namespace refield {

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

bool is_seen(float measured, const float* column, std::size_t stride) {
  constexpr float min_share = 1e-6f;  // a thousandth of the light
  float all = 0.0f;
  dots(column, &column, 1, stride, &all);
  return measured >= min_share * all;
}

PixelFitter::PixelFitter(KernelCache& cache, const EstimateOptions& options)
    : GreedyTree(cache, std::min(options.max_kernels(), cache.table().images()), 0),
      mode_(options.mode),
      trial_gram_(static_cast<std::size_t>(max_leaves_) * max_leaves_),
      trial_h_(max_leaves_),
      trial_x_(max_leaves_) {}

PixelKernels PixelFitter::fit(const PixelSamples& samples, const Observer& observer) {
  samples_.assign(samples, stride_, cache_.table().images());
  const float* values = samples_.values.data();
  start({{{values}, {values + stride_}, {values + 2 * stride_}}},
        samples_.complete ? nullptr : samples_.measured.data());
  solve();
  if (observer) report(observer);
  while (leaves() < max_leaves_ && !is_exact(squared_residual())) {
    update_candidates();
    const int best = mode_ == EstimateMode::paper ? best_by_solving() : best_by_gain();
    if (best < 0) break;
    split(best);
    solve();
    if (observer) report(observer);
  }
  return leaves_as_kernels();
}

PixelKernels PixelFitter::leaves_as_kernels() const {
  PixelKernels kernels;
  kernels.squared_residual = squared_residual();
  kernels.squared_samples = squared_targets_;
  for (int l = 0; l < leaves(); ++l) {
    const std::array weights{fits_[0][0].weights[l], fits_[1][0].weights[l], fits_[2][0].weights[l]};
    if (std::ranges::none_of(weights, [](double weight) { return weight > 0.0; })) continue;
    kernels.boxes.push_back(leaf_box(l));
    for (const double weight : weights) kernels.weights.push_back(static_cast<float>(weight));
  }
  return kernels;
}

double PixelFitter::residual_bound(const Candidate& candidate) {
  // The unconstrained fit on the enlarged space: no non-negative fit can be closer.
  double residual = 0.0;
  for (int c = 0; c < 3; ++c) {
    double squared = samples_.squared[c];
    double correlation = candidate.with_targets[c][0];
    const float* coordinate = candidate_coordinates(c, candidate.slot);
    const std::vector<double>& y = fits_[c][0].in_basis;
    for (int k = 0; k < dictionary_.rank; ++k) {
      squared -= y[k] * y[k];
      correlation -= coordinate[k] * y[k];
    }
    if (candidate.remaining_norm2[c] > dependence_tolerance * candidate.split->norm2[c])
      squared -= correlation * correlation / candidate.remaining_norm2[c];
    residual += std::max(squared, 0.0);
  }
  return residual;
}

int PixelFitter::best_by_solving() {
  std::vector<std::tuple<double, int, int>> order;  // bound, slot, candidate
  for (std::size_t i = 0; i < candidates_.size(); ++i)
    order.emplace_back(residual_bound(candidates_[i]), candidates_[i].slot, static_cast<int>(i));
  std::ranges::sort(order);
  int best = -1;
  double best_residual = std::numeric_limits<double>::infinity();
  for (const auto& [bound, slot, candidate] : order) {
    if (bound >= best_residual) break;
    const double residual = residual_after(candidates_[candidate], best_residual);
    if (residual < best_residual) {
      best_residual = residual;
      best = candidate;
    }
  }
  return best;
}

double PixelFitter::residual_after(const Candidate& candidate, double give_up_above) {
  const int count = leaves(), rank = dictionary_.rank;
  const int first = candidate.leaf;
  const int second = count;
  const int n = max_leaves_;
  double residual = 0.0;
  for (int c = 0; c < 3; ++c) {
    // Gram matrix with the leaf replaced by its halves a₁ = d + f p and a₂ = p − a₁, from coordinates.
    const Fit& fit = fits_[c][0];
    const double* G = gram_[c].data();
    const double* parent = leaf_coordinates(c, first);
    const float* d = candidate_coordinates(c, candidate.slot);
    const double f = candidate.split->fraction[c];
    double* T = trial_gram_.data();
    for (int i = 0; i < count; ++i)
      std::copy_n(G + static_cast<std::size_t>(i) * n, count, T + static_cast<std::size_t>(i) * n);
    for (int l = 0; l < count; ++l) {
      const double* a = leaf_coordinates(c, l);
      double product = 0.0;
      for (int k = 0; k < rank; ++k) product += d[k] * a[k];
      product += f * G[static_cast<std::size_t>(first) * n + l];
      T[static_cast<std::size_t>(first) * n + l] = T[static_cast<std::size_t>(l) * n + first] = product;
      const double rest = G[static_cast<std::size_t>(first) * n + l] - product;
      T[static_cast<std::size_t>(second) * n + l] = T[static_cast<std::size_t>(l) * n + second] = rest;
    }
    const double parent2 = G[static_cast<std::size_t>(first) * n + first];
    const double with_parent = T[static_cast<std::size_t>(first) * n + first];  // ⟨a₁,p⟩, overwritten below
    double half2 = std::max<double>(candidate.remaining_norm2[c], 0.0);
    for (int k = 0; k < rank; ++k) {
      const double a = d[k] + f * parent[k];
      half2 += a * a;
    }
    T[static_cast<std::size_t>(first) * n + first] = half2;
    T[static_cast<std::size_t>(first) * n + second] = T[static_cast<std::size_t>(second) * n + first] =
        with_parent - half2;
    T[static_cast<std::size_t>(second) * n + second] = parent2 - 2.0 * with_parent + half2;
    std::copy_n(fit.with_target.begin(), count, trial_h_.begin());
    trial_h_[first] = candidate.with_targets[c][0] + f * fit.with_target[first];
    trial_h_[second] = fit.with_target[first] - trial_h_[first];
    std::copy_n(fit.weights.begin(), count, trial_x_.begin());
    trial_x_[second] = trial_x_[first];
    trial_nnls_.solve(T, n, trial_h_.data(), count + 1, trial_x_.data());
    residual +=
        refield::squared_residual(T, n, trial_h_.data(), count + 1, trial_x_.data(), samples_.squared[c]);
    if (residual >= give_up_above) return residual;
  }
  return residual;
}

void PixelFitter::report(const Observer& observer) const {
  std::vector<Box> boxes;
  std::vector<float> weights;
  for (int l = 0; l < leaves(); ++l) {
    boxes.push_back(leaf_box(l));
    for (int c = 0; c < 3; ++c) weights.push_back(static_cast<float>(fits_[c][0].weights[l]));
  }
  observer(leaves() - 1, boxes, weights);
}

}  // namespace refield
