// SPDX-License-Identifier: Apache-2.0
#include "cli/report/report.h"

#include <cmath>

#include "core/base/run_context.h"
#include "estimate/estimate.h"

namespace refield::report {

namespace {

constexpr int subdivisions_of_the_paper[] = {1, 2, 3, 4, 5, 10, 20, 24};

/// Pixels darker than this share of the median brightness carry more noise than light.
constexpr double dark_share = 0.25;
/// Two shown pixels are at least this share of the image's width apart.
constexpr double least_distance = 0.1;
/// Pixels nearer to the border than this share of the image are not taken: their marks would be cut off.
constexpr double border = 0.03;

/// Mean and variance of positions within [first, last), evenly filled.
struct Interval {
  double centre, variance;
  Interval(int first, int last)
      : centre((first + last) / 2.0), variance((last - first) * (last - first) / 12.0) {}
};

KernelSpread spread_of(const ReflectanceField& field, std::size_t pixel) {
  KernelSpread result;
  double x_sum = 0.0, y_sum = 0.0, square_sum = 0.0, highest = 0.0;
  for (std::uint64_t e = field.transfer.row_start[pixel]; e < field.transfer.row_start[pixel + 1]; ++e) {
    const float* w = field.transfer.weight.data() + 3 * e;
    const Box box = field.basis.support(field.transfer.column[e]);
    const double weight = (std::abs(static_cast<double>(w[0])) + std::abs(w[1]) + std::abs(w[2])) / 3.0;
    const double energy = weight * field.basis.area(field.transfer.column[e]);
    const Interval x(box.x0, box.x1), y(box.y0, box.y1);
    result.energy += energy;
    x_sum += energy * x.centre;
    y_sum += energy * y.centre;
    square_sum += energy * (x.centre * x.centre + x.variance + y.centre * y.centre + y.variance);
    highest = std::max(highest, weight);
  }
  if (!(result.energy > 0.0)) return result;
  const LightDomain& domain = field.basis.domain;
  const double texels = static_cast<double>(domain.width) * domain.height;
  const double x_mean = x_sum / result.energy, y_mean = y_sum / result.energy;
  const double variance = square_sum / result.energy - x_mean * x_mean - y_mean * y_mean;
  result.spread = std::sqrt(std::max(0.0, variance)) / std::hypot(domain.width, domain.height);
  result.peak = highest * texels / result.energy;
  return result;
}

/// [pixels]: the median of a measure over a pixel and its eight neighbours, as far as they count.
std::vector<float> median_of_neighbours(const ReflectanceField& field,
                                        const std::function<bool(std::size_t)>& counts,
                                        const std::function<double(std::size_t)>& measure,
                                        const RunContext& run) {
  std::vector<float> medians(field.transfer.rows());
  std::vector<float> values;
  for (int y = 0; y < field.height; ++y) {
    run.throw_if_stopped();
    for (int x = 0; x < field.width; ++x) {
      values.clear();
      for (int v = std::max(0, y - 1); v <= std::min(field.height - 1, y + 1); ++v)
        for (int u = std::max(0, x - 1); u <= std::min(field.width - 1, x + 1); ++u) {
          const std::size_t p = static_cast<std::size_t>(v) * field.width + u;
          if (counts(p)) values.push_back(static_cast<float>(measure(p)));
        }
      if (!values.empty())
        medians[static_cast<std::size_t>(y) * field.width + x] = static_cast<float>(quantile(values, 0.5));
    }
  }
  return medians;
}

class Chooser {
 public:
  Chooser(const ReflectanceField& field, std::vector<std::size_t> candidates)
      : width_(field.width), candidates_(std::move(candidates)) {}

  /// Takes the pixel at `quantile` of the candidates ordered by `key`, or the nearest in that order that lies
  /// far enough from those already chosen.
  void take(const std::function<double(std::size_t)>& key, double quantile, std::string kind,
            const RunContext& run) {
    run.throw_if_stopped();
    auto order = candidates_;
    // Ties are broken by position, so that the choice is the same everywhere.
    std::ranges::sort(order, {}, [&](std::size_t p) { return std::pair(key(p), p); });
    const auto middle = static_cast<std::ptrdiff_t>(quantile * static_cast<double>(order.size() - 1));
    for (std::ptrdiff_t offset = 0; offset < static_cast<std::ptrdiff_t>(order.size()); ++offset)
      for (const std::ptrdiff_t at : {middle - offset, middle + offset})
        if (at >= 0 && at < static_cast<std::ptrdiff_t>(order.size()) && far_from_others(order[at])) {
          chosen_.push_back(
              {static_cast<int>(order[at] % width_), static_cast<int>(order[at] / width_), std::move(kind)});
          return;
        }
  }

  std::vector<ChosenPixel> chosen() && { return std::move(chosen_); }

