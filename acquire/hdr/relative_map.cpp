// SPDX-License-Identifier: Apache-2.0
#include "acquire/hdr/relative_map.h"

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>

#include "core/base/errors.h"
#include "core/base/linear_algebra.h"

namespace refield {

namespace {

/// The nodes around a point and their bilinear weights.
struct Corner {
  int node;
  double weight;
};

std::array<Corner, 4> corners_around(double u, double v, int columns, int rows) {
  const double x = std::clamp(u, 0.0, 1.0) * (columns - 1);
  const double y = std::clamp(v, 0.0, 1.0) * (rows - 1);
  const int i = std::min(static_cast<int>(x), columns - 2);
  const int j = std::min(static_cast<int>(y), rows - 2);
  const double fx = x - i;
  const double fy = y - j;
  const int node = j * columns + i;
  return {{{node, (1 - fx) * (1 - fy)},
           {node + 1, fx * (1 - fy)},
           {node + columns, (1 - fx) * fy},
           {node + columns + 1, fx * fy}}};
}

/// Adds `weight` · (second difference of three nodes in a line)² to the normal equations.
void add_straightness(Eigen::MatrixXd& normal, int before, int middle, int after, double weight) {
  const std::array<std::pair<int, double>, 3> difference{{{before, 1.0}, {middle, -2.0}, {after, 1.0}}};
  for (const auto& [a, factor_a] : difference)
    for (const auto& [b, factor_b] : difference) normal(a, b) += weight * factor_a * factor_b;
}

/// Calls change(value, factor of the map there) for all values of all channels; for none where the map is
/// empty.
template <class Change>
void for_each_value(Image& image, const RelativeMap& map, const Change& change) {
  if (map.empty()) return;
  std::size_t i = 0;
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) {
      const float factor = map.at_pixel(x, y, image);
      for (int c = 0; c < image.channels; ++c) change(image.values[i++], factor);
    }
}

}  // namespace

float RelativeMap::at(double u, double v) const {
  if (empty()) return 1.0f;
  double sum = 0.0;
  for (const Corner& corner : corners_around(u, v, columns, rows)) sum += corner.weight * values[corner.node];
  return static_cast<float>(sum);
}

void RelativeMap::check(const std::string& where) const {
  if (empty() && columns == 0 && rows == 0) return;
  const std::string remedy = "; repair that entry or calibrate again";
  if (columns < 2 || rows < 2 || columns > 1024 || rows > 1024 ||
      values.size() != static_cast<std::size_t>(columns) * rows)
    throw InputError(where + ": has " + std::to_string(values.size()) + " values for " +
                     std::to_string(columns) + "×" + std::to_string(rows) + " nodes" + remedy);
  for (float value : values)
    if (!(std::isfinite(value) && value > 0.0f))
      throw InputError(where + ": has a value of " + std::to_string(value) + ", which must be above zero" +
                       remedy);
}

RelativeMap fit_relative_map(const Image& image, const Image& weight, int columns, int rows) {
  if (image.channels != 1 || !image.same_shape(weight))
    throw InputError("a relative map is fitted to one channel, not " + shape_text(image));
  const int nodes = columns * rows;
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(nodes, nodes);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(nodes);
  double total = 0.0;
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) {
      const double w = weight.at(x, y, 0);
      if (!(w > 0.0)) continue;
      const auto around = corners_around((x + 0.5) / image.width, (y + 0.5) / image.height, columns, rows);
      for (const Corner& a : around) {
        right(a.node) += w * a.weight * image.at(x, y, 0);
        for (const Corner& b : around) normal(a.node, b.node) += w * a.weight * b.weight;
      }
      total += w;
    }
  if (!(total > 0.0)) throw InputError("a relative map cannot be fitted: no pixel counts");
  const double pull =
      0.02 * total / nodes;  // of a node's data: smooths noise, bends a falloff by less than 1e-3
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < columns; ++i) {
      const int node = j * columns + i;
      if (i > 0 && i + 1 < columns) add_straightness(normal, node - 1, node, node + 1, pull);
      if (j > 0 && j + 1 < rows) add_straightness(normal, node - columns, node, node + columns, pull);
    }
  const Eigen::VectorXd fitted = solve_symmetric(normal, right);
  RelativeMap map{columns, rows, std::vector<float>(nodes)};
  for (int node = 0; node < nodes; ++node)
    map.values[node] = static_cast<float>(fitted(node) / fitted.maxCoeff());
  map.check("fitted map");
  return map;
}

void multiply(Image& image, const RelativeMap& map) {
  for_each_value(image, map, [](float& value, float factor) { value *= factor; });
}

void divide(Photograph& photograph, const RelativeMap& map) {
  const auto through = [](float& value, float factor) { value /= factor; };
  for_each_value(photograph.radiance, map, through);
  for_each_value(photograph.sigma, map, through);
}

}  // namespace refield
