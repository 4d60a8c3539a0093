// SPDX-License-Identifier: Apache-2.0
// A chart stands in the scene of a session: from photographs in the camera's channels to a relit picture in
// linear Rec.709.
#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <nlohmann/json.hpp>
#include <random>

#include "acquire/colour/colour_chart.h"
#include "core/base/files.h"
#include "core/image/image_io.h"
#include "core/session/capture_session.h"
#include "tests/cli/matchers.h"
#include "tests/support/synthetic_capture.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using test::RefusedNaming;
using test::run_refield;
using test::Succeeded;
using testing::AllOf;
using testing::HasSubstr;

constexpr int pitch_px = 18, width = 6 * pitch_px + 12, height = 4 * pitch_px + 12;

int patch_at(int x, int y) {
  const int column = (x - 6) / pitch_px, row = (y - 6) / pitch_px;
  const int along = (x - 6) % pitch_px, down = (y - 6) % pitch_px;
  const bool is_inside =
      x >= 6 && y >= 6 && column < 6 && row < 4 && along >= 2 && along < 16 && down >= 2 && down < 16;
  return is_inside ? 6 * row + column : -1;
}

Eigen::Vector3d surface(int x, int y) {
  const int patch = patch_at(x, y);
  return patch < 0 ? Eigen::Vector3d(0.02, 0.02, 0.02)
                   : rec709_from_lab(chart_lab()[static_cast<std::size_t>(patch)]);
}

class ColourVerb : public testing::Test {
 protected:
  ColourVerb() {
    CaptureSession session;
    session.folder = folder_ / "session";
    session.light = {8, 6, Parameterisation::monitor};
    session.width = width;
    session.height = height;
    create_folders(session.folder / "illumination");
    create_folders(session.folder / "observed");
    auto lights = test::random_lights(14, 8, 6, 3);
    lights.push_back({Image(8, 6, 3, 1.0f), Parameterisation::monitor});
    for (std::size_t l = 0; l < lights.size(); ++l) {
      const bool is_white = l + 1 == lights.size();
      const std::string name = is_white ? "white" : "train_" + std::to_string(l);
      session.frames.push_back({name, FrameRole::train, is_white ? "white" : "natural",
                                session.folder / "illumination" / (name + ".exr"),
                                session.folder / "observed" / (name + ".exr")});
      write_exr(session.frames.back().illumination, lights[l].radiance);
      write_exr(session.frames.back().observed, photograph(mean_of(lights[l].radiance)));
    }
    session.frames[0].role = FrameRole::test;
    write_session_manifest(session);
  }

  static Eigen::Vector3d mean_of(const Image& light) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < light.values.size(); ++i) mean[static_cast<int>(i % 3)] += light.values[i];
    return mean / static_cast<double>(light.pixel_count());
  }

  /// The camera's channels overlap and are not balanced.
  Image photograph(const Eigen::Vector3d& light) {
    const Eigen::Matrix3d camera =
        Eigen::Vector3d(0.6, 1.0, 0.7).asDiagonal() *
        (Eigen::Matrix3d() << 0.74, 0.24, 0.02, 0.14, 0.71, 0.15, 0.03, 0.25, 0.72).finished();
    std::normal_distribution<double> noise(0.0, 0.002);
    Image image(width, height, 3);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        const Eigen::Vector3d seen = camera * surface(x, y).cwiseProduct(light);
        for (int c = 0; c < 3; ++c) image.at(x, y, c) = static_cast<float>(seen[c] + noise(generator_));
      }
    return image;
  }

  /// The largest error of a patch's channel in a picture under `light`, relative to white. Fields have no
  /// negative weights, so cyan, whose red is negative in Rec.709, has none.
  static double worst_patch(const Image& picture, const Eigen::Vector3d& light) {
    std::array<Eigen::Vector3d, chart_patches> sums;
    sums.fill(Eigen::Vector3d::Zero());
    std::array<double, chart_patches> counts{};
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        if (const int patch = patch_at(x, y); patch >= 0) {
          sums[static_cast<std::size_t>(patch)] +=
              Eigen::Vector3d(picture.at(x, y, 0), picture.at(x, y, 1), picture.at(x, y, 2));
          counts[static_cast<std::size_t>(patch)] += 1.0;
        }
    double worst = 0.0;
    for (std::size_t k = 0; k < chart_patches; ++k)
      worst = std::max(
          worst, (sums[k] / counts[k] - rec709_from_lab(chart_lab()[k]).cwiseMax(0.0).cwiseProduct(light))
                     .cwiseAbs()
                     .maxCoeff());
    return worst;
  }

  test::TemporaryFolder folder_;
  std::mt19937 generator_{1};
};

