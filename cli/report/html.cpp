// SPDX-License-Identifier: Apache-2.0
#include "cli/report/html.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

namespace refield::report {

std::string escaped(std::string_view text) {
  std::string safe;
  safe.reserve(text.size());
  for (const char c : text) switch (c) {
      case '&':
        safe += "&amp;";
        break;
      case '<':
        safe += "&lt;";
        break;
      case '>':
        safe += "&gt;";
        break;
      case '"':
        safe += "&quot;";
        break;
      case '\'':
        safe += "&#39;";
        break;
      default:
        safe += c;
    }
  return safe;
}

std::string base64(std::span<const std::uint8_t> bytes) {
  static constexpr char alphabet[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t left = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k) group = group << 8 | (k < left ? bytes[i + k] : 0u);
    for (std::size_t k = 0; k < 4; ++k) text += k <= left ? alphabet[group >> (18 - 6 * k) & 63] : '=';
  }
  return text;
}

std::string fixed(double value, int decimals) {
  if (!std::isfinite(value)) return "–";
  std::array<char, 400> buffer;
  const auto end =
      std::to_chars(buffer.data(), buffer.data() + buffer.size(), value, std::chars_format::fixed, decimals)
          .ptr;
  return {buffer.data(), end};
}

std::string significant(double value, int digits) {
  if (!std::isfinite(value)) return "–";
  if (value == 0.0) return "0";
  // Round first: 9.996 to three digits is 10.0, which has a decimal less.
  std::array<char, 64> rounded;
  const auto end = std::to_chars(rounded.data(), rounded.data() + rounded.size(), value,
                                 std::chars_format::scientific, digits - 1)
                       .ptr;
  std::from_chars(rounded.data(), end, value);
  const int magnitude = static_cast<int>(std::floor(std::log10(std::abs(value)) + 1e-9));
  return fixed(value, std::max(0, digits - 1 - magnitude));
}

std::string percent(double fraction) {
  return std::isfinite(fraction) ? significant(100.0 * fraction, 3) + "\u00a0%" : "–";
}

std::string bytes_text(double bytes) {
  static constexpr std::array units = {"bytes", "kB", "MB", "GB", "TB"};
  std::size_t unit = 0;
  for (; bytes >= 999.5 && unit + 1 < units.size(); ++unit) bytes /= 1000.0;
  return (unit == 0 ? fixed(bytes, 0) : significant(bytes, 3)) + " " + units[unit];
}

std::string duration_text(double seconds) {
  if (!std::isfinite(seconds)) return "–";
  if (seconds < 0.9995) return significant(1000.0 * seconds, 2) + " ms";
  if (seconds < 59.95) return significant(seconds, seconds < 9.95 ? 2 : 3) + " s";
  const auto whole = static_cast<std::uint64_t>(std::llround(seconds));
  if (whole < 3600) return std::to_string(whole / 60) + " min " + std::to_string(whole % 60) + " s";
  const std::uint64_t minutes = (whole + 30) / 60;
  return std::to_string(minutes / 60) + " h " + std::to_string(minutes % 60) + " min";
}

std::string counted(std::uint64_t count, std::string_view noun) {
  return std::to_string(count) + " " + std::string(noun) + (count == 1 ? "" : "s");
}

}  // namespace refield::report
