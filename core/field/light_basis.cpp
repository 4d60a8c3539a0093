// SPDX-License-Identifier: Apache-2.0
#include "core/field/light_basis.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <tuple>

#include "core/light/cube_map.h"
#include "core/light/summed_area_table.h"

namespace refield {

namespace {

/// Position of a texel's centre in units of the distance between nodes.
double position(int texel, int texels, int nodes) {
  return (texel + 0.5) / texels * (nodes - 1);
}

double hat(double position, int node, int nodes) {
  return nodes == 1 ? 1.0 : std::max(0.0, 1.0 - std::abs(position - node));
}

/// Texels [first, last) whose centres lie between two nodes, the first of which is `node`.
struct Interval {
  int node = 0;
  int first = 0;
  int last = 0;
};

std::vector<Interval> intervals(int first, int last, int texels, int nodes) {
  std::vector<Interval> found;
  for (int texel = first; texel < last; ++texel) {
    const int node = std::min(static_cast<int>(position(texel, texels, nodes)), std::max(nodes - 2, 0));
    if (found.empty() || found.back().node != node) found.push_back({node, texel, texel});
    found.back().last = texel + 1;
  }
  return found;
}

}  // namespace

float HatGrid::value(int node, int x, int y, const LightDomain& domain) const {
  return static_cast<float>(hat(position(x, domain.width, columns), node % columns, columns) *
                            hat(position(y, domain.height, rows), node / columns, rows));
}

Box HatGrid::support(int node, const LightDomain& domain) const {
  const auto interval = [](int texels, int at, int nodes) -> std::pair<int, int> {
    if (nodes == 1) return {0, texels};
    const double spacing = static_cast<double>(texels) / (nodes - 1);
    return {std::max(0, static_cast<int>(std::floor((at - 1) * spacing))),
            std::min(texels, static_cast<int>(std::ceil((at + 1) * spacing)))};
  };
  const auto [x0, x1] = interval(domain.width, node % columns, columns);
  const auto [y0, y1] = interval(domain.height, node / columns, rows);
  return {x0, y0, x1, y1};
}

std::vector<double> HatGrid::project(const LightMap& light) const {
  const LightDomain domain = light.domain();
  return project(light.radiance, {0, 0, domain.width, domain.height}, domain);
}

std::vector<double> HatGrid::project(const Image& radiance, const Box& within,
                                     const LightDomain& domain) const {
  if (count() == 0) return {};
  // Between two nodes a row gives its light to both, in parts that are linear in x: the sum of the light and
  // of its share for the right node say it all, two products a texel and channel.
  const auto row_values = static_cast<std::size_t>(columns) * 3;
  std::vector<double> along_rows(row_values * static_cast<std::size_t>(within.height()), 0.0);
  const std::vector<Interval> across = intervals(within.x0, within.x1, domain.width, columns);
  std::vector<double> shares;
  for (const Interval& interval : across)
    for (int x = interval.first; x < interval.last; ++x)
      shares.push_back(position(x, domain.width, columns) - interval.node);
  tbb::parallel_for(0, within.height(), [&](int y) {
    double* along_row = along_rows.data() + row_values * static_cast<std::size_t>(y);
    const float* texel = radiance.row(y).data();
    const double* share = shares.data();
    for (const Interval& interval : across) {
      // Two texels at a time: a sum waits half as often for the one before.
      double sum[6] = {}, right[6] = {};
      int x = interval.first;
      for (; x + 1 < interval.last; x += 2, texel += 6, share += 2)
        for (int i = 0; i < 6; ++i) {
          sum[i] += texel[i];
          right[i] += share[i / 3] * texel[i];
        }
      for (; x < interval.last; ++x, texel += 3, ++share)
        for (int c = 0; c < 3; ++c) {
          sum[c] += texel[c];
          right[c] += *share * texel[c];
        }
      for (int c = 0; c < 3; ++c) {
        sum[c] += sum[c + 3];
        right[c] += right[c + 3];
      }
      for (int c = 0; c < 3; ++c) {
        if (interval.node + 1 < columns) along_row[3 * (interval.node + 1) + c] += right[c];
        along_row[3 * interval.node + c] += sum[c] - right[c];
      }
    }
  });
  std::vector<double> coefficients(static_cast<std::size_t>(count()) * 3);
  for (const Interval& interval : intervals(within.y0, within.y1, domain.height, rows))
    for (int y = interval.first; y < interval.last; ++y) {
      const double share = position(y, domain.height, rows) - interval.node;
      const double* along_row = along_rows.data() + row_values * static_cast<std::size_t>(y - within.y0);
      double* upper = coefficients.data() + row_values * static_cast<std::size_t>(interval.node);
      for (std::size_t i = 0; i < row_values; ++i) {
        upper[i] += (1.0 - share) * along_row[i];
        if (interval.node + 1 < rows) upper[row_values + i] += share * along_row[i];
      }
    }
  return coefficients;
}

namespace {

/// Means of the harmonics over texel (x, y), by the four Gauss points of the square and their densities of
/// solid angle: exact but for the fourth power of (order ∕ resolution).
void texel_means(int order, int x, int y, int resolution, std::vector<double>& means) {
  std::array<double, harmonics_of(largest_harmonics_order)> at_point;
  const auto functions = static_cast<std::size_t>(harmonics_of(order));
  means.assign(functions, 0.0);
  double total = 0.0;
  for (const auto& [column, row] : square_gauss_points) {
    const Eigen::Vector3d direction = cube_direction(x + column, y + row, resolution);
    const double density = std::pow(direction.cwiseAbs().maxCoeff(), 3);
    evaluate_harmonics(order, direction, std::span(at_point).first(functions));
    for (std::size_t i = 0; i < functions; ++i) means[i] += density * at_point[i];
    total += density;
  }
  for (double& mean : means) mean /= total;
}

}  // namespace

float HarmonicKernels::value(int kernel, int x, int y, const LightDomain& domain) const {
  std::vector<double> means;
  texel_means(order, x, y, domain.width, means);
  return static_cast<float>((kernel % 2 == 0 ? 1.0 : -1.0) * means[static_cast<std::size_t>(kernel / 2)]);
}

HarmonicTable::HarmonicTable(const HarmonicKernels& kernels, const LightDomain& domain)
    : domain_(domain),
      functions_(static_cast<std::size_t>(harmonics_of(kernels.order))),
      values_(static_cast<std::size_t>(domain.width) * domain.height * functions_) {
  tbb::parallel_for(0, domain.height, [&](int y) {
    std::vector<double> means;
    float* to = values_.data() + static_cast<std::size_t>(y) * domain.width * functions_;
    for (int x = 0; x < domain.width; ++x) {
      texel_means(kernels.order, x, y, domain.width, means);
      for (const double mean : means) *to++ = static_cast<float>(mean);
    }
  });
}

std::vector<double> HarmonicTable::project(const Image& part, const Box& within) const {
  // Sums of a row in float, of rows in double: rows are short.
  const auto functions = static_cast<Eigen::Index>(functions_);
  constexpr int rows_at_a_time = 16;
  const int blocks = (part.height + rows_at_a_time - 1) / rows_at_a_time;
  std::vector<Eigen::ArrayXXd> of_block(static_cast<std::size_t>(blocks));
  tbb::parallel_for(0, blocks, [&](int block) {
    Eigen::ArrayXXd sum = Eigen::ArrayXXd::Zero(functions, 3);
    for (int y = block * rows_at_a_time; y < std::min(part.height, (block + 1) * rows_at_a_time); ++y) {
      const std::size_t first =
          static_cast<std::size_t>(within.y0 + y) * domain_.width + static_cast<std::size_t>(within.x0);
      const Eigen::Map<const Eigen::MatrixXf> harmonics(values_.data() + first * functions_, functions,
                                                        part.width);
      const Eigen::Map<const Eigen::Matrix<float, Eigen::Dynamic, 3, Eigen::RowMajor>> light(
          part.row(y).data(), part.width, 3);
      sum += (harmonics * light).array().cast<double>();
    }
    of_block[static_cast<std::size_t>(block)] = sum;
  });
  std::vector<double> coefficients(2 * functions_ * 3, 0.0);
  for (const auto& sum : of_block)
    for (std::size_t i = 0; i < functions_; ++i)
      for (std::size_t c = 0; c < 3; ++c) {
        const double value = sum(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(c));
        coefficients[6 * i + c] += value;
        coefficients[6 * i + 3 + c] -= value;
      }
  return coefficients;
}

namespace {

/// Sum of a hat along one side over the centres of the texels, by HatGrid's formula: value 1 − |p − node| at
/// p = (t + ½) s, s = (nodes − 1)/texels, which rises up to the node and falls from there. In closed form,
/// since a file may state any size.
double hat_sum(int node, int nodes, int texels) {
  if (nodes == 1) return texels;
  const double s = static_cast<double>(nodes - 1) / texels;
  /// The first texel whose centre does not lie before p.
  const auto first_from = [&](double p) { return std::clamp(std::ceil(p / s - 0.5), 0.0, 1.0 * texels); };
  const double begin = first_from(node - 1), top = first_from(node), end = first_from(node + 1);
  const auto sum_of_positions = [&](double from, double to) { return s * (to * to - from * from) / 2.0; };
  return (top - begin) * (1.0 - node) + sum_of_positions(begin, top) + (end - top) * (1.0 + node) -
         sum_of_positions(top, end);
}

}  // namespace

/// The light vectors of a face's cells between the edges of boxes, as a summed-area table: of the part that
/// lies in a rectangle of texels.
class VectorBoxTable::FaceSums {
 public:
  FaceSums(const VectorBoxTable& table, int face, const Image& part, const Box& within)
      : columns_(table.faces_[static_cast<std::size_t>(face)].columns),
        rows_(table.faces_[static_cast<std::size_t>(face)].rows) {
    const int top = face * table.resolution_;
    const Box inside{within.x0, std::max(within.y0 - top, 0), within.x1,
                     std::min(within.y1 - top, table.resolution_)};
    std::tie(column0_, column1_) = covering(columns_, inside.x0, inside.x1);
    std::tie(row0_, row1_) = covering(rows_, inside.y0, inside.y1);
    if (empty()) return;
    sums_.resize(static_cast<std::size_t>(row1_ - row0_ + 1) * stride(), Eigen::Matrix3d::Zero());
    tbb::parallel_for(row0_, row1_, [&](int row) {
      Eigen::Matrix3d* along = &sums_[static_cast<std::size_t>(row - row0_ + 1) * stride()];
      for (int y = std::max(rows_[row], inside.y0); y < std::min(rows_[row + 1], inside.y1); ++y) {
        const float* line = part.row(top + y - within.y0).data();
        const Eigen::Vector3f* means =
            &table.means_[static_cast<std::size_t>(y) * static_cast<std::size_t>(table.resolution_)];
        for (int column = column0_; column < column1_; ++column) {
          const int x0 = std::max(columns_[column], inside.x0),
                    x1 = std::min(columns_[column + 1], inside.x1);
          Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
          for (int x = x0; x < x1; ++x) {
            const Eigen::Map<const Eigen::Vector3f> light(line + std::ptrdiff_t{3} * (x - within.x0));
            sum.noalias() += means[x].cast<double>() * light.cast<double>().transpose();
          }
          along[column - column0_ + 1] += sum;
        }
      }
      for (int column = column0_; column < column1_; ++column)
        along[column - column0_ + 1] += along[column - column0_];
    });
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, stride(), 32), [&](const auto& range) {
      for (std::size_t at = stride() + range.begin(); at < sums_.size(); at += stride())
        for (std::size_t i = 0; i < range.size(); ++i) sums_[at + i] += sums_[at + i - stride()];
    });
  }

  bool empty() const { return column0_ >= column1_ || row0_ >= row1_; }
  /// Whether the light may reach a box.
  bool reaches(const Place& box) const {
    return box.column0 < column1_ && box.column1 > column0_ && box.row0 < row1_ && box.row1 > row0_;
  }
  /// The light vector of a box, [x, y, z of the face][channels].
  Eigen::Matrix3d sum(const Place& box) const {
    const auto at = [&](int column, int row) -> const Eigen::Matrix3d& {
      return sums_[static_cast<std::size_t>(std::clamp(row, row0_, row1_) - row0_) * stride() +
                   static_cast<std::size_t>(std::clamp(column, column0_, column1_) - column0_)];
    };
    return at(box.column1, box.row1) - at(box.column0, box.row1) - at(box.column1, box.row0) +
           at(box.column0, box.row0);
  }

 private:
  /// The places in `edges` of those around the texels [first, last); equal where there are none.
  static std::pair<int, int> covering(const std::vector<int>& edges, int first, int last) {
    if (edges.empty() || first >= last || last <= edges.front() || first >= edges.back()) return {0, 0};
    const auto from = std::ranges::upper_bound(edges, first) - edges.begin();
    const auto until = std::ranges::lower_bound(edges, last) - edges.begin();
    return {static_cast<int>(std::max<std::ptrdiff_t>(from - 1, 0)),
            static_cast<int>(std::min<std::ptrdiff_t>(until, std::ssize(edges) - 1))};
  }
  std::size_t stride() const { return static_cast<std::size_t>(column1_ - column0_) + 1; }

  const std::vector<int>& columns_;
  const std::vector<int>& rows_;
  int column0_ = 0, column1_ = 0, row0_ = 0, row1_ = 0;
  std::vector<Eigen::Matrix3d> sums_;  // [rows + 1][columns + 1]
};

