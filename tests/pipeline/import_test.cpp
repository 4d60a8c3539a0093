// SPDX-License-Identifier: Apache-2.0
// Raw frames of the virtual rig, exported as other tools would and imported, give what the capture itself
// gave.
#include <OpenImageIO/imageio.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <regex>

#include "acquire/calibrate/calibration.h"
#include "acquire/hdr/bracket_files.h"
#include "acquire/import/import_series.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/image/metrics.h"
#include "core/session/capture_session.h"
#include "tests/pipeline/program.h"
#include "tests/pipeline/tiny_recipe.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using test::run_program;
using test::TemporaryFolder;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

constexpr std::array<double, 3> exposures = {0.02, 0.08, 0.32};

/// A 16-bit TIFF with EXIF exposure and time.
void export_tiff(const fs::path& path, const RawFrame& frame, double seconds, const std::string& time) {
  OIIO::ImageSpec spec(frame.width, frame.height, 3, OIIO::TypeDesc::UINT16);
  spec.attribute("ExposureTime", static_cast<float>(seconds));
  spec.attribute("DateTime", time);
  auto output = OIIO::ImageOutput::create(path.string());
  ASSERT_TRUE(output && output->open(path.string(), spec));
  ASSERT_TRUE(output->write_image(OIIO::TypeDesc::UINT16, frame.samples.data()) && output->close());
}

class Import : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = std::make_unique<TemporaryFolder>();
    std::string recipe = test::tiny_recipe;
    recipe.insert(recipe.find("count = 4"), "ambient_frames = 1\n");
    write_text_atomically(*folder_ / "recipe.toml", recipe);
    ASSERT_EQ(run_program({"simulate", at("recipe.toml"), "-o", at("truth")}, at("log")), 0)
        << read_text(at("log"));
    ASSERT_EQ(run_program({"acquire", "run", at("recipe.toml"), "--truth", at("truth"), "-o", at("session"),
                           "--keep-raw", "--exposures", "0.02,0.08,0.32"},
                          at("log")),
              0)
        << read_text(at("log"));
    fs::create_directories(at("shots"));
    const std::regex name("(.*)_e([0-9])\\.png");
    int second = 0;
    for (const GlobMatch& raw : expand_glob(at("session/raw"))) {
      std::smatch match;
      const std::string file = raw.path.filename().string();
      ASSERT_TRUE(std::regex_match(file, match, name)) << file;
      char time[32];
      std::snprintf(time, sizeof time, "2004:06:21 12:%02d:%02d", second / 60, second % 60);
      ++second;
      export_tiff(at("shots/" + match[1].str() + "-" + match[2].str() + ".tif"),
                  read_bracket_file(raw.path).frame, exposures.at(std::stoul(match[2].str())), time);
    }
  }
  static void TearDownTestSuite() { folder_.reset(); }
  static std::string at(const std::string& name) { return *folder_ / name; }

  ImportRequest request() const {
    ImportRequest request;
    for (const GlobMatch& match : expand_glob(at("shots"))) request.photographs.push_back(match.path);
    for (const GlobMatch& match : expand_glob(at("shots/ambient-*"))) request.ambient.push_back(match.path);
    for (const GlobMatch& match : expand_glob(at("session/illumination")))
      request.lights.push_back(match.path);
    request.rule.pattern = "{light}-?.tif";
    request.camera.response = at("session/calibration.toml");
    request.folder = out_ / "imported";
    return request;
  }
  static std::string message(const ImportRequest& request) {
    try {
      import_series(request);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  }

  static void expect_equal(const fs::path& imported, const fs::path& captured) {
    const CaptureSession a = read_capture_session(imported);
    const CaptureSession b = read_capture_session(captured);
    ASSERT_EQ(a.frames.size(), b.frames.size());
    for (const CaptureFrame& frame : a.frames) {
      const auto twin = std::ranges::find(b.frames, frame.name, &CaptureFrame::name);
      ASSERT_NE(twin, b.frames.end()) << frame.name;
      EXPECT_EQ(frame.role, twin->role);
      const Photograph one = read_photograph(frame.observed), other = read_photograph(twin->observed);
      constexpr double exif_rounding = 2e-6;  // exposure times are rationals and floats there
      for (std::size_t i = 0; i < one.radiance.values.size(); ++i) {
        ASSERT_NEAR(one.radiance.values[i], other.radiance.values[i],
                    exif_rounding * std::abs(other.radiance.values[i]) + 1e-3 * other.sigma.values[i]);
        if (std::isfinite(other.sigma.values[i])) {
          ASSERT_NEAR(one.sigma.values[i], other.sigma.values[i], 1e-3 * other.sigma.values[i]);
        } else {
          ASSERT_FALSE(std::isfinite(one.sigma.values[i]));
        }
      }
      EXPECT_EQ(read_image(frame.illumination).values, read_image(twin->illumination).values);
    }
  }

  static std::unique_ptr<TemporaryFolder> folder_;
  const TemporaryFolder out_;
};

