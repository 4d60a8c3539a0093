// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/clusters.h"

#include <tbb/parallel_for.h>
#include <Eigen/Dense>

#include <cmath>
#include <iterator>
#include <unordered_map>

#include "core/base/json.h"
#include "core/base/units.h"
#include "core/light/cube_map.h"

namespace refield::prt {

namespace {
constexpr std::uint32_t first_name = 8;  // faces are 8 to 13: four bits that are never zero in front
}

CubeSquare face_square(int face, int resolution) {
  return {{0, face * resolution, resolution, (face + 1) * resolution},
          first_name + static_cast<std::uint32_t>(face)};
}

std::array<CubeSquare, 4> quadrisect(const CubeSquare& square) {
  const Box& box = square.box;
  const int x = box.x0 + (box.width() + 1) / 2, y = box.y0 + (box.height() + 1) / 2;
  const std::uint32_t name = 4 * square.name;
  return {{{{box.x0, box.y0, x, y}, name},
           {{x, box.y0, box.x1, y}, name + 1},
           {{box.x0, y, x, box.y1}, name + 2},
           {{x, y, box.x1, box.y1}, name + 3}}};
}

Box box_of_name(std::uint32_t name, int resolution) {
  int splits = 0;
  while (name >> (2 * splits) >= first_name + cube_faces) ++splits;
  CubeSquare square = face_square(static_cast<int>((name >> (2 * splits)) - first_name), resolution);
  while (splits-- > 0) square = quadrisect(square)[name >> (2 * splits) & 3];
  return square.box;
}

std::array<Eigen::Vector3d, 4> corners_of(const Box& square, int resolution) {
  const int face = square.y0 / resolution;
  const double step = 2.0 / resolution;
  std::array<Eigen::Vector3d, 4> corners;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const double u = (i % 2 ? square.x1 : square.x0) * step - 1.0,
                 v = 1.0 - ((i / 2 ? square.y1 : square.y0) - face * resolution) * step;
    corners[i] = (cube_face_axes(face).transpose() * Eigen::Vector3d(u, v, 1.0)).normalized();
  }
  return corners;
}

std::array<Eigen::Vector3d, 3> corner_functions(const Box& square, int resolution) {
  const auto corners = corners_of(square, resolution);
  Eigen::Matrix3d rows;
  rows << corners[0].transpose(), corners[1].transpose(), corners[2].transpose();
  const Eigen::Matrix3d functions = rows.inverse();
  return {functions.col(0), functions.col(1), functions.col(2)};
}

namespace {

/// A light and its transfer vector, [groups × channels × 16].
struct Light {
  int x = 0, y = 0;
  std::vector<float> transfer;
};
/// A square that is still to be clustered, and those of its lights that are known.
struct Domain {
  CubeSquare square;
  std::vector<std::unique_ptr<Light>> known;
};

/// Up to `samples` of the integers [first, last), spread evenly, ends included. As halves of the range end
/// beside the middle one, samples of a range are samples of its parts.
std::vector<int> spread(int first, int last, int samples) {
  const int steps = std::min(samples, last - first) - 1;
  std::vector<int> at(1, first);
  for (int i = 1; i <= steps; ++i) at.push_back(first + i * (last - first - 1) / steps);
  return at;
}

class LightClusters {
 public:
  LightClusters(const TransferSamples& transfer, std::size_t outputs, const ClusterOptions& options,
                ClusterStatistics& statistics)
      : transfer_(transfer),
        options_(options),
        statistics_(statistics),
        outputs_(static_cast<double>(outputs)),
        weights_(transfer.groups()) {}

  std::vector<GroupWeights> cluster(const RunContext& run) {
    const int resolution = options_.resolution;
    Progress progress(run, "clustering lights", std::uint64_t{6} * resolution * resolution);
    for (int face = 0; face < cube_faces; ++face) {
      std::vector<Domain> domains(1);
      domains[0].square = face_square(face, resolution);
      while (!domains.empty()) {
        Domain domain = std::move(domains.back());
        domains.pop_back();
        held_ = domain.known.size();
        for (const Domain& other : domains) held_ += other.known.size();
        const bool is_cluster = make_cluster(domain, run);
        run.throw_if_stopped();
        if (is_cluster)
          progress.advance(static_cast<std::uint64_t>(domain.square.box.area()));
        else
          split(std::move(domain), domains);
      }
    }
    return std::move(weights_);
  }

