// SPDX-License-Identifier: Apache-2.0
// Two cameras with clocks of their own, one on the scene, one on the light: their series become a session
// that estimation takes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "acquire/series/match_series.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/rng.h"
#include "core/field_io/reflectance_field_file.h"
#include "tests/pipeline/program.h"
#include "tests/support/random_data.h"
#include "tests/support/series_error.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using test::TemporaryFolder;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

constexpr LightDomain sky_domain{16, 8, Parameterisation::lat_long};
constexpr ClockSeconds morning = 1'087'800'000.0;

class MatchSeries : public ::testing::Test {
 protected:
  /// Every two minutes; the scene's camera starts later, misses two photographs and its clock is ahead by
  /// `ahead`.
  explicit MatchSeries(double ahead = 431.0) : ahead_(ahead) {
    fs::create_directories(folder_ / "city");
    fs::create_directories(folder_ / "sky");
    Rng random(12);
    scene_ = test::random_field(random, 6, 4, sky_domain, 20, 3);
    std::map<std::string, ClockSeconds> city_times, sky_times;
    double cloud = 0.0;
    for (int i = 0; i < 60; ++i) {
      cloud = 0.8 * cloud + 0.3 * random.normal();
      LightMap light = test::random_light(random, sky_domain);
      for (float& value : light.radiance.values) value *= static_cast<float>(std::exp(cloud));
      const ClockSeconds time = morning + 120.0 * i;
      const std::string name = "roof_" + std::to_string(1000 + i);
      write_exr(folder_ / "sky" / (name + ".exr"), light.radiance);
      sky_times[name] = time;
      if (i < 3 || i == 20 || i == 21) continue;
      const std::string photograph = "view_" + std::to_string(2000 + i);
      write_exr(folder_ / "city" / (photograph + ".exr"), scene_.relight(light));
      city_times[photograph] = time + ahead_ + random.uniform(-3.0, 3.0);
      truth_[photograph] = name;
    }
    write_times(folder_ / "city", city_times);
    write_times(folder_ / "sky", sky_times);
    request_.observed = (folder_ / "city").string();
    request_.probes = (folder_ / "sky").string();
    request_.folder = folder_ / "session";
    request_.offset_seconds = std::nullopt;
  }

  std::string message() {
    try {
      match_series(request_);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  }

  const TemporaryFolder folder_;
  const double ahead_;
  ReflectanceField scene_;
  std::map<std::string, std::string> truth_;
  MatchRequest request_;
};

TEST_F(MatchSeries, NotOnePairIsWrong) {
  request_.test_every = 5;
  const MatchSummary summary = match_series(request_);
  EXPECT_EQ(summary.pairs.size(), 55U);
  for (const MatchedPair& pair : summary.pairs) EXPECT_EQ(truth_.at(pair.observed.stem()), pair.probe.stem());
  EXPECT_NEAR(summary.clocks.offset_seconds, ahead_, 20.0);
  EXPECT_EQ(summary.probes_left_out.size(), 5U);
  EXPECT_TRUE(summary.observed_left_out.empty());
  const CaptureSession session = read_capture_session(request_.folder);
  EXPECT_EQ(session.light, sky_domain);
  EXPECT_EQ(session.frames_of(FrameRole::test).size(), 11U);
  EXPECT_NEAR(session.frames[1].order, 120.0, 7.0);

  // Another run finds all of it done; one without --resume is refused.
  request_.if_exists = IfExists::resume;
  EXPECT_EQ(match_series(request_).pairs.size(), 55U);
  request_.if_exists = IfExists::refuse;
  EXPECT_THAT(message(), HasSubstr("--resume"));
}

TEST_F(MatchSeries, TheSessionIsEstimatedFrom) {
  ASSERT_EQ(test::run_program({"acquire", "import", folder_ / "city", "--light", folder_ / "sky",
                               "--parameterisation", "lat_long", "--pair-by", "time", "-o",
                               folder_ / "session", "--offset", "auto", "--hold-out", "5"},
                              folder_ / "match.log"),
            0)
      << read_text(folder_ / "match.log");
  EXPECT_THAT(read_text(folder_ / "match.log"), HasSubstr("55 pairs"));
  ASSERT_EQ(test::run_program({"estimate", folder_ / "session", "-o", folder_ / "city.rfield"},
                              folder_ / "estimate.log"),
            0)
      << read_text(folder_ / "estimate.log");
  const ReflectanceField field = read_reflectance_field(folder_ / "city.rfield");
  // Wrong pairs would leave nothing to predict; the scene has three boxes a pixel, the fit 44 photographs.
  std::vector<Image> predicted, observed;
  for (const CaptureFrame& frame : read_capture_session(folder_ / "session").frames_of(FrameRole::test)) {
    predicted.push_back(field.relight(read_light_map(frame.illumination, Parameterisation::lat_long)));
    observed.push_back(read_image(frame.observed));
  }
  EXPECT_LT(relative_rmse(predicted, observed), 0.1);
}

TEST_F(MatchSeries, DiscardedLightsTakeTheirPhotographsWithThem) {
  request_.offset_seconds = ahead_;
  write_text_atomically(folder_ / "sky" / "probe.toml",
                        "[[photograph]]\nname = \"roof_1030\"\ndiscarded = \"sun only\"\n");
  fs::remove(folder_ / "sky" / "roof_1030.exr");
  request_.tolerance_seconds = 200.0;  // wide enough to reach the next light
  const MatchSummary summary = match_series(request_);
  EXPECT_EQ(summary.pairs.size(), 54U);
  ASSERT_EQ(summary.observed_left_out.size(), 1U);
  EXPECT_EQ(summary.observed_left_out[0].file.stem(), "view_2030");
  EXPECT_THAT(summary.observed_left_out[0].reason, HasSubstr("sun only"));
}

TEST_F(MatchSeries, SaysWhatIsMissing) {
  request_.offset_seconds = ahead_ + 5000.0;
  request_.tolerance_seconds = 1.0;
  EXPECT_THAT(message(), HasSubstr("--offset"));
  fs::remove(folder_ / "city" / "times.tsv");
  EXPECT_THAT(message(), HasSubstr("times.tsv"));
  write_text_atomically(folder_ / "city" / "times.tsv", "view_2003\tyesterday\n");
  EXPECT_THAT(message(), HasSubstr("line 1"));
  EXPECT_FALSE(fs::exists(request_.folder));
}

}  // namespace
}  // namespace refield
