// SPDX-License-Identifier: Apache-2.0
// What a rig does besides B = T L is found from the image pairs, and nothing is where there is nothing.
#include "estimate/rig/estimate_rig.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "core/base/errors.h"
#include "core/base/rng.h"
#include "core/image/image_io.h"
#include "core/session/capture_session.h"
#include "estimate/estimate.h"
#include "estimate/job/observations.h"
#include "estimate/rig/camera_path.h"
#include "estimate/rig/rig_model.h"
#include "relight/relighter.h"
#include "tests/support/message_of.h"
#include "tests/support/synthetic_capture.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using testing::HasSubstr;

/// A scene of smooth waves, whose photographs are known between the pixels, under random lights.
class WavyCapture {
 public:
  static constexpr int width = 64, height = 48, waves = 40;

  explicit WavyCapture(int images, double noise = 0.01, std::uint64_t seed = 1)
      : lights_(test::random_lights(images, 16, 12, seed)), noise_(noise), seed_(seed) {
    shift.assign(images, {0.0, 0.0});
    gain.assign(images, {1.0, 1.0, 1.0});
    room.assign(images, 0.0);
    light_of.resize(images);
    std::iota(light_of.begin(), light_of.end(), 0);
    for (LightMap& light : lights_)
      for (float& value : light.radiance.values) value = std::min(1.0f, 0.02f + 0.5f * value);
  }

  Eigen::Matrix3d mixing = Eigen::Matrix3d::Identity();
  double tone = 1.0;  ///< exponent of the true light
  std::vector<std::array<double, 2>> shift;
  std::vector<std::array<double, 2>> turn;  ///< radians, and growth; empty: none
  std::vector<std::array<double, 3>> gain;
  std::vector<double> room;
  std::vector<int> light_of;      ///< what each photograph shows
  std::vector<double> strength;   ///< of each texel, besides what the maps say; empty: 1
  bool has_edges = false;         ///< bars between pixels in place of waves: interpolation blurs them
  std::filesystem::path ambient;  ///< of a photograph of the room light; empty: none
  int hot_every = 0;              ///< rows and columns between pixels that show 100; 0: there are none

  int images() const { return static_cast<int>(lights_.size()); }

  RigReport report(float clip_level = INFINITY) {
    photograph();
    const auto features = light_features(session_.frames, session_.light, {});
    const std::vector<char> none(lights_.size(), 0);
    return estimate_rig(session_.frames, none, session_, {}, clip_level, features, {});
  }
  std::vector<int> pairing() {
    photograph();
    const auto features = light_features(session_.frames, session_.light, {});
    const auto sample = read_pixel_sample(session_.frames, width, height, {}, INFINITY, {});
    finding_ = {};
    return find_pairing(features, sample, session_.frames, false, finding_, {});
  }
  std::vector<LightMap>& lights() { return lights_; }
  const CaptureSession& session() const { return session_; }
  /// Of the last pairing().
  const RigFinding& finding() const { return finding_; }

 private:
  /// The sum of the light in a blob around the wave's own place.
  double lit(const LightMap& light, int wave, int c) const {
    Rng rng(seed_ + 77, static_cast<std::uint64_t>(wave));
    const double x0 = 16 * rng.uniform(), y0 = 12 * rng.uniform(), reach = 1.5 + 2.0 * rng.uniform();
    double sum = 0.0;
    for (int y = 0; y < 12; ++y)
      for (int x = 0; x < 16; ++x)
        sum += std::exp(-0.5 * ((x - x0) * (x - x0) + (y - y0) * (y - y0)) / (reach * reach)) *
               std::pow(light.radiance.at(x, y, c), tone) *
               (strength.empty() ? 1.0 : strength[static_cast<std::size_t>(16 * y + x)]);
    return sum / (reach * reach);
  }

