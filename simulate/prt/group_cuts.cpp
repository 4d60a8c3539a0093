// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/group_cuts.h"

#include <tbb/parallel_for.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/cube_map.h"
#include "core/run_context.h"
#include "simulate/prt/cube_quadtree.h"

namespace refield::prt {

namespace {

constexpr int coarsest_side = 8;  // squares along a face that are looked at in any case
/// Lobes of larger exponents are narrower than the samples of the coarsest squares are apart.
constexpr float narrow_exponent = 20.0f;

/// Of a group's values over some samples, each counting by its solid angle.
struct Moments {
  using Values = Eigen::Array<double, Eigen::Dynamic, 1, 0, 3 * TransferSamples::group_outputs, 1>;
  double weight = 0.0;
  Values sum, squares;

  explicit Moments(std::size_t values) : sum(Values::Zero(static_cast<Eigen::Index>(values))), squares(sum) {}
  void add(double solid_angle, const Values& values) {
    weight += solid_angle;
    sum += solid_angle * values;
    squares += solid_angle * values.square();
  }
  void operator+=(const Moments& other) {
    weight += other.weight;
    sum += other.sum;
    squares += other.squares;
  }
  /// Ω² var T, the largest of all outputs and channels.
  double loss() const { return (weight * squares - sum.square()).maxCoeff(); }
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
    for (int face = 0; face < cube_faces; ++face) visit(face_square(face, options_.resolution));
    GroupWeights weights;
    for (const auto& [name, mean] : leaves_)
      weights.append(name, {mean.data(), static_cast<std::size_t>(mean.size())});
    return weights;
  }
  std::uint64_t rays() const { return rays_; }
  std::uint64_t lights() const { return lights_; }

 private:
  struct Leaf {
    std::uint32_t name;
    Eigen::ArrayXf mean;
  };

  /// Moments of all samples in a square; what it is cut into stands at the end of the leaves.
  Moments visit(const CubeSquare& square) {
    const std::size_t first = leaves_.size();
    Moments moments(transfer_.group_values());
    const bool must_split = has_to_split(square);
    if (!must_split) sample(square, moments);
    if (must_split || (moments.loss() > limit_ && square.box.area() > 1)) {
      moments = Moments(transfer_.group_values());
      for (const CubeSquare& part : quadrisect(square))
        if (part.box.area() > 0) moments += visit(part);
      if (moments.loss() > limit_) return moments;
      leaves_.resize(first);
    }
    if ((moments.sum > 0.0).any())
      leaves_.push_back({square.name, (moments.sum / moments.weight).cast<float>()});
    return moments;
  }

  bool has_to_split(const CubeSquare& square) const {
    const Box& box = square.box;
    if (box.area() <= 1) return false;
    if (box.width() * coarsest_side > options_.resolution) return true;
    if (lobes_.empty()) return false;
    const auto at = [&](double x, double y) { return cube_direction(x, y, options_.resolution); };
    // Rows of the face's lower edge belong to the next face: stay a little inside.
    const double x0 = box.x0, x1 = box.x1, y0 = box.y0 + 1e-6, y1 = box.y1 - 1e-6;
    const Eigen::Vector3d middle = at(0.5 * (x0 + x1), 0.5 * (y0 + y1));
    const double nearest = std::min(
        {middle.dot(at(x0, y0)), middle.dot(at(x1, y0)), middle.dot(at(x0, y1)), middle.dot(at(x1, y1))});
    const double radius = std::acos(std::min(nearest, 1.0));
    return std::ranges::any_of(lobes_, [&](const Cone& lobe) {
      return radius > lobe.angle &&
             middle.dot(lobe.direction) > std::cos(std::min(radius + lobe.angle, std::numbers::pi));
    });
  }

  /// The middles of s×s parts of a square, or all its texels if there are fewer.
  void sample(const CubeSquare& square, Moments& moments) {
    const Box& box = square.box;
    const int across = std::min(options_.samples, box.width()),
              down = std::min(options_.samples, box.height());
    for (int j = 0; j < down; ++j)
      for (int i = 0; i < across; ++i) {
        const int x = box.x0 + (2 * i + 1) * box.width() / (2 * across);
        const int y = box.y0 + (2 * j + 1) * box.height() / (2 * down);
        const Eigen::Vector3d direction = cube_direction(x + 0.5, y + 0.5, options_.resolution);
        rays_ += transfer_.evaluate(group_, direction.cast<float>(), values_);
        ++lights_;
        // A texel's solid angle, up to a factor of 1 + O(1/R²), times the texels that the sample stands for.
        const double ahead = direction.cwiseAbs().maxCoeff();
        const double texels = static_cast<double>(box.area()) / (across * down);
        const Eigen::Map<const Eigen::ArrayXf> values(values_.data(),
                                                      static_cast<Eigen::Index>(values_.size()));
        moments.add(texels * texel_area_ * ahead * ahead * ahead, values.cast<double>());
      }
  }

  const TransferSamples& transfer_;
  std::size_t group_;
  const ClusterOptions& options_;
  double limit_;
  double texel_area_;  // on a cube whose faces are at distance 1
  std::vector<float> values_;
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

}  // namespace refield::prt
