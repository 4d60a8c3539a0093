// SPDX-License-Identifier: Apache-2.0
#include "estimate/select_kernels.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace refield {

namespace {
/// Rectangles that keep less than this part of their squared norm beside the chosen ones say nothing new.
constexpr float dependence_tolerance = 1e-6f;
/// The pursuit ends after this many rectangles in a row that the criterion does not reward: a shape may take
/// several rectangles before it pays.
constexpr int patience = 12;
/// Relative squared residual below which float32 columns tell nothing.
constexpr double exact_fit = 1e-10;
}  // namespace

void KernelDictionary::resize(int rectangles, std::size_t coordinates) {
  size = rectangles;
  stride = padded_length(coordinates);
  for (int c = 0; c < 3; ++c) {
    columns[c].assign(static_cast<std::size_t>(size) * stride, 0.0f);
    samples[c].assign(stride, 0.0);
  }
}

double information_criterion(double squared_residual, double squared_samples, double measured,
                             int parameters) {
  const double floor = std::max(exact_fit * squared_samples, std::numeric_limits<double>::min());
  return measured * std::log(std::max(squared_residual, floor) / measured) + parameters * std::log(measured);
}

void KernelSelector::select(const KernelDictionary& dictionary, int most) {
  most_ = most;
  chosen_.clear();
  best_chosen_.clear();
  best_residual_ = dictionary.squared_samples;
  is_chosen_.assign(dictionary.size, 0);
  // Weights that fall to zero free their place, so a few more rectangles than `most` may be tried.
  const int most_tried = std::min(3 * most, static_cast<int>(dictionary.stride));
  orthonormal_.resize(std::size_t{3} * most_tried * dictionary.stride);
  pointers_.resize(std::max(dictionary.size, most_tried));
  products_.resize(pointers_.size());
  for (int c = 0; c < 3; ++c) {
    best_weights_[c].clear();
    weights_[c].clear();
    with_samples_[c].clear();
    gram_[c].assign(static_cast<std::size_t>(most_tried) * most_tried, 0.0);
    residual_[c].assign(dictionary.samples[c].begin(), dictionary.samples[c].end());
    norm2_[c].resize(dictionary.size);
    for (int d = 0; d < dictionary.size; ++d) {
      const float* column = dictionary.column(c, d);
      dots(column, &column, 1, dictionary.stride, &norm2_[c][d]);
    }
    remaining_norm2_[c] = norm2_[c];
  }
  if (!(dictionary.squared_samples > 0.0)) return;

  double best_criterion = std::numeric_limits<double>::infinity();
  int unrewarded = 0;
  while (static_cast<int>(chosen_.size()) < most_tried && unrewarded < patience) {
    const int next = best_candidate(dictionary);
    if (next < 0) break;
    add(dictionary, next);
    double residual = dictionary.squared_outside;
    int parameters = 0, kernels = 0;
    for (int c = 0; c < 3; ++c) {
      for (const float r : residual_[c]) residual += static_cast<double>(r) * r;
      parameters += static_cast<int>(std::ranges::count_if(weights_[c], [](double w) { return w > 0.0; }));
    }
    for (std::size_t i = 0; i < chosen_.size(); ++i)
      kernels += weights_[0][i] > 0.0 || weights_[1][i] > 0.0 || weights_[2][i] > 0.0;
    if (kernels > most) break;
    const double criterion =
        information_criterion(residual, dictionary.squared_samples, dictionary.measured, parameters);
    if (criterion < best_criterion) {
      best_criterion = criterion;
      best_chosen_ = chosen_;
      best_weights_ = weights_;
      best_residual_ = residual;
      unrewarded = 0;
    } else {
      ++unrewarded;
    }
  }
}

int KernelSelector::best_candidate(const KernelDictionary& dictionary) {
  std::vector<float>& gains = products_;
  std::vector<float> total(dictionary.size, 0.0f);
  for (int c = 0; c < 3; ++c) {
    for (int d = 0; d < dictionary.size; ++d) pointers_[d] = dictionary.column(c, d);
    dots(residual_[c].data(), pointers_.data(), dictionary.size, dictionary.stride, gains.data());
    for (int d = 0; d < dictionary.size; ++d)
      if (gains[d] > 0.0f && remaining_norm2_[c][d] > dependence_tolerance * norm2_[c][d])
        total[d] += gains[d] * gains[d] / remaining_norm2_[c][d];
  }
  int best = -1;
  float best_gain = 0.0f;
  for (int d = 0; d < dictionary.size; ++d)
    if (!is_chosen_[d] && total[d] > best_gain) {
      best_gain = total[d];
      best = d;
    }
  return best;
}

void KernelSelector::add(const KernelDictionary& dictionary, int rectangle) {
  const std::size_t stride = dictionary.stride;
  const int index = static_cast<int>(chosen_.size());
  const int most_tried = std::min(3 * most_, static_cast<int>(stride));
  chosen_.push_back(rectangle);
  is_chosen_[rectangle] = 1;
  for (int c = 0; c < 3; ++c) {
    const float* column = dictionary.column(c, rectangle);
    const auto basis = [&](int k) {
      return orthonormal_.data() + (static_cast<std::size_t>(c) * most_tried + k) * stride;
    };

    // Its part perpendicular to the chosen ones, normalised (Gram-Schmidt, twice), leaves the others'
    // remaining norms.
    float* q = basis(index);
    std::copy_n(column, stride, q);
    for (int pass = 0; pass < 2; ++pass) {
      for (int k = 0; k < index; ++k) pointers_[k] = basis(k);
      dots(q, pointers_.data(), index, stride, products_.data());
      subtract_combination(q, pointers_.data(), products_.data(), index, stride);
    }
    float norm2 = 0.0f;
    const float* self = q;
    dots(q, &self, 1, stride, &norm2);
    const float scale = norm2 > dependence_tolerance * norm2_[c][rectangle] ? 1.0f / std::sqrt(norm2) : 0.0f;
    std::transform(q, q + stride, q, [scale](float v) { return v * scale; });
    for (int d = 0; d < dictionary.size; ++d) pointers_[d] = dictionary.column(c, d);
    dots(q, pointers_.data(), dictionary.size, stride, products_.data());
    for (int d = 0; d < dictionary.size; ++d) remaining_norm2_[c][d] -= products_[d] * products_[d];

    // Normal equations grow by a row.
    for (int i = 0; i <= index; ++i) pointers_[i] = dictionary.column(c, chosen_[i]);
    dots(column, pointers_.data(), index + 1, stride, products_.data());
    double* gram = gram_[c].data();
    for (int i = 0; i <= index; ++i)
      gram[static_cast<std::size_t>(index) * most_tried + i] =
          gram[static_cast<std::size_t>(i) * most_tried + index] = products_[i];
    double h = 0.0;
    for (std::size_t k = 0; k < stride; ++k) h += column[k] * dictionary.samples[c][k];
    with_samples_[c].push_back(h);
    weights_[c].push_back(0.0);
    nnls_.solve(gram, most_tried, with_samples_[c].data(), index + 1, weights_[c].data());

    for (std::size_t k = 0; k < stride; ++k) residual_[c][k] = static_cast<float>(dictionary.samples[c][k]);
    for (int i = 0; i <= index; ++i) products_[i] = static_cast<float>(weights_[c][i]);
    subtract_combination(residual_[c].data(), pointers_.data(), products_.data(), index + 1, stride);
  }
}

}  // namespace refield
