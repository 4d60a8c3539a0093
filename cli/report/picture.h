// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

#include "core/image/image.h"
#include "core/image/metrics.h"

namespace refield::report {

/// Pictures are shown at most this wide; larger images are averaged down to keep the page small.
inline constexpr int max_picture_width = 480;

/// Means of k × k pixels with the smallest k that makes the image at most `max_width` wide. Borders that do
/// not fill a block are averaged over what is there.
Image shrunk(const Image& image, int max_width);
/// The same with the highest value of each block: small bright details survive.
Image shrunk_by_maximum(const Image& image, int max_width);

/// The exposure at which the 99th percentile of the brightest channel inside the mask is white: two
/// significant digits, so that the page can state it. 1 for a black image.
double display_exposure(const Image& image, const Mask& mask);

/// Root mean square over the channels of predicted − reference, [height × width × 1].
Image error_magnitude(const Image& predicted, const Image& reference);

/// Black, violet, red, orange, pale yellow for 0 … high, as linear values that an exposure of 1 shows.
/// Values above `high` and infinite ones take the last colour; pixels outside the mask are a flat grey.
Image false_coloured(const Image& map, double high, const Mask& mask);

/// The colours of false_coloured() from 0 to high, as HTML. `low_text` and `high_text` label the ends.
std::string colour_bar_html(const std::string& low_text, const std::string& high_text);

/// An <img> with the picture inside. `css` names its class, `alt` describes it.
std::string image_html(const Image& image, double exposure, const std::string& alt,
                       const std::string& css = "photo");
/// The picture as a data: address.
std::string png_address(const Image& image, double exposure);

}  // namespace refield::report