std::vector<std::size_t> firsts_of_boxes(std::span<const VectorBox> kernels) {
  std::vector<std::size_t> firsts;
  for (std::size_t k = 0; k < kernels.size(); ++k)
    if (k == 0 || kernels[k].box != kernels[k - 1].box) firsts.push_back(k);
  firsts.push_back(kernels.size());
  return firsts;
}

VectorBoxTable::VectorBoxTable(std::span<const VectorBox> kernels, int resolution)
    : resolution_(resolution), means_(static_cast<std::size_t>(resolution) * resolution) {
  for (const VectorBox& kernel : kernels) {
    const int face = kernel.box.y0 / resolution, top = face * resolution;
    Face& edges = faces_[static_cast<std::size_t>(face)];
    edges.columns.insert(edges.columns.end(), {kernel.box.x0, kernel.box.x1});
    edges.rows.insert(edges.rows.end(), {kernel.box.y0 - top, kernel.box.y1 - top});
    vectors_.emplace_back(cube_face_axes(face) * kernel.vector.cast<double>());
  }
  for (Face& face : faces_)
    for (auto* edges : {&face.columns, &face.rows}) {
      std::ranges::sort(*edges);
      edges->erase(std::unique(edges->begin(), edges->end()), edges->end());
    }
  for (const std::size_t k : firsts_of_boxes(kernels)) {
    if (k == kernels.size()) break;
    const Box& box = kernels[k].box;
    const int face = box.y0 / resolution, top = face * resolution;
    const auto place = [](const std::vector<int>& edges, int at) {
      return static_cast<int>(std::ranges::lower_bound(edges, at) - edges.begin());
    };
    const Face& edges = faces_[static_cast<std::size_t>(face)];
    places_.push_back({face, place(edges.columns, box.x0), place(edges.columns, box.x1),
                       place(edges.rows, box.y0 - top), place(edges.rows, box.y1 - top), k});
  }
  tbb::parallel_for(0, resolution, [&](int y) {
    for (int x = 0; x < resolution; ++x)
      means_[static_cast<std::size_t>(y) * static_cast<std::size_t>(resolution) +
             static_cast<std::size_t>(x)] = cube_mean_direction(x, y, resolution).cast<float>();
  });
}

