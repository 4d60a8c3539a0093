// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/peers/single_box.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <unordered_map>

#include "cli/run_context.h"
#include "core/light/summed_area_table.h"

namespace refield::peers {

namespace {

constexpr int block_pixels = 64;
constexpr int coarse_cells = 16;  // along the longer side
constexpr int starts = 4;         // coarse rectangles that are refined

/// The sums of all lights over any rectangle, all images of a channel side by side.
class LightTable {
 public:
  explicit LightTable(const PeerData& data)
      : images_(data.images()),
        across_(data.domain.width + 1),
        prefix_(3 * static_cast<Eigen::Index>(images_),
                static_cast<Eigen::Index>(across_) * (data.domain.height + 1)) {
    tbb::parallel_for(0, images_, [&](int j) {
      const SummedAreaTable table(data.lights[j].radiance);
      for (int y = 0; y <= data.domain.height; ++y)
        for (int x = 0; x < across_; ++x) {
          const auto sum = table.sum({0, 0, x, y});
          for (int c = 0; c < 3; ++c) prefix_(c * images_ + j, at(x, y)) = sum[c];
        }
    });
  }
  /// [3 · images], channel by channel.
  Eigen::VectorXd column(const Box& box) const {
    return prefix_.col(at(box.x1, box.y1)) - prefix_.col(at(box.x0, box.y1)) -
           prefix_.col(at(box.x1, box.y0)) + prefix_.col(at(box.x0, box.y0));
  }

 private:
  Eigen::Index at(int x, int y) const { return static_cast<Eigen::Index>(y) * across_ + x; }
  int images_, across_;
  Eigen::MatrixXd prefix_;
};

/// All rectangles with corners on a coarse grid.
std::vector<Box> coarse_boxes(const LightDomain& domain, int step) {
  const auto edges = [step](int size) {
    std::vector<int> at;
    for (int x = 0; x < size; x += step) at.push_back(x);
    at.push_back(size);
    return at;
  };
  const auto columns = edges(domain.width), rows = edges(domain.height);
  std::vector<Box> boxes;
  for (std::size_t j0 = 0; j0 < rows.size(); ++j0)
    for (std::size_t j1 = j0 + 1; j1 < rows.size(); ++j1)
      for (std::size_t i0 = 0; i0 < columns.size(); ++i0)
        for (std::size_t i1 = i0 + 1; i1 < columns.size(); ++i1)
          boxes.push_back({columns[i0], rows[j0], columns[i1], rows[j1]});
  return boxes;
}

class SingleBoxFit {
 public:
  explicit SingleBoxFit(const PeerData& data)
      : data_(data),
        table_(data),
        step_((std::max(data.domain.width, data.domain.height) + coarse_cells - 1) / coarse_cells),
        boxes_(coarse_boxes(data.domain, step_)) {
    const Eigen::Index n = data.images();
    for (auto& columns : coarse_) columns.resize(n, static_cast<Eigen::Index>(boxes_.size()));
    tbb::parallel_for(std::size_t{0}, boxes_.size(), [&](std::size_t k) {
      const Eigen::VectorXd column = table_.column(boxes_[k]);
      for (int c = 0; c < 3; ++c) {
        const auto part = column.segment(c * n, n);
        const double norm = part.norm();
        if (norm > 0.0)
          coarse_[c].col(static_cast<Eigen::Index>(k)) = (part / norm).cast<float>();
        else
          coarse_[c].col(static_cast<Eigen::Index>(k)).setZero();
      }
    });
  }

  ReflectanceField run() {
    std::vector<Box> found(static_cast<std::size_t>(data_.pixels()));
    Progress progress(run_context(), "single box", data_.pixels());
    tbb::parallel_for(0, (data_.pixels() + block_pixels - 1) / block_pixels, [&](int block) {
      run_context().throw_if_stopped();
      const int first = block * block_pixels;
      const int count = std::min(block_pixels, data_.pixels() - first);
      fit_block(first, count, found);
      progress.advance(count);
    });
    return assemble(found);
  }

 private:
  /// Samples of a pixel, channel by channel, missing ones zero; and which ones count.
  struct Samples {
    Eigen::VectorXd values, measured;  // [3 · images]
    bool complete = true;
  };

  Samples samples_of(int pixel) const {
    const Eigen::Index n = data_.images();
    Samples samples{Eigen::VectorXd(3 * n), Eigen::VectorXd::Ones(3 * n), true};
    for (int c = 0; c < 3; ++c)
      for (Eigen::Index j = 0; j < n; ++j) {
        const float value = data_.observed(j, 3 * pixel + c);
        samples.values(c * n + j) = std::isnan(value) ? 0.0 : value;
        if (!std::isnan(value)) continue;
        samples.measured(c * n + j) = 0.0;
        samples.complete = false;
      }
    return samples;
  }

