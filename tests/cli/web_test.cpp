// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "cli/web/export.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/field_io/field_sampler.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "simulate/geometry/mesh_shapes.h"
#include "tests/cli/matchers.h"
#include "tests/support/interruption.h"
#include "tests/support/mesh_field.h"
#include "tests/support/random_data.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

namespace fs = std::filesystem;
using test::RefusedNaming;
using test::run_refield;
using test::Succeeded;
using testing::HasSubstr;
using web::SharedExponent;

/// Of 9 bits of mantissa, the highest of which the largest channel may leave unused: relative to that
/// channel.
constexpr double rounding = 1.0 / 512.0;

/// Hats and boxes; brighter than the light maps are large, so that images are neither black nor white.
ReflectanceField sample_field(Parameterisation parameterisation) {
  Rng rng(7);
  ReflectanceField field = test::random_field(rng, 60, 45, {64, 32, parameterisation}, 80, 20);
  field.basis.hats = {5, 4};
  if (parameterisation == Parameterisation::monitor)
    field.monitors = {{.width_mm = 800.0, .height_mm = 400.0, .distance_mm = 500.0, .turn = {.yaw = 40.0}}};
  for (float& weight : field.transfer.weight) weight *= weight * 0.001f;
  if (parameterisation == Parameterisation::lat_long) {  // as of a light stage
    for (int y = 4; y < 32; y += 8)
      for (int x = 4; x < 64; x += 8) field.observed_light.push_back({x, y, x + 1, y + 1});
    field.basis.interpolation = LightInterpolation{field.observed_light, 0.8, 0.01, 0.1, 0.6};
  }
  return field;
}

TEST(SharedExponent, RoundsByLessThanItsMantissa) {
  Rng rng(1);
  const SharedExponent exponent = SharedExponent::for_largest(3.7f);
  for (int i = 0; i < 2000; ++i) {
    const float scale = std::ldexp(3.7f, -static_cast<int>(rng.below(20)));
    const float rgb[3] = {scale, scale * static_cast<float>(rng.uniform()),
                          scale * static_cast<float>(rng.uniform())};
    float back[3];
    exponent.unpack(exponent.packed(rgb), back);
    for (int c = 0; c < 3; ++c) ASSERT_NEAR(back[c], rgb[c], rounding * scale) << scale;
    ASSERT_EQ(exponent.packed(back), exponent.packed(rgb)) << scale;
  }
}

TEST(SharedExponent, ZeroTinyAndMantissasThatRoundUp) {
  const SharedExponent exponent = SharedExponent::for_largest(1.0f);
  const auto round_trip = [&](float value) {
    const float rgb[3] = {value, 0.0f, value};
    float back[3];
    exponent.unpack(exponent.packed(rgb), back);
    EXPECT_EQ(back[0], back[2]);
    EXPECT_EQ(back[1], 0.0f);
    return back[0];
  };
  EXPECT_EQ(round_trip(0.0f), 0.0f);
  EXPECT_EQ(round_trip(1e-30f), 0.0f);
  EXPECT_EQ(round_trip(1.0f), 1.0f);
  EXPECT_EQ(round_trip(0.99999f), 1.0f);
  EXPECT_EQ(round_trip(0.5f), 0.5f);
}

TEST(PageField, RelightsAsTheFieldDoes) {
  const ReflectanceField field = sample_field(Parameterisation::monitor);
  Rng rng(2);
  const LightMap light = test::random_light(rng, field.basis.domain);
  const Image expected = field.relight(light), seen = web::page_field(field).field.relight(light);
  for (std::size_t p = 0; p < expected.pixel_count(); ++p) {
    const auto* values = &expected.values[3 * p];
    // Weights differ between channels by more than the light does: a bound on the largest bounds them all.
    const float most = std::max({values[0], values[1], values[2]});
    for (int c = 0; c < 3; ++c) ASSERT_NEAR(seen.values[3 * p + c], values[c], 4 * rounding * most) << p;
  }
}

TEST(PageField, LeavesOutBoxesThatNoPixelUses) {
  ReflectanceField field = sample_field(Parameterisation::monitor);
  const std::size_t boxes = field.basis.boxes.size();
  field.basis.boxes.insert(field.basis.boxes.end(), 30, Box{0, 0, 3, 3});
  const ReflectanceField shown = web::page_field(field).field;
  EXPECT_LE(shown.basis.boxes.size(), boxes);
  EXPECT_EQ(shown.transfer.entries(), field.transfer.entries());
}

TEST(PageField, EndsOnAnInterruption) {
  const ReflectanceField field = sample_field(Parameterisation::monitor);
  EXPECT_TRUE(test::heeds_interruption([&](const RunContext& run) { web::page_field(field, run); }));
}

TEST(PageField, RefusesPrecomputedFields) {
  EXPECT_THROW(web::page_field(test::unshadowed_field(prt::rabbit_mesh(6))), InputError);
}