std::vector<double> VectorBoxTable::project(const Image& part, const Box& within) const {
  std::vector<FaceSums> of_face;
  of_face.reserve(faces_.size());
  for (int face = 0; face < cube_faces; ++face) of_face.emplace_back(*this, face, part, within);
  std::vector<double> coefficients(vectors_.size() * 3, 0.0);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, places_.size(), 512), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      const FaceSums& sums = of_face[static_cast<std::size_t>(places_[i].face)];
      if (sums.empty() || !sums.reaches(places_[i])) continue;
      const Eigen::Matrix3d light = sums.sum(places_[i]);
      const std::size_t last = i + 1 < places_.size() ? places_[i + 1].first : vectors_.size();
      for (std::size_t k = places_[i].first; k < last; ++k) {
        Eigen::Map<Eigen::RowVector3d> of_kernel(&coefficients[3 * k]);
        of_kernel = vectors_[k].transpose() * light;
      }
    }
  });
  return coefficients;
}

double LightBasis::area(std::size_t kernel) const {
  if (is_vector_box(kernel)) {
    const VectorBox& vector_box = vector_boxes[kernel - first_vector_box()];
    double sum = 0.0;
    for (const auto& [x, y] : square_gauss_points)
      sum += std::abs(vector_box.vector.cast<double>().dot(
          cube_direction(vector_box.box.x0 + x * vector_box.box.width(),
                         vector_box.box.y0 + y * vector_box.box.height(), domain.width)));
    return 0.25 * sum * cube_solid_angle(vector_box.box, domain.width);
  }
  if (!is_smooth(kernel))
    return measure == Measure::texels ? static_cast<double>(box(kernel).area())
                                      : cube_solid_angle(box(kernel), domain.width);
  const auto number = static_cast<int>(kernel);
  if (number >= hats.count()) {  // harmonics but the first integrate to nothing
    const int harmonic = (number - hats.count()) / 2, sign = (number - hats.count()) % 2 == 0 ? 1 : -1;
    return harmonic == 0 ? sign * std::sqrt(4.0 * std::numbers::pi) : 0.0;
  }
  if (measure == Measure::texels)
    return hat_sum(number % hats.columns, hats.columns, domain.width) *
           hat_sum(number / hats.columns, hats.rows, domain.height);
  double sum = 0.0;
  const Box within = support(kernel);
  for (int y = within.y0; y < within.y1; ++y)
    for (int x = within.x0; x < within.x1; ++x)
      sum += hats.value(number, x, y, domain) * cube_solid_angle(x, y, domain.width);
  return sum;
}

