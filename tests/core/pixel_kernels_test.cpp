// SPDX-License-Identifier: Apache-2.0
#include "core/pixel_kernels.h"

#include <gtest/gtest.h>

#include "core/errors.h"
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
    for (std::size_t k = 0; k < kernels.size(); ++k) {
      EXPECT_EQ(kernels[k].support, field.basis.support(kernels[k].kernel));
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