 private:
  /// The lights that stand for a square; those not known yet are to be traced.
  std::vector<Light*> sample(Domain& domain) {
    std::vector<Light*> lights;
    const Box& box = domain.square.box;
    for (const int y : spread(box.y0, box.y1, options_.samples))
      for (const int x : spread(box.x0, box.x1, options_.samples)) {
        const auto known = std::ranges::find_if(
            domain.known, [&](const auto& light) { return light->x == x && light->y == y; });
        if (known != domain.known.end()) {
          lights.push_back(known->get());
        } else {
          domain.known.push_back(std::make_unique<Light>(Light{x, y, {}}));
          lights.push_back(domain.known.back().get());
        }
      }
    return lights;
  }

  /// Traces the lights that are not known yet. If all samples are similar, makes the square a cluster, whose
  /// vector is their mean (eq. 10), and returns true.
  bool make_cluster(Domain& domain, const RunContext& run) {
    const std::vector<Light*> lights = sample(domain);
    const std::size_t size = transfer_.group_values(), groups = transfer_.groups();
    const auto channels = static_cast<std::size_t>(transfer_.channels());
    std::vector<Eigen::Vector3f> missing(lights.size(), Eigen::Vector3f::Zero());
    for (std::size_t l = 0; l < lights.size(); ++l)
      if (lights[l]->transfer.empty()) {
        missing[l] =
            cube_direction(lights[l]->x + 0.5, lights[l]->y + 0.5, options_.resolution).cast<float>();
        lights[l]->transfer.resize(groups * size);
        ++statistics_.lights;
        ++held_;
      }
    statistics_.peak_vectors = std::max(statistics_.peak_vectors, held_);

    std::vector<float> mean(groups * size);
    std::vector<double> distance(groups * lights.size() * channels);  // squares of a group's part
    std::vector<std::uint64_t> rays(groups);
    tbb::parallel_for(std::size_t{0}, groups, [&](std::size_t g) {
      if (run.is_stopped()) return;  // thrown away
      const std::span group_mean = std::span(mean).subspan(g * size, size);
      for (std::size_t l = 0; l < lights.size(); ++l) {
        const std::span values = std::span(lights[l]->transfer).subspan(g * size, size);
        if (!missing[l].isZero()) rays[g] += transfer_.evaluate(g, missing[l], values);
        for (std::size_t i = 0; i < size; ++i) group_mean[i] += values[i] / static_cast<float>(lights.size());
      }
      double* to = &distance[g * lights.size() * channels];
      for (const Light* light : lights)
        for (std::size_t c = 0; c < channels; ++c, ++to)
          for (std::size_t i = c * TransferSamples::group_outputs;
               i < (c + 1) * TransferSamples::group_outputs; ++i) {
            const double difference = group_mean[i] - light->transfer[g * size + i];
            *to += difference * difference;
          }
    });
    for (const std::uint64_t count : rays) statistics_.rays += count;
    const double max_distance = options_.epsilon * outputs_;  // of ‖T_C − T_l‖, eq. 11
    for (std::size_t i = 0; i < lights.size() * channels; ++i) {
      double sum = 0.0;
      for (std::size_t g = 0; g < groups; ++g) sum += distance[g * lights.size() * channels + i];
      if (lights.size() > 1 && !(sum < max_distance * max_distance)) return false;
    }
    tbb::parallel_for(std::size_t{0}, groups, [&](std::size_t g) {
      weights_[g].append(GroupWeights::kernel_key(domain.square.name, SquareKernel::constant),
                         std::span(mean).subspan(g * size, size));
    });
    return true;
  }

  void split(Domain domain, std::vector<Domain>& domains) {
    for (const CubeSquare& part : quadrisect(domain.square)) {
      if (part.box.area() == 0) continue;
      Domain next{part, {}};
      for (auto& light : domain.known)
        if (light && part.box.contains(light->x, light->y)) next.known.push_back(std::move(light));
      domains.push_back(std::move(next));
    }
  }

