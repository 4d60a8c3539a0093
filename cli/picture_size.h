// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

namespace refield::cli {

struct PictureSize {
  int width = 0;  ///< pixels
  int height = 0;
};

/// Reads "1440x900", the value of --size. Throws InputError for what is none, smaller than `least` or larger
/// than 16384x16384.
PictureSize read_picture_size(const std::string& text, PictureSize least);

}  // namespace refield::cli
