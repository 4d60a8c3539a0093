// SPDX-License-Identifier: Apache-2.0
// Photographs that do not fit the others are found, named and left out, and the field is as if they had never
// been taken.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "core/base/rng.h"
#include "core/image/image_io.h"
#include "estimate/estimate.h"
#include "estimate/quality/frame_check.h"
#include "tests/support/stability.h"
#include "tests/support/synthetic_capture.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using test::change_photograph;

class OutlierFrames : public testing::Test {
 protected:
  OutlierFrames() : session_(test::write_capture(folder_ / "session", scene_.truth, scene_.lights, 0.01)) {
    options_.kernels = 12;
    options_.spatial_passes = 0;
  }
  EstimateSummary estimate(const EstimateOptions& options) {
    return estimate_to_file(session_, options, folder_ / "f.rfield", false);
  }
  FrameReport report() {
    EstimateJob job = open_job(session_, options_);
    return check_frames(job, options_);
  }
  static std::vector<std::string> names(const FrameReport& report) {
    std::vector<std::string> result;
    for (const LeftOutFrame& frame : report.left_out) result.push_back(frame.name);
    return result;
  }
  /// Photograph j becomes one under the mean of two other lights, which no pairing puts right.
  void photograph_other_light(int j) {
    const Image a = read_image(session_.frames[j + 5].observed),
                b = read_image(session_.frames[j + 8].observed);
    change_photograph(session_.frames[j], [&](Image& image) {
      for (std::size_t i = 0; i < image.values.size(); ++i)
        image.values[i] = 0.5f * (a.values[i] + b.values[i]);
    });
  }
  double error(const EstimateOptions& options) { return scene_.error(estimate_field(session_, options)); }

  /// Damages the capture and compares: found, error near the undisturbed one, far from that of keeping them.
  void expect_found(const std::string& setting, const std::vector<std::string>& damaged,
                    const std::function<void()>& damage, double least_harm) {
    const double clean = error(options_);
    damage();
    EXPECT_EQ(names(report()), damaged);
    const double left_out = error(options_);
    EstimateOptions keep = options_;
    keep.keep_outliers = true;
    const double kept = error(keep);
    test::record_figure({"outlier frames", setting + ", left out", left_out, clean,
                         scene_.error_of_constant(session_), scene_.error_of_ridge(session_)});
    test::record_figure({"outlier frames", setting + ", kept", kept, clean,
                         scene_.error_of_constant(session_), scene_.error_of_ridge(session_)});
    EXPECT_LT(left_out, 1.15 * clean);
    EXPECT_GT(kept, least_harm * left_out) << "the damage did no harm: the test shows nothing";
  }

  test::StabilityScene scene_;
  test::TemporaryFolder folder_;
  CaptureSession session_;
  EstimateOptions options_;
};

TEST_F(OutlierFrames, AGoodCaptureKeepsAll) {
  EXPECT_EQ(names(report()), std::vector<std::string>{});
  // Nor do few images, or noise with heavy tails, make outliers.
  for (std::size_t j = 0; j < session_.frames.size(); ++j)
    change_photograph(session_.frames[j], [&](Image& image) {
      Rng rng(7, j);
      for (float& value : image.values)
        value *= static_cast<float>(1.0 + 0.02 * rng.normal() / std::max(0.05, std::sqrt(rng.uniform())));
    });
  EXPECT_EQ(names(report()), std::vector<std::string>{});
  for (const std::size_t count : {40, 20, 12}) {
    session_.frames.resize(count);
    EXPECT_EQ(names(report()), std::vector<std::string>{}) << count;
  }
}

TEST_F(OutlierFrames, AnUnusualLightIsNone) {
  // A white light and a thin bar among natural ones: poorly predicted, and known to be.
  scene_.lights[5].radiance = Image(32, 24, 3, 2.0f);
  scene_.lights[6].radiance = Image(32, 24, 3);
  for (int y = 0; y < 24; ++y)
    for (int x = 20; x < 22; ++x)
      for (int c = 0; c < 3; ++c) scene_.lights[6].radiance.at(x, y, c) = 1.0f;
  session_ = test::write_capture(folder_ / "session", scene_.truth, scene_.lights, 0.01);
  EXPECT_EQ(names(report()), std::vector<std::string>{});
}

TEST_F(OutlierFrames, AFlickerIsFoundAndMeasured) {
  expect_found(
      "3 of 80 dark", {"train_010", "train_011", "train_044"},
      [&] {
        for (const int j : {10, 11, 44})
          change_photograph(session_.frames[j], [](Image& image) {
            for (float& value : image.values) value *= 0.7f;
          });
      },
      1.1);
  for (const LeftOutFrame& frame : report().left_out) {
    EXPECT_EQ(frame.found.kind, OutlierFrame::Kind::brightness);
    for (const double change : frame.found.brightness) EXPECT_NEAR(change, -0.3, 0.02);
  }
}

TEST_F(OutlierFrames, PhotographsOfOtherLightsAreFound) {
  expect_found(
      "4 of 80 of other lights", {"train_003", "train_027", "train_050", "train_071"},
      [&] {
        for (const int j : {3, 27, 50, 71}) photograph_other_light(j);
      },
      1.3);
  for (const LeftOutFrame& frame : report().left_out) EXPECT_NE(frame.found.kind, OutlierFrame::Kind::region);
}

