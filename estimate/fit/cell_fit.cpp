// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/cell_fit.h"

#include <queue>

#include "core/base/linear_algebra.h"
#include "estimate/fit/select_kernels.h"
#include "estimate/fit/vector_kernels.h"
#include "estimate/fit/weighted_fit.h"

namespace refield {

namespace {

/// Cells per image, and their largest number: of the usual light maps the time grows with its cube.
constexpr int cells_per_image = 6, max_cells = 320;
/// The blur of the rectangles, in parts of the light map's longer side: as far as their edges err.
constexpr int sides_per_blur = 40;
/// What is expected everywhere, in parts of the mean.
constexpr double everywhere = 0.1;
/// Variances of the weights that are tried, in units of noise / squared effect of all cells on all samples.
constexpr std::array variances{316.0, 1780.0, 1e4, 56200.0};

/// Values over the texels of a light map, and their sums over rectangles. One channel and one thread, unlike
/// SummedAreaTable: a pixel is fitted within a parallel loop.
class TexelMap {
 public:
  TexelMap(int width, int height)
      : width_(width), height_(height), sums_(static_cast<std::size_t>(width_ + 1) * (height_ + 1), 0.0) {}

  /// Adds to all texels of a rectangle; before integrate().
  void add(const Box& box, double value) {
    at(box.x0, box.y0) += value;
    at(box.x1, box.y0) -= value;
    at(box.x0, box.y1) -= value;
    at(box.x1, box.y1) += value;
  }
  /// From what add() noted to sums over all texels above and to the left.
  void integrate() {
    accumulate();  // the values, each in its texel's upper left corner
    for (int y = height_; y > 0; --y)
      for (int x = width_; x > 0; --x) at(x, y) = at(x - 1, y - 1);
    for (int x = 0; x <= width_; ++x) at(x, 0) = 0.0;
    for (int y = 0; y <= height_; ++y) at(0, y) = 0.0;
    accumulate();
  }
  double sum(const Box& box) const {
    return (at(box.x1, box.y1) - at(box.x0, box.y1)) - (at(box.x1, box.y0) - at(box.x0, box.y0));
  }
  double mean(const Box& box) const { return sum(box) / static_cast<double>(box.area()); }
  Box all() const { return {0, 0, width_, height_}; }

  /// Means over squares of 2 `radius` + 1 texels, as far as they lie in the map, plus `offset`.
  TexelMap blurred(int radius, double offset) const {
    TexelMap result(width_, height_);
    for (int y = 0; y < height_; ++y)
      for (int x = 0; x < width_; ++x)
        result.at(x + 1, y + 1) =
            offset + mean({std::max(x - radius, 0), std::max(y - radius, 0), std::min(x + radius + 1, width_),
                           std::min(y + radius + 1, height_)});
    result.accumulate();
    return result;
  }

 private:
  double& at(int x, int y) { return sums_[static_cast<std::size_t>(y) * (width_ + 1) + x]; }
  double at(int x, int y) const { return sums_[static_cast<std::size_t>(y) * (width_ + 1) + x]; }
  void accumulate() {
    for (int y = 0; y <= height_; ++y)
      for (int x = 0; x <= width_; ++x)
        at(x, y) += (x > 0 ? at(x - 1, y) : 0.0) + (y > 0 ? at(x, y - 1) : 0.0) -
                    (x > 0 && y > 0 ? at(x - 1, y - 1) : 0.0);
  }