float LightBasis::value(std::size_t kernel, int x, int y) const {
  const auto number = static_cast<int>(kernel);
  if (number < hats.count()) return hats.value(number, x, y, domain);
  if (kernel < first_vector_box()) return harmonics.value(number - hats.count(), x, y, domain);
  if (!is_vector_box(kernel)) return box(kernel).contains(x, y) ? 1.0f : 0.0f;
  const VectorBox& of = vector_boxes[kernel - first_vector_box()];
  if (!of.box.contains(x, y)) return 0.0f;
  const Eigen::Vector3d mean =
      cube_face_axes(y / domain.width).transpose() * cube_mean_direction(x, y, domain.width);
  return of.vector.dot(mean.cast<float>());
}

Box LightBasis::support(std::size_t kernel) const {
  const auto number = static_cast<int>(kernel);
  if (number < hats.count()) return hats.support(number, domain);
  if (is_vector_box(kernel)) return vector_boxes[kernel - first_vector_box()].box;
  return is_smooth(kernel) ? Box{0, 0, domain.width, domain.height} : box(kernel);
}

std::vector<float> LightBasis::project(const LightMap& light) const {
  require_domain(light, domain);
  const Box whole{0, 0, domain.width, domain.height};
  const SmoothProjector projector(*this);
  std::optional<Image> weighed;
  if (projector.weighs()) projector.weigh(weighed.emplace(light.radiance), whole);
  const Image& values = weighed ? *weighed : light.radiance;
  std::vector<float> coefficients(size() * 3);
  std::ranges::transform(projector.project(values, whole), coefficients.begin(),
                         [](double sum) { return static_cast<float>(sum); });
  if (boxes.empty()) return coefficients;
  const SummedAreaTable table(values);
  float* sums = coefficients.data() + smooth() * 3;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, boxes.size(), 4096), [&](const auto& range) {
    for (std::size_t k = range.begin(); k != range.end(); ++k) {
      const auto sum = table.sum(boxes[k]);
      for (int c = 0; c < 3; ++c) sums[3 * k + c] = static_cast<float>(sum[c]);
    }
  });
  return coefficients;
}