std::unique_ptr<TemporaryFolder> Import::folder_;

TEST_F(Import, GivesTheSameRadianceAsTheCapture) {
  const ImportSummary summary = import_series(request());
  EXPECT_EQ(summary.photographs, 20U);
  EXPECT_EQ(summary.timed, 20U);
  ASSERT_EQ(summary.exposures.size(), 3U);
  EXPECT_NEAR(summary.exposures[1].count(), 0.08, 1e-6);
  expect_equal(out_ / "imported", at("session"));
}

TEST_F(Import, TellsBracketsByExposureAndLightsByOrder) {
  ImportRequest by_order = request();
  by_order.rule.pattern.clear();
  by_order.lights_by_order = true;
  import_series(by_order);
  expect_equal(out_ / "imported", at("session"));
}

TEST_F(Import, TheCommandMakesASessionThatIsEstimatedFrom) {
  const std::string log = out_ / "log";
  ASSERT_EQ(run_program({"acquire", "import", at("shots"), "--light", at("session/illumination"), "--names",
                         "{light}-?.tif", "--ambient", at("shots/ambient-*"), "--response",
                         at("session/calibration.toml"), "-o", out_ / "imported"},
                        log),
            0)
      << read_text(log);
  EXPECT_THAT(read_text(log), HasSubstr("20 photographs"));
  EXPECT_EQ(run_program({"estimate", out_ / "imported", "-o", out_ / "scene.rfield"}, log), 0)
      << read_text(log);
}

TEST_F(Import, GoesOnWhereItWasStopped) {
  import_series(request());
  const fs::path whole = out_ / "whole";
  fs::rename(out_ / "imported", whole);
  fs::create_directories(out_ / "imported");
  for (const char* name : {"illumination", "observed", "plan.toml", "ambient.exr", "journal"})
    fs::copy(whole / name, out_ / "imported" / name, fs::copy_options::recursive);
  write_text_atomically(out_ / "imported/observed/train_003.exr", "torn");  // as a bad disk leaves it
  EXPECT_THAT(message(request()), HasSubstr("--resume"));
  ImportRequest resumed = request();
  resumed.if_exists = IfExists::resume;
  EXPECT_EQ(import_series(resumed).found_done, 20U);  // ambient and nineteen lights
  EXPECT_EQ(test::folder_difference(out_ / "imported", whole), "");
}

TEST_F(Import, WithoutLightsPhotographsAreMergedWithTheirTimes) {
  ImportRequest series = request();
  series.lights.clear();
  EXPECT_EQ(import_series(series).photographs, 20U);
  const Photograph merged = read_photograph(out_ / "imported/train_000.exr");
  EXPECT_EQ(merged.radiance.values.size(), 24U * 18U * 3U);
  EXPECT_THAT(read_text(out_ / "imported/times.tsv"), HasSubstr("train_000\t2004-06-21T12:"));
  EXPECT_THAT(message(series), HasSubstr("--resume"));
  series.if_exists = IfExists::resume;
  EXPECT_EQ(import_series(series).found_done, 20U);
}

