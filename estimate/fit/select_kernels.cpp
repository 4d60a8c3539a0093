// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/select_kernels.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace refield {

namespace {
/// Rectangles that keep less than this part of their squared norm beside the chosen ones say nothing new.
constexpr float metric_tolerance = 1e-5f;
/// The pursuit ends after this many rectangles in a row that the criterion does not reward: a shape may take
/// several rectangles before it pays.
constexpr int patience = 6;
/// Small enough to change nothing, and makes the solver take the new rectangle as free from the start, which
/// saves it a factorisation.
constexpr double entering_weight = 1e-30;
/// A class whose criterion was worse by more than this for a pixel is not tried for the next one like it.
/// Measured: 12 to 30 halve the time and change errors by a few per cent either way.
constexpr double far_behind = 20.0;
}  // namespace

KernelSelector::KernelSelector(const SmoothSpace& smooth)
    : smooth_(smooth), metrics_(smooth.classes().size()) {}

void KernelSelector::prepare(const TreeDictionary& dictionary) {
  dictionary_ = &dictionary;
  padded_size_ = padded_length(dictionary.size());
  for (Metric& metric : metrics_) metric.ready = false;
  pointers_.resize(std::max<std::size_t>(padded_size_, 256));
  products_.resize(pointers_.size());
}

void KernelSelector::weigh(float* coordinates, int smooth_class, int channel) const {
  // Q spans the columns' whole space already, V's coordinates correct the products for the class.
  const auto& correction = smooth_.classes()[smooth_class].correction[channel];
  for (std::size_t k = 0; k < correction.size(); ++k)
    coordinates[dictionary_->smooth_offset + k] *= correction[k];
}

KernelSelector::Metric& KernelSelector::metric(int smooth_class) {
  Metric& metric = metrics_[smooth_class];
  if (metric.ready) return metric;
  const std::size_t stride = dictionary_->coordinate_stride;
  const int size = dictionary_->size();
  left_.resize(stride);
  for (int c = 0; c < 3; ++c) {
    metric.norm2[c].assign(padded_size_, 0.0f);
    metric.least_norm2[c].assign(padded_size_, std::numeric_limits<float>::infinity());
    metric.gram[c].resize(size * padded_size_);
    for (int d = 0; d < size; ++d) {
      const float* column = dictionary_->column(c, d);
      std::copy_n(column, stride, left_.data());
      weigh(left_.data(), smooth_class, c);
      dots(left_.data(), &column, 1, stride, &metric.norm2[c][d]);
      metric.least_norm2[c][d] = metric_tolerance * metric.norm2[c][d];
    }
  }
  metric.has_row.assign(size, 0);
  metric.ready = true;
  return metric;
}

void KernelSelector::make_row(int smooth_class, int box) {
  Metric& current = metric(smooth_class);
  if (current.has_row[box]) return;
  const int size = dictionary_->size();
  for (int c = 0; c < 3; ++c) {
    for (int d = 0; d < size; ++d) pointers_[d] = dictionary_->column(c, d);
    std::copy_n(pointers_[box], dictionary_->coordinate_stride, left_.data());
    weigh(left_.data(), smooth_class, c);
    float* row = current.gram[c].data() + box * padded_size_;
    dots(left_.data(), pointers_.data(), size, dictionary_->coordinate_stride, row);
    std::fill(row + size, row + padded_size_, 0.0f);
  }
  current.has_row[box] = 1;
}

void KernelSelector::load_samples(const PixelCoordinates& pixel, int smooth_class) {
  const std::size_t stride = dictionary_->coordinate_stride;
  const int size = dictionary_->size();
  left_.resize(stride);
  for (int c = 0; c < 3; ++c) {
    const auto& correction = smooth_.classes()[smooth_class].correction[c];
    std::ranges::fill(left_, 0.0f);
    std::ranges::copy(pixel.inside[c], left_.begin());
    std::ranges::copy(pixel.smooth[c], left_.begin() + dictionary_->smooth_offset);
    weigh(left_.data(), smooth_class, c);
    squared_[c] = pixel.squared[c];
    for (std::size_t k = 0; k < correction.size(); ++k)
      squared_[c] += static_cast<double>(correction[k]) * pixel.smooth[c][k] * pixel.smooth[c][k];
    squared_[c] = std::max(squared_[c], 0.0);
    for (int d = 0; d < size; ++d) pointers_[d] = dictionary_->column(c, d);
    with_samples_[c].assign(padded_size_, 0.0f);
    dots(left_.data(), pointers_.data(), size, stride, with_samples_[c].data());
  }
}

