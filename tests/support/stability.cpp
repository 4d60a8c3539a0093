// SPDX-License-Identifier: Apache-2.0
#include "tests/support/stability.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <limits>

#include "core/base/linear_algebra.h"
#include "core/base/rng.h"
#include "core/image/image_io.h"
#include "core/image/metrics.h"
#include "tests/support/series_error.h"
#include "tests/support/synthetic_capture.h"

namespace refield::test {

namespace {

constexpr LightDomain domain{32, 24, Parameterisation::monitor};
constexpr int picture_width = 20;
constexpr int picture_height = 16;

/// Where a pixel class looks on the light map moves with the pixel, as in a scene. All boxes of a pixel get
/// a share of the whole: a texel sum of one.
void add_pixel(ReflectanceField& field, int x, int y) {
  Rng rng(5, x, y);
  std::vector<Box> boxes;
  const int cx = 4 + x * (domain.width - 8) / picture_width;
  const int cy = 4 + y * (domain.height - 8) / picture_height;
  const auto around = [&](int half_width, int half_height) {
    return Box{std::max(cx - half_width, 0), std::max(cy - half_height, 0),
               std::min(cx + half_width, domain.width), std::min(cy + half_height, domain.height)};
  };
  const Box all{0, 0, domain.width, domain.height};
  switch ((x / 5) % 4) {
    case 0:
      boxes = {all, around(14, 10), around(10, 7), around(6, 5)};
      break;
    case 1:
      boxes = {all, around(5, 4), around(3, 2)};
      break;
    case 2:
      boxes = {around(1, 1)};
      break;
    default:
      boxes = {{0, 0, cx, domain.height}};
  }
  std::vector<std::uint32_t> columns;
  std::vector<float> weights;
  for (const Box& box : boxes) {
    columns.push_back(static_cast<std::uint32_t>(field.basis.boxes.size()));
    field.basis.boxes.push_back(box);
    for (int c = 0; c < 3; ++c)
      weights.push_back(
          static_cast<float>(rng.uniform(0.5, 1.0) / (boxes.size() * static_cast<double>(box.area()))));
  }
  field.transfer.append_row(columns, weights);
}

/// [images × texels or pixels] of one channel.
Eigen::MatrixXd rows_of(const std::vector<Image>& images, int channel) {
  Eigen::MatrixXd rows(images.size(), images[0].pixel_count());
  for (std::size_t j = 0; j < images.size(); ++j)
    for (std::size_t p = 0; p < images[j].pixel_count(); ++p) rows(j, p) = images[j].values[3 * p + channel];
  return rows;
}

struct Training {
  std::vector<Image> lights, photographs;
};

Training read_training(const CaptureSession& session) {
  Training training;
  for (const CaptureFrame& frame : session.frames_of(FrameRole::train)) {
    training.lights.push_back(read_image(frame.illumination));
    training.photographs.push_back(read_photograph(frame.observed).radiance);
  }
  return training;
}

}  // namespace

void record_figure(const StabilityFigure& f) {
  std::printf("%s, %s: error %.4f (undisturbed %.4f, constant %.4f, ridge %.4f)\n", f.condition.c_str(),
              f.setting.c_str(), f.error, f.undisturbed, f.constant, f.ridge);
  const char* folder = std::getenv("REFIELD_FIGURES");
  if (!folder) return;
  const std::filesystem::path path = std::filesystem::path(folder) / "stability.csv";
  std::filesystem::create_directories(folder);
  const bool is_new = !std::filesystem::exists(path);
  std::ofstream file(path, std::ios::app);
  if (is_new) file << "condition,setting,error,undisturbed,constant,ridge\n";
  file << '"' << f.condition << "\",\"" << f.setting << "\"," << f.error << ',' << f.undisturbed << ','
       << f.constant << ',' << f.ridge << '\n';
}

StabilityScene::StabilityScene(int images, std::uint64_t seed)
    : lights(random_lights(images, domain.width, domain.height, seed)),
      held_out(random_lights(12, domain.width, domain.height, seed + 1000)) {
  truth.width = picture_width;
  truth.height = picture_height;
  truth.basis.domain = domain;
  for (int y = 0; y < picture_height; ++y)
    for (int x = 0; x < picture_width; ++x) add_pixel(truth, x, y);
}

double StabilityScene::error(const std::function<Image(const LightMap&)>& predict) const {
  std::vector<Image> predicted, exact;
  for (const LightMap& light : held_out) {
    predicted.push_back(predict(light));
    exact.push_back(truth.relight(light));
    for (Image* image : {&predicted.back(), &exact.back()})
      for (int c = 0; c < 3; ++c) {
        if (std::ranges::find(channels, c) != channels.end()) continue;
        for (std::size_t p = 0; p < image->pixel_count(); ++p) image->values[3 * p + c] = 0.0f;
      }
  }
  return quantile(relative_rmse_map(predicted, exact).values, of_pixels);
}

double StabilityScene::error(const ReflectanceField& field) const {
  return error([&](const LightMap& light) { return field.relight(light); });
}

double StabilityScene::error_of_constant(const CaptureSession& session) const {
  const Training training = read_training(session);
  Image mean(truth.width, truth.height, 3);
  for (const Image& photograph : training.photographs)
    for (std::size_t i = 0; i < mean.values.size(); ++i)
      mean.values[i] += photograph.values[i] / static_cast<float>(training.photographs.size());
  return error([&](const LightMap&) { return mean; });
}

double StabilityScene::error_of_ridge(const CaptureSession& session) const {
  const Training training = read_training(session);
  std::array<Eigen::MatrixXd, 3> weights;  // [texels × pixels]
  for (int c = 0; c < 3; ++c) {
    const Eigen::MatrixXd L = rows_of(training.lights, c);
    const Eigen::MatrixXd B = rows_of(training.photographs, c);
    const SymmetricEigen gram = symmetric_eigen(L * L.transpose());
    const Eigen::MatrixXd UtB = gram.vectors.transpose() * B;
    const Eigen::ArrayXd values = gram.values.array().max(0.0);
    Eigen::MatrixXd dual = Eigen::MatrixXd::Zero(B.rows(), B.cols());
    Eigen::ArrayXd best = Eigen::ArrayXd::Constant(B.cols(), std::numeric_limits<double>::infinity());
    for (int step = -16; step <= 4; ++step) {
      const double ridge = values.maxCoeff() * std::pow(10.0, 0.5 * step);
      const Eigen::ArrayXd left = ridge / (values + ridge);
      const double trace = left.mean();
      for (Eigen::Index p = 0; p < B.cols(); ++p) {
        const double score = (left * UtB.col(p).array()).square().mean() / (trace * trace);
        if (!(score < best[p])) continue;
        best[p] = score;
        dual.col(p) = (UtB.col(p).array() / (values + ridge)).matrix();
      }
    }
    weights[c] = L.transpose() * (gram.vectors * dual);
  }
  return error([&](const LightMap& light) {
    Image image(truth.width, truth.height, 3);
    for (int c = 0; c < 3; ++c) {
      const Eigen::MatrixXd predicted = rows_of({light.radiance}, c) * weights[c];
      for (std::size_t p = 0; p < image.pixel_count(); ++p)
        image.values[3 * p + c] = static_cast<float>(predicted(0, p));
    }
    return image;
  });
}

void change_photograph(const CaptureFrame& frame, const std::function<void(Image&)>& change) {
  Image image = read_photograph(frame.observed).radiance;
  change(image);
  write_exr(frame.observed, image);
}

}  // namespace refield::test
