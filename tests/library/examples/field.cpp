// SPDX-License-Identifier: Apache-2.0
// Says what a field is, what one of its pixels takes light from, and writes a packed copy.
#include "refield/field.h"

#include <cstdio>

int main(int, char** arguments) {
  const refield::Field field(arguments[1]);
  const refield::LightDomain light = field.light_domain();
  std::printf("%d×%d pixels, lit by %d×%d texels\n", field.width(), field.height(), light.width,
              light.height);
  for (const refield::PixelKernel& kernel : field.kernels(field.width() / 2, field.height() / 2))
    std::printf("  %s of %d×%d texels, %.0f %% of the energy\n", kernel.hat ? "hat" : "box",
                kernel.support.width(), kernel.support.height(), 100.0 * kernel.energy_share);
  refield::pack(field, 0.001).write(arguments[2]);
}
