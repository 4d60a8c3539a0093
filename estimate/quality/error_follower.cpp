// SPDX-License-Identifier: Apache-2.0
#include "estimate/quality/error_follower.h"

#include <tbb/parallel_for.h>

#include <Eigen/LU>

#include "core/base/run_context.h"
#include "core/field/light_error.h"
#include "core/image/image_io.h"
#include "core/image/metrics.h"
#include "estimate/job/estimate_band.h"
#include "estimate/quality/error_evidence.h"

namespace refield {

namespace {

/// Pixels of the sample: blocks on a square lattice, row by row within a block.
std::vector<std::array<int, 2>> lattice_of(int width, int height, int max_pixels) {
  constexpr int side = block_side_px;
  const double blocks = std::max(1.0, static_cast<double>(width / side) * (height / side));
  const int step =
      std::max(1, static_cast<int>(std::ceil(std::sqrt(blocks * side * side / max_pixels)))) * side;
  std::vector<std::array<int, 2>> lattice;
  for (int y = step / (2 * side) * side; y + side <= height; y += step)
    for (int x = step / (2 * side) * side; x + side <= width; x += step)
      for (int i = 0; i < side * side; ++i) lattice.push_back({x + i % side, y + i / side});
  if (lattice.empty()) lattice.assign(side * side, {width / 2, height / 2});  // a tiny picture
  return lattice;
}

}  // namespace

void ErrorFollower::add(const CaptureFrame& frame, Parameterisation parameterisation, const RunContext& run) {
  const Photograph photograph = read_photograph(frame.observed);
  const Image& radiance = photograph.radiance;
  if (lights_.empty()) {
    width_ = radiance.width;
    height_ = radiance.height;
    pixels_ = lattice_of(width_, height_, max_pixels_);
    samples_.resize(pixels_.size());
    noise2_.resize(pixels_.size());
  }
  if (radiance.width != width_ || radiance.height != height_)
    throw InputError(frame.observed, ": is ", shape_text(radiance), ", those before are ", width_, "×",
                     height_, "; use one camera mode");
  lights_.push_back(read_illumination(frame, parameterisation, run));
  for (std::size_t i = 0; i < pixels_.size(); ++i)
    for (int c = 0; c < 3; ++c) {
      const float sigma =
          photograph.sigma.empty() ? 0.0f : photograph.sigma.at(pixels_[i][0], pixels_[i][1], c);
      const bool measured = !std::isinf(sigma);
      samples_[i][c].push_back(measured ? radiance.at(pixels_[i][0], pixels_[i][1], c)
                                        : std::numeric_limits<float>::quiet_NaN());
      if (measured) noise2_[i] += static_cast<double>(sigma) * sigma;
    }
}

double ErrorFollower::mean_square() const {
  double sum = 0.0;
  std::size_t count = 0;
  for (const auto& pixel : samples_)
    for (const auto& channel : pixel)
      for (const float value : channel)
        if (std::isfinite(value)) {
          sum += static_cast<double>(value) * value;
          ++count;
        }
  return count > 0 ? sum / static_cast<double>(count) : 0.0;
}

std::optional<Eigen::Matrix3d> ErrorFollower::unmixing() const {
  // Under one primary all channels see the same reflectance, so that their ratios are a column of the matrix.
  Eigen::Matrix3d mixing = Eigen::Matrix3d::Zero();
  for (std::size_t j = 0; j < lights_.size(); ++j) {
    Eigen::Array3d light = Eigen::Array3d::Zero();
    const std::vector<float>& values = lights_[j].radiance.values;
    for (std::size_t i = 0; i < values.size(); ++i) light(static_cast<Eigen::Index>(i % 3)) += values[i];
    Eigen::Index primary = 0;
    constexpr double pure = 0.99;
    if (light.maxCoeff(&primary) < pure * light.sum()) continue;
    Eigen::Vector3d products = Eigen::Vector3d::Zero();
    for (const auto& pixel : samples_)
      if (const Eigen::Vector3d seen(pixel[0][j], pixel[1][j], pixel[2][j]); seen.allFinite())
        products += seen(primary) * seen;
    if (products(primary) > 0.0) mixing.col(primary) = products / products(primary);
  }
  constexpr double least_determinant = 0.1;  // of channels that differ
  if (!(std::abs(mixing.determinant()) > least_determinant)) return std::nullopt;
  return mixing.inverse();
}

std::vector<double> ErrorFollower::change_of_light(const BoxTable& table,
                                                   const std::vector<PixelKernels>& kernels,
                                                   const RunContext& run) const {
  std::vector<double> change(kernels.size(), 1.0);
  if (expected_.empty()) return change;
  const LightErrorModel model = light_error_model(table, {});
  if (!model.known()) return change;
  const BoxTable expected(expected_, table.hats(), run);
  const double count = expected.images();
  double variance = 0.0;
  for (const LightMap& light : expected_) variance += model.variances_under(light.radiance).front() / count;
  std::vector<float> column(3 * expected.stride());
  for (std::size_t p = 0; p < kernels.size(); ++p) {
    const PixelKernels& pixel = kernels[p];
    std::vector<double> values(3 * expected.stride(), 0.0);
    for (std::size_t k = 0; k < pixel.boxes.size(); ++k) {
      expected.column(pixel.boxes[k], column.data());
      for (std::size_t i = 0; i < values.size(); ++i)
        values[i] += static_cast<double>(pixel.weights[3 * k + i / expected.stride()]) * column[i];
    }
    for (std::size_t i = 0; i < pixel.smooth.size(); ++i)
      for (int j = 0; j < expected.images(); ++j)
        values[i % 3 * expected.stride() + j] +=
            static_cast<double>(pixel.smooth[i]) *
            expected.hat_sums(static_cast<int>(i / 3), static_cast<int>(i % 3))[j];
    double squared = 0.0;
    for (int c = 0; c < 3; ++c)
      for (int j = 0; j < expected.images(); ++j)
        squared += std::pow(values[c * expected.stride() + j] * expected.unit() / table.unit(), 2.0) / count;
    change[p] = squared > 0.0 ? variance * pixel.squared_samples / (images() * squared) : 0.0;
  }
  return change;
}

FollowedError ErrorFollower::predict(const RunContext& run) {
  if (images() < 2) throw InputError("an error can be predicted from two images or more");
  const BoxTable table(lights_, hats_of(options_, lights_.front().domain(), images()), run);
  FollowedError error{images(), count_of(table.light_groups()), {}, 0.0};
  if (!is_error_known(table, nullptr)) return error;
  EstimateOptions options = options_;
  options.kernels = std::min(options.kernels, images());
  const double typical = mean_square();
  FitWorkers workers;
  std::vector<float> predicted(pixels_.size(), 0.0f), noise(pixels_.size(), 0.0f);
  const double share = share_of_cross_validation(table);
  const auto unmix = unmixing();
  std::vector<PixelKernels> kernels(pixels_.size());
  constexpr std::size_t block_size = block_side_px * block_side_px;
  tbb::parallel_for(std::size_t{0}, pixels_.size() / block_size, [&](std::size_t b) {
    run.throw_if_stopped();
    auto& worker = workers.local();
    if (!worker) worker = std::make_unique<FitWorker>(table, options, typical);
    KernelCache& cache = worker->model.cache();
    cache.keep_within(cache_limit_bytes);
    AlignedFloats padded(block_size * 3 * table.stride());
    std::vector<PixelSamples> block(block_size);
    for (std::size_t i = 0; i < block_size; ++i)
      for (int c = 0; c < 3; ++c) {
        float* values = padded.data() + (3 * i + c) * table.stride();
        std::ranges::copy(samples_[b * block_size + i][c], values);
        block[i][c] = values;
      }
    if (unmix)
      for (std::size_t i = 0; i < block_size; ++i)
        for (int j = 0; j < images(); ++j) {
          const Eigen::Vector3d seen(block[i][0][j], block[i][1][j], block[i][2][j]);
          for (int c = 0; c < 3; ++c)
            padded[(3 * i + c) * table.stride() + j] = static_cast<float>(unmix->row(c).dot(seen));
        }
    const auto fitted = worker->model.fit(block, block_side_px, {}, run);
    const auto validated = worker->evaluator.cross_validate(block, block_side_px, 5, run);
    MaskedSamples masked;
    AlignedFloats residuals(3 * table.stride());
    for (std::size_t i = 0; i < block_size; ++i) {
      const double squared = fitted[i].squared_samples;
      if (!(squared > 0.0)) continue;
      masked.assign(block[i], table.stride(), images());
      const double left_out = worker->evaluator.leave_one_out(fitted[i], cache, masked, residuals.data());
      const double noise2 = noise2_[b * block_size + i];
      predicted[b * block_size + i] = static_cast<float>(
          std::sqrt((noise2 > 0.0 ? std::max(error_of_all_images(validated[i], noise2), left_out)
                                  : std::lerp(left_out, validated[i], share)) /
                    squared));
      noise[b * block_size + i] = static_cast<float>(std::sqrt(noise2_[b * block_size + i] / squared));
      kernels[b * block_size + i] = fitted[i];
    }
  });
  const std::vector<double> change = change_of_light(table, kernels, run);
  for (std::size_t p = 0; p < predicted.size(); ++p) {
    const double noise2 = std::pow(noise[p], 2.0), own = std::max(std::pow(predicted[p], 2.0) - noise2, 0.0);
    if (!expected_.empty() && predicted[p] > 0.0f)
      predicted[p] = static_cast<float>(std::sqrt(own * change[p] + noise2));
  }
  std::erase(predicted, 0.0f);
  std::erase(noise, 0.0f);
  error.predicted = predicted.empty() ? 0.0 : quantile(predicted, 0.5);
  error.noise = noise.empty() ? 0.0 : quantile(noise, 0.5);
  noise_ = error.noise;
  history_.push_back({static_cast<float>(error.images), static_cast<float>(*error.predicted)});
  return error;
}

int ErrorFollower::images_for(double error) const {
  const LearningCurve curve(history_, noise_);
  if (!curve.known() || history_.size() < 3) return 0;
  constexpr int furthest = 10;
  for (int count = images(); count <= furthest * images(); ++count)
    if (curve.error_at(count) <= error) return count;
  return 0;
}

}  // namespace refield
