// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <string>
#include <vector>

namespace refield::test {

/// A camera's RAW file, written byte by byte: a little-endian TIFF with one image of 16-bit Bayer samples and
/// the tags that DNG 1.4 requires. Black is 256, saturation 4095. `colours` of the first two by two sites: 0
/// red, 1 green, 2 blue.
std::string dng(std::uint32_t width, std::uint32_t height, const std::vector<std::uint16_t>& samples,
                const std::vector<std::uint8_t>& colours, double seconds, double f_number = 2.8);

}  // namespace refield::test