 private:
  bool far_from_others(std::size_t pixel) const {
    const int x = static_cast<int>(pixel % width_), y = static_cast<int>(pixel / width_);
    return std::ranges::all_of(chosen_, [&](const ChosenPixel& other) {
      return std::hypot(other.x - x, other.y - y) >=
             std::max(1.0, least_distance * static_cast<double>(width_));
    });
  }
  std::size_t width_;
  std::vector<std::size_t> candidates_;
  std::vector<ChosenPixel> chosen_;
};

}  // namespace

Image kernel_density(const LightDomain& domain, std::span<const Box> boxes,
                     std::span<const std::array<float, 3>> weights) {
  if (boxes.size() != weights.size())
    throw InputError(boxes.size(), " boxes do not go with ", weights.size(), " weights");
  Image density(domain.width, domain.height, 1);
  for (std::size_t k = 0; k < boxes.size(); ++k) {
    const float weight = (weights[k][0] + weights[k][1] + weights[k][2]) / 3.0f;
    if (weight == 0.0f) continue;
    for (int y = boxes[k].y0; y < boxes[k].y1; ++y)
      for (float& value : density.row(y).subspan(boxes[k].x0, boxes[k].width())) value += weight;
  }
  return density;
}

KernelStudy study_kernels(const ReportInput& input, const std::vector<ChosenPixel>& pixels,
                          const RunContext& run) {
  KernelStudy study;
  const auto images = static_cast<int>(input.session.frames_of(FrameRole::train).size());
  for (const int count : subdivisions_of_the_paper)
    if (count < images) study.subdivisions.push_back(count);
  if (study.subdivisions.empty() || pixels.empty()) return study;
  EstimateOptions options = input.fields.front().options;
  // As many kernels as the last panel needs, whatever cap the field was made with.
  study.kernels = options.kernels = study.subdivisions.back() + 1;
  Progress progress(run, "computing kernels of selected pixels", pixels.size());
  for (const ChosenPixel& pixel : pixels) {
    run.throw_if_stopped();
    PixelKernels kernels{pixel, {}, {}, {}};
    const auto history = kernel_history(input.session, options, pixel.x, pixel.y, study.subdivisions, run);
    for (const int count : study.subdivisions) {
      const auto snapshot = std::ranges::find(history, count, &KernelSnapshot::subdivisions);
      kernels.after.push_back(snapshot == history.end()
                                  ? std::optional<Image>()
                                  : kernel_density(input.session.light, snapshot->boxes, snapshot->weights));
    }
    const std::size_t index = static_cast<std::size_t>(pixel.y) * input.session.width + pixel.x;
    kernels.in_field = kernel_density(input.fields.front().field, index);
    if (input.transport) kernels.exact = kernel_density(*input.transport, index);
    study.pixels.push_back(std::move(kernels));
    progress.advance();
  }
  return study;
}

std::vector<KernelSpread> kernel_spreads(const ReflectanceField& field, const RunContext& run) {
  std::vector<KernelSpread> spreads(field.transfer.rows());
  for (std::size_t p = 0; p < spreads.size(); ++p) {
    if (p % 4096 == 0) run.throw_if_stopped();
    spreads[p] = spread_of(field, p);
  }
  return spreads;
}

std::vector<ChosenPixel> choose_pixels(const ReflectanceField& field, const Mask& mask,
                                       const RunContext& run) {
  const auto spreads = kernel_spreads(field, run);
  const auto inside = [&](std::size_t p) {
    return (mask.empty() || mask[p] != 0) && spreads[p].energy > 0.0;
  };
  std::vector<float> energies;
  for (std::size_t p = 0; p < spreads.size(); ++p)
    if (inside(p)) energies.push_back(static_cast<float>(spreads[p].energy));
  const double dark = dark_share * quantile(energies, 0.5);
  const auto near_border = [&](std::size_t p) {
    const double x = static_cast<double>(p % field.width) + 0.5,
                 y = static_cast<double>(p / field.width) + 0.5;
    return std::min(x, field.width - x) < border * field.width ||
           std::min(y, field.height - y) < border * field.height;
  };
  const auto bright = [&](std::size_t p) { return inside(p) && spreads[p].energy > dark; };
  std::vector<std::size_t> candidates;
  for (std::size_t p = 0; p < spreads.size(); ++p)
    if (bright(p) && !near_border(p)) candidates.push_back(p);
  if (candidates.empty()) return {};

  const auto smooth = [&](const std::function<double(std::size_t)>& measure) {
    return median_of_neighbours(field, bright, measure, run);
  };
  const auto spread = smooth([&](std::size_t p) { return spreads[p].spread; });
  const auto peak = smooth([&](std::size_t p) { return std::log1p(spreads[p].peak); });
  Chooser chooser(field, std::move(candidates));
  chooser.take([&](std::size_t p) { return spread[p]; }, 0.002, "concentrated, as mirrors and glass are",
               run);
  chooser.take([&](std::size_t p) { return spread[p]; }, 0.1, "narrow", run);
  chooser.take([&](std::size_t p) { return spread[p] * peak[p]; }, 0.995,
               "a peak over a broad base, as glossy surfaces have", run);
  chooser.take([&](std::size_t p) { return spread[p]; }, 0.5, "middle of all pixels", run);
  chooser.take([&](std::size_t p) { return spread[p] / peak[p]; }, 0.98,
               "broad and even, as diffuse surfaces are", run);
  if (!field.quality.training_error.empty()) {
    const auto error = smooth([&](std::size_t p) { return field.quality.training_error[p]; });
    chooser.take([&](std::size_t p) { return error[p]; }, 0.99, "fits its training images badly", run);
  }
  return std::move(chooser).chosen();
}

}  // namespace refield::report
