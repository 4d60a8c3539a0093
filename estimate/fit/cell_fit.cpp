// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/cell_fit.h"

#include <queue>

#include "core/base/linear_algebra.h"
#include "estimate/fit/select_kernels.h"
#include "estimate/fit/vector_kernels.h"
#include "estimate/fit/weighted_fit.h"

namespace refield {

namespace {

/// Cells per image, and their largest number: the time grows with its cube.
constexpr int cells_per_image = 6, max_cells = 320;
/// The blur of the rectangles, in parts of the light map's longer side: as far as their edges err.
constexpr int sides_per_blur = 40;
/// What is expected everywhere, in parts of the mean.
constexpr double everywhere = 0.1;
/// Variances of the weights that are tried, in units of noise / mean squared effect of a cell.
constexpr std::array variances{316.0, 1780.0, 1e4, 56200.0};

/// Values over the texels of a light map, and their sums over rectangles.
class TexelMap {
 public:
  explicit TexelMap(const LightDomain& domain)
      : width_(domain.width),
        height_(domain.height),
        sums_(static_cast<std::size_t>(width_ + 1) * (height_ + 1), 0.0) {}

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
    from_values();
  }
  double sum(const Box& box) const {
    return (at(box.x1, box.y1) - at(box.x0, box.y1)) - (at(box.x1, box.y0) - at(box.x0, box.y0));
  }
  double mean(const Box& box) const { return sum(box) / static_cast<double>(box.area()); }
  Box all() const { return {0, 0, width_, height_}; }