TEST_F(ColourVerb, FieldsOfASessionWithAChartAreInRec709) {
  const Eigen::Vector3d light(1.0, 0.5, 0.2);
  Image warm(8, 6, 3);
  for (std::size_t i = 0; i < warm.values.size(); ++i)
    warm.values[i] = static_cast<float>(light[static_cast<int>(i % 3)]);
  write_exr(folder_ / "warm.exr", warm);
  const auto relit = [&](const std::string& name) {
    EXPECT_THAT(run_refield({"estimate", folder_ / "session", "-o", folder_ / (name + ".rfield"),
                             "--max-kernels", "2"}),
                Succeeded());
    EXPECT_THAT(run_refield({"relight", folder_ / (name + ".rfield"), "--light", folder_ / "warm.exr", "-o",
                             folder_ / (name + ".exr")}),
                Succeeded());
    return read_image(folder_ / (name + ".exr"));
  };
  const Image before = relit("before");
  EXPECT_THAT(run_refield({"info", folder_ / "before.rfield"}).out, HasSubstr("camera RGB"));

  const auto calibrated =
      run_refield({"acquire", "colour", folder_ / "session", "-o", folder_ / "check.png", "--json"});
  ASSERT_THAT(calibrated, Succeeded());
  const auto figures = nlohmann::json::parse(calibrated.out);
  EXPECT_LE(figures["delta_e_2000"]["median"].get<double>(), 1.0);
  EXPECT_LE(figures["delta_e_2000"]["largest"].get<double>(), 3.0);
  EXPECT_TRUE(std::filesystem::exists(folder_ / "check.png"));

  // The field of before does not fit the session any more.
  EXPECT_THAT(run_refield({"compare", folder_ / "before.rfield", folder_ / "session"}),
              RefusedNaming("session", "linear Rec.709"));
  const Image after = relit("after");
  EXPECT_THAT(run_refield({"info", folder_ / "after.rfield"}).out, HasSubstr("linear Rec.709"));
  EXPECT_THAT(run_refield({"info", folder_ / "session"}).out,
              AllOf(HasSubstr("linear Rec.709"), HasSubstr("white.exr")));
  const auto file = OIIO::ImageInput::open((folder_ / "after.exr").string());
  EXPECT_NE(file->spec().find_attribute("chromaticities"), nullptr);
  // Green of grey keeps its value, 1 here. Under coloured light the camera's channels do not separate: the
  // reason why photographs are converted and not the relit picture.
  EXPECT_LT(worst_patch(after, light), 0.02);
  EXPECT_GT(worst_patch(before, light), 0.1);
}

TEST_F(ColourVerb, RefusesWhatIsNoLinearPhotographOfAChart) {
  write_png(folder_ / "chart.png", Image(64, 48, 3, 0.5f));
  EXPECT_THAT(run_refield({"acquire", "colour", folder_ / "session", "--chart", folder_ / "chart.png"}),
              RefusedNaming("chart.png", "refield acquire import"));
  write_exr(folder_ / "wall.exr", Image(64, 48, 3, 0.5f));
  EXPECT_THAT(run_refield({"acquire", "colour", folder_ / "session", "--chart", folder_ / "wall.exr"}),
              RefusedNaming("wall.exr", "no chart of 24 patches"));
  EXPECT_FALSE(read_capture_session(folder_ / "session").colour) << "the session is as before";
  ASSERT_THAT(run_refield({"acquire", "colour", folder_ / "session"}), Succeeded());
  EXPECT_THAT(run_refield({"estimate", folder_ / "session", "-o", folder_ / "f.rfield", "--max-kernels", "2",
                           "--clip", "0.9"}),
              RefusedNaming("session", "[camera.colour]"));
}

}  // namespace
}  // namespace refield
