// SPDX-License-Identifier: Apache-2.0
#include "cli/picture_size.h"

#include <cstdio>

#include "core/errors.h"

namespace refield::cli {

PictureSize read_picture_size(const std::string& text, PictureSize least) {
  constexpr int largest = 16384;
  PictureSize size;
  char rest = '\0';
  if (std::sscanf(text.c_str(), "%dx%d%c", &size.width, &size.height, &rest) != 2 ||
      size.width < least.width || size.height < least.height || size.width > largest || size.height > largest)
    throw InputError("--size " + text + ": give width x height in pixels, " + std::to_string(least.width) +
                     "x" + std::to_string(least.height) + " to 16384x16384");
  return size;
}

}  // namespace refield::cli
