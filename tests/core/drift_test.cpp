// SPDX-License-Identifier: Apache-2.0
// Drift: measured from frames of one light, robust to noise, walkers and flickers.
#include "core/field/drift.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/rng.h"
#include "core/image/image_io.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

constexpr int width = 60;
constexpr int height = 45;
constexpr int references = 9;
constexpr double last_order = 160.0;

class DriftOfReferences : public testing::Test {
 protected:
  DriftOfReferences() {
    create_folders(folder_.path());
    session_.folder = folder_.path();
    session_.width = width;
    session_.height = height;
    session_.light = {4, 3, Parameterisation::monitor};
    write_exr(folder_ / "light.exr", Image(4, 3, 3, 0.7f));
  }

  /// Reference frames whose brightness follows `gain` (channel, share of the capture), with 1 % noise.
  void take(const std::function<double(int, double)>& gain, double noise = 0.01) {
    session_.frames.clear();
    for (int k = 0; k < references; ++k) {
      Rng scene(1), rng(2, k);
      Image image(width, height, 3);
      for (std::size_t i = 0; i < image.values.size(); ++i) {
        const double radiance = std::pow(scene.uniform(), 3.0);
        image.values[i] = static_cast<float>(
            radiance * gain(static_cast<int>(i % 3), k / (references - 1.0)) * (1.0 + noise * rng.normal()) +
            0.001 * rng.normal());
      }
      const std::string name = "reference_" + std::to_string(k);
      write_exr(folder_ / (name + ".exr"), image);
      session_.frames.push_back({name, FrameRole::reference, "reference", folder_ / "light.exr",
                                 folder_ / (name + ".exr"), last_order * k / (references - 1.0)});
    }
    session_.frames.push_back({"train", FrameRole::train, "natural", folder_ / "light.exr",
                               folder_ / "reference_0.exr", 0.6 * last_order});
  }
  void change(int k, const std::function<void(Image&)>& how) {
    Image image = read_image(session_.frames[k].observed);
    how(image);
    write_exr(session_.frames[k].observed, image);
  }
  /// The largest error of the measured gain at any moment.
  static double worst_error(const Drift& drift, const std::function<double(int, double)>& gain) {
    double worst = 0.0;
    for (double share = 0.0; share <= 1.0; share += 0.01)
      for (int c = 0; c < 3; ++c)
        worst = std::max(
            worst, std::abs(drift.gain_at(share * last_order)[c] / (gain(c, share) / gain(c, 0.0)) - 1.0));
    return worst;
  }

  test::TemporaryFolder folder_;
  CaptureSession session_;
};

/// Five per cent over the capture, fast at first, different in each channel.
double warming_up(int channel, double share) {
  return 1.0 - (0.05 - 0.01 * channel) * std::expm1(-2.0 * share) / std::expm1(-2.0);
}

TEST_F(DriftOfReferences, IsMeasuredForEachChannel) {
  take(warming_up);
  const Drift drift = measure_drift(session_);
  EXPECT_TRUE(drift.significant);
  ASSERT_EQ(drift.points.size(), 9u);
  EXPECT_NEAR(drift.largest, 0.05, 0.002);
  EXPECT_LT(worst_error(drift, warming_up), 0.003);
  for (const DriftPoint& point : drift.points)
    for (int c = 0; c < 3; ++c) {
      EXPECT_TRUE(point.used);
      const double truth = warming_up(c, point.order / last_order);
      EXPECT_LT(std::abs(point.gain[c] / truth - 1.0), 5.0 * point.uncertainty[c] * std::sqrt(2.0));
    }
}

TEST_F(DriftOfReferences, FramesGetTheGainOfTheirMoment) {
  take(warming_up);
  remove_drift(session_);
  const CaptureFrame& train = session_.frames.back();
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(train.gain[c], warming_up(c, 0.6), 0.002);
  const Image raw = read_image(train.observed);
  const Photograph even = read_observed(train);
  const Photograph rows = read_observed_rows(train, 7, 9);
  for (int c = 0; c < 3; ++c) {
    EXPECT_FLOAT_EQ(even.radiance.at(5, 7, c), raw.at(5, 7, c) / train.gain[c]);
    EXPECT_EQ(rows.radiance.at(5, 0, c), even.radiance.at(5, 7, c));
  }
}

