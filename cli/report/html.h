// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace refield::report {

/// Text made safe for HTML and SVG content and for double-quoted attributes.
std::string escaped(std::string_view text);

/// RFC 4648, with padding.
std::string base64(std::span<const std::uint8_t> bytes);

/// `value` with a fixed number of decimals, "–" when it is not finite. Never depends on the locale.
std::string fixed(double value, int decimals);

/// `value` with a number of significant digits, never in exponent form: "0.0123", "340".
std::string significant(double value, int digits);

/// A fraction as a percentage with three significant digits: 0.0234 becomes "2.34 %", with a
/// no-break space.
std::string percent(double fraction);

/// "1.23 MB", decimal prefixes.
std::string bytes_text(double bytes);

/// "38 ms", "4.2 s", "2 min 5 s", "1 h 12 min".
std::string duration_text(double seconds);

/// "1 image", "3 images".
std::string counted(std::uint64_t count, std::string_view noun);

}  // namespace refield::report
