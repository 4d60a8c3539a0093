// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/errors.h"
#include "refield/image.h"

namespace refield {

/// The rows [first, last) of a view as an image.
Image copied_rows(const ImageView& view, int first, int last);

/// "640×480×3", for messages.
std::string shape_text(const Image& image);

/// Throws InputError, naming `name` and the first bad pixel, when a value is NaN, infinite or, unless
/// `allow_negative`, below zero. `remedy` ends the message.
void require_finite(const Image& image, const std::string& name, bool allow_negative,
                    const std::string& remedy);

/// An image at another size: each new texel is the mean of the radiance over its area of the old image, to
/// the fraction of a texel. Light is neither lost nor made (the mean over the image stays what it was),
/// nothing overshoots, and enlarging repeats texels, with a mixed one where a border falls within. Each side
/// is scaled on its own. Throws InputError for an empty image or a size below 1.
Image resample_area(const Image& image, int width, int height);

/// The same without changing the shape of what it shows: the middle part of `image` with the proportions of
/// width:height, then resample_area().
Image resample_area_cropped(const Image& image, int width, int height);

}  // namespace refield