  const TransferSamples& transfer_;
  const ClusterOptions& options_;
  ClusterStatistics& statistics_;
  double outputs_;          // N
  std::uint64_t held_ = 0;  // transfer vectors
  std::vector<GroupWeights> weights_;
};

}  // namespace

std::vector<GroupWeights> cluster_lights(const TransferSamples& transfer, std::size_t outputs,
                                         const ClusterOptions& options, ClusterStatistics& statistics,
                                         const RunContext& run) {
  return LightClusters(transfer, outputs, options, statistics).cluster(run);
}

namespace {

constexpr int coarsest_side = 8;  // squares along a face that are looked at in any case
/// Lobes of larger exponents are narrower than the samples of the coarsest squares are apart.
constexpr float narrow_exponent = 20.0f;

/// Sums over some samples, each weighted by its solid angle, of products of a group's values
/// and directions.
struct Moments {
  static constexpr int max_values = 3 * static_cast<int>(TransferSamples::group_outputs);
  using Values = Eigen::Array<double, Eigen::Dynamic, 1, 0, max_values, 1>;
  using Vectors = Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, max_values>;
  double weight = 0.0;
  Eigen::Vector3d direction = Eigen::Vector3d::Zero();
  Eigen::Matrix3d directions = Eigen::Matrix3d::Zero();
  Values sum, squares;
  Vectors vectors;  ///< of values and directions

  explicit Moments(std::size_t values)
      : sum(Values::Zero(static_cast<Eigen::Index>(values))),
        squares(sum),
        vectors(Vectors::Zero(3, static_cast<Eigen::Index>(values))) {}
  void add(double solid_angle, const Eigen::Vector3d& at, const Values& values) {
    const Eigen::Vector3d weighed = solid_angle * at;
    weight += solid_angle;
    direction += weighed;
    directions += weighed * at.transpose();
    sum += solid_angle * values;
    squares += solid_angle * values.square();
    vectors += weighed * values.matrix().transpose();
  }
  void operator+=(const Moments& other) {
    weight += other.weight;
    direction += other.direction;
    directions += other.directions;
    sum += other.sum;
    squares += other.squares;
    vectors += other.vectors;
  }
  /// Ω² var T, the largest of all outputs and channels.
  double loss() const { return (weight * squares - sum.square()).maxCoeff(); }
};

/// The fit of a group's values in a square by linear functions of the direction, non-negative in the square
/// and of the same mean.
class LinearFit {
 public:
  LinearFit(const CubeSquare& square, int resolution, const Moments& moments) {
    const auto corners = corners_of(square.box, resolution);
    const Eigen::Vector3d middle = (corners[0] + corners[3]).normalized();
    const double ahead = middle.dot(moments.direction);
    // Slopes that leave the mean over the samples as it is.
    Eigen::Matrix<double, 3, 2> slopes;
    slopes << corners[1] - corners[0], corners[2] - corners[0];
    const Eigen::RowVector2d uneven = moments.direction.transpose() * slopes / ahead;
    slopes -= middle * uneven;
    const Eigen::Matrix2d gram = slopes.transpose() * moments.directions * slopes;
    if (!(gram.determinant() > 1e-6 * gram.trace() * gram.trace())) return;  // samples in a line
    const Eigen::Matrix2d inverse = gram.inverse();
    const Eigen::Vector2d beside = slopes.transpose() * (moments.directions * middle);
    weights_.resize(3, moments.sum.size());
    loss_ = 0.0;
    for (Eigen::Index v = 0; v < moments.sum.size(); ++v) {
      const double mean = moments.sum[v] / ahead;
      const Eigen::Vector3d level = mean * middle;
      const Eigen::Vector2d slope = inverse * (slopes.transpose() * moments.vectors.col(v) - mean * beside);
      const Eigen::Vector3d steepest = slopes * slope;
      double share = 1.0;
      for (const Eigen::Vector3d& corner : corners) {
        const double constant = level.dot(corner), change = steepest.dot(corner);
        if (constant + share * change < 0.0) share = std::max(0.0, -constant / change);
      }
      const Eigen::Vector3d fit = level + share * steepest;
      for (int i = 0; i < weights_.rows(); ++i)
        weights_(i, v) = fit.dot(corners[static_cast<std::size_t>(i)]);
      loss_ = std::max(loss_, moments.weight * (moments.squares[v] - 2.0 * fit.dot(moments.vectors.col(v)) +
                                                fit.dot(moments.directions * fit)));
    }
    weights_ = (weights_.array() > rounding).select(weights_, 0.0);
  }