  void photograph() {
    photographs_.clear();
    std::vector<Image> scenes;
    Image mean(width, height, 1);
    for (int j = 0; j < images(); ++j) {
      Image& image = scenes.emplace_back(width, height, 3);
      for (int c = 0; c < 3; ++c)
        for (int w = 0; w < waves; ++w) {
          Rng rng(seed_ + 5, static_cast<std::uint64_t>(10 * w + c));
          const double angle = 2 * std::numbers::pi * rng.uniform(), phase = 6.0 * rng.uniform(),
                       period = 7.0 + 8.0 * rng.uniform(),
                       power = lit(lights_[static_cast<std::size_t>(light_of[j])], w, c) / waves;
          for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x) {
              double u = x - shift[j][0], v = y - shift[j][1];
              if (!turn.empty()) {
                const double right = u - width / 2, down = v - height / 2;
                u += turn[j][0] * down - turn[j][1] * right;
                v -= turn[j][0] * right + turn[j][1] * down;
              }
              const double along = u * std::cos(angle) + v * std::sin(angle);
              double wave = 0.8 * std::sin(2 * std::numbers::pi * along / period + phase);
              if (has_edges)
                wave = std::sin(12 * std::numbers::pi * along / period + phase) > 0.0 ? 0.8 : -0.8;
              image.at(x, y, c) += static_cast<float>(power * (1.0 + wave));
            }
        }
      for (std::size_t i = 0; i < image.values.size(); ++i)
        mean.values[i / 3] += image.values[i] / static_cast<float>(3 * images());
    }
    Image dark(width, height, 3);  // the room light: brighter to the right, as bright as a tenth of the scene
    for (std::size_t i = 0; i < dark.values.size(); ++i)
      dark.values[i] = 0.1f * mean.values[0] * (0.5f + static_cast<float>(i / 3 % width) / width);
    for (int j = 0; j < images(); ++j) {
      Image& image = scenes[static_cast<std::size_t>(j)];
      Rng rng(seed_ + 9, static_cast<std::uint64_t>(j));
      for (std::size_t i = 0; i < image.values.size(); i += 3) {
        Eigen::Vector3d pixel(image.values[i], image.values[i + 1], image.values[i + 2]);
        pixel.array() += room[j] * (ambient.empty() ? mean.values[i / 3] : dark.values[i]);
        pixel = mixing * pixel;
        for (int c = 0; c < 3; ++c)
          image.values[i + c] = static_cast<float>(gain[j][c] * pixel[c] * (1.0 + noise_ * rng.normal()));
      }
      for (int y = 3; hot_every > 0 && y < height; y += hot_every)
        for (int x = 3; x < width; x += hot_every) image.at(x, y, y % 3) = 100.0f;
      photographs_.push_back(std::move(image));
    }
    session_ = {};
    if (!ambient.empty()) {
      write_exr(ambient, dark);
      session_.ambient = ambient;
    }
    session_.width = width;
    session_.height = height;
    session_.light = {16, 12, Parameterisation::monitor};
    for (int j = 0; j < images(); ++j) {
      CaptureFrame& frame = session_.frames.emplace_back();
      frame.name = std::to_string(j);
      frame.order = j;
      frame.views = {
          lights_[static_cast<std::size_t>(j)].radiance, photographs_[static_cast<std::size_t>(j)], {}};
    }
  }

  std::vector<LightMap> lights_;
  std::vector<Image> photographs_;
  CaptureSession session_;
  RigFinding finding_;
  double noise_;
  std::uint64_t seed_;
};

const RigFinding& finding(const RigReport& report, const std::string& effect) {
  const auto found = std::ranges::find(report.findings, effect, &RigFinding::effect);
  EXPECT_NE(found, report.findings.end()) << effect;
  return *found;
}

double shift_error(const RigReport& report, const WavyCapture& capture) {
  if (report.model.shift_px.empty()) return INFINITY;
  double sum = 0.0;
  for (std::size_t j = 0; j < capture.shift.size(); ++j)
    for (int i = 0; i < 2; ++i)
      sum += std::pow(report.model.shift_px[j][i] - (capture.shift[j][i] - capture.shift[0][i]), 2);
  return std::sqrt(sum / static_cast<double>(2 * capture.shift.size()));
}

constexpr double max_shift_error_px = 0.03, max_mixing_error = 0.02, max_tone_error = 0.012;

TEST(Rig, AnUndisturbedCaptureIsTheIdentity) {
  for (const std::uint64_t seed : {1, 2, 3})
    for (const double noise : {0.0, 0.01, 0.05}) {
      const RigReport report = WavyCapture(40, noise, seed).report();
      EXPECT_TRUE(report.model.is_identity()) << seed << " " << noise << " " << rig_text(report.model);
      EXPECT_EQ(report.findings.size(), 5u);
    }
}

TEST(Rig, FewImagesSayNothing) {
  WavyCapture capture(min_frames_for_rig - 1);
  for (std::size_t j = 10; j < capture.shift.size(); ++j) capture.shift[j] = {0.5, 0.0};
  EXPECT_TRUE(capture.report().findings.empty());
}

TEST(Rig, ACreepingCameraIsALine) {
  WavyCapture capture(60);
  for (int j = 0; j < 60; ++j) capture.shift[j] = {0.3 * j / 59, -0.2 * j / 59};
  const RigReport report = capture.report();
  EXPECT_LT(shift_error(report, capture), max_shift_error_px);
  EXPECT_NE(finding(report, "motion").measured.find("steadily"), std::string::npos);
  EXPECT_FALSE(report.model.mixes_colours());
}

TEST(Rig, HotPixelsDoNotHideAMovingCamera) {
  WavyCapture capture(60);
  for (int j = 0; j < 60; ++j) capture.shift[j] = {0.3 * j / 59, -0.2 * j / 59};
  capture.hot_every = 6;  // no pixel has a neighbourhood without
  EXPECT_LT(shift_error(capture.report(50.0f), capture), max_shift_error_px);
}

TEST(Rig, ABumpIsAJumpWithItsPlace) {
  WavyCapture capture(60);
  for (int j = 25; j < 60; ++j) capture.shift[j] = {-0.4, 0.9};
  const RigReport report = capture.report();
  EXPECT_LT(shift_error(report, capture), max_shift_error_px);
  EXPECT_NE(finding(report, "motion").measured.find("moved after 24,"), std::string::npos);
}

