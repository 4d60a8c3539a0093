// SPDX-License-Identifier: Apache-2.0
#include "core/image/colour.h"

#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include <array>

#include "core/image/image_io.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

TEST(Colour, DeltaE2000OfPublishedPairs) {
  struct Pair {
    Eigen::Vector3d one, other;
    double delta_e;
  };
  // Sharma et al. 2005, table 1; each line there tests another branch of the formula.
  const std::array<Pair, 8> pairs = {{{{50.0, 2.6772, -79.7751}, {50.0, 0.0, -82.7485}, 2.0425},
                                      {{50.0, -1.3802, -84.2814}, {50.0, 0.0, -82.7485}, 1.0000},
                                      {{50.0, 0.0, 0.0}, {50.0, -1.0, 2.0}, 2.3669},
                                      {{50.0, 2.49, -0.001}, {50.0, -2.49, 0.0011}, 7.2195},
                                      {{50.0, 2.5, 0.0}, {50.0, 0.0, -2.5}, 4.3065},
                                      {{50.0, 2.5, 0.0}, {73.0, 25.0, -18.0}, 27.1492},
                                      {{60.2574, -34.0099, 36.2677}, {60.4626, -34.1751, 39.4387}, 1.2644},
                                      {{2.0776, 0.0795, -1.1350}, {0.9033, -0.0636, -0.5514}, 0.9082}}};
  for (const Pair& pair : pairs) {
    EXPECT_NEAR(delta_e_2000(pair.one, pair.other), pair.delta_e, 5e-5);
    EXPECT_NEAR(delta_e_2000(pair.other, pair.one), pair.delta_e, 5e-5);
  }
}

TEST(Colour, MatricesAreThePublishedOnes) {
  // IEC 61966-2-1, to its four digits.
  const Eigen::Matrix3d xyz =
      (Eigen::Matrix3d() << 0.4124, 0.3576, 0.1805, 0.2126, 0.7152, 0.0722, 0.0193, 0.1192, 0.9505)
          .finished();
  EXPECT_LT((xyz_from_rgb(rec709_chromaticities()) - xyz).cwiseAbs().maxCoeff(), 1e-4);
  // That of the OpenColorIO configurations for ACES.
  const Eigen::Matrix3d acescg = (Eigen::Matrix3d() << 0.613097, 0.339523, 0.047379, 0.070194, 0.916354,
                                  0.013452, 0.020616, 0.109570, 0.869815)
                                     .finished();
  EXPECT_LT((rgb_from_rgb(rec709_chromaticities(), acescg_chromaticities()) - acescg).cwiseAbs().maxCoeff(),
            1e-6);
}

TEST(Colour, WhiteIsNeutralAndLabIsInverted) {
  EXPECT_LT(
      (lab_from_rec709(Eigen::Vector3d::Ones()) - Eigen::Vector3d(100.0, 0.0, 0.0)).cwiseAbs().maxCoeff(),
      1e-9);
  for (const Eigen::Vector3d& lab : {Eigen::Vector3d(50.0, 20.0, -60.0), {5.0, -3.0, 2.0}, {95.0, -1.0, 3.0}})
    EXPECT_LT((lab_from_rec709(rec709_from_lab(lab)) - lab).cwiseAbs().maxCoeff(), 1e-9);
}

TEST(Colour, ExrFilesSayTheirChromaticities) {
  const test::TemporaryFolder folder;
  const Image image(4, 3, 3, 0.5f);
  write_exr(folder / "rec709.exr", image, Precision::half, ColourSpace::rec709);
  write_exr(folder / "camera.exr", image, Precision::half);
  const auto chromaticities = [&](const char* name) {
    const auto file = OIIO::ImageInput::open((folder / name).string());
    const auto* found = file->spec().find_attribute("chromaticities");
    std::vector<float> xy;
    if (found)
      xy.assign(static_cast<const float*>(found->data()), static_cast<const float*>(found->data()) + 8);
    return xy;
  };
  EXPECT_EQ(chromaticities("rec709.exr"),
            (std::vector<float>{0.64f, 0.33f, 0.30f, 0.60f, 0.15f, 0.06f, 0.3127f, 0.3290f}));
  EXPECT_TRUE(chromaticities("camera.exr").empty()) << "without a chart they are not known";
  EXPECT_EQ(read_image(folder / "rec709.exr").values, image.values);
}

}  // namespace
}  // namespace refield