  /// Ω² times the mean squared difference, the largest of all outputs and channels.
  double loss() const { return loss_; }
  /// Weights of a SquareKernel beyond the first, for all values.
  Eigen::ArrayXf weights(SquareKernel kernel) const {
    return weights_.row(static_cast<int>(kernel) - 1).cast<float>().transpose();
  }

 private:
  static constexpr double rounding = 1e-9;

  Moments::Vectors weights_;
  double loss_ = std::numeric_limits<double>::infinity();
};

/// An angle around a direction within which a lobe is above a tenth of its top.
struct Cone {
  Eigen::Vector3d direction;
  double angle;
};

class GroupCut {
 public:
  GroupCut(const TransferSamples& transfer, std::size_t group, const ClusterOptions& options)
      : transfer_(transfer),
        group_(group),
        options_(options),
        limit_(options.epsilon * options.epsilon),
        texel_area_(4.0 / options.resolution / options.resolution),
        values_(transfer.group_values()) {
    for (const Lobe& lobe : transfer.lobes(group, narrow_exponent))
      lobes_.push_back({lobe.direction.cast<double>(), std::acos(std::pow(0.1, 1.0 / lobe.exponent))});
  }

  GroupWeights run() {
    for (int face = 0; face < cube_faces; ++face) {
      top_ = face * options_.resolution;
      from_face_ = cube_face_axes(face).transpose();
      traced_.clear();
      traced_values_.clear();
      visit(face_square(face, options_.resolution));
    }
    GroupWeights weights;
    for (const auto& [key, values] : leaves_)
      weights.append(key, {values.data(), static_cast<std::size_t>(values.size())});
    return weights;
  }
  std::uint64_t rays() const { return rays_; }
  std::uint64_t lights() const { return lights_; }

 private:
  /// A kernel of the cut.
  struct Leaf {
    std::uint32_t key;
    Eigen::ArrayXf values;
  };
  static constexpr std::size_t fit_kernels = 3;

  /// Moments of all samples in a square; what it is cut into stands at the end of the leaves.
  Moments visit(const CubeSquare& square) {
    const std::size_t first = leaves_.size();
    Moments moments(transfer_.group_values());
    const bool must_split = has_to_split(square), may_split = square.box.area() > 1;
    if (!must_split) {
      sample(square, moments);
      if (append_kernels(square, moments, fit_kernels, !may_split)) return moments;
    }
    moments = Moments(transfer_.group_values());
    for (const CubeSquare& part : quadrisect(square))
      if (part.box.area() > 0) moments += visit(part);
    const std::size_t kernels = leaves_.size() - first;
    std::vector<Leaf> parts(std::make_move_iterator(leaves_.begin() + static_cast<std::ptrdiff_t>(first)),
                            std::make_move_iterator(leaves_.end()));
    leaves_.resize(first);
    if (!append_kernels(square, moments, kernels, false))
      std::ranges::move(parts, std::back_inserter(leaves_));
    return moments;
  }

  /// Appends a square's kernels, unless more than `allowed` would be needed and it can be cut; returns
  /// whether it did.
  bool append_kernels(const CubeSquare& square, const Moments& moments, std::size_t allowed, bool is_last) {
    if (!(moments.sum > 0.0).any()) return true;
    if (is_last || moments.loss() <= limit_) {
      leaves_.push_back({GroupWeights::kernel_key(square.name, SquareKernel::constant),
                         (moments.sum / moments.weight).cast<float>()});
      return true;
    }
    if (allowed < fit_kernels) return false;
    const LinearFit fit(square, options_.resolution, moments);
    if (fit.loss() > limit_) return false;
    for (const auto kernel : {SquareKernel::upper_left, SquareKernel::upper_right, SquareKernel::lower_left})
      leaves_.push_back({GroupWeights::kernel_key(square.name, kernel), fit.weights(kernel)});
    return true;
  }