TEST(Rig, RotationAndScaleAreFollowed) {
  for (const std::array<double, 2> last : {std::array{0.005, 0.0}, {0.0, -0.005}}) {
    WavyCapture capture(60);
    for (int j = 0; j < 60; ++j) capture.turn.push_back({last[0] * j / 59, last[1] * j / 59});
    const RigReport report = capture.report();
    EXPECT_EQ(finding(report, "motion").state, RigFinding::State::corrected);
    constexpr double corner_px = 40.0, max_error_px = 0.05;
    EXPECT_NEAR(finding(report, "motion").amount, corner_px * 0.005, max_error_px);
    EXPECT_THAT(finding(report, "motion").measured,
                HasSubstr(last[0] > 0.0 ? "turned by 0.2" : "grew by -0.5"));
    ASSERT_EQ(report.model.turn.size(), capture.turn.size());
    for (std::size_t j = 0; j < 60; ++j)
      for (int i = 0; i < 2; ++i)
        EXPECT_NEAR(corner_px * report.model.turn[j][i], corner_px * capture.turn[j][i], max_error_px) << j;
  }
}

TEST(Rig, ATurnBesideAShiftIsFollowed) {
  WavyCapture capture(60);
  for (std::size_t j = 0; j < 60; ++j) {
    capture.turn.push_back({j < 30 ? 0.0 : -0.008, 0.0});
    if (j >= 30) capture.shift[j] = {0.3, -0.2};
  }
  const RigReport report = capture.report();
  EXPECT_LT(shift_error(report, capture), max_shift_error_px);
  ASSERT_EQ(report.model.turn.size(), capture.turn.size());
  EXPECT_NEAR(report.model.turn[45][0], -0.008, 0.001);
  EXPECT_NEAR(report.model.turn[45][1], 0.0, 0.001);
}

TEST(Rig, ACameraThatMovedTooFarIsToldAndNotCorrected) {
  WavyCapture capture(60);
  for (int j = 30; j < 60; ++j) capture.shift[j] = {9.0, 0.0};
  const RigReport report = capture.report();
  EXPECT_TRUE(report.model.shift_px.empty());
  EXPECT_EQ(finding(report, "motion").state, RigFinding::State::unusable);
  EXPECT_THAT(finding(report, "motion").measured, HasSubstr("by about 9 pixels near 30"));
}

TEST(Rig, EdgesThatInterpolationBlursAreNotMovedBack) {
  WavyCapture capture(60);
  for (int j = 25; j < 60; ++j) capture.shift[j] = {0.4, -0.3};
  EXPECT_FALSE(capture.report().model.shift_px.empty());
  capture.has_edges = true;
  const RigReport report = capture.report();
  EXPECT_TRUE(report.model.is_identity()) << rig_text(report.model);
  EXPECT_EQ(finding(report, "motion").state, RigFinding::State::suspicious);
  EXPECT_THAT(finding(report, "motion").measured, HasSubstr("blur more"));
}

TEST(Rig, ARandomWalkIsFollowed) {
  WavyCapture capture(60);
  Rng rng(4);
  for (int j = 1; j < 60; ++j)
    for (int i = 0; i < 2; ++i) capture.shift[j][i] = capture.shift[j - 1][i] + 0.05 * rng.normal();
  EXPECT_LT(shift_error(capture.report(), capture), max_shift_error_px);
}

TEST(Rig, ColourMixingIsFoundAndUndone) {
  WavyCapture capture(60);
  capture.mixing << 1, 0.05, 0.12, 0.15, 1, 0.02, -0.03, 0.1, 1;
  const RigReport report = capture.report();
  EXPECT_LT((report.model.mixing - capture.mixing).cwiseAbs().maxCoeff(), max_mixing_error);
  EXPECT_EQ(finding(report, "colour").state, RigFinding::State::corrected);
  EXPECT_LT(finding(report, "colour").residual_after, finding(report, "colour").residual_before);
}

TEST(Rig, ColourMixingThatFewPhotographsCannotTellIsDoubtful) {
  WavyCapture capture(24);
  Rng rng(1);
  for (auto& gain : capture.gain)
    for (double& of : gain) of = 1.0 + 0.02 * rng.normal();
  EXPECT_EQ(finding(capture.report(), "colour").state, RigFinding::State::good);
  capture.mixing << 1, 0.05, 0.12, 0.15, 1, 0.02, 0.03, 0.1, 1;
  const RigReport report = capture.report();
  EXPECT_TRUE(report.model.is_identity()) << rig_text(report.model);
  EXPECT_EQ(finding(report, "colour").state, RigFinding::State::suspicious);
  EXPECT_THAT(finding(report, "colour").measured, HasSubstr("do not agree"));
}

/// Grey lights, and in the end one full-screen light of each primary.
WavyCapture grey_capture_with_primaries() {
  WavyCapture capture(60);
  for (std::size_t j = 0; j < 60; ++j) {
    auto& values = capture.lights()[j].radiance.values;
    for (std::size_t i = 0; i < values.size(); i += 3) values[i + 1] = values[i + 2] = values[i];
    for (std::size_t i = 0; j >= 57 && i < values.size(); ++i) values[i] = i % 3 == j - 57 ? 1.0f : 0.0f;
  }
  return capture;
}

