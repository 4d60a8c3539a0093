// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/select_kernels.h"

namespace refield {

namespace {
/// Rectangles that keep less than this part of their squared norm beside the chosen ones say nothing new.
constexpr float metric_tolerance = 1e-5f;
/// Small enough to change nothing, and makes the solver take the new rectangle as free from the start, which
/// saves it a factorisation.
constexpr double entering_weight = 1e-30;
}  // namespace

KernelSelector::KernelSelector(const SmoothSpace& smooth, const FitTuning& tuning)
    : smooth_(smooth), tuning_(tuning), metrics_(smooth.classes().size()) {
  for (std::size_t k = 0; k < metrics_.size(); ++k) metrics_[k].smooth_class = &smooth.classes()[k];
}

void KernelSelector::prepare(const TreeDictionary& dictionary) {
  dictionary_ = &dictionary;
  padded_size_ = padded_length(dictionary.size());
  for (Metric& metric : metrics_) metric.ready = false;
  pointers_.resize(std::max<std::size_t>(padded_size_, 256));
  products_.resize(pointers_.size());
}

void KernelSelector::weigh(float* coordinates, const SmoothClass& smooth_class, int channel) const {
  // Q spans the columns' whole space already, V's coordinates correct the products for the class.
  const auto& correction = smooth_class.correction[channel];
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
    metric.min_norm2[c].assign(padded_size_, std::numeric_limits<float>::infinity());
    metric.gram[c].resize(size * padded_size_);
    for (int d = 0; d < size; ++d) {
      const float* column = dictionary_->column(c, d);
      std::copy_n(column, stride, left_.data());
      weigh(left_.data(), *metric.smooth_class, c);
      dots(left_.data(), &column, 1, stride, &metric.norm2[c][d]);
      metric.min_norm2[c][d] = metric_tolerance * metric.norm2[c][d];
    }
  }
  metric.has_row.assign(size, 0);
  metric.ready = true;
  return metric;
}

void KernelSelector::make_row(Metric& metric, int box) {
  if (metric.has_row[box]) return;
  const int size = dictionary_->size();
  for (int c = 0; c < 3; ++c) {
    for (int d = 0; d < size; ++d) pointers_[d] = dictionary_->column(c, d);
    std::copy_n(pointers_[box], dictionary_->coordinate_stride, left_.data());
    weigh(left_.data(), *metric.smooth_class, c);
    float* row = metric.gram[c].data() + box * padded_size_;
    dots(left_.data(), pointers_.data(), size, dictionary_->coordinate_stride, row);
    std::fill(row + size, row + padded_size_, 0.0f);
  }
  metric.has_row[box] = 1;
}

void KernelSelector::load_samples(const PixelCoordinates& pixel, const SmoothClass& smooth_class) {
  const std::size_t stride = dictionary_->coordinate_stride;
  const int size = dictionary_->size();
  left_.resize(stride);
  for (int c = 0; c < 3; ++c) {
    const auto& correction = smooth_class.correction[c];
    std::ranges::fill(left_, 0.0f);
    std::ranges::copy(pixel.inside[c], left_.begin());
    std::ranges::copy(pixel.smooth[c], left_.begin() + dictionary_->smooth_offset);
    weigh(left_.data(), smooth_class, c);
    double& squared = samples_.squared[c];
    squared = pixel.squared[c];
    for (std::size_t k = 0; k < correction.size(); ++k)
      squared += static_cast<double>(correction[k]) * pixel.smooth[c][k] * pixel.smooth[c][k];
    squared = std::max(squared, 0.0);
    for (int d = 0; d < size; ++d) pointers_[d] = dictionary_->column(c, d);
    samples_.products[c].assign(padded_size_, 0.0f);
    dots(left_.data(), pointers_.data(), size, stride, samples_.products[c].data());
  }
}