  bool has_to_split(const CubeSquare& square) const {
    const Box& box = square.box;
    if (box.area() <= 1) return false;
    if (box.width() * coarsest_side > options_.resolution) return true;
    if (lobes_.empty()) return false;
    const auto corners = corners_of(box, options_.resolution);
    const Eigen::Vector3d middle = (corners[0] + corners[3]).normalized();
    double nearest = 1.0;
    for (const Eigen::Vector3d& corner : corners) nearest = std::min(nearest, middle.dot(corner));
    const double radius = std::acos(nearest);
    return std::ranges::any_of(lobes_, [&](const Cone& lobe) {
      return radius > lobe.angle &&
             middle.dot(lobe.direction) > std::cos(std::min(radius + lobe.angle, std::numbers::pi));
    });
  }

  /// Where samples lie along a side of a square, and the texels for which each stands: ends included, so that
  /// they are those of neighbours and of parts, too.
  static void spread_with_ends(int first, int last, int samples, std::vector<std::pair<int, double>>& at) {
    const int steps = std::min(samples - 1, last - first);
    at.assign(1, {first, 0.0});
    for (int i = 1; i <= steps; ++i) {
      const int next = first + i * (last - first) / steps;
      const double half = 0.5 * (next - at.back().first);
      at.back().second += half;
      at.emplace_back(next, half);
    }
  }

  /// Samples s×s points of a square, corners included; of a texel, its middle.
  void sample(const CubeSquare& square, Moments& moments) {
    const Box& box = square.box;
    if (box.area() == 1) {
      const Eigen::Vector3d direction = cube_direction(box.x0 + 0.5, box.y0 + 0.5, options_.resolution);
      trace(direction, values_.data());
      add(direction, 1.0, values_.data(), moments);
      return;
    }
    spread_with_ends(box.x0, box.x1, options_.samples, across_);
    spread_with_ends(box.y0 - top_, box.y1 - top_, options_.samples, down_);
    for (const auto& [y, rows] : down_)
      for (const auto& [x, columns] : across_) {
        const double step = 2.0 / options_.resolution;
        const Eigen::Vector3d direction =
            (from_face_ * Eigen::Vector3d(x * step - 1.0, 1.0 - y * step, 1.0)).normalized();
        add(direction, rows * columns, traced_at(x, y, direction), moments);
      }
  }

  /// The transfer at a crossing of the face's grid lines; valid until the next call.
  const float* traced_at(int x, int y, const Eigen::Vector3d& direction) {
    const std::size_t size = transfer_.group_values();
    const auto [entry, is_new] = traced_.try_emplace(
        std::uint32_t(x) << 16 | std::uint32_t(y), static_cast<std::uint32_t>(traced_values_.size() / size));
    if (is_new) {
      traced_values_.resize(traced_values_.size() + size);
      trace(direction, &traced_values_[entry->second * size]);
    }
    return &traced_values_[entry->second * size];
  }

  void trace(const Eigen::Vector3d& direction, float* values) {
    rays_ += transfer_.evaluate(group_, direction.cast<float>(), {values, transfer_.group_values()});
    ++lights_;
  }

  void add(const Eigen::Vector3d& direction, double texels, const float* values, Moments& moments) const {
    // A texel's solid angle, up to a factor of 1 + O(1/R²), times the texels that the sample stands for.
    const double ahead = direction.cwiseAbs().maxCoeff();
    moments.add(texels * texel_area_ * ahead * ahead * ahead, direction,
                Eigen::Map<const Eigen::ArrayXf>(values, moments.sum.size()).cast<double>());
  }

  const TransferSamples& transfer_;
  std::size_t group_;
  const ClusterOptions& options_;
  double limit_;
  double texel_area_;  // on a cube whose faces are at distance 1
  std::vector<float> values_;
  int top_ = 0;  // of the face that is looked at
  Eigen::Matrix3d from_face_;
  std::unordered_map<std::uint32_t, std::uint32_t> traced_;  // places in traced_values_
  std::vector<float> traced_values_;
  std::vector<std::pair<int, double>> across_, down_;
  std::vector<Cone> lobes_;
  std::vector<Leaf> leaves_;
  std::uint64_t rays_ = 0, lights_ = 0;
};

}  // namespace

