// SPDX-License-Identifier: Apache-2.0
#include "acquire/calibrate/calibration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/rng.h"
#include "tests/support/message_of.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using testing::HasSubstr;

MonitorCalibration monitor() {
  MonitorCalibration calibration;
  for (int c = 0; c < 3; ++c)
    for (int level = 0; level < 256; ++level)
      calibration.radiance_from_level[c].push_back(
          static_cast<float>(0.002 + std::pow(level / 255.0, 1.8 + 0.2 * c)));
  return calibration;
}

CameraCalibration camera() {
  CameraCalibration calibration;
  calibration.bits = 10;
  calibration.linear_from_dn = gamma_response(10, 1.7);
  calibration.black_level_dn = 31.25;
  calibration.saturation_dn = 1000.0;
  calibration.electrons_per_dn = 3.1;
  calibration.read_noise_electrons = 2.7;
  calibration.electrons_per_radiance_second = 123456.789;
  return calibration;
}

TEST(DriveLevels, RoundTripThroughLight) {
  const auto calibration = monitor();
  DriveImage all{256, 1, {}};
  for (int level = 0; level < 256; ++level)
    all.levels.insert(all.levels.end(), 3, static_cast<std::uint8_t>(level));
  std::size_t too_bright = 99;
  EXPECT_EQ(drive_levels(emitted_above_black(all, calibration), calibration, &too_bright).levels, all.levels);
  EXPECT_EQ(too_bright, 0u);
}

TEST(DriveLevels, AreTheNearestByLight) {
  const auto calibration = monitor();
  Image wanted(64, 64, 3);
  for (std::size_t i = 0; i < wanted.values.size(); ++i)
    wanted.values[i] = static_cast<float>(i) / static_cast<float>(wanted.values.size());
  const Image emitted = emitted_above_black(drive_levels(wanted, calibration), calibration);
  for (std::size_t i = 0; i < wanted.values.size(); ++i) {
    const auto& table = calibration.radiance_from_level[i % 3];
    float best = std::numeric_limits<float>::max();
    for (float radiance : table) best = std::min(best, std::abs(radiance - table[0] - wanted.values[i]));
    // Two levels may be equally near but for rounding.
    EXPECT_NEAR(std::abs(emitted.values[i] - wanted.values[i]), best, 1e-6f);
  }
}

TEST(DriveLevels, OutOfRangeLightIsCountedAndBlackIsBlack) {
  const auto calibration = monitor();
  Image wanted(2, 1, 3, 0.0f);
  wanted.values[0] = 7.0f;
  std::size_t too_bright = 0;
  const DriveImage drive = drive_levels(wanted, calibration, &too_bright);
  EXPECT_EQ(drive.levels, (std::vector<std::uint8_t>{255, 0, 0, 0, 0, 0}));
  EXPECT_EQ(too_bright, 1u);
  EXPECT_EQ(emitted_above_black(drive, calibration).values[1], 0.0f);
}

TEST(DriveLevels, EqualLevelsGiveTheLowest) {
  auto calibration = monitor();
  for (int level = 0; level < 10; ++level) calibration.radiance_from_level[0][level] = 0.002f;
  const Image dark(1, 1, 3, 0.0f);
  EXPECT_EQ(drive_levels(dark, calibration).levels[0], 0);
}

TEST(CalibrationFile, RoundTripIsExact) {
  const test::TemporaryFolder folder;
  const auto path = folder / "calibration.toml";
  write_calibration(path, camera(), monitor());
  const CameraCalibration read = read_camera_calibration(path);
  EXPECT_EQ(read.linear_from_dn, camera().linear_from_dn);
  EXPECT_EQ(read.bits, 10);
  EXPECT_EQ(read.black_level_dn, camera().black_level_dn);
  EXPECT_EQ(read.saturation_dn, camera().saturation_dn);
  EXPECT_EQ(read.electrons_per_dn, camera().electrons_per_dn);
  EXPECT_EQ(read.read_noise_electrons, camera().read_noise_electrons);
  EXPECT_EQ(read.electrons_per_radiance_second, camera().electrons_per_radiance_second);
  EXPECT_EQ(read_monitor_calibration(path).radiance_from_level, monitor().radiance_from_level);

  CameraCalibration linear = camera();
  linear.linear_from_dn = linear_response(10);
  write_calibration(path, linear, monitor());
  EXPECT_TRUE(read_camera_calibration(path).is_linear());
}