SmoothProjector::SmoothProjector(const LightBasis& basis)
    : domain_(basis.domain), hats_(basis.hats), count_(basis.smooth()) {
  if (basis.measure == Measure::solid_angle) solid_angles_ = cube_solid_angles(domain_.width);
  if (basis.harmonics.order > 0) harmonics_.emplace(basis.harmonics, domain_);
  if (!basis.vector_boxes.empty()) vector_boxes_.emplace(basis.vector_boxes, domain_.width);
  if (basis.interpolation)
    interpolator_ = std::make_shared<const LightInterpolator>(*basis.interpolation, domain_);
}

void SmoothProjector::weigh(Image& part, const Box& within) const {
  if (interpolator_) return interpolator_->gather(part);
  const int side = domain_.width;
  tbb::parallel_for(0, part.height, [&](int row) {
    const float* angle = solid_angles_.data() +
                         static_cast<std::size_t>((within.y0 + row) % side) * static_cast<std::size_t>(side) +
                         within.x0;
    float* texel = part.row(row).data();
    for (int x = 0; x < part.width; ++x, texel += 3)
      for (int c = 0; c < 3; ++c) texel[c] *= angle[x];
  });
}

std::vector<double> SmoothProjector::project(const Image& part, const Box& within) const {
  std::vector<double> coefficients = hats_.project(part, within, domain_);
  if (harmonics_) {
    const std::vector<double> more = harmonics_->project(part, within);
    coefficients.insert(coefficients.end(), more.begin(), more.end());
  }
  if (vector_boxes_) {
    const std::vector<double> more = vector_boxes_->project(part, within);
    coefficients.insert(coefficients.end(), more.begin(), more.end());
  }
  return coefficients;
}

}  // namespace refield
