// SPDX-License-Identifier: Apache-2.0
// Simulates a capture of a recipe's scene, for trying things out without a camera.
#include "refield/simulate.h"

#include <cstdio>

int main(int, char** arguments) {
  const char *recipe = arguments[1], *folder = arguments[2];
  refield::SimulationOptions options;
  options.width = 32;
  options.height = 24;
  options.light_width = 16;
  options.light_height = 12;
  options.train = 40;
  options.natural = 4;
  options.bars = 2;
  options.squares = 0;
  options.quality = 1;
  const refield::Session session = refield::simulate(recipe, folder, options);
  std::printf("%zu photographs of %d×%d pixels\n", session.size(), session.width(), session.height());
}