TEST_F(DriftOfReferences, WhereNothingDriftsNothingChanges) {
  for (const double noise : {0.0, 0.01, 0.1}) {
    take([](int, double) { return 1.0; }, noise);
    const Drift drift = remove_drift(session_);
    EXPECT_FALSE(drift.significant) << noise;
    EXPECT_EQ(session_.frames.back().gain, (std::array<float, 3>{1.0f, 1.0f, 1.0f}));
  }
}

TEST_F(DriftOfReferences, SomeoneInAThirdOfThePictureDoesNoHarm) {
  take(warming_up);
  change(4, [](Image& image) {
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width / 3; ++x)
        for (int c = 0; c < 3; ++c) image.at(x, y, c) *= 0.2f;
  });
  const Drift drift = measure_drift(session_);
  EXPECT_LT(worst_error(drift, warming_up), 0.005);
}

TEST_F(DriftOfReferences, AFlickerBreaksTheCurveAndIsNotUsed) {
  for (const int flicker : {1, 3, 7}) {
    take(warming_up);
    change(flicker, [](Image& image) {
      for (float& value : image.values) value *= 0.93f;
    });
    const Drift drift = measure_drift(session_);
    for (int k = 0; k < references; ++k) EXPECT_EQ(drift.points[k].used, k != flicker) << flicker << " " << k;
    EXPECT_LT(worst_error(drift, warming_up), 0.004);
  }
}

TEST_F(DriftOfReferences, AFastStartIsNoFlicker) {
  const auto fast = [](int, double share) { return 1.0 - 0.2 * -std::expm1(-12.0 * share); };
  take(fast);
  const Drift drift = measure_drift(session_);
  for (const DriftPoint& point : drift.points) EXPECT_TRUE(point.used) << point.frame;
}

TEST_F(DriftOfReferences, AStepIsDriftToo) {
  const auto step = [](int, double share) { return share < 0.5 ? 1.0 : 0.9; };
  take(step);
  const Drift drift = measure_drift(session_);
  for (const DriftPoint& point : drift.points) EXPECT_TRUE(point.used) << point.frame;
  EXPECT_NEAR(drift.gain_at(last_order)[1], 0.9, 0.002);
}

// Gains that differ from photograph to photograph say nothing of those between two references.
TEST_F(DriftOfReferences, ScatterIsNoDrift) {
  take([](int, double share) { return 1.0 + 0.01 * std::cos(std::numbers::pi * (references - 1) * share); });
  EXPECT_FALSE(remove_drift(session_).significant);
  EXPECT_EQ(session_.frames.back().gain, (std::array<float, 3>{1.0f, 1.0f, 1.0f}));
}

TEST_F(DriftOfReferences, FewerThanTwoFramesSayNothing) {
  take(warming_up);
  session_.frames.erase(session_.frames.begin() + 1, session_.frames.begin() + references);
  session_.frames.back().gain = {2.0f, 2.0f, 2.0f};
  EXPECT_TRUE(remove_drift(session_).points.empty());
  EXPECT_EQ(session_.frames.back().gain[0], 2.0f) << "a gain that is known stays";
}

TEST_F(DriftOfReferences, FramesOfTwoLightsAreRefused) {
  take(warming_up);
  write_exr(folder_ / "other.exr", Image(4, 3, 3, 0.6f));
  session_.frames[2].illumination = folder_ / "other.exr";
  EXPECT_THROW(measure_drift(session_), InputError);
  write_exr(folder_ / "other.exr", Image(4, 3, 3, 0.7f));
  EXPECT_NO_THROW(measure_drift(session_));
}

TEST_F(DriftOfReferences, TheManifestKeepsTheOrder) {
  take(warming_up);
  write_session_manifest(session_);
  const CaptureSession read = read_capture_session(folder_.path());
  ASSERT_EQ(read.frames.size(), session_.frames.size());
  for (std::size_t i = 0; i < read.frames.size(); ++i)
    EXPECT_EQ(read.frames[i].order, session_.frames[i].order);
  // Without a word in the manifest the place counts.
  for (CaptureFrame& frame : session_.frames) frame.order = 0.0;
  write_session_manifest(session_);
  EXPECT_EQ(read_text(folder_ / session_manifest_name).find("order"), std::string::npos);
  EXPECT_EQ(read_capture_session(folder_.path()).frames[4].order, 4.0);
}

}  // namespace
}  // namespace refield
