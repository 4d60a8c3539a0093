// SPDX-License-Identifier: Apache-2.0
// Looks at an image of another program's, whose rows stand from bottom to top, and writes it as OpenEXR.
#include "refield/image.h"

#include <vector>

int main(int, char** arguments) {
  constexpr int width = 4, height = 3, row = 3 * width;
  std::vector<float> theirs(row * height, 0.5f);
  const refield::ImageView view(theirs.data() + row * (height - 1), width, height, 3, 1, 3, -row);
  refield::write_exr(arguments[1], refield::Image(view));
  return refield::read_image(arguments[1]).at(3, 2, 1) == 0.5f ? 0 : 1;
}