TEST_F(Import, LightsMayBeDriveLevels) {
  ImportRequest levels = request();
  levels.lights.clear();
  fs::create_directories(out_ / "shown");
  const MonitorCalibration monitor = read_monitor_calibration(at("session/calibration.toml"));
  for (const GlobMatch& match : expand_glob(at("session/illumination"))) {
    const DriveImage drive = drive_levels(read_image(match.path), monitor);
    const fs::path file = out_ / "shown" / (match.path.stem().string() + ".png");
    OIIO::ImageSpec spec(drive.width, drive.height, 3, OIIO::TypeDesc::UINT8);
    auto output = OIIO::ImageOutput::create(file.string());
    ASSERT_TRUE(output && output->open(file.string(), spec) &&
                output->write_image(OIIO::TypeDesc::UINT8, drive.levels.data()) && output->close());
    levels.lights.push_back(file);
  }
  levels.light_content = LightContent::drive_levels;
  EXPECT_THAT(message(levels), HasSubstr("--response"));
  levels.monitor = at("session/calibration.toml");
  import_series(levels);
  expect_equal(out_ / "imported", at("session"));
}

TEST_F(Import, NamesTheFileAndTheRemedy) {
  ImportRequest wrong = request();
  wrong.lights.pop_back();
  EXPECT_THAT(message(wrong),
              AllOf(HasSubstr("-0.tif: there is no light named '"), HasSubstr("--pair-by order")));
  wrong = request();
  wrong.rule = {"", 7};
  EXPECT_THAT(message(wrong), HasSubstr("do not make brackets of 7"));
  wrong = request();
  wrong.exposures = {Seconds(0.1)};
  EXPECT_THAT(message(wrong), HasSubstr("--exposures gives 1 times for 3"));
  wrong = request();
  wrong.camera.response = "cineon";
  EXPECT_THAT(message(wrong), HasSubstr("cineon"));
  wrong = request();
  write_text_atomically(out_ / "train_000-9.tif", "no image");
  wrong.photographs = {out_ / "train_000-9.tif"};
  wrong.lights = {at("session/illumination/train_000.exr")};
  EXPECT_THAT(message(wrong), HasSubstr("train_000-9.tif"));
}

/// A matt sphere on black under a distant light source of radiance 1 [height × width × 3]; x right, y up, z
/// towards the camera.
Image lit_sphere(const Eigen::Vector3d& direction) {
  constexpr int width = 16, height = 12;
  constexpr std::array<float, 3> albedo = {0.5f, 0.4f, 0.2f};
  Image image(width, height, 3);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const double u = (x + 0.5 - width / 2.0) / 5.5, v = (height / 2.0 - y - 0.5) / 5.5;
      if (u * u + v * v >= 1.0) continue;
      const double cosine = direction.dot(Eigen::Vector3d(u, v, std::sqrt(1.0 - u * u - v * v)));
      for (int c = 0; c < 3; ++c)
        image.at(x, y, c) = albedo[static_cast<std::size_t>(c)] * static_cast<float>(std::max(0.0, cosine));
    }
  return image;
}

