// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/image/image.h"

namespace refield {

/// 69 letters by which is_same_pattern() recognises a light map in another encoding (half or 8 bits, JPEG)
/// and at another brightness: to a field, which is linear, multiples of one light are the same. They hold a
/// count sketch (Charikar, Chen and Farach-Colton 2002) of what differs from the mean, which also tells
/// single texels apart, the mean's colour, the contrast, a sketch of the encoded luma, and `is_jpeg`.
std::string pattern_of(const Image& radiance, bool is_jpeg = false);
/// Whether two lights differ by less than about 5 % of what differs from their mean. If one is of a JPEG
/// file, which may store one colour for four texels: or their luma by less than about 30 %.
bool is_same_pattern(std::string_view a, std::string_view b);

}  // namespace refield
