// SPDX-License-Identifier: Apache-2.0
#include "core/field/field_statistics.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "core/base/errors.h"
#include "tests/support/random_data.h"

namespace refield {
namespace {

TEST(PixelKernels, ComeWithMostEnergyFirst) {
  Rng rng{5};
  const ReflectanceField field = test::random_field(rng, 5, 4, {16, 12, Parameterisation::monitor}, 30, 8);
  for (std::size_t p = 0; p < field.transfer.rows(); ++p) {
    const auto kernels = kernels_of_pixel(field, p);
    ASSERT_EQ(kernels.size(), field.transfer.row_start[p + 1] - field.transfer.row_start[p]);
    double sum = 0.0;
    for (auto e = field.transfer.row_start[p]; e < field.transfer.row_start[p + 1]; ++e)
      EXPECT_TRUE(std::ranges::any_of(kernels, [&](const PixelKernel& kernel) {
        return kernel.support == field.basis.support(field.transfer.column[e]) &&
               kernel.weight[0] == field.transfer.weight[3 * e];
      }));
    for (std::size_t k = 0; k < kernels.size(); ++k) {
      if (k > 0) {
        EXPECT_LE(kernels[k].energy_share, kernels[k - 1].energy_share);
      }
      sum += kernels[k].energy_share;
    }
    EXPECT_NEAR(sum, kernels.empty() ? 0.0 : 1.0, 1e-12);
  }
  EXPECT_THROW(kernels_of_pixel(field, 20), InputError);
}

}  // namespace
}  // namespace refield