TEST_F(OutlierFrames, AWalkerIsFoundWhereHeIs) {
  scene_.of_pixels = 0.9;  // four fifths of the picture take no harm
  expect_found(
      "person in 4 of 80", {"train_020", "train_021", "train_022", "train_060"},
      [&] {
        for (const int j : {20, 21, 22, 60})
          change_photograph(session_.frames[j], [](Image& image) {
            for (int y = 0; y < image.height; ++y)
              for (int x = 4; x < 8; ++x)
                for (int c = 0; c < 3; ++c) image.at(x, y, c) = 0.05f;
          });
      },
      1.3);
  for (const LeftOutFrame& frame : report().left_out) {
    EXPECT_EQ(frame.found.kind, OutlierFrame::Kind::region);
    EXPECT_NEAR(frame.found.x, 6, 2);
    EXPECT_LT(frame.found.share, 0.4);
    EXPECT_NE(frame.why.find("something moved"), std::string::npos);
  }
}

TEST_F(OutlierFrames, UnmeasuredSamplesMakeNone) {
  const auto unmeasure =
      [&](const std::function<bool(std::size_t frame, std::size_t sample, Rng&)>& is_lost) {
        session_ = test::write_capture(folder_ / "session", scene_.truth, scene_.lights, 0.01);
        for (std::size_t j = 0; j < session_.frames.size(); ++j) {
          Photograph photograph = read_photograph(session_.frames[j].observed);
          photograph.sigma = Image(photograph.radiance.width, photograph.radiance.height, 3, 0.01f);
          Rng rng(5, j);
          for (std::size_t i = 0; i < photograph.sigma.values.size(); ++i)
            if (is_lost(j, i, rng)) photograph.sigma.values[i] = std::numeric_limits<float>::infinity();
          write_photograph(session_.frames[j].observed, photograph);
        }
      };
  const std::size_t half = 3 * static_cast<std::size_t>(session_.width) * session_.height / 2;
  unmeasure([](std::size_t, std::size_t, Rng& rng) { return rng.uniform() < 0.6; });
  EXPECT_EQ(names(report()), std::vector<std::string>{}) << "samples of all";
  unmeasure([](std::size_t j, std::size_t, Rng& rng) { return j >= 9 && rng.uniform() < 0.5; });
  EXPECT_EQ(names(report()), std::vector<std::string>{}) << "nine are whole";
  unmeasure([&](std::size_t j, std::size_t i, Rng&) { return j % 2 == 0 && i >= half; });
  EXPECT_EQ(names(report()), std::vector<std::string>{}) << "lower halves of every second";
  for (const int j : {10, 45})
    change_photograph(session_.frames[j], [](Image& image) {
      for (float& value : image.values) value *= 0.7f;
    });
  EXPECT_EQ(names(report()), (std::vector<std::string>{"train_010", "train_045"}));
}

TEST_F(OutlierFrames, APhotographWithTheRoomLightOnIsNamed) {
  Image ambient = read_photograph(session_.frames[0].observed).radiance;
  for (std::size_t i = 0; i < ambient.values.size(); ++i) {
    Rng rng(3, i / 3);
    ambient.values[i] = static_cast<float>(0.02 + 0.03 * rng.uniform());
  }
  session_.ambient = folder_ / "ambient.exr";
  write_exr(*session_.ambient, ambient);
  change_photograph(session_.frames[30], [&](Image& image) {
    for (std::size_t i = 0; i < image.values.size(); ++i) image.values[i] += 20.0f * ambient.values[i];
  });
  const FrameReport found = report();
  ASSERT_EQ(names(found), std::vector<std::string>{"train_030"});
  EXPECT_NE(found.left_out[0].why.find("the room light was on: it shows 2"), std::string::npos)
      << found.left_out[0].why;
  session_.ambient.reset();
  EXPECT_EQ(report().left_out.at(0).why.find("room light was on"), std::string::npos);
}

TEST_F(OutlierFrames, AreNamedInTheSummaryAndTheField) {
  for (const int j : {3, 50}) photograph_other_light(j);
  const EstimateSummary summary = estimate(options_);
  EXPECT_EQ(names(summary.frames), (std::vector<std::string>{"train_003", "train_050"}));
  EXPECT_EQ(summary.plan.images, 78);
  EstimateOptions keep = options_;
  keep.keep_outliers = true;
  EXPECT_EQ(estimate(keep).plan.images, 80);
  EXPECT_TRUE(estimate(keep).frames.left_out.empty());
}

TEST_F(OutlierFrames, WhereThereIsNoMajorityNoneIsLeftOut) {
  const auto exchange = [&](int first, int last) {
    for (int j = first; j < last; ++j)
      std::swap(session_.frames[j].observed, session_.frames[j + 40].observed);
  };
  exchange(0, 11);  // 22 of 80: seen, but more than a quarter
  const FrameReport many = report();
  EXPECT_TRUE(many.left_out.empty());
  EXPECT_GT(many.doubtful.size(), 20u);
  exchange(11, 40);
  EXPECT_TRUE(report().left_out.empty());
}

}  // namespace
}  // namespace refield
