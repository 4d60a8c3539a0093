// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/json.h"
#include "core/image/metrics.h"

namespace refield::report {

/// A page that draws `data`: one file, nothing loaded from elsewhere. data["page"] names what draws it,
/// "report" (cli/report/report.js) or "calibration" (calibration.js); data["command"] is what the page says
/// made it. Follows the reader's light or dark scheme and prints on white.
std::string page_html(const Json& data);

/// RFC 4648, with padding.
std::string base64(std::span<const std::uint8_t> bytes);

/// `value` with a number of significant digits, never in exponent form: "0.0123", "340"; "–" when it is not
/// finite. Never depends on the locale.
std::string significant(double value, int digits);

/// "1.23 MB", decimal prefixes.
std::string bytes_text(double bytes);

/// The smallest round number (1, 2, 2.5 or 5 times a power of ten) that is not below `value` > 0.
double round_up(double value);

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

/// Width, height and the picture as a data: address.
Json picture_json(const Image& image, double exposure);

}  // namespace refield::report