  /// Means over squares of 2 `radius` + 1 texels, dark beyond the map, plus `offset`.
  TexelMap blurred(int radius, double offset) const {
    TexelMap result(*this);
    const double per_texel = 1.0 / ((2.0 * radius + 1.0) * (2.0 * radius + 1.0));
    for (int y = 0; y < height_; ++y)
      for (int x = 0; x < width_; ++x)
        result.at(x, y) =
            offset + per_texel * sum({std::max(x - radius, 0), std::max(y - radius, 0),
                                      std::min(x + radius + 1, width_), std::min(y + radius + 1, height_)});
    result.from_values();
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
  /// Sums in place of values, which lie at (x, y).
  void from_values() {
    for (int y = height_; y > 0; --y)
      for (int x = width_; x > 0; --x) at(x, y) = at(x - 1, y - 1);
    for (int x = 0; x <= width_; ++x) at(x, 0) = 0.0;
    for (int y = 0; y <= height_; ++y) at(0, y) = 0.0;
    accumulate();
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
  std::vector<Box> texels;
  cells.emplace(map.sum(map.all()), map.all());
  while (!cells.empty() && static_cast<int>(cells.size() + texels.size()) < count) {
    const Box box = cells.top().second;
    cells.pop();
    if (box.area() == 1) {
      texels.push_back(box);
      continue;
    }
    Box first = box, second = box;
    if (box.x1 - box.x0 >= box.y1 - box.y0)
      first.x1 = second.x0 = (box.x0 + box.x1) / 2;
    else
      first.y1 = second.y0 = (box.y0 + box.y1) / 2;
    for (const Box& half : {first, second}) cells.emplace(map.sum(half), half);
  }
  for (; !cells.empty(); cells.pop()) texels.push_back(cells.top().second);
  return texels;
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

}  // namespace

std::optional<PixelKernels> CellFit::fit(const PixelKernels& rectangles, const MaskedSamples& samples) {
  const std::array<double, 3> colour = colour_of(rectangles);
  if (!(colour[0] + colour[1] + colour[2] > 0.0)) return std::nullopt;
  TexelMap density(table_.domain());
  for (std::size_t k = 0; k < rectangles.boxes.size(); ++k) {
    const float* w = &rectangles.weights[3 * k];
    density.add(rectangles.boxes[k], (static_cast<double>(w[0]) + w[1] + w[2]) / 3.0);
  }
  density.integrate();
  const int radius = std::max(std::max(table_.domain().width, table_.domain().height) / sides_per_blur, 1);
  const TexelMap expected =
      density.blurred(radius, 0.0).blurred(radius, everywhere * density.mean(density.all()));
  const std::vector<Box> cells = divide(expected, std::min(cells_per_image * table_.images(), max_cells));

  // Columns of the cells, the channels one behind the other, for weights in units of what is expected.
  const int count = static_cast<int>(cells.size());
  const std::size_t stride = table_.stride(), length = 3 * stride;
  AlignedFloats columns(count * length), rest = samples.values;
  std::vector<const float*> pointers(count);
  std::vector<double> unit(count);
  Eigen::VectorXd mean(count);
  for (int i = 0; i < count; ++i) {
    float* column = columns.data() + i * length;
    table_.column(cells[i], column);
    unit[i] = expected.mean(cells[i]);
    mean[i] = std::max(density.mean(cells[i]), 0.0) / unit[i];
    for (int c = 0; c < 3; ++c)
      for (std::size_t j = 0; j < stride; ++j)
        column[c * stride + j] *= static_cast<float>(unit[i] * colour[c]);
    pointers[i] = column;
  }
  for (std::size_t h = 0; h < rectangles.smooth.size() / 3; ++h)
    for (int c = 0; c < 3; ++c) {
      const float* hat = smooth_.hat_column(static_cast<int>(h), c);
      subtract_combination(rest.data() + c * stride, &hat, &rectangles.smooth[3 * h + c], 1, stride);
    }
  std::vector<float> products(count);
  Eigen::MatrixXd gram(count, count);
  for (int i = 0; i < count; ++i) {
    dots(pointers[i], pointers.data(), i + 1, length, products.data());
    for (int k = 0; k <= i; ++k) gram(i, k) = gram(k, i) = products[k];
  }
  dots(rest.data(), pointers.data(), count, length, products.data());
  const Eigen::VectorXd with_samples =
      Eigen::Map<const Eigen::VectorXf>(products.data(), count).cast<double>();
  const Eigen::VectorXd with_rest = with_samples - gram * mean;
  const double mean_effect = gram.trace() / count;
  double squared = 0.0;
  for (const float value : rest) squared += static_cast<double>(value) * value;
  squared += mean.dot(gram * mean) - 2.0 * mean.dot(with_samples);

  // The evidence of each variance, with the noise that suits it best.
  const int measured = samples.count_sum();
  double best_ridge = 0.0, best_criterion = criterion_of(rectangles, measured, 0.0);
  const int parameters = static_cast<int>(rectangles.boxes.size()) + 2;
  for (const double variance : variances) {
    const double ridge = count * mean_effect / variance;
    const DefiniteSolution solution =
        solve_definite(gram + ridge * Eigen::MatrixXd::Identity(count, count), with_rest);
    const double residual = squared - with_rest.dot(solution.x);
    const double criterion = information_criterion(residual, samples.squared_sum(), measured, parameters) +
                             solution.log_determinant - count * std::log(ridge);
    if (!(criterion < best_criterion)) continue;
    best_criterion = criterion;
    best_ridge = ridge;
  }
  if (!(best_ridge > 0.0)) return std::nullopt;

  gram.diagonal().array() += best_ridge;
  const Eigen::VectorXd right = with_samples + best_ridge * mean;
  Eigen::VectorXd weights = mean;
  nnls_.solve(gram.data(), count, right.data(), count, weights.data());
  PixelKernels kernels;
  kernels.smooth = rectangles.smooth;
  kernels.squared_samples = rectangles.squared_samples;
  std::vector<int> kept;
  for (int i = 0; i < count; ++i) {
    if (!(weights[i] > 0.0)) continue;
    kept.push_back(i);
    kernels.boxes.push_back(cells[i]);
    for (int c = 0; c < 3; ++c)
      kernels.weights.push_back(static_cast<float>(weights[i] * unit[i] * colour[c]));
    const auto weight = static_cast<float>(weights[i]);
    subtract_combination(rest.data(), &pointers[i], &weight, 1, length);
  }
  for (const float value : rest) kernels.squared_residual += static_cast<double>(value) * value;
  // Qᵀ (G + ridge)⁻¹ Q of the cells that are left.
  const Eigen::MatrixXd among_kept = gram(kept, kept);
  const Eigen::MatrixXf inner = inverse(among_kept).cast<float>();
  Eigen::MatrixXf of_kept(static_cast<Eigen::Index>(kept.size()), static_cast<Eigen::Index>(length));
  for (std::size_t k = 0; k < kept.size(); ++k)
    of_kept.row(static_cast<Eigen::Index>(k)) =
        Eigen::Map<const Eigen::RowVectorXf>(pointers[kept[k]], static_cast<Eigen::Index>(length));
  const Eigen::VectorXf leverage = (inner * of_kept).cwiseProduct(of_kept).colwise().sum().transpose();
  kernels.leverage.assign(leverage.data(), leverage.data() + leverage.size());
  return kernels;
}

}  // namespace refield