TEST(Rig, PrimariesMeasureColourMixing) {
  WavyCapture capture = grey_capture_with_primaries();
  EXPECT_TRUE(capture.report().model.is_identity());
  capture.mixing << 1, 0.05, 0.12, 0.15, 1, 0.02, 0.03, 0.1, 1;
  const RigReport report = capture.report();
  constexpr double noise = 0.005;  // of medians over 200 pixels
  EXPECT_LT((report.model.mixing - capture.mixing).cwiseAbs().maxCoeff(), noise);
  EXPECT_EQ(finding(report, "colour").state, RigFinding::State::corrected);
}

TEST(Rig, ToneCurveAndConstantRoomLightAreToldApart) {
  WavyCapture capture(60);
  capture.tone = 1.06;
  capture.room.assign(60, 0.02);
  const RigReport report = capture.report();
  for (const double exponent : report.model.tone) EXPECT_NEAR(exponent, capture.tone, max_tone_error);
  capture.tone = 1.0;
  EXPECT_FALSE(capture.report().model.bends_tone());
}

// It looks like gains as long as the mean photograph stands for it.
TEST(Rig, RoomLightThatChangesIsAMultipleOfTheAmbientPhotograph) {
  const test::TemporaryFolder folder;
  WavyCapture capture(80);
  capture.ambient = folder / "ambient.exr";
  EXPECT_TRUE(capture.report().model.is_identity());
  for (std::size_t j = 40; j < 80; ++j) capture.room[j] = 1.0;
  const RigReport report = capture.report();
  EXPECT_TRUE(report.model.ambient_room);
  EXPECT_TRUE(report.model.gain.empty()) << rig_text(report.model);
  ASSERT_EQ(report.model.room.size(), capture.room.size());
  constexpr double max_error = 0.1;  // of the ambient photograph: 1 % of the scene
  for (std::size_t j = 0; j < 80; ++j)
    EXPECT_NEAR(report.model.room[j] - report.model.room[0], capture.room[j], max_error) << j;
  RigModel twice;
  twice.photographs = report.model.photographs;
  twice.room.assign(80, 2.0);
  twice.ambient_room = true;
  auto frames = capture.session().frames;
  const auto shown = read_observations(frames, WavyCapture::width, 7, 9, INFINITY, {});
  apply_rig(twice, capture.session(), frames);
  const auto left = read_observations(frames, WavyCapture::width, 7, 9, INFINITY, {});
  const Image ambient = read_image(capture.ambient);
  for (int c = 0; c < 3; ++c)
    EXPECT_EQ(left.samples(20, 8, c)[3], shown.samples(20, 8, c)[3] - 2.0f * ambient.at(20, 8, c));
  EXPECT_THAT(test::message_of([&] { apply_rig(twice, CaptureSession(), frames); }),
              HasSubstr("ambient photograph"));
}

// Where each photograph has one light source, an exponent only changes their brightness.
TEST(Rig, SingleLightSourcesTellNoToneCurve) {
  WavyCapture capture(48);
  Rng rng(4);
  for (int j = 0; j < capture.images(); ++j) {
    Image& light = capture.lights()[static_cast<std::size_t>(j)].radiance;
    std::ranges::fill(light.values, 0.0f);
    const float brightness = 0.3f + 0.7f * static_cast<float>(rng.uniform());
    for (int y = 0; y < 3; ++y)
      for (int x = 0; x < 3; ++x)
        for (int c = 0; c < 3; ++c)
          light.at(j % 8 * 2 + std::min(x, 1), std::min(j / 8 * 2 + y, 11), c) = brightness;
  }
  capture.tone = 1.3;
  EXPECT_FALSE(capture.report().model.bends_tone());
}

// Sources of a light stage whose strength differs from that in the maps change the brightness as gains do.
TEST(Rig, StrengthOfLightSourcesIsNoGain) {
  WavyCapture capture(100);
  Rng rng(4);
  for (int i = 0; i < 16 * 12; ++i) capture.strength.push_back(std::exp(0.3 * rng.normal()));
  for (LightMap& light : capture.lights())
    for (int y = 0; y < 12; ++y)
      for (int x = 0; x < 16; ++x) {
        const auto grey = static_cast<float>(x % 2 == 0 && y % 2 == 0 ? rng.uniform() : 0.0);
        for (int c = 0; c < 3; ++c) light.radiance.at(x, y, c) = grey;
      }
  const RigReport report = capture.report();
  EXPECT_TRUE(report.model.is_identity()) << rig_text(report.model);
}

TEST(Rig, WhiteBalanceOfEachPhotographIsFound) {
  for (const auto& [deviation, max_error] : {std::pair(0.03, 0.3), {0.015, 0.6}}) {
    WavyCapture capture(60);
    Rng rng(8);
    for (auto& gain : capture.gain)
      for (double& of : gain) of = 1.0 + deviation * rng.normal();
    const RigReport report = capture.report();
    ASSERT_FALSE(report.model.gain.empty()) << deviation;
    double error = 0.0, size = 0.0;
    for (int j = 0; j < 60; ++j) {
      const double true_ratio = capture.gain[j][0] / capture.gain[j][2],
                   found = report.model.gain[j][0] / report.model.gain[j][2];
      error += std::pow(found - true_ratio, 2);
      size += std::pow(true_ratio - 1.0, 2);
    }
    EXPECT_LT(error, max_error * size) << deviation;
    EXPECT_FALSE(report.model.mixes_colours());
  }
}

