// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace refield {

/// RGB samples, 8 bits, of one MJPEG frame: [height × width × 3], top row first. Frames without Huffman
/// tables, as USB cameras send them, are read with the standard's own. Throws DeviceError naming `device`
/// when the data are torn or of another size.
std::vector<std::uint16_t> decode_jpeg_frame(std::span<const std::uint8_t> jpeg, int width, int height,
                                             const std::string& device);

}  // namespace refield
