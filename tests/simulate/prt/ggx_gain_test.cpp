// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/prt_scene.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "simulate/dynamic/brdf.h"

namespace refield::prt {
namespace {

TEST(GgxGain, PhongExponentIsThreeQuartersOfWhatIsAsWide) {
  EXPECT_FLOAT_EQ(phong_exponent(1.0f), 0.0f);
  // A quarter of 2/α² − 2 is 7.5 at α = 0.25.
  EXPECT_FLOAT_EQ(phong_exponent(0.5f), 0.75f * 7.5f);
}

/// Of uniform light, by cells of the hemisphere.
float reflected(const dynamic::Brdf& brdf, float cosine) {
  constexpr int rows = 400, columns = 800;
  const Eigen::Vector3f sight(std::sqrt(1.0f - cosine * cosine), 0.0f, cosine);
  double sum = 0.0;
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < columns; ++j) {
      const float z = (static_cast<float>(i) + 0.5f) / rows, across = std::sqrt(1.0f - z * z);
      const float phi = 2.0f * std::numbers::pi_v<float> * (static_cast<float>(j) + 0.5f) / columns;
      sum += z * brdf({across * std::cos(phi), across * std::sin(phi), z}, sight)[0];
    }
  return static_cast<float>(sum * 2.0 * std::numbers::pi / (rows * columns));
}

TEST(GgxGain, MakesThePhongLobeReflectWhatGgxDoes) {
  const Eigen::Array3f black = Eigen::Array3f::Zero();
  for (const float roughness : {0.3f, 0.5f, 0.8f}) {
    const GgxGain gain(roughness);
    for (const float cosine : {0.25f, 0.5f, 0.97f})
      for (const float specular : {0.04f, 0.9f}) {
        const float phong = reflected(
            {black, Eigen::Array3f::Ones(), dynamic::Lobe::phong, phong_exponent(roughness)}, cosine);
        const float ggx = reflected(
            {black, Eigen::Array3f::Constant(specular), dynamic::Lobe::ggx, 0.0f, roughness * roughness},
            cosine);
        const float made = gain(cosine)(Eigen::Array3f::Constant(specular), false)[0] * phong;
        EXPECT_NEAR(made, ggx, 0.02f * ggx) << roughness << ' ' << cosine << ' ' << specular;
        // Without it metals would be too dark towards their outlines.
        if (cosine < 0.3f && specular > 0.5f) {
          EXPECT_LT(phong * specular, 0.75f * ggx);
        }
      }
  }
}

TEST(GgxGain, OfMetalsKeepsTheirColour) {
  const GgxGain::At gain = GgxGain(0.4f)(0.3f);
  const Eigen::Array3f gold(1.0f, 0.8f, 0.3f), made = gain(gold, true);
  EXPECT_NEAR(made[2] / made[0], 0.3f, 1e-6f);
  EXPECT_GT(gain(gold, false)[2] / gain(gold, false)[0], 0.3f);
  EXPECT_EQ(gain(Eigen::Array3f::Zero(), false)[0], 0.0f);  // what has no highlight gets none
}

}  // namespace
}  // namespace refield::prt