TEST(ImportLightStage, SumsOfLightSourcesAreRelitFromPhotographsUnderSingleOnes) {
  const TemporaryFolder folder;
  const std::string log = folder / "log", stage = folder / "stage";
  fs::create_directories(stage);
  constexpr int sources = 24;
  std::vector<Eigen::Vector3d> directions;
  std::string positions, names, intensities;
  for (int i = 0; i < sources; ++i) {
    const double z = (i + 0.5) / sources, r = std::sqrt(1.0 - z * z), angle = 2.399963 * i;
    directions.emplace_back(r * std::cos(angle), r * std::sin(angle), z);
    // A radius of 300 millimetres, and light sources of different brightness and colour.
    char line[128];
    std::snprintf(line, sizeof line, "%.6f %.6f %.6f\n", 300.0 * directions[i].x(), 300.0 * directions[i].y(),
                  300.0 * z);
    positions += line;
    const std::array<double, 3> intensity = {1.0 + 0.03 * i, 1.0, 1.6 - 0.02 * i};
    std::snprintf(line, sizeof line, "%.6f %.6f %.6f\n", intensity[0], intensity[1], intensity[2]);
    intensities += line;
    const std::string name = std::to_string(i) + ".png";
    names += name + "\n";
    const Image radiance = lit_sphere(directions[i]);
    RawFrame frame;
    frame.width = radiance.width;
    frame.height = radiance.height;
    for (std::size_t k = 0; k < radiance.values.size(); ++k)
      frame.samples.push_back(
          static_cast<std::uint16_t>(std::lround(65535.0 * radiance.values[k] * intensity[k % 3])));
    write_raw_frame(fs::path(stage) / name, frame);
  }
  write_text_atomically(fs::path(stage) / "light_directions.txt", positions);
  write_text_atomically(fs::path(stage) / "filenames.txt", names);
  write_text_atomically(fs::path(stage) / "light_intensities.txt", intensities);
  ASSERT_EQ(run_program({"acquire", "import", stage, "--light-sources", stage + "/light_directions.txt", "-o",
                         folder / "session"},
                        log),
            0)
      << read_text(log);
  EXPECT_THAT(read_text(log),
              HasSubstr("light directions that were normalised: 24 (first: light_directions.txt:1"));
  ASSERT_EQ(run_program({"estimate", folder / "session", "-o", folder / "scene.rfield"}, log), 0)
      << read_text(log);

  // Irradiance 1 from three of the sources, placed in the map by the axes of docs/reference/conventions.md.
  const LightDomain domain = read_capture_session(folder / "session").light;
  Image light(domain.width, domain.height, 3), expected(16, 12, 3);
  for (const int source : {2, 9, 20}) {
    const Eigen::Vector3d& d = directions[static_cast<std::size_t>(source)];
    const Eigen::Vector2d at = lat_long_position({d.x(), d.y(), -d.z()}, domain.width, domain.height);
    const auto row = static_cast<int>(at.y());
    const double solid_angle = lat_long_solid_angle(row, domain.width, domain.height);
    for (int c = 0; c < 3; ++c)
      light.at(static_cast<int>(at.x()), row, c) = static_cast<float>(1.0 / solid_angle);
    const Image alone = lit_sphere(d);
    for (std::size_t k = 0; k < alone.values.size(); ++k) expected.values[k] += alone.values[k];
  }
  write_exr(folder / "light.exr", light);
  ASSERT_EQ(run_program({"relight", folder / "scene.rfield", "--light", folder / "light.exr", "-o",
                         folder / "relit.exr"},
                        log),
            0)
      << read_text(log);
  EXPECT_LT(relative_rmse(read_image(folder / "relit.exr"), expected), 1e-3);
}

TEST(ImportLightStage, OptionsWithoutEffectAreRefused) {
  const TemporaryFolder folder;
  const std::string log = folder / "log";
  const auto refusal = [&](std::vector<std::string> options) {
    options.insert(options.begin(), {"acquire", "import", "shots", "-o", folder / "session"});
    EXPECT_EQ(run_program(options, log), 2);
    return read_text(log);
  };
  for (const std::vector<std::string>& without_effect :
       {std::vector<std::string>{"--pair-by", "order"}, {"--light-content", "drive"}})
    EXPECT_THAT(refusal({"--light-sources", "dome.lp", without_effect[0], without_effect[1]}),
                HasSubstr(without_effect[0] + " requires --light"));
  EXPECT_THAT(refusal({"--ball", "find", "--object-at", "0,0,0"}), HasSubstr("requires --light-sources"));
  EXPECT_THAT(refusal({"--light-sources", "dome.lp", "--ball", "1,2,3"}), HasSubstr("--light-sources ball"));
  EXPECT_THAT(refusal({"--light-sources", "dome.lp", "--horizontal-fov", "40"}),
              HasSubstr("--light-sources ball"));
}