/// A monitor that warms up: each channel by its own amount, along a curve.
TEST(Rig, ADriftOfTheBrightnessIsFollowed) {
  WavyCapture capture(80);
  for (int j = 0; j < 80; ++j) {
    const double t = j / 79.0;
    capture.gain[j] = {1.0 + 0.03 * t, 1.0 + 0.05 * t * t, 1.0};
  }
  const RigReport report = capture.report();
  ASSERT_EQ(report.model.gain.size(), 80u);
  EXPECT_TRUE(report.model.room.empty());
  for (int c = 0; c < 3; ++c)
    for (const int j : {40, 79}) {
      const double found = report.model.gain[j][c] / report.model.gain[0][c];
      EXPECT_NEAR(found, capture.gain[j][c] / capture.gain[0][c], 0.004) << j << " " << c;
    }
  const auto finding = std::ranges::find(report.findings, "gain", &RigFinding::effect);
  EXPECT_THAT(finding->measured, testing::HasSubstr("drifted by"));
}

TEST(Rig, RoomLightThatGrowsIsNoDriftOfTheBrightness) {
  WavyCapture capture(80);
  for (int j = 0; j < 80; ++j) capture.room[j] = 0.06 * j / 79.0;
  const RigReport report = capture.report();
  EXPECT_TRUE(report.model.gain.empty());
  ASSERT_EQ(report.model.room.size(), 80u);
  EXPECT_NEAR(report.model.room[79] - report.model.room[0], 0.06, 0.015);
}

TEST(Rig, ColouredLightThatIsGreyTellsNothingOfMixing) {
  WavyCapture capture(60);
  for (LightMap& light : capture.lights())
    for (std::size_t i = 0; i < light.radiance.values.size(); i += 3)
      light.radiance.values[i + 1] = light.radiance.values[i + 2] = light.radiance.values[i];
  capture.mixing << 1, 0.1, 0.1, 0.1, 1, 0.1, 0.1, 0.1, 1;
  EXPECT_FALSE(capture.report().model.mixes_colours());
}

TEST(Rig, PairsThatAreRightStay) {
  for (const std::uint64_t seed : {1, 2, 3})
    EXPECT_TRUE(WavyCapture(40, 0.02, seed).pairing().empty()) << seed;
}

TEST(Rig, AnotherOffsetOfThePairsIsFound) {
  for (const int offset : {1, -2, 7}) {
    WavyCapture capture(40);
    for (int j = 0; j < 40; ++j) capture.light_of[j] = (j + offset + 40) % 40;
    const std::vector<int> truth = capture.light_of;
    EXPECT_EQ(capture.pairing(), truth) << offset;
  }
}

TEST(Rig, ADoubledAndAMissingPhotographAreFound) {
  for (const int offset : {-1, 1}) {
    WavyCapture capture(50);
    for (int j = 20; j < 50; ++j) capture.light_of[j] = std::min(j + offset, 49);
    const std::vector<int> found = capture.pairing();
    ASSERT_FALSE(found.empty()) << offset;
    for (int j = 0; j < 48; ++j)
      if (j < 19 || j > 21) {
        EXPECT_EQ(found[j], capture.light_of[j]) << j;
      }
    const int twin = offset < 0 ? 19 : 48;
    EXPECT_TRUE(found[twin] == -1 || found[twin + 1] == -1);
    EXPECT_THAT(capture.finding().measured, HasSubstr(std::to_string(twin) + " and " +
                                                      std::to_string(twin + 1) + " show the same light"));
  }
}

TEST(Rig, PhotographsThatShowEachOthersLightsAreFoundAndNamed) {
  WavyCapture capture(50);
  std::swap(capture.light_of[7], capture.light_of[30]);
  std::swap(capture.light_of[11], capture.light_of[12]);
  std::swap(capture.light_of[12], capture.light_of[40]);
  EXPECT_EQ(capture.pairing(), capture.light_of);
  EXPECT_THAT(capture.finding().measured, HasSubstr("7 and 30 are exchanged"));
  EXPECT_THAT(capture.finding().measured, HasSubstr("11 shows the light of 12"));
}

TEST(Rig, RandomPairsAreLeftAsTheyAre) {
  WavyCapture capture(40);
  Rng rng(6);
  for (int j = 39; j > 0; --j)
    std::swap(capture.light_of[j], capture.light_of[static_cast<int>(rng.uniform() * (j + 1))]);
  EXPECT_TRUE(capture.pairing().empty());
  EXPECT_EQ(capture.finding().state, RigFinding::State::unusable);
}

