// SPDX-License-Identifier: Apache-2.0
#include "acquire/calibration.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "core/errors.h"
#include "core/files.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

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

TEST(CalibrationFile, RefusesImpossibleContent) {
  const test::TemporaryFolder folder;
  const auto path = folder / "calibration.toml";
  write_text_atomically(path, "[camera]\nbits = 12\n");
  EXPECT_THROW(read_camera_calibration(path), FormatError);
  EXPECT_THROW(read_monitor_calibration(path), FormatError);
  write_text_atomically(path, "not toml at all [");
  EXPECT_THROW(read_camera_calibration(path), FormatError);
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