TEST(CalibrationFile, KeepsTimingFlatFieldAndUniformity) {
  const test::TemporaryFolder folder;
  const auto path = folder / "calibration.toml";
  write_calibration(path, camera(), monitor());
  EXPECT_FALSE(read_timing_calibration(path));
  EXPECT_TRUE(read_camera_calibration(path).flat_field.empty());

  CameraCalibration shaded = camera();
  shaded.flat_field = {3, 2, {0.7f, 1.0f, 0.71f, 0.72f, 0.99f, 0.73f}};
  MonitorCalibration uneven = monitor();
  uneven.uniformity = {2, 2, {0.9f, 1.0f, 0.95f, 0.93f}};
  TimingCalibration timing{Seconds(0.031), Seconds(0.0123), 3, Seconds(1.0 / 60.0), Seconds(1.0 / 240.0)};
  write_calibration(path, shaded, uneven, timing);
  EXPECT_EQ(read_camera_calibration(path).flat_field.values, shaded.flat_field.values);
  EXPECT_EQ(read_monitor_calibration(path).uniformity.values, uneven.uniformity.values);
  const auto read = read_timing_calibration(path);
  ASSERT_TRUE(read);
  EXPECT_EQ(read->display_latency, timing.display_latency);
  EXPECT_EQ(read->display_settling, timing.display_settling);
  EXPECT_EQ(read->control_latency_frames, 3);
  EXPECT_EQ(read->exposure_unit, timing.exposure_unit);

  shaded.flat_field.values[2] = 0.0f;
  EXPECT_THROW(shaded.check("test"), InputError);
  uneven.uniformity.rows = 3;
  EXPECT_THROW(uneven.check("test"), InputError);
  timing.display_settling = Seconds(-1.0);
  EXPECT_THROW(timing.check("test"), InputError);
}

TEST(CalibrationFile, RefusesImpossibleContent) {
  const test::TemporaryFolder folder;
  const auto path = folder / "calibration.toml";
  write_text_atomically(path, "[camera]\nbits = 12\n");
  EXPECT_THAT(test::message_of([&] { read_camera_calibration(path); }),
              HasSubstr("black_level_dn: is missing"));
  EXPECT_THAT(test::message_of([&] { read_monitor_calibration(path); }), HasSubstr("[monitor]"));
  write_text_atomically(path, "not toml at all [");
  EXPECT_THAT(test::message_of([&] { read_camera_calibration(path); }), HasSubstr("not valid TOML"));
}

TEST(RelativeMap, FollowsASmoothFalloffThroughNoiseAndGaps) {
  Image image(96, 64, 1);
  Image weight(96, 64, 1, 1.0f);
  Rng noise(3);
  const auto truth = [](double u, double v) {
    return 1.0 - 0.5 * ((u - 0.5) * (u - 0.5) + (v - 0.5) * (v - 0.5));
  };
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) {
      const bool hole = std::hypot(x - 60, y - 30) < 6;
      weight.at(x, y, 0) = hole ? 0.0f : 1.0f;
      image.at(x, y, 0) = hole ? 9.0f
                               : static_cast<float>(40.0 * truth((x + 0.5) / 96, (y + 0.5) / 64) *
                                                    (1.0 + 0.01 * noise.normal()));
    }
  const RelativeMap map = fit_relative_map(image, weight, 9, 7);
  for (double u : {0.01, 0.3, 0.62, 0.99})
    for (double v : {0.01, 0.48, 0.99}) EXPECT_NEAR(map.at(u, v) / map.at(0.5, 0.5), truth(u, v), 0.008);
  EXPECT_THROW(fit_relative_map(image, Image(96, 64, 1), 9, 7), InputError);
}

TEST(RelativeMap, DividingUndoesMultiplying) {
  const RelativeMap map{2, 2, {0.5f, 1.0f, 0.8f, 0.9f}};
  Photograph photograph{Image(5, 4, 3, 2.0f), Image(5, 4, 3, 0.1f)};
  multiply(photograph.radiance, map);
  EXPECT_NEAR(photograph.radiance.at(0, 0, 1), 2.0f * map.at(0.1, 0.125), 1e-6f);
  divide(photograph, map);
  EXPECT_NEAR(photograph.radiance.at(4, 3, 2), 2.0f, 1e-6f);
  EXPECT_NEAR(photograph.sigma.at(4, 3, 2), 0.1f / map.at(0.9, 0.875), 1e-6f);
}

TEST(Calibration, RefusesImpossibleValues) {
  const auto refused = [](auto change) {
    CameraCalibration calibration = camera();
    change(calibration);
    EXPECT_THROW(calibration.check("test"), InputError);
  };
  EXPECT_NO_THROW(camera().check("test"));
  refused([](auto& c) { c.linear_from_dn[500] = 0.0f; });
  refused([](auto& c) { c.linear_from_dn[500] = std::nanf(""); });
  refused([](auto& c) { c.linear_from_dn.pop_back(); });
  refused([](auto& c) { c.black_level_dn = 1020.0; });
  refused([](auto& c) { c.saturation_dn = 1024.0; });
  refused([](auto& c) { c.electrons_per_dn = 0.0; });
  refused([](auto& c) { c.read_noise_electrons = -1.0; });
  auto falling = monitor();
  falling.radiance_from_level[1][7] = 0.9f;
  EXPECT_THROW(falling.check("test"), InputError);
  auto short_table = monitor();
  short_table.radiance_from_level[2].pop_back();
  EXPECT_THROW(short_table.check("test"), InputError);
}

}  // namespace
}  // namespace refield