/// What is found of the pairs of photographs and lights of white noise. A pixel sees two texels; or, where
/// the patterns were not shown, nothing but a steady room.
RigFinding pairs_of_white_noise(int images, bool is_lit) {
  constexpr int columns = 12, rows = 8, side_px = 16;
  std::vector<Image> lights, photographs;
  CaptureSession session;
  session.width = session.height = side_px;
  session.light = {columns, rows, Parameterisation::monitor};
  for (int j = 0; j < images; ++j) {
    Rng rng(3, static_cast<std::uint64_t>(j));
    Image& light = lights.emplace_back(columns, rows, 3);
    for (float& value : light.values) value = static_cast<float>(rng.uniform());
    Image& photograph = photographs.emplace_back(side_px, side_px, 3, is_lit ? 0.0f : 1.0f);
    for (int p = 0; p < side_px * side_px; ++p) {
      Rng of_pixel(4, static_cast<std::uint64_t>(p));
      for (int texel = 0; texel < (is_lit ? 2 : 0); ++texel) {
        const std::uint64_t seen = of_pixel.below(columns * rows);
        for (int c = 0; c < 3; ++c) photograph.values[3 * p + c] += light.values[3 * seen + c];
      }
      for (int c = 0; c < 3; ++c) photograph.values[3 * p + c] *= static_cast<float>(1 + 0.01 * rng.normal());
    }
  }
  for (int j = 0; j < images; ++j)
    session.frames.emplace_back().views = {
        lights[static_cast<std::size_t>(j)], photographs[static_cast<std::size_t>(j)], {}};
  const auto sample = read_pixel_sample(session.frames, side_px, side_px, {}, INFINITY, {});
  RigFinding finding;
  const auto light_of = find_pairing(light_features(session.frames, session.light, {}), sample,
                                     session.frames, false, finding, {});
  EXPECT_TRUE(light_of.empty()) << images;
  return finding;
}

// Lights of white noise have only their mean in common, which fits any photograph.
TEST(Rig, WhiteNoiseDoesNotMakeRightPairsUnusable) {
  for (const int images : {90, 120}) {
    const RigFinding finding = pairs_of_white_noise(images, true);
    EXPECT_EQ(finding.state, RigFinding::State::good) << images << ": " << finding.measured;
  }
}

TEST(Rig, PhotographsThatShowNoPatternAreNamed) {
  for (const int images : {30, 90}) {
    const RigFinding finding = pairs_of_white_noise(images, false);
    EXPECT_EQ(finding.state, RigFinding::State::unusable) << images;
    EXPECT_THAT(finding.measured, HasSubstr("do not change with the light")) << images;
  }
}

TEST(Rig, RepeatedLightsDoNotHideAMovingCamera) {
  // Photographs that follow each other show the same light: each is predicted to the noise by its twin.
  WavyCapture capture(80);
  for (std::size_t j = 0; j < 80; j += 2)
    for (std::size_t i = 0; i < capture.lights()[j].radiance.values.size(); ++i)
      capture.lights()[j + 1].radiance.values[i] = 0.5f * capture.lights()[j].radiance.values[i];
  for (int j = 0; j < 80; ++j) capture.shift[j] = {0.4 * j / 79, 0.2 * j / 79};
  EXPECT_LT(shift_error(capture.report(), capture), max_shift_error_px);
}

TEST(CapturePath, ChoosesTheFewestParameters) {
  std::vector<int> all(80);
  std::iota(all.begin(), all.end(), 0);
  const Eigen::VectorXd even = Eigen::VectorXd::Ones(80);
  Eigen::MatrixXd noise(80, 2);
  Rng rng(3);
  for (Eigen::Index i = 0; i < noise.size(); ++i) noise.data()[i] = 0.01 * rng.normal();
  const auto kind = [&](const Eigen::MatrixXd& path) {
    return choose_path(path + noise, even, all, 80, 0.005);
  };
  Eigen::MatrixXd path = Eigen::MatrixXd::Zero(80, 2);
  EXPECT_EQ(kind(path).kind, CapturePath::Kind::rest);
  EXPECT_EQ(kind(path).values.cwiseAbs().maxCoeff(), 0.0);
  for (int j = 0; j < 80; ++j) path.row(j) << 0.004 * j, 0.0;
  EXPECT_EQ(kind(path).kind, CapturePath::Kind::line);
  EXPECT_LT((kind(path).values - path).cwiseAbs().maxCoeff(), 0.015);
  path.setZero();
  path.bottomRows(50).col(1).setConstant(0.2);
  path.bottomRows(10).col(0).setConstant(-0.1);
  EXPECT_EQ(kind(path).jumps, (std::vector<int>{30, 70}));
  for (int j = 1; j < 80; ++j)
    path.row(j) = path.row(j - 1) + Eigen::RowVector2d(0.04 * rng.normal(), 0.04 * rng.normal());
  EXPECT_EQ(kind(path).kind, CapturePath::Kind::walk);
}

TEST(RigModel, TextGivesTheSameModel) {
  RigModel rig;
  rig.photographs = {"a", "b"};
  rig.light_of = {1, -1};
  rig.shift_px = {{0.0, 0.0}, {0.1, -1.0 / 3.0}};
  rig.turn = {{0.0, 0.0}, {0.001, -0.002}};
  rig.mixing(0, 1) = 0.1;
  rig.tone = {1.01, 1.0, 0.97};
  rig.white = 0.9;
  rig.gain = {{1.0, 1.01, 0.99}, {1.0, 1.0, 1.0}};
  rig.room = {0.0, 0.02};
  EXPECT_EQ(rig_text(rig_from_text(rig_text(rig), "test")), rig_text(rig));
  EXPECT_THROW(rig_from_text("{}", "test"), InputError);
  EXPECT_THROW(rig_from_text(R"({"photographs": ["a"], "room": [1, 2]})", "test"), InputError);
  std::vector<CaptureFrame> frames(1);
  frames[0].name = "c";
  EXPECT_THROW(apply_rig(rig, CaptureSession(), frames), InputError);
}