/// Near light sources in a table, brackets of two exposures, ambient light, and a white card under each
/// source: together the options give the reflection of the scene.
TEST(ImportLightStage, NearSourcesBracketsAmbientLightAndFlatFields) {
  const TemporaryFolder folder;
  const std::string log = folder / "log";
  constexpr int sources = 3, width = 24, height = 16;
  constexpr float ambient = 0.02f;  // no sample is within 2 % of clipping, where merging is uncertain
  const auto reflection = [](int source, int x) {
    return 0.2f + 0.02f * static_cast<float>(x) + 0.1f * source;
  };
  const std::array<Eigen::Vector3d, sources> places = {{{0, 0, 400}, {300, 0, 500}, {0, -240, 420}}};
  const auto write = [&](const std::string& name, const auto& radiance) {
    for (const double seconds : {0.5, 2.0}) {
      RawFrame frame;
      frame.width = width;
      frame.height = height;
      for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
          for (int c = 0; c < 3; ++c)
            frame.samples.push_back(static_cast<std::uint16_t>(
                std::clamp(std::lround(65535.0 * seconds * (ambient + radiance(x))), 0L, 65535L)));
      write_raw_frame(name + (seconds < 1.0 ? "_1.png" : "_2.png"), frame);
    }
  };
  std::string list = "file,x,y,z\n";
  for (const char* name : {"shots", "cards", "dark"}) fs::create_directories(folder / name);
  write(folder / "dark/dark", [](int) { return 0.0f; });
  for (int i = 0; i < sources; ++i) {
    const Eigen::Vector3d& place = places[static_cast<std::size_t>(i)];
    char line[80];
    std::snprintf(line, sizeof line, "light%d_1.png,%g,%g,%g\n", i, place.x(), place.y(), place.z());
    list += line;
    const double distance = (place - Eigen::Vector3d(0, 0, 100)).norm();
    const auto irradiance = [=](int x) {
      return static_cast<float>(5.1e4 / (distance * distance) * (1.0 + 0.01 * x));
    };
    const auto cosine = static_cast<float>((place.z() - 100.0) / distance);
    const std::string name = "light" + std::to_string(i);
    write(folder / ("shots/" + name), [&](int x) { return irradiance(x) * reflection(i, x); });
    write(folder / ("cards/" + name), [&](int x) { return irradiance(x) * cosine; });
  }
  write_text_atomically(folder / "dome.csv", list);
  const std::vector<std::string> options = {
      "acquire",     "import",    folder / "shots", "--light-sources", folder / "dome.csv",
      "--object-at", "0,0,100",   "--names",        "{light}_?.png",   "--exposures",
      "0.5,2",       "--ambient", folder / "dark"};
  const auto import_to = [&](const std::string& session, std::vector<std::string> more) {
    more.insert(more.begin(), options.begin(), options.end());
    more.insert(more.end(), {"-o", folder / session});
    ASSERT_EQ(run_program(more, log), 0) << read_text(log);
  };
  constexpr double rounding = 1e-3;  // to 16 bits
  import_to("flat", {"--flat-fields", folder / "cards"});
  import_to("falling", {});
  const CaptureSession flat = read_capture_session(folder / "flat"),
                       falling = read_capture_session(folder / "falling");
  /// The largest radiance × solid angle of a texel.
  const auto irradiance_of = [](const CaptureFrame& frame) {
    const Image light = read_light_map(frame.illumination, Parameterisation::lat_long, {}).radiance;
    double largest = 0.0;
    for (int y = 0; y < light.height; ++y)
      largest = std::max(largest, *std::ranges::max_element(light.row(y)) *
                                      lat_long_solid_angle(y, light.width, light.height));
    return largest;
  };
  double mean = 0.0;
  for (const Eigen::Vector3d& place : places) mean += (place - Eigen::Vector3d(0, 0, 100)).norm() / sources;
  for (std::size_t i = 0; i < sources; ++i) {
    const Image observed = read_observed(flat.frames[i]).radiance;
    for (int x = 0; x < width; ++x) {
      const float expected = reflection(static_cast<int>(i), x);
      EXPECT_NEAR(observed.at(x, 3, 1), expected, rounding * expected);
    }
    EXPECT_NEAR(irradiance_of(flat.frames[i]), 1.0, 1e-6);
    // Without cards the light map holds the fall-off.
    const double brightness = irradiance_of(falling.frames[i]);
    EXPECT_NEAR(brightness, std::pow(mean / (places[i] - Eigen::Vector3d(0, 0, 100)).norm(), 2), 1e-5);
    EXPECT_NEAR(read_observed(falling.frames[i]).radiance.at(0, 3, 1) / brightness,
                5.1e4 / (mean * mean) * reflection(static_cast<int>(i), 0), rounding);
  }
}

}  // namespace
}  // namespace refield
