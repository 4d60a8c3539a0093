// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/peers/single_box.h"

#include <gtest/gtest.h>

#include "tests/studies/peer_fixture.h"
#include "tests/support/synthetic_capture.h"

namespace refield {
namespace {

constexpr LightDomain domain{40, 30, Parameterisation::monitor};

TEST(SingleBox, RecoversABox) {
  for (const Box& box : {Box{0, 0, 40, 30}, Box{7, 3, 19, 22}, Box{31, 25, 38, 29}, Box{11, 0, 14, 30}}) {
    const ReflectanceField truth = test::field_of_boxes(3, 2, domain, {box}, 3);
    const auto field = peers::fit_single_box(
        test::photographed(truth, test::random_lights(40, domain.width, domain.height, 1)));
    ASSERT_EQ(field.basis.boxes.size(), 1u);
    EXPECT_EQ(field.basis.boxes[0], box);
    for (const LightMap& light : test::random_lights(2, domain.width, domain.height, 5))
      EXPECT_LT(test::relative_difference(field.relight(light), truth.relight(light)), 1e-5);
  }
}

TEST(SingleBox, WithHolesInTheObservations) {
  const ReflectanceField truth = test::field_of_boxes(2, 2, domain, {{7, 3, 19, 22}}, 3);
  auto data = test::photographed(truth, test::random_lights(40, domain.width, domain.height, 1));
  for (int j = 0; j < 40; j += 3) data.observed(j, 4) = NAN;
  const auto field = peers::fit_single_box(data);
  for (const LightMap& light : test::random_lights(2, domain.width, domain.height, 5))
    EXPECT_LT(test::relative_difference(field.relight(light), truth.relight(light)), 1e-5);
}

TEST(SingleBox, KeepsMaskedPixelsEmpty) {
  const ReflectanceField truth = test::field_of_boxes(2, 1, domain, {{7, 3, 19, 22}}, 3);
  auto data = test::photographed(truth, test::random_lights(20, domain.width, domain.height, 1));
  data.mask = {1, 0};
  const auto field = peers::fit_single_box(data);
  EXPECT_EQ(field.transfer.row_start, (std::vector<std::uint64_t>{0, 1, 1}));
}

TEST(SingleBox, AMapOfOneTexel) {
  const LightDomain single{1, 1, Parameterisation::monitor};
  const ReflectanceField truth = test::field_of_boxes(2, 1, single, {{0, 0, 1, 1}}, 3);
  const auto field = peers::fit_single_box(test::photographed(truth, test::random_lights(5, 1, 1, 1)));
  EXPECT_EQ(field.basis.boxes[0], (Box{0, 0, 1, 1}));
}

}  // namespace
}  // namespace refield