TEST(RigModel, UndoesShiftGainAndMixingOfAParabola) {
  // Cubic convolution is exact for parabolas.
  Image image(12, 10, 3);
  FrameCorrection correction;
  correction.shift_px = {0.3, -1.6};
  correction.gain = {1.1f, 1.0f, 0.9f};
  Eigen::Matrix3f mixing;
  mixing << 1, 0.1f, 0, 0.2f, 1, 0, 0, 0.1f, 1;
  correction.primaries_from_camera = mixing.inverse();
  const auto truth = [](double x, double y, int c) {
    return static_cast<float>(1.0 + 0.1 * x * y + 0.02 * c * x * x - 0.03 * y * y + c);
  };
  for (int y = 0; y < 10; ++y)
    for (int x = 0; x < 12; ++x) {
      Eigen::Vector3f pixel;
      for (int c = 0; c < 3; ++c) pixel[c] = truth(x - 0.3, y + 1.6, c);
      pixel = (mixing * pixel).eval();
      for (int c = 0; c < 3; ++c) image.at(x, y, c) = correction.gain[c] * pixel[c];
    }
  const Image undone = undo_rig(image, {}, 0, 4, 7, correction);
  for (int y = 4; y < 7; ++y)
    for (int x = 2; x < 9; ++x)
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(undone.at(x, y - 4, c), truth(x, y, c), 1e-4);
}

TEST(RigModel, UndoesATurnOfAParabola) {
  Image image(13, 11, 3);
  FrameCorrection correction;
  correction.width_px = image.width;
  correction.height_px = image.height;
  correction.shift_px = {0.3, -0.2};
  correction.turn = {0.05, -0.03};
  const auto truth = [](double x, double y) {
    return static_cast<float>(1.0 + 0.1 * x * y + 0.02 * x * x - 0.03 * y * y);
  };
  Eigen::Matrix2d turned;  // of places from the middle, (6, 5)
  turned << 1.0 + correction.turn[1], -correction.turn[0], correction.turn[0], 1.0 + correction.turn[1];
  for (int y = 0; y < 11; ++y)
    for (int x = 0; x < 13; ++x) {
      const Eigen::Vector2d at = turned.inverse() * Eigen::Vector2d(x - 6 - 0.3, y - 5 + 0.2);
      for (int c = 0; c < 3; ++c) image.at(x, y, c) = truth(at[0] + 6, at[1] + 5);
    }
  ASSERT_LE(rig_margin(&correction), 5);
  const Image undone = undo_rig(image, {}, 0, 4, 7, correction);
  for (int y = 4; y < 7; ++y)
    for (int x = 2; x < 11; ++x) EXPECT_NEAR(undone.at(x, y - 4, 1), truth(x, y), 1e-4) << x << " " << y;
}

TEST(RigModel, AClippedSampleTakesAlongOnlyWhatConsistsOfIt) {
  Image image(9, 5, 3);
  std::ranges::fill(image.values, 1.0f);
  std::vector<char> unmeasured(image.values.size(), 0);
  const auto clip = [&](int x, float shown) {
    image.at(x, 2, 0) = shown;
    unmeasured[(std::size_t{2} * 9 + x) * 3] = 1;
  };
  clip(4, 4.0f);
  FrameCorrection correction;
  const auto measured = [&](int x, int c) {
    return std::isfinite(undo_rig(image, unmeasured, 0, 0, 5, correction).at(x, 2, c));
  };
  correction.shift_px = {0.05, 0.0};  // Keys' weights of the pixels beside: −0.02 and 0.01
  EXPECT_FALSE(measured(4, 0));
  EXPECT_TRUE(measured(3, 0));
  EXPECT_TRUE(measured(5, 0));
  EXPECT_TRUE(measured(4, 1));
  correction.shift_px = {0.4, 0.0};  // pixel 3 is interpolated from pixel 4, which makes up most of it
  EXPECT_FALSE(measured(3, 0));
  EXPECT_TRUE(measured(1, 0));
  correction.shift_px = {};
  correction.primaries_from_camera(1, 0) = -0.05f;
  correction.primaries_from_camera(2, 0) = -0.5f;
  EXPECT_FALSE(measured(4, 0));
  EXPECT_TRUE(measured(4, 1));
  EXPECT_FALSE(measured(4, 2));
  clip(4, 0.0f);  // a dead pixel shows nothing, its neighbours do
  correction = {};
  correction.shift_px = {0.4, 0.0};
  EXPECT_FALSE(measured(3, 0));
}

/// Ten photographs, of which every fifth is held out, and the rig model of the others.
struct HeldOutCapture {
  CaptureSession session;
  RigModel rig;