KernelChoice KernelSelector::select(const PixelCoordinates& pixel, int most, ClassGuess& guess) {
  const int classes = static_cast<int>(metrics_.size());
  const int last_smooth = classes - 2;
  std::vector<std::optional<KernelChoice>> tried(classes);
  guess.behind.resize(classes, 0.0);
  // Downhill from the guess; the class without a smooth part is another model and looked at besides.
  int best = guess.best >= 0 && guess.best <= last_smooth ? guess.best : std::max(0, (classes - 1) / 2);
  const auto criterion = [&](int k) {
    if (k != best && guess.behind[k] > far_behind) return std::numeric_limits<double>::infinity();
    if (!tried[k]) tried[k] = pursue(pixel, k, smooth_.classes()[k].smooth ? most - smooth_.hats() : most);
    return tried[k]->criterion;
  };
  for (const int step : {1, -1})
    while (best + step >= 0 && best + step <= last_smooth && criterion(best + step) < criterion(best)) {
      best += step;
      guess.behind[std::clamp(best + step, 0, classes - 1)] = 0.0;  // now worth a look
    }
  if (criterion(classes - 1) < criterion(best)) best = classes - 1;
  for (int k = 0; k < classes; ++k)
    if (tried[k]) guess.behind[k] = tried[k]->criterion - tried[best]->criterion;
  guess.best = best;
  return std::move(*tried[best]);
}

KernelChoice KernelSelector::pursue(const PixelCoordinates& pixel, int smooth_class, int most) {
  Metric& current = metric(smooth_class);
  load_samples(pixel, smooth_class);
  const double evidence = smooth_.classes()[smooth_class].log_determinant;
  const double squared = squared_[0] + squared_[1] + squared_[2];
  // Relative to ‖b‖², whatever the class, so that an exact fit is the same for all.
  const double squared_samples = pixel.squared[0] + pixel.squared[1] + pixel.squared[2];
  KernelChoice best;
  best.smooth_class = smooth_class;
  best.criterion = information_criterion(squared, squared_samples, pixel.measured, 0) + evidence;
  if (!(squared > 0.0)) return best;

  chosen_.clear();
  is_chosen_.assign(dictionary_->size(), 0);
  for (int c = 0; c < 3; ++c) {
    correlation_[c] = with_samples_[c];
    remaining_norm2_[c] = current.norm2[c];
    weights_[c].clear();
  }
  // Weights that fall to zero free their place, so a few more rectangles than `most` may be tried.
  const int max_tried = std::min(2 * most, dictionary_->size());
  for (int c = 0; c < 3; ++c) {
    projections_[c].resize(max_tried * padded_size_);
    chosen_gram_[c].resize(static_cast<std::size_t>(max_tried) * max_tried);
    with_chosen_[c].clear();
    nnls_[c].start(max_tried);
  }
  gram_stride_ = max_tried;
  int unrewarded = 0;
  while (static_cast<int>(chosen_.size()) < max_tried && unrewarded < patience) {
    const int next = best_candidate(current);
    if (next < 0) break;
    add(smooth_class, next);
    const int count = static_cast<int>(chosen_.size());
    double residual = 0.0;
    int parameters = 0, kernels = 0;
    for (int c = 0; c < 3; ++c) {
      // ‖b − A x‖² = ‖b‖² − xᵀ(h + (h − G x)).
      double explained = 0.0;
      for (int i = 0; i < count; ++i) {
        const int d = chosen_[i];
        explained += weights_[c][i] * (static_cast<double>(with_samples_[c][d]) + correlation_[c][d]);
        parameters += weights_[c][i] > 0.0;
      }
      residual += std::max(squared_[c] - explained, 0.0);
    }
    for (int i = 0; i < count; ++i)
      kernels += weights_[0][i] > 0.0 || weights_[1][i] > 0.0 || weights_[2][i] > 0.0;
    if (kernels > most) break;
    const double criterion = information_criterion(residual, squared_samples, pixel.measured, parameters) +
                             evidence + pixel.search_penalty * kernels;
    if (criterion < best.criterion) {
      best.criterion = criterion;
      best.boxes = chosen_;
      best.weights = weights_;
      unrewarded = 0;
    } else {
      ++unrewarded;
    }
  }
  return best;
}

int KernelSelector::best_candidate(const Metric& current) {
  const int size = dictionary_->size();
  total_gain_.assign(padded_size_, 0.0f);
  for (int c = 0; c < 3; ++c)
    add_gains(correlation_[c].data(), remaining_norm2_[c].data(), current.least_norm2[c].data(), padded_size_,
              total_gain_.data());
  int best = -1;
  float best_gain = 0.0f;
  for (int d = 0; d < size; ++d)
    if (!is_chosen_[d] && total_gain_[d] > best_gain) {
      best_gain = total_gain_[d];
      best = d;
    }
  return best;
}