  /// Non-negative weights of a rectangle and how much of Σ b² they explain.
  struct Score {
    double gain = 0.0;
    std::array<double, 3> weights{};
  };

  Score score(const Box& box, const Samples& samples) const {
    const Eigen::Index n = data_.images();
    Eigen::VectorXd column = table_.column(box);
    if (!samples.complete) column = column.cwiseProduct(samples.measured);
    Score score;
    for (int c = 0; c < 3; ++c) {
      const auto part = column.segment(c * n, n);
      const double norm2 = part.squaredNorm();
      const double product = part.dot(samples.values.segment(c * n, n));
      if (norm2 <= 0.0 || product <= 0.0) continue;
      score.weights[c] = product / norm2;
      score.gain += product * product / norm2;
    }
    return score;
  }

  void fit_block(int first, int count, std::vector<Box>& found) const {
    Eigen::ArrayXXf gains = Eigen::ArrayXXf::Zero(static_cast<Eigen::Index>(boxes_.size()), count);
    Eigen::MatrixXf observed = data_.observed.middleCols(3 * first, 3 * count);
    observed = observed.array().isNaN().select(0.0f, observed);
    for (int c = 0; c < 3; ++c) {
      const Eigen::MatrixXf channel = observed(Eigen::all, Eigen::seqN(c, count, 3));
      gains += (coarse_[c].transpose() * channel).array().max(0.0f).square();
    }
    std::vector<Eigen::Index> order(boxes_.size());
    for (int i = 0; i < count; ++i) {
      const int pixel = first + i;
      if (!data_.counts(pixel)) continue;
      for (std::size_t k = 0; k < order.size(); ++k) order[k] = static_cast<Eigen::Index>(k);
      const auto kept = std::min<std::ptrdiff_t>(starts, std::ssize(order));
      std::partial_sort(order.begin(), order.begin() + kept, order.end(), [&](auto a, auto b) {
        return gains(a, i) != gains(b, i) ? gains(a, i) > gains(b, i) : a < b;
      });
      const Samples samples = samples_of(pixel);
      double best = -1.0;
      for (std::ptrdiff_t k = 0; k < kept; ++k) {
        const Box box =
            refined(boxes_[static_cast<std::size_t>(order[static_cast<std::size_t>(k)])], samples);
        const double gain = score(box, samples).gain;
        if (gain <= best) continue;
        best = gain;
        found[static_cast<std::size_t>(pixel)] = box;
      }
    }
  }

  Box refined(Box box, const Samples& samples) const {
    double gain = score(box, samples).gain;
    for (int step = (step_ + 1) / 2;; step = (step + 1) / 2) {
      bool better = true;
      while (better) {
        better = false;
        for (std::int32_t Box::*edge : {&Box::x0, &Box::y0, &Box::x1, &Box::y1})
          for (const int by : {-step, step}) {
            Box moved = box;
            moved.*edge += by;
            if (!moved.inside(data_.domain.width, data_.domain.height)) continue;
            const double moved_gain = score(moved, samples).gain;
            if (moved_gain <= gain) continue;
            gain = moved_gain;
            box = moved;
            better = true;
          }
      }
      if (step <= 1) return box;
    }
  }

  ReflectanceField assemble(const std::vector<Box>& found) const {
    ReflectanceField field;
    field.width = data_.width;
    field.height = data_.height;
    field.basis.domain = data_.domain;
    std::unordered_map<Box, std::uint32_t, BoxHash> numbers;
    for (int p = 0; p < data_.pixels(); ++p) {
      if (!data_.counts(p)) {
        field.transfer.append_row({}, {});
        continue;
      }
      const Box& box = found[static_cast<std::size_t>(p)];
      const auto [entry, is_new] =
          numbers.try_emplace(box, static_cast<std::uint32_t>(field.basis.boxes.size()));
      if (is_new) field.basis.boxes.push_back(box);
      const auto weights = score(box, samples_of(p)).weights;
      const std::array<float, 3> stored{static_cast<float>(weights[0]), static_cast<float>(weights[1]),
                                        static_cast<float>(weights[2])};
      field.transfer.append_row(std::span(&entry->second, 1), stored);
    }
    return field;
  }

  const PeerData& data_;
  LightTable table_;
  int step_;
  std::vector<Box> boxes_;
  std::array<Eigen::MatrixXf, 3> coarse_;  // normalised columns, [images × boxes]
};

}  // namespace

ReflectanceField fit_single_box(const PeerData& data) {
  return SingleBoxFit(data).run();
}

}  // namespace refield::peers