std::vector<GroupWeights> cut_groups(const TransferSamples& transfer, const ClusterOptions& options,
                                     ClusterStatistics& statistics, const RunContext& run) {
  const std::size_t groups = transfer.groups();
  std::vector<GroupWeights> weights(groups);
  std::vector<std::uint64_t> rays(groups), lights(groups);
  Progress progress(run, "clustering lights per vertex group", groups);
  tbb::parallel_for(std::size_t{0}, groups, [&](std::size_t g) {
    if (run.is_stopped()) return;  // thrown away
    GroupCut cut(transfer, g, options);
    weights[g] = cut.run();
    rays[g] = cut.rays();
    lights[g] = cut.lights();
    progress.advance();
  });
  run.throw_if_stopped();
  for (std::size_t g = 0; g < groups; ++g) {
    statistics.rays += rays[g];
    statistics.lights += static_cast<double>(lights[g]) / static_cast<double>(groups);
  }
  return weights;
}

namespace {

constexpr std::size_t group_outputs = TransferSamples::group_outputs;

void check(const ClusterOptions& options) {
  const auto require = [](bool met, const std::string& what) {
    if (!met) throw InputError(what);
  };
  require(options.resolution >= 1 && options.resolution <= largest_cube_resolution,
          "resolution " + std::to_string(options.resolution) +
              " of the cube's faces is out of range; give 1 to " + std::to_string(largest_cube_resolution));
  require(options.samples >= 2 && options.samples <= 16,
          "samples " + std::to_string(options.samples) +
              " along the side of a light cluster is out of range; give 2 to 16");
  require(options.epsilon >= 0.0,
          "epsilon " + std::to_string(options.epsilon) + " is not a valid threshold; give 0 or more");
  require(options.pixel_samples >= 1 && options.pixel_samples <= 8,
          "samples " + std::to_string(options.pixel_samples) +
              " along a pixel's side is out of range; give 1 to 8");
  require(options.bounces >= 0 && options.bounces <= 16,
          "bounces " + std::to_string(options.bounces) + " of light are out of range; give 0 to 16");
}

/// Gives the kernels in use their numbers in the basis, by name: of both kinds whole faces first, then their
/// quarters, …
void number_kernels(std::vector<GroupWeights>& weights, int resolution, LightBasis& basis) {
  const auto is_constant = [](std::uint32_t key) {
    return static_cast<SquareKernel>(key % 4) == SquareKernel::constant;
  };
  std::vector<bool> used;
  for (const GroupWeights& group : weights)
    for (const std::uint32_t key : group.kernel) {
      if (key >= used.size()) used.resize(key + 1);
      used[key] = true;
    }
  // Keys, not a table of all that there may be: of 4096² texels per face that would take gigabytes.
  std::vector<std::uint32_t> vectors, constants;
  for (std::uint32_t key = 0; key < used.size(); ++key) {
    if (!used[key]) continue;
    const Box box = box_of_name(key / 4, resolution);
    if (is_constant(key)) {
      constants.push_back(key);
      basis.boxes.push_back(box);
    } else {
      vectors.push_back(key);
      basis.vector_boxes.push_back({box, corner_functions(box, resolution)[key % 4 - 1].cast<float>()});
    }
  }
  tbb::parallel_for(std::size_t{0}, weights.size(), [&](std::size_t g) {
    for (std::uint32_t& kernel : weights[g].kernel) {
      const auto& keys = is_constant(kernel) ? constants : vectors;
      const std::size_t first = is_constant(kernel) ? vectors.size() : 0;
      kernel = static_cast<std::uint32_t>(
          first + static_cast<std::size_t>(std::ranges::lower_bound(keys, kernel) - keys.begin()));
    }
  });
}

/// What rows of the field are made from.
struct Clusters {
  OutputLayout layout;
  int channels = 1;
  std::vector<GroupWeights> weights;

  SparseTransfer rows(RowRange range) const {
    SparseTransfer transfer;
    std::vector<std::uint32_t> columns;
    std::vector<float> row;
    const auto width = static_cast<std::size_t>(layout.width);
    for (std::size_t pixel = range.first * width; pixel < range.last * width; ++pixel) {
      columns.clear();
      row.clear();
      if (const std::uint32_t place = layout.place_of_pixel[pixel]; place != OutputLayout::none)
        append_output(weights[place / group_outputs], place % group_outputs, columns, row);
      transfer.append_row(columns, row);
    }
    return transfer;
  }