void KernelSelector::add(int smooth_class, int box) {
  make_row(smooth_class, box);
  Metric& current = metric(smooth_class);
  const int index = static_cast<int>(chosen_.size());
  const int count = index + 1;
  chosen_.push_back(box);
  is_chosen_[box] = 1;
  for (int c = 0; c < 3; ++c) {
    // A row of the Cholesky factor of the Gram matrix, for all rectangles at once: what the new direction
    // takes from them.
    const float* row = current.gram[c].data() + box * padded_size_;
    float* projection = projections_[c].data() + index * padded_size_;
    std::copy_n(row, padded_size_, projection);
    for (int i = 0; i < index; ++i) {
      pointers_[i] = projections_[c].data() + i * padded_size_;
      products_[i] = pointers_[i][box];
    }
    subtract_combination(projection, pointers_.data(), products_.data(), index, padded_size_);
    const float pivot = remaining_norm2_[c][box];
    const float scale = pivot > current.least_norm2[c][box] ? 1.0f / std::sqrt(pivot) : 0.0f;
    for (std::size_t d = 0; d < padded_size_; ++d) {
      projection[d] *= scale;
      remaining_norm2_[c][d] -= projection[d] * projection[d];
    }

    double* gram = chosen_gram_[c].data();
    for (int i = 0; i < count; ++i)
      gram[index * gram_stride_ + i] = gram[i * gram_stride_ + index] = row[chosen_[i]];
    with_chosen_[c].push_back(with_samples_[c][box]);
    // The weights so far are the best without the new one, which enters only where it correlates.
    weights_[c].push_back(0.0);
    if (!(correlation_[c][box] > 0.0f)) continue;
    weights_[c].back() = entering_weight;
    nnls_[c].proceed(gram, gram_stride_, with_chosen_[c].data(), count, weights_[c].data());
    std::ranges::copy(with_samples_[c], correlation_[c].begin());
    for (int i = 0; i < count; ++i) {
      pointers_[i] = current.gram[c].data() + chosen_[i] * padded_size_;
      products_[i] = static_cast<float>(weights_[c][i]);
    }
    subtract_combination(correlation_[c].data(), pointers_.data(), products_.data(), count, padded_size_);
  }
}

PixelWeights KernelSelector::solve(const PixelCoordinates& pixel, const KernelChoice& choice,
                                   const std::array<double, 3>& noise_kept, std::span<const float> like) {
  const SmoothClass& smooth = smooth_.classes()[choice.smooth_class];
  const int none = smooth_.class_without();  // in whose metric products are those of images
  Metric& raw = metric(none);
  load_samples(pixel, none);
  const int hats = smooth.smooth ? smooth_.hats() : 0;
  const int boxes = static_cast<int>(choice.boxes.size());
  const int size = hats + boxes;
  for (const int box : choice.boxes) make_row(none, box);
  gram_.resize(size * size);
  raw_gram_.resize(size * size);
  h_.resize(size);
  x_.resize(size);
  PixelWeights result;
  for (int c = 0; c < 3; ++c) {
    for (int i = 0; i < hats; ++i)
      for (int k = 0; k < hats; ++k) raw_gram_[i * size + k] = smooth_.hat_gram(c)[i * hats + k];
    if (hats > 0) smooth_.hat_products(pixel.smooth[c].data(), c, h_.data());
    std::vector<double> products(hats);
    for (int i = 0; i < boxes; ++i) {
      const int box = choice.boxes[i];
      if (hats > 0)
        smooth_.hat_products(dictionary_->column(c, box) + dictionary_->smooth_offset, c, products.data());
      for (int k = 0; k < hats; ++k)
        raw_gram_[(hats + i) * size + k] = raw_gram_[k * size + hats + i] = products[k];
      const float* row = raw.gram[c].data() + box * padded_size_;
      for (int k = 0; k < boxes; ++k) raw_gram_[(hats + i) * size + hats + k] = row[choice.boxes[k]];
      h_[hats + i] = with_samples_[c][box];
      x_[hats + i] = choice.weights[c][i];
    }
    gram_ = raw_gram_;
    for (int i = 0; i < hats; ++i) {
      for (int k = 0; k < hats; ++k) gram_[i * size + k] += noise_kept[c] * smooth.penalty[c][i * hats + k];
      x_[i] = like.empty() || like[3 * i + c] > 0.0f ? 1.0 : 0.0;
    }
    nnls_[c].solve(gram_.data(), size, h_.data(), size, x_.data());
    result.squared_residual[c] =
        std::max(squared_residual(raw_gram_.data(), size, h_.data(), size, x_.data(), pixel.squared[c]), 0.0);
    result.hats[c].assign(x_.begin(), x_.begin() + hats);
    result.boxes[c].assign(x_.begin() + hats, x_.end());
  }
  return result;
}

}  // namespace refield