  HeldOutCapture() {
    session.width = session.height = 8;
    for (int j = 0; j < 10; ++j) {
      CaptureFrame& frame = session.frames.emplace_back();
      frame.name = "photo_" + std::to_string(j);
      frame.illumination = "light_" + std::to_string(j);
      frame.order = j;
      frame.role = j % 5 == 4 ? FrameRole::test : FrameRole::train;
      if (frame.role == FrameRole::test) continue;
      rig.photographs.push_back(frame.name);
      rig.shift_px.push_back({0.1 * j, 0.0});
      rig.turn.push_back({0.0, 0.01 * j});
    }
  }
  void correct() { correct_held_out("{\"rig\":" + rig_text(rig) + "}", session); }
};

TEST(RigModel, HeldOutPhotographsTakeWhatTheirNeighboursHave) {
  HeldOutCapture capture;
  capture.rig.tone = {1.05, 1.0, 1.0};
  capture.rig.gain.assign(8, {2.0, 2.0, 2.0});
  capture.rig.mixing(0, 1) = 0.1;
  capture.correct();
  ASSERT_EQ(capture.session.frames.size(), 10u);
  EXPECT_FALSE(capture.session.frames[3].correction) << "of training frames the estimate knows";
  const auto correction = capture.session.frames[4].correction;
  ASSERT_TRUE(correction);
  EXPECT_NEAR(correction->shift_px[0], 0.4, 1e-9);
  EXPECT_NEAR(correction->turn[1], 0.04, 1e-9);
  EXPECT_NEAR(capture.session.frames[9].correction->shift_px[0], 0.8, 1e-9) << "as the last one known";
  EXPECT_FLOAT_EQ(correction->tone[0], 1.05f);
  EXPECT_EQ(correction->gain[0], 1.0f) << "not known";
  EXPECT_TRUE(correction->primaries_from_camera.isIdentity()) << "the field mixes colours itself";
  EXPECT_EQ(capture.session.frames[4].illumination, "light_4");
}

TEST(RigModel, HeldOutPhotographsArePairedAsTheirNeighboursAre) {
  HeldOutCapture capture;
  capture.rig.shift_px.clear();
  for (int j = 0; j < 8; ++j) capture.rig.light_of.push_back(j < 7 ? j + 1 : -1);
  capture.correct();
  EXPECT_EQ(capture.session.frames[4].illumination, "light_5");
  EXPECT_EQ(capture.session.frames.size(), 9u) << "the light after the last is not there";
}

TEST(RigModel, PhotographsOfAnotherCaptureStayAsTheyAre) {
  HeldOutCapture capture;
  for (CaptureFrame& frame : capture.session.frames) frame.name += "_of_another";
  capture.correct();
  for (const CaptureFrame& frame : capture.session.frames) EXPECT_FALSE(frame.correction);
}

TEST(RigModel, ReadersOfPhotographsUndoTheShift) {
  Image photograph(9, 8, 3), sigma(9, 8, 3);
  for (int y = 0; y < 8; ++y)
    for (int x = 0; x < 9; ++x)
      for (int c = 0; c < 3; ++c) photograph.at(x, y, c) = static_cast<float>(1 + x + 10 * y);
  sigma.at(2, 3, 1) = INFINITY;
  CaptureFrame frame;
  frame.views = {photograph, photograph, sigma};
  FrameCorrection correction;
  correction.height_px = 8;
  correction.shift_px = {0.5, 0.0};
  frame.correction = std::make_shared<const FrameCorrection>(correction);
  const Photograph read = read_observed(frame);
  EXPECT_NEAR(read.radiance.at(5, 4, 0), 1 + 5.5 + 40, 1e-4);
  EXPECT_TRUE(std::isinf(read.sigma.at(2, 3, 1))) << "was not measured";
  EXPECT_TRUE(std::isinf(read.sigma.at(1, 3, 1))) << "half of it was not measured";
  EXPECT_EQ(read.sigma.at(3, 3, 1), 0.0f) << "a sixteenth of it was not measured";
  EXPECT_EQ(read.sigma.at(5, 4, 0), 0.0f);
}

TEST(RigModel, TheFieldMixesColoursWhereItIsRelit) {
  const LightDomain domain{16, 12, Parameterisation::monitor};
  auto field = test::field_of_boxes(20, 18, domain, {{0, 0, 8, 6}, {4, 2, 16, 12}, {3, 3, 5, 9}}, 5);
  const auto lights = test::random_lights(2, 16, 12, 3);
  const Image plain = field.relight(lights[0]);
  field.output_from_primaries << 1, 0.1f, 0.02f, 0.2f, 1, 0.1f, 0, 0.15f, 1;
  const Image mixed = field.relight(lights[0]);
  TileRelighter relighter(field, RelightPrecision::fine);
  const Image first = relighter.relight(lights[1]);
  const Image& updated = relighter.update(lights[0], {0, 0, 16, 12});
  for (std::size_t i = 0; i < plain.values.size(); i += 3) {
    const Eigen::Vector3f expected =
        field.output_from_primaries *
        Eigen::Vector3f(plain.values[i], plain.values[i + 1], plain.values[i + 2]);
    for (int c = 0; c < 3; ++c) {
      EXPECT_NEAR(mixed.values[i + c], expected[c], 1e-5 * expected[c]);
      EXPECT_NEAR(updated.values[i + c], expected[c], 1e-4 * expected[c]);
    }
  }
}

}  // namespace
}  // namespace refield