  int width_, height_;
  std::vector<double> sums_;
};

/// Divides the map in `count` cells of about equal sum, down to texels: the brightest is halved next.
std::vector<Box> divide(const TexelMap& map, int count) {
  const auto darker = [](const std::pair<double, Box>& a, const std::pair<double, Box>& b) {
    return a.first < b.first;
  };
  std::priority_queue<std::pair<double, Box>, std::vector<std::pair<double, Box>>, decltype(darker)> cells(
      darker);
  std::vector<Box> finished;  // texels
  cells.emplace(map.sum(map.all()), map.all());
  while (!cells.empty() && static_cast<int>(cells.size() + finished.size()) < count) {
    const Box box = cells.top().second;
    cells.pop();
    if (box.area() == 1) {
      finished.push_back(box);
      continue;
    }
    Box first = box, second = box;
    if (box.x1 - box.x0 >= box.y1 - box.y0)
      first.x1 = second.x0 = (box.x0 + box.x1) / 2;
    else
      first.y1 = second.y0 = (box.y0 + box.y1) / 2;
    for (const Box& half : {first, second}) cells.emplace(map.sum(half), half);
  }
  for (; !cells.empty(); cells.pop()) finished.push_back(cells.top().second);
  return finished;
}

/// The rectangles' colour, of mean 1; black without light.
std::array<double, 3> colour_of(const PixelKernels& kernels) {
  std::array<double, 3> colour{};
  for (std::size_t k = 0; k < kernels.boxes.size(); ++k)
    for (int c = 0; c < 3; ++c)
      colour[c] += static_cast<double>(kernels.boxes[k].area()) * kernels.weights[3 * k + c];
  const double mean = (colour[0] + colour[1] + colour[2]) / 3.0;
  for (double& each : colour) each = mean > 0.0 ? each / mean : 0.0;
  return colour;
}

/// Least squares for the weights of cells, in units of what is expected of each, given their mean.
struct CellSystem {
  std::vector<Box> cells;
  std::vector<double> unit;      ///< [cells], of a weight
  AlignedFloats columns;         ///< [cells][3 × stride], of a weight of one unit and the pixel's colour
  std::vector<const float*> at;  ///< [cells], into columns
  Eigen::VectorXd mean;          ///< [cells]
  Eigen::MatrixXd gram;
  Eigen::VectorXd with_samples;  ///< products of the columns with the samples

