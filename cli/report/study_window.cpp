// SPDX-License-Identifier: Apache-2.0
#include "cli/report/study_window.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "cli/report/pixel_choice.h"
#include "core/files.h"
#include "core/image_io.h"
#include "core/interrupt.h"
#include "core/progress.h"

namespace refield::report {

namespace {

constexpr std::array quantiles = {0.1, 0.25, 0.5, 0.75, 0.9};
/// Windows are tried this share of their own size apart.
constexpr double stride_share = 0.2;

/// Quantiles of a map inside a window, in logarithms: a factor counts the same for small and large values.
std::array<double, quantiles.size()> log_quantiles(const Image& map, const Mask& mask, const Box& window) {
  std::vector<float> values;
  for (int y = window.y0; y < window.y1; ++y)
    for (int x = window.x0; x < window.x1; ++x) {
      const std::size_t p = static_cast<std::size_t>(y) * map.width + x;
      const float value = map.values[p];
      if ((mask.empty() || mask[p] != 0) && value > 0.0f && std::isfinite(value))
        values.push_back(std::log(value));
    }
  std::array<double, quantiles.size()> result{};
  for (std::size_t i = 0; i < quantiles.size(); ++i) result[i] = quantile(values, quantiles[i]);
  return result;
}

/// The measures by which pixels are compared: how well they fit, how far their kernels spread.
std::vector<Image> measures_of(const ReflectanceField& field) {
  std::vector<Image> measures(1, Image(field.width, field.height, 1));
  const auto spreads = kernel_spreads(field);
  std::ranges::transform(spreads, measures[0].values.begin(),
                         [](const KernelSpread& s) { return static_cast<float>(s.spread); });
  if (!field.training_error.empty()) {
    measures.emplace_back(field.width, field.height, 1);
    measures[1].values = field.training_error;
  }
  return measures;
}

}  // namespace

Box typical_window(const ReflectanceField& field, const Mask& mask, std::size_t most_pixels) {
  const Box whole{0, 0, field.width, field.height};
  const auto most = static_cast<double>(std::max<std::size_t>(1, most_pixels));
  if (static_cast<double>(whole.area()) <= most) return whole;
  const double scale = std::sqrt(most / static_cast<double>(whole.area()));
  const int width = std::max(1, static_cast<int>(scale * field.width));
  const int height = std::clamp(static_cast<int>(scale * field.height), 1, field.height);
  const int x_step = std::max(1, static_cast<int>(stride_share * width));
  const int y_step = std::max(1, static_cast<int>(stride_share * height));

  const auto measures = measures_of(field);
  std::vector<std::array<double, quantiles.size()>> everywhere;
  for (const Image& measure : measures) everywhere.push_back(log_quantiles(measure, mask, whole));
  Box best{(field.width - width) / 2, (field.height - height) / 2, 0, 0};
  double least = std::numeric_limits<double>::infinity();
  for (int y = 0; y + height <= field.height; y += y_step)
    for (int x = 0; x + width <= field.width; x += x_step) {
      throw_if_interrupted();
      const Box window{x, y, x + width, y + height};
      double difference = 0.0;
      for (std::size_t m = 0; m < measures.size(); ++m) {
        const auto here = log_quantiles(measures[m], mask, window);
        for (std::size_t i = 0; i < quantiles.size(); ++i) difference += std::abs(here[i] - everywhere[m][i]);
      }
      if (difference < least) {  // never for NaN: a window without pixels
        least = difference;
        best = window;
      }
    }
  return {best.x0, best.y0, best.x0 + width, best.y0 + height};
}

Image cropped(const Image& image, const Box& window) {
  Image part(window.width(), window.height(), image.channels);
  for (int y = 0; y < part.height; ++y) {
    const auto row = image.row(window.y0 + y);
    std::ranges::copy(row.subspan(static_cast<std::size_t>(window.x0) * image.channels, part.row(y).size()),
                      part.row(y).begin());
  }
  return part;
}

Mask cropped(const Mask& mask, int width, const Box& window) {
  Mask part;
  if (mask.empty()) return part;
  for (int y = window.y0; y < window.y1; ++y)
    for (int x = window.x0; x < window.x1; ++x) part.push_back(mask[static_cast<std::size_t>(y) * width + x]);
  return part;
}

ReflectanceField cropped(const ReflectanceField& field, const Box& window) {
  ReflectanceField part;
  part.width = window.width();
  part.height = window.height();
  part.basis = field.basis;
  part.provenance = field.provenance;
  const SparseTransfer& transfer = field.transfer;
  for (int y = window.y0; y < window.y1; ++y)
    for (int x = window.x0; x < window.x1; ++x) {
      const std::size_t p = static_cast<std::size_t>(y) * field.width + x;
      const std::uint64_t first = transfer.row_start[p], count = transfer.row_start[p + 1] - first;
      part.transfer.append_row(std::span(transfer.column).subspan(first, count),
                               std::span(transfer.weight).subspan(3 * first, 3 * count));
      if (!field.training_error.empty()) part.training_error.push_back(field.training_error[p]);
    }
  return part;
}

CaptureSession cropped(const CaptureSession& session, const Box& window,
                       const std::filesystem::path& folder) {
  if (window == Box{0, 0, session.width, session.height}) return session;
  create_folders(folder);
  CaptureSession part = session;
  part.width = window.width();
  part.height = window.height();
  const Box columns{window.x0, 0, window.x1, window.height()};
  Progress progress("cut photographs", session.frames.size());
  for (std::size_t i = 0; i < part.frames.size(); ++i) {
    throw_if_interrupted();
    const Photograph rows = read_photograph_rows(session.frames[i].observed, window.y0, window.y1);
    part.frames[i].observed = folder / (std::to_string(i) + ".exr");
    write_photograph(part.frames[i].observed, {cropped(rows.radiance, columns),
                                               rows.sigma.empty() ? Image{} : cropped(rows.sigma, columns)});
    progress.advance();
  }
  if (session.mask) {
    part.mask = folder / "mask.exr";
    write_exr(*part.mask, cropped(read_image(*session.mask), window));
  }
  return part;
}

}  // namespace refield::report