KernelChoice KernelSelector::select(const PixelCoordinates& pixel, int max_kernels, ClassGuess& guess) {
  const int classes = static_cast<int>(metrics_.size());
  const int last_smooth = classes - 2;
  std::vector<std::optional<KernelChoice>> tried(classes);
  guess.behind.resize(classes, 0.0);
  // Downhill from the guess; the class without a smooth part is another model and looked at besides.
  int best = guess.best >= 0 && guess.best <= last_smooth ? guess.best : std::max(0, (classes - 1) / 2);
  const auto criterion = [&](int k) {
    if (k != best && guess.behind[k] > tuning_.class_cutoff) return std::numeric_limits<double>::infinity();
    if (!tried[k])
      tried[k] = pursue(pixel, k, smooth_.classes()[k].smooth ? max_kernels - smooth_.hats() : max_kernels);
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

KernelChoice KernelSelector::pursue(const PixelCoordinates& pixel, int smooth_class, int max_kernels) {
  Metric& current = metric(smooth_class);
  load_samples(pixel, *current.smooth_class);
  const double evidence = current.smooth_class->log_determinant;
  const double squared = samples_.squared[0] + samples_.squared[1] + samples_.squared[2];
  // Relative to ‖b‖², whatever the class, so that an exact fit is the same for all.
  const double squared_samples = pixel.squared[0] + pixel.squared[1] + pixel.squared[2];
  KernelChoice best;
  best.smooth_class = smooth_class;
  best.criterion = information_criterion(squared, squared_samples, pixel.measured, 0) + evidence;
  if (!(squared > 0.0)) return best;

  // Weights that fall to zero free their place, so a few more rectangles than `max_kernels` may be tried.
  start_pursuit(current, std::min(2 * max_kernels, dictionary_->size()));
  int unrewarded = 0;
  while (static_cast<int>(pursuit_.chosen.size()) < pursuit_.max_chosen && unrewarded < tuning_.patience) {
    const int next = best_candidate(current);
    if (next < 0) break;
    choose(current, next);
    const FitSummary fit = summarise_pursuit();
    if (fit.kernels > max_kernels) break;
    const double criterion =
        information_criterion(fit.squared_residual, squared_samples, pixel.measured, fit.parameters) +
        evidence + pixel.search_penalty * fit.kernels;
    if (criterion < best.criterion) {
      best.criterion = criterion;
      best.boxes = pursuit_.chosen;
      for (int c = 0; c < 3; ++c) best.weights[c] = pursuit_.channels[c].weights;
      unrewarded = 0;
    } else {
      ++unrewarded;
    }
  }
  return best;
}

void KernelSelector::start_pursuit(const Metric& metric, int max_chosen) {
  pursuit_.max_chosen = max_chosen;
  pursuit_.chosen.clear();
  pursuit_.is_chosen.assign(dictionary_->size(), 0);
  for (int c = 0; c < 3; ++c) {
    PursuitChannel& channel = pursuit_.channels[c];
    channel.correlation = samples_.products[c];
    channel.remaining_norm2 = metric.norm2[c];
    channel.weights.clear();
    channel.projections.resize(max_chosen * padded_size_);
    channel.gram.resize(static_cast<std::size_t>(max_chosen) * max_chosen);
    channel.products.clear();
    channel.nnls.start(max_chosen);
  }
}

int KernelSelector::best_candidate(const Metric& metric) {
  const int size = dictionary_->size();
  total_gain_.assign(padded_size_, 0.0f);
  for (int c = 0; c < 3; ++c) {
    const PursuitChannel& channel = pursuit_.channels[c];
    add_gains(channel.correlation.data(), channel.remaining_norm2.data(), metric.min_norm2[c].data(),
              padded_size_, total_gain_.data());
  }
  int best = -1;
  float best_gain = 0.0f;
  for (int d = 0; d < size; ++d)
    if (!pursuit_.is_chosen[d] && total_gain_[d] > best_gain) {
      best_gain = total_gain_[d];
      best = d;
    }
  return best;
}

void KernelSelector::choose(Metric& metric, int box) {
  make_row(metric, box);
  pursuit_.chosen.push_back(box);
  pursuit_.is_chosen[box] = 1;
  for (int c = 0; c < 3; ++c) {
    remove_direction(metric, c);
    update_weights(metric, c);
  }
}

void KernelSelector::remove_direction(const Metric& metric, int c) {
  // A row of the Cholesky factor of the Gram matrix, for all rectangles at once: what the new direction takes
  // from them.
  PursuitChannel& channel = pursuit_.channels[c];
  const int box = pursuit_.chosen.back();
  const int index = static_cast<int>(pursuit_.chosen.size()) - 1;
  float* projection = channel.projections.data() + index * padded_size_;
  std::copy_n(metric.gram[c].data() + box * padded_size_, padded_size_, projection);
  for (int i = 0; i < index; ++i) {
    pointers_[i] = channel.projections.data() + i * padded_size_;
    products_[i] = pointers_[i][box];
  }
  subtract_combination(projection, pointers_.data(), products_.data(), index, padded_size_);
  float* remaining_norm2 = channel.remaining_norm2.data();
  const float pivot = remaining_norm2[box];
  const float scale = pivot > metric.min_norm2[c][box] ? 1.0f / std::sqrt(pivot) : 0.0f;
  for (std::size_t d = 0; d < padded_size_; ++d) {
    projection[d] *= scale;
    remaining_norm2[d] -= projection[d] * projection[d];
  }
}

void KernelSelector::update_weights(const Metric& metric, int c) {
  PursuitChannel& channel = pursuit_.channels[c];
  const int stride = pursuit_.max_chosen;
  const int box = pursuit_.chosen.back();
  const int count = static_cast<int>(pursuit_.chosen.size());
  const int index = count - 1;
  const float* row = metric.gram[c].data() + box * padded_size_;
  double* gram = channel.gram.data();
  for (int i = 0; i < count; ++i)
    gram[index * stride + i] = gram[i * stride + index] = row[pursuit_.chosen[i]];
  channel.products.push_back(samples_.products[c][box]);
  // The weights so far are the best without the new one, which enters only where it correlates.
  channel.weights.push_back(0.0);
  if (!(channel.correlation[box] > 0.0f)) return;
  channel.weights.back() = entering_weight;
  channel.nnls.proceed(gram, stride, channel.products.data(), count, channel.weights.data());
  std::ranges::copy(samples_.products[c], channel.correlation.begin());
  for (int i = 0; i < count; ++i) {
    pointers_[i] = metric.gram[c].data() + pursuit_.chosen[i] * padded_size_;
    products_[i] = static_cast<float>(channel.weights[i]);
  }
  subtract_combination(channel.correlation.data(), pointers_.data(), products_.data(), count, padded_size_);
}

KernelSelector::FitSummary KernelSelector::summarise_pursuit() const {
  FitSummary fit;
  const auto& channels = pursuit_.channels;
  const int count = static_cast<int>(pursuit_.chosen.size());
  for (int c = 0; c < 3; ++c) {
    // ‖b − A x‖² = ‖b‖² − xᵀ(h + (h − G x)).
    double explained = 0.0;
    for (int i = 0; i < count; ++i) {
      const int d = pursuit_.chosen[i];
      const double weight = channels[c].weights[i];
      explained += weight * (static_cast<double>(samples_.products[c][d]) + channels[c].correlation[d]);
      fit.parameters += weight > 0.0;
    }
    fit.squared_residual += std::max(samples_.squared[c] - explained, 0.0);
  }
  for (int i = 0; i < count; ++i)
    fit.kernels +=
        channels[0].weights[i] > 0.0 || channels[1].weights[i] > 0.0 || channels[2].weights[i] > 0.0;
  return fit;
}

PixelWeights KernelSelector::solve(const PixelCoordinates& pixel, const KernelChoice& choice,
                                   const std::array<double, 3>& noise_kept, std::span<const float> like) {
  const SmoothClass& smooth = smooth_.classes()[choice.smooth_class];
  Metric& raw = metric(smooth_.class_without());  // in which products are those of images
  load_samples(pixel, *raw.smooth_class);
  const int hats = smooth.smooth ? smooth_.hats() : 0;
  const int size = hats + static_cast<int>(choice.boxes.size());
  for (const int box : choice.boxes) make_row(raw, box);
  auto& [raw_gram, gram, h, x] = equations_;
  PixelWeights result;
  for (int c = 0; c < 3; ++c) {
    load_equations(raw, pixel, choice, hats, c);
    for (int i = 0; i < hats; ++i) {
      for (int k = 0; k < hats; ++k) gram[i * size + k] += noise_kept[c] * smooth.penalty[c][i * hats + k];
      x[i] = like.empty() || like[3 * i + c] > 0.0f ? 1.0 : 0.0;
    }
    pursuit_.channels[c].nnls.solve(gram.data(), size, h.data(), size, x.data());
    result.squared_residual[c] =
        std::max(squared_residual(raw_gram.data(), size, h.data(), size, x.data(), pixel.squared[c]), 0.0);
    result.hats[c].assign(x.begin(), x.begin() + hats);
    result.boxes[c].assign(x.begin() + hats, x.end());
  }
  return result;
}

void KernelSelector::load_equations(const Metric& raw, const PixelCoordinates& pixel,
                                    const KernelChoice& choice, int hats, int c) {
  const int boxes = static_cast<int>(choice.boxes.size());
  const int size = hats + boxes;
  auto& [raw_gram, gram, h, x] = equations_;
  raw_gram.resize(size * size);
  h.resize(size);
  x.resize(size);
  for (int i = 0; i < hats; ++i)
    for (int k = 0; k < hats; ++k) raw_gram[i * size + k] = smooth_.hat_gram(c)[i * hats + k];
  if (hats > 0) smooth_.hat_products(pixel.smooth[c].data(), c, h.data());
  std::vector<double> products(hats);
  for (int i = 0; i < boxes; ++i) {
    const int box = choice.boxes[i];
    if (hats > 0)
      smooth_.hat_products(dictionary_->column(c, box) + dictionary_->smooth_offset, c, products.data());
    for (int k = 0; k < hats; ++k)
      raw_gram[(hats + i) * size + k] = raw_gram[k * size + hats + i] = products[k];
    const float* row = raw.gram[c].data() + box * padded_size_;
    for (int k = 0; k < boxes; ++k) raw_gram[(hats + i) * size + hats + k] = row[choice.boxes[k]];
    h[hats + i] = samples_.products[c][box];
    x[hats + i] = choice.weights[c][i];
  }
  gram = raw_gram;
}

}  // namespace refield