  int count() const { return static_cast<int>(cells.size()); }
  std::size_t length() const { return columns.size() / cells.size(); }
};

CellSystem system_of(const BoxTable& table, const PixelKernels& rectangles,
                     const std::array<double, 3>& colour, const AlignedFloats& samples) {
  const LightDomain& domain = table.domain();
  TexelMap density(domain.width, domain.height);
  for (std::size_t k = 0; k < rectangles.boxes.size(); ++k) {
    const float* w = &rectangles.weights[3 * k];
    density.add(rectangles.boxes[k], (static_cast<double>(w[0]) + w[1] + w[2]) / 3.0);
  }
  density.integrate();
  const int radius = std::max(std::max(domain.width, domain.height) / sides_per_blur, 1);
  const TexelMap expected =
      density.blurred(radius, 0.0).blurred(radius, everywhere * density.mean(density.all()));
  CellSystem system;
  system.cells = divide(expected, std::min(cells_per_image * table.images(), max_cells));
  const int count = system.count();
  const std::size_t stride = table.stride(), length = 3 * stride;
  system.columns.resize(count * length);
  system.mean.resize(count);
  for (int i = 0; i < count; ++i) {
    const Box& cell = system.cells[i];
    const double unit = expected.mean(cell);
    system.unit.push_back(unit);
    system.mean[i] = std::max(density.mean(cell), 0.0) / unit;
    float* column = system.columns.data() + i * length;
    table.column(cell, column);
    for (std::size_t k = 0; k < length; ++k) column[k] *= static_cast<float>(unit * colour[k / stride]);
    system.at.push_back(column);
  }
  std::vector<float> products(count);
  system.gram.resize(count, count);
  for (int i = 0; i < count; ++i) {
    dots(system.at[i], system.at.data(), i + 1, length, products.data());
    for (int k = 0; k <= i; ++k) system.gram(i, k) = system.gram(k, i) = products[k];
  }
  dots(samples.data(), system.at.data(), count, length, products.data());
  system.with_samples = Eigen::Map<const Eigen::VectorXf>(products.data(), count).cast<double>();
  return system;
}

double squared_sum(const AlignedFloats& values) {
  double sum = 0.0;
  for (const float value : values) sum += static_cast<double>(value) * value;
  return sum;
}

/// What the evidence is for.
struct CellChoice {
  double ridge = 0.0;       ///< noise variance / variance of a weight; 0 for the rectangles
  Eigen::VectorXd weights;  ///< not bounded
};

/// The variance of the weights for which the evidence is greatest, with the noise that suits it best, or the
/// rectangles, where their criterion is lower. `squared`: squared sum of the samples without the hats' part.
CellChoice choose(const CellSystem& system, double squared, const PixelKernels& rectangles,
                  const MaskedSamples& samples) {
  const Eigen::VectorXd of_mean = system.gram * system.mean;
  const Eigen::VectorXd with_rest = system.with_samples - of_mean;
  const double squared_rest = squared + system.mean.dot(of_mean) - 2.0 * system.mean.dot(system.with_samples);
  const int count = system.count(), measured = samples.count_sum();
  // The mean's, the noise and the variance.
  const int parameters = static_cast<int>(rectangles.boxes.size()) + 2;
  double best_criterion = criterion_of(rectangles, measured, 0.0);
  CellChoice best;
  const auto try_variance = [&](double variance) {
    const double ridge = system.gram.trace() / variance;
    const DefiniteSolution solution =
        solve_definite(system.gram + ridge * Eigen::MatrixXd::Identity(count, count), with_rest);
    const double evidence = solution.log_determinant - count * std::log(ridge);
    const double criterion = evidence + information_criterion(squared_rest - with_rest.dot(solution.x),
                                                              samples.squared_sum(), measured, parameters);
    if (criterion < best_criterion) {
      best_criterion = criterion;
      best = {ridge, system.mean + solution.x};
    }
    return criterion;
  };
  // The evidence is taken to have one maximum; the two in the middle tell on which side of them it is.
  const double low = try_variance(variances[1]), high = try_variance(variances[2]);
  try_variance(low < high ? variances[0] : variances[3]);
  return best;
}

/// PixelKernels::leverage: of each image the block of Q (QᵀQ + ridge)⁻¹ Qᵀ, of the cells that have weight.
std::vector<float> leverage_of(const CellSystem& system, const std::vector<int>& kept,
                               const BoxTable& table) {
  const Eigen::MatrixXd among_kept = system.gram(kept, kept);
  const Eigen::MatrixXf inner = inverse(among_kept).cast<float>();
  const auto length = static_cast<Eigen::Index>(system.length());
  Eigen::MatrixXf columns(length, static_cast<Eigen::Index>(kept.size()));
  for (std::size_t k = 0; k < kept.size(); ++k)
    columns.col(static_cast<Eigen::Index>(k)) = Eigen::Map<const Eigen::VectorXf>(system.at[kept[k]], length);
  const Eigen::MatrixXf spread = columns * inner;
  const Eigen::Index images = table.images(), stride = length / 3;
  std::vector<float> leverage(static_cast<std::size_t>(9 * images));
  for (int c = 0; c < 3; ++c)
    for (int other = 0; other < 3; ++other) {
      const Eigen::VectorXf along = spread.middleRows(c * stride, images)
                                        .cwiseProduct(columns.middleRows(other * stride, images))
                                        .rowwise()
                                        .sum();
      for (Eigen::Index j = 0; j < images; ++j) leverage[9 * j + 3 * c + other] = along[j];
    }
  return leverage;
}

}  // namespace

std::uint64_t CellFit::bytes(const LightDomain& domain) {
  return 3 * sizeof(double) * (domain.width + std::uint64_t{1}) * (domain.height + std::uint64_t{1});
}

std::optional<PixelKernels> CellFit::fit(const PixelKernels& rectangles, const MaskedSamples& samples) {
  const std::array<double, 3> colour = colour_of(rectangles);
  if (!(colour[0] + colour[1] + colour[2] > 0.0)) return std::nullopt;
  AlignedFloats rest = samples.values;  // without the hats' part
  for (std::size_t h = 0; h < rectangles.smooth.size() / 3; ++h)
    for (int c = 0; c < 3; ++c) {
      const float* hat = smooth_.hat_column(static_cast<int>(h), c);
      subtract_combination(rest.data() + c * table_.stride(), &hat, &rectangles.smooth[3 * h + c], 1,
                           table_.stride());
    }
  CellSystem system = system_of(table_, rectangles, colour, rest);
  const CellChoice choice = choose(system, squared_sum(rest), rectangles, samples);
  if (!(choice.ridge > 0.0)) return std::nullopt;

  const int count = system.count();
  system.gram.diagonal().array() += choice.ridge;
  const Eigen::VectorXd right = system.with_samples + choice.ridge * system.mean;
  Eigen::VectorXd weights = choice.weights.cwiseMax(0.0);
  nnls_.solve(system.gram.data(), count, right.data(), count, weights.data());
  PixelKernels kernels;
  kernels.smooth = rectangles.smooth;
  kernels.squared_samples = rectangles.squared_samples;
  std::vector<int> kept;
  for (int i = 0; i < count; ++i) {
    if (!(weights[i] > 0.0)) continue;
    kept.push_back(i);
    kernels.boxes.push_back(system.cells[i]);
    for (const double of_channel : colour)
      kernels.weights.push_back(static_cast<float>(weights[i] * system.unit[i] * of_channel));
    const auto weight = static_cast<float>(weights[i]);
    subtract_combination(rest.data(), &system.at[i], &weight, 1, system.length());
  }
  kernels.squared_residual = squared_sum(rest);
  // The bounds may cost what the weights have gained.
  if (kept.empty() || !(kernels.squared_residual < rectangles.squared_residual)) return std::nullopt;
  kernels.leverage = leverage_of(system, kept, table_);
  return kernels;
}

}  // namespace refield
