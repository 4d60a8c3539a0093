// SPDX-License-Identifier: Apache-2.0
// How near the merge of bracketed exposures comes to the best that any method could do, and to two others.
// The table of docs/guide/hdr.md is printed by these tests.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <functional>

#include "acquire/hdr/hdr_merge.h"
#include "core/base/rng.h"
#include "tests/acquire/cramer_rao.h"
#if REFIELD_HAS_OPENCV_PHOTO
#include <opencv2/photo.hpp>
#endif

namespace refield {
namespace {

const std::vector<double> times = {0.01, 0.04, 0.16, 0.64};

CameraCalibration sensor(int bits) {
  CameraCalibration camera;
  camera.bits = bits;
  camera.linear_from_dn = linear_response(bits);
  camera.electrons_per_dn = bits == 12 ? 4.0 : 62.0;
  camera.black_level_dn = bits == 12 ? 64.0 : 4.0;
  camera.saturation_dn = (1 << bits) - 1;
  camera.read_noise_electrons = 3.0;
  camera.electrons_per_radiance_second = 200'000.0;
  return camera;
}

/// The radiance that just saturates the shortest exposure: 100 % of the range.
double whole_range(const CameraCalibration& camera) {
  return (camera.saturation_dn - camera.black_level_dn) * camera.electrons_per_dn /
         (times[0] * camera.electrons_per_radiance_second);
}

std::vector<RawFrame> bracket(const std::vector<double>& radiance, int width, const CameraCalibration& camera,
                              std::uint64_t seed) {
  std::vector<RawFrame> frames;
  const int height = static_cast<int>(radiance.size()) / width;
  for (double seconds : times) {
    RawFrame frame{width, height, PixelLayout::grey, {}, {}, Seconds(seconds), 1.0, frames.size()};
    Rng noise(seed, frames.size());
    for (double r : radiance) {
      const double electrons = noise.poisson(r * seconds * camera.electrons_per_radiance_second) +
                               camera.read_noise_electrons * noise.normal();
      const double dn = std::round(camera.black_level_dn + electrons / camera.electrons_per_dn);
      frame.samples.push_back(static_cast<std::uint16_t>(std::clamp(dn, 0.0, camera.saturation_dn)));
    }
    frames.push_back(std::move(frame));
  }
  return frames;
}

/// RMS error of the merge at one radiance over the bound there.
double error_over_bound(double share, const CameraCalibration& camera) {
  constexpr int width = 100, height = 100;
  const double truth = share * whole_range(camera);
  const auto merged =
      merge_exposures(bracket(std::vector<double>(width * height, truth), width, camera, 7), camera);
  double squares = 0.0;
  for (std::size_t i = 0; i < merged.radiance.values.size(); i += 3)
    squares += std::pow(merged.radiance.values[i] - truth, 2) / (width * height);
  return std::sqrt(squares) / test::cramer_rao_bound(truth, times, camera);
}

/// Within 2 % of these shares of the range a longer exposure is at the point of clipping. There the bound
/// speaks of many photographs: one sample that either clipped or did not tells less than its average, and no
/// estimate from a single bracket reaches it.
bool is_at_a_clipping_point(double share) {
  for (double clipping : {1.0 / 4.0, 1.0 / 16.0, 1.0 / 64.0})
    if (std::abs(share / clipping - 1.0) < 0.02) return true;
  return false;
}

TEST(HdrBound, ErrorIsWithinTenPerCentOfTheCramerRaoBoundFromOneToNinetyNinePerCentOfTheRange) {
  const CameraCalibration camera = sensor(12);
  constexpr int bands = 24, steps = 8;  // a band is a fifth of its radiance wide
  double worst_step = 0.0, worst_anywhere = 0.0, all = 0.0;
  std::printf("| share of the range | error / Cramér–Rao bound |\n| --- | --- |\n");
  for (int band = 0; band < bands; ++band) {
    double squares = 0.0;
    const auto share_at = [&](double x) { return 0.01 * std::pow(99.0, x / bands); };
    for (int step = 0; step < steps; ++step) {
      const double share = share_at(band + (step + 0.5) / steps);
      const double ratio = error_over_bound(share, camera);
      squares += ratio * ratio / steps;
      worst_anywhere = std::max(worst_anywhere, ratio);
      if (!is_at_a_clipping_point(share)) worst_step = std::max(worst_step, ratio);
    }
    std::printf("| %.1f %% to %.1f %% | %.3f |\n", 100.0 * share_at(band), 100.0 * share_at(band + 1),
                std::sqrt(squares));
    EXPECT_LT(std::sqrt(squares), 1.10) << "band from " << 100.0 * share_at(band) << " %";
    all += squares / bands;
  }
  std::printf(
      "| whole | %.3f |\nworst single radiance, clipping points left out: %.3f; at one: %.3f\n",
      std::sqrt(all), worst_step,
      std::max({worst_anywhere, error_over_bound(0.25, camera), error_over_bound(1.0 / 16.0, camera)}));
  EXPECT_LT(worst_step, 1.10);
  EXPECT_LT(error_over_bound(0.99, camera), 1.10);
  // At a clipping point itself: without the censored fit it is 1.6.
  EXPECT_LT(error_over_bound(0.25, camera), 1.45);
}

TEST(HdrBound, InformationIsThatOfShotNoiseInTheMiddleAndNoneBeyondSaturation) {
  const CameraCalibration camera = sensor(12);
  EXPECT_NEAR(test::information_of_electrons(5000.0, camera) * (5000.0 + 9.0), 1.0, 0.01);
  EXPECT_LT(test::information_of_electrons(20000.0, camera) * 20000.0, 1e-6);
}

#if REFIELD_HAS_OPENCV_PHOTO

/// Relative RMS error of a merge, its scale chosen so that the error is smallest: OpenCV's is free.
double relative_error(const std::vector<double>& merged, const std::vector<double>& truth) {
  double top = 0.0, bottom = 0.0, squares = 0.0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const double m = merged[i] / truth[i];
    top += m;
    bottom += m * m;
  }
  const double scale = top / bottom;
  for (std::size_t i = 0; i < truth.size(); ++i) squares += std::pow(scale * merged[i] / truth[i] - 1.0, 2);
  return std::sqrt(squares / static_cast<double>(truth.size()));
}

std::vector<double> merged_by_opencv(
    const std::vector<RawFrame>& frames, const CameraCalibration& camera,
    const std::function<void(const std::vector<cv::Mat>&, cv::Mat&, const std::vector<float>&,
                             const cv::Mat&)>& merge) {
  std::vector<cv::Mat> images;
  std::vector<float> seconds;
  for (const RawFrame& frame : frames) {
    cv::Mat image(frame.height, frame.width, CV_8UC3);
    for (std::size_t i = 0; i < frame.samples.size(); ++i)
      for (int c = 0; c < 3; ++c) image.data[3 * i + c] = static_cast<std::uint8_t>(frame.samples[i]);
    images.push_back(image);
    seconds.push_back(static_cast<float>(frame.exposure.count()));
  }
  // The camera's true response, black taken off: better than OpenCV could find by itself.
  cv::Mat response(256, 1, CV_32FC3);
  for (int dn = 0; dn < 256; ++dn) {
    const auto light = static_cast<float>(std::max(dn - camera.black_level_dn, 0.05));
    response.at<cv::Vec3f>(dn) = {light, light, light};
  }
  cv::Mat merged;
  merge(images, merged, seconds, response);
  std::vector<double> values;
  for (int y = 0; y < merged.rows; ++y)
    for (int x = 0; x < merged.cols; ++x) values.push_back(merged.at<cv::Vec3f>(y, x)[0]);
  return values;
}

TEST(HdrBound, BeatsOpenCvOnEightBitBrackets) {
  const CameraCalibration camera = sensor(8);
  constexpr int width = 300, height = 300;
  std::vector<double> truth;
  for (int i = 0; i < width * height; ++i)
    truth.push_back(whole_range(camera) * 0.01 *
                    std::pow(99.0, static_cast<double>(i) / (width * height - 1.0)));
  const auto frames = bracket(truth, width, camera, 3);
  const auto photograph = merge_exposures(frames, camera);
  std::vector<double> ours;
  for (std::size_t i = 0; i < photograph.radiance.values.size(); i += 3)
    ours.push_back(photograph.radiance.values[i]);
  const auto debevec = merged_by_opencv(
      frames, camera, [](const auto& images, auto& merged, const auto& seconds, const auto& response) {
        cv::createMergeDebevec()->process(images, merged, seconds, response);
      });
  const auto robertson = merged_by_opencv(
      frames, camera, [](const auto& images, auto& merged, const auto& seconds, const auto& response) {
        cv::createMergeRobertson()->process(images, merged, seconds, response);
      });
  double bound = 0.0;
  constexpr int every = 300;
  for (std::size_t i = 0; i < truth.size(); i += every)
    bound += std::pow(test::cramer_rao_bound(truth[i], times, camera) / truth[i], 2) * every /
             static_cast<double>(truth.size());
  std::printf("relative RMS error over 1 %% to 99 %% of the range, 8 bits\n");
  std::printf("  Cramér–Rao bound      %.4f\n  refield               %.4f\n", std::sqrt(bound),
              relative_error(ours, truth));
  std::printf("  OpenCV MergeDebevec   %.4f\n  OpenCV MergeRobertson %.4f\n", relative_error(debevec, truth),
              relative_error(robertson, truth));
  EXPECT_LT(relative_error(ours, truth), relative_error(debevec, truth));
  EXPECT_LT(relative_error(ours, truth), relative_error(robertson, truth));
  EXPECT_LT(relative_error(ours, truth), 1.10 * std::sqrt(bound));
}

#endif

}  // namespace
}  // namespace refield
