// SPDX-License-Identifier: Apache-2.0
#include "core/field/field_statistics.h"

#include <gtest/gtest.h>

#include "tests/support/random_data.h"

namespace refield {
namespace {

/// Pixels: one kernel of energy 90; three of energy 6, 3 and 0; one outside the mask.
ReflectanceField small_field() {
  ReflectanceField field;
  field.width = 3;
  field.height = 1;
  field.basis = {{10, 3, Parameterisation::monitor}, {}, {{0, 0, 10, 3}, {0, 0, 1, 1}}};
  const std::vector<std::uint32_t> first = {0};
  const std::vector<std::uint32_t> second = {1, 0, 1};
  field.transfer.append_row(first, std::vector<float>{1, 1, 1});                        // area 30 × 3
  field.transfer.append_row(second, std::vector<float>{2, 2, 2, 0.1f, 0, 0, 0, 0, 0});  // 6, 30 × 0.1, 0
  field.transfer.append_row({}, {});
  return field;
}

TEST(KernelStatistics, CountsAgainstTheKernelsThatWereAllowed) {
  const KernelStatistics s = kernel_statistics(small_field(), 5);
  EXPECT_EQ(s.pixels, 2u);
  EXPECT_EQ(s.kernels, 10u);
  EXPECT_EQ(s.stored, 4u);
  EXPECT_EQ(s.distinct_boxes, 2u);
  EXPECT_DOUBLE_EQ(s.mean_stored, 2.0);
  EXPECT_DOUBLE_EQ(s.nonzero_share, 0.3);
  // 90 of 99 is 90.9 %: two kernels reach 95 % (96.97 %), three 99 %.
  EXPECT_DOUBLE_EQ(s.share_of_95_percent, 0.2);
  EXPECT_DOUBLE_EQ(s.share_of_99_percent, 0.3);
  EXPECT_EQ(s.histogram, (std::vector<std::uint64_t>{1, 1, 0, 1}));
}

TEST(KernelStatistics, WithoutACapTheFullestPixelIsTheMeasure) {
  EXPECT_EQ(kernel_statistics(small_field()).kernels, 6u);
}

// In closed form: a forged file may state any size.
TEST(KernelStatistics, TheAreaOfAHatIsTheSumOverItsTexels) {
  for (const HatGrid& hats : {HatGrid{4, 3}, HatGrid{1, 7}, HatGrid{13, 2}, HatGrid{13, 7}, HatGrid{2, 1}}) {
    const LightBasis basis{{13, 7, Parameterisation::monitor}, hats, {}};
    double whole = 0.0;
    for (int node = 0; node < hats.count(); ++node) {
      double sum = 0.0;
      for (int y = 0; y < 7; ++y)
        for (int x = 0; x < 13; ++x) sum += hats.value(node, x, y, basis.domain);
      EXPECT_NEAR(basis.area(node), sum, 1e-5) << hats.columns << "×" << hats.rows << ", node " << node;
      whole += basis.area(node);
    }
    EXPECT_NEAR(whole, 13.0 * 7.0, 1e-9);
  }
  const LightBasis large{{65536, 4096, Parameterisation::monitor}, {3, 2}, {}};
  EXPECT_NEAR(large.area(1), 65536.0 / 2 * 4096.0 / 2, 1.0);
}

TEST(KernelStatistics, EmptyField) {
  ReflectanceField field;
  field.width = field.height = 1;
  field.transfer.append_row({}, {});
  const KernelStatistics s = kernel_statistics(field, 25);
  EXPECT_EQ(s.pixels, 0u);
  EXPECT_EQ(s.nonzero_share, 0.0);
}

TEST(KernelStatistics, SharesAreOrdered) {
  Rng rng(1);
  const auto s = kernel_statistics(test::random_field(rng, 20, 10, {16, 16}, 100, 12));
  EXPECT_LT(s.share_of_95_percent, s.share_of_99_percent);
  EXPECT_LT(s.share_of_99_percent, s.nonzero_share);
  EXPECT_LE(s.nonzero_share, 1.0);
}

}  // namespace
}  // namespace refield