 private:
  void append_output(const GroupWeights& group, std::size_t output, std::vector<std::uint32_t>& columns,
                     std::vector<float>& row) const {
    const std::uint8_t* weight = group.weight.data() + output;
    for (std::size_t k = 0; k < group.kernel.size(); ++k) {
      std::array<float, 3> values{};
      for (int c = 0; c < channels; ++c, weight += group_outputs)
        values[c] = group.scale[k] * static_cast<float>(*weight);
      if (channels == 1) values.fill(values[0]);
      if (values[0] + values[1] + values[2] == 0.0f) continue;
      columns.push_back(group.kernel[k]);
      row.insert(row.end(), values.begin(), values.end());
    }
  }
};

void count(const Clusters& clusters, ClusterStatistics& statistics) {
  constexpr float bytes_of_white = 255.0f * std::numbers::pi_v<float>;
  for (const GroupWeights& group : clusters.weights) {
    const std::size_t size = group_outputs * static_cast<std::size_t>(clusters.channels);
    for (std::size_t k = 0; k < group.kernel.size(); ++k)
      for (std::size_t i = 0; i < group_outputs; ++i) {
        bool any = false;
        for (std::size_t v = k * size + i; v < (k + 1) * size; v += group_outputs) {
          any |= group.weight[v] > 0;
          statistics.bytes_of_paper +=
              group.scale[k] * static_cast<float>(group.weight[v]) * bytes_of_white >= 0.5f;
        }
        statistics.entries += any;
      }
  }
}

std::string provenance_of(const ClusterOptions& options, const ClusterStatistics& statistics) {
  Json provenance = {{"relighting", options.relighting == Relighting::image ? "image" : "geometry"},
                     {"similarity", options.similarity == Similarity::group ? "group" : "all_outputs"},
                     {"resolution", options.resolution},
                     {"samples", options.samples},
                     {"epsilon", options.epsilon},
                     {"bounces", options.bounces},
                     {"clusters", statistics.clusters},
                     {"entries", statistics.entries},
                     {"bytes_as_the_paper_counts", statistics.bytes_of_paper},
                     {"lights", statistics.lights},
                     {"rays", statistics.rays},
                     {"peak_vectors", statistics.peak_vectors}};
  if (options.relighting == Relighting::image) provenance["pixel_samples"] = options.pixel_samples;
  return json_text(provenance);
}

/// With colours as core/field/mesh.h has them: what a vertex' light is multiplied by.
OutputMesh coloured(const Scene& scene) {
  OutputMesh mesh{scene.mesh};
  mesh.colours = diffuse_reflectance(scene);
  return mesh;
}

}  // namespace

FieldRows cluster_transfer(const Scene& scene, const ClusterOptions& options, ClusterStatistics& statistics,
                           const RunContext& run) {
  const ThreadLimit limit(run);
  check(options);
  const auto start = std::chrono::steady_clock::now();
  statistics = {};
  const auto clusters = std::make_shared<Clusters>();
  clusters->layout = layout_of(scene, options.relighting);
  const TransferSamples transfer(scene, {options.relighting, options.pixel_samples, options.bounces},
                                 clusters->layout.outputs, run);
  clusters->channels = transfer.channels();
  const auto outputs = static_cast<std::size_t>(std::ranges::count_if(
      clusters->layout.outputs, [](std::uint32_t output) { return output != OutputLayout::none; }));
  clusters->weights = options.similarity == Similarity::group
                          ? cut_groups(transfer, options, statistics, run)
                          : cluster_lights(transfer, outputs, options, statistics, run);

  FieldRows field;
  field.outline.width = clusters->layout.width;
  field.outline.height = clusters->layout.height;
  field.outline.basis.domain = cube_domain(options.resolution);
  field.outline.basis.measure = Measure::solid_angle;
  number_kernels(clusters->weights, options.resolution, field.outline.basis);
  if (options.relighting == Relighting::geometry) field.outline.mesh = coloured(scene);
  statistics.clusters = field.outline.basis.size();
  count(*clusters, statistics);
  statistics.seconds = seconds_since(start);
  field.outline.provenance = provenance_of(options, statistics);
  field.rows = [clusters](RowRange range) { return clusters->rows(range); };
  return field;
}

}  // namespace refield::prt