TEST(ExportWeb, WritesAPageAndSaysWhatItCosts) {
  const test::TemporaryFolder folder;
  write_reflectance_field(folder / "f.rfield", sample_field(Parameterisation::lat_long));
  const auto result = run_refield({"export-web", folder / "f.rfield", "-o", folder / "page", "--json"});
  ASSERT_THAT(result, Succeeded());
  const auto report = nlohmann::json::parse(result.out);
  std::uint64_t bytes = 0;
  for (const auto& entry : fs::directory_iterator(folder / "page")) bytes += entry.file_size();
  EXPECT_EQ(report["bytes"], bytes);
  EXPECT_LT(report["relative_rmse"].get<double>(), rounding);
  EXPECT_LE(report["largest_8_bit_difference"].get<int>(), 1);
  const std::string page = read_text(folder / "page" / "index.html");
  for (const char* name : {"style.css", "decode.js", "light.js", "map_file.js", "relighter.js", "overlay.js",
                           "controls.js", "viewer.js"}) {
    EXPECT_THAT(page, HasSubstr(name));
    EXPECT_TRUE(fs::exists(folder / "page" / name)) << name;
  }
}

TEST(ExportWeb, BringsEnvironmentsAlongAsRelightReadsThem) {
  const test::TemporaryFolder folder;
  const std::string field_path = folder / "f.rfield", sky = folder / "sky.exr", cube = folder / "cube.exr";
  ReflectanceField field = sample_field(Parameterisation::monitor);
  write_reflectance_field(field_path, field);
  write_exr(sky, Image(32, 16, 3, 0.5f));
  write_exr(cube, Image(8, 48, 3, 0.25f));
  ASSERT_THAT(run_refield({"export-web", field_path, "--env", sky, cube, "-o", folder / "page"}),
              Succeeded());
  const std::string data = read_text(folder / "page" / "data.js");
  const auto begin = data.find('{');
  const auto maps = nlohmann::json::parse(data.substr(begin, data.rfind('}') + 1 - begin))["maps"];
  ASSERT_EQ(maps.size(), 2u);
  EXPECT_EQ(maps[0]["name"], "sky");
  EXPECT_EQ(maps[0]["width"], 32);
  EXPECT_EQ(maps[1]["width"], 2 * maps[1]["height"].get<int>()) << "a cube becomes a panorama";

  field.monitors.clear();
  write_reflectance_field(field_path, field);
  EXPECT_THAT(run_refield({"export-web", field_path, "--env", sky, "-o", folder / "other"}),
              RefusedNaming("f.rfield", "--placement 520x320@600"));
}

TEST(ExportWeb, RefusesAFileAsItsFolder) {
  const test::TemporaryFolder folder;
  write_reflectance_field(folder / "f.rfield", sample_field(Parameterisation::monitor));
  EXPECT_THAT(run_refield({"export-web", folder / "f.rfield", "-o", folder / "f.rfield"}),
              RefusedNaming("f.rfield", "give a folder"));
}

/// Of a camera whose channels see several primaries of the light, no two entries alike.
ReflectanceField mixing_field() {
  ReflectanceField field = sample_field(Parameterisation::monitor);
  field.output_from_primaries << 1.0f, 0.2f, 0.05f, 0.3f, 1.0f, 0.1f, 0.02f, 0.25f, 1.0f;
  return field;
}

TEST(Page, ItsExportEndsOnAnInterruption) {
  const test::TemporaryFolder folder;
  EXPECT_TRUE(test::heeds_interruption(
      [&](const RunContext& run) { web::export_page(mixing_field(), "scene", folder / "page", {}, run); }));
}

/// Runs a script of this folder on a field; it needs Chromium.
void drive(const char* script, const std::string& field, const test::TemporaryFolder& folder) {
  const std::string command = std::string("python3 -B " REFIELD_SOURCE_DIR "/tests/cli/") + script +
                              " " REFIELD_PROGRAM " " + field + " " + (folder / "work").string();
  const int status = std::system(command.c_str());
  constexpr int skipped = 77, no_such_command = 127;
  if (WIFEXITED(status) && (WEXITSTATUS(status) == skipped || WEXITSTATUS(status) == no_such_command))
    GTEST_SKIP()
        << "no Chromium with its driver, or no Python here (Debian: chromium, chromium-driver, python3)";
  EXPECT_EQ(status, 0);
}

class PageInChromium : public testing::TestWithParam<Parameterisation> {};

// Loads, drags, turns, exposes and picks as a person would; see drive_page.py.
TEST_P(PageInChromium, DrawsWhatTheProgramComputes) {
  const test::TemporaryFolder folder;
  write_reflectance_field(folder / "f.rfield", sample_field(GetParam()));
  drive("drive_page.py", folder / "f.rfield", folder);
}

INSTANTIATE_TEST_SUITE_P(Maps, PageInChromium,
                         testing::Values(Parameterisation::monitor, Parameterisation::lat_long),
                         [](const auto& maps) { return std::string(name_of(maps.param)); });

TEST(ColourMixingInChromium, IsThatOfTheProgram) {
  const test::TemporaryFolder folder;
  write_reflectance_field(folder / "f.rfield", mixing_field());
  drive("drive_page.py", folder / "f.rfield", folder);
}

}  // namespace
}  // namespace refield
