// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cctype>
#include <charconv>
#include <cstdarg>
#include <cstddef>
#include <cstdio>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <string_view>

namespace refield {

/// All of `text` as a number, which may be NaN or infinite; nothing where it is no number or more than one.
/// `format`: the base of an integer, or std::chars_format.
template <class Number, class... Format>
std::optional<Number> number_from_text(std::string_view text, Format... format) {
  Number value{};
  const char* const last = text.data() + text.size();
  const auto [end, error] = std::from_chars(text.data(), last, value, format...);
  if (error != std::errc() || end != last) return std::nullopt;
  return value;
}

/// As std::printf() would print it.
[[gnu::format(printf, 1, 2)]] inline std::string formatted(const char* format, ...) {
  std::va_list values, again;
  va_start(values, format);
  va_copy(again, values);
  std::string text(static_cast<std::size_t>(std::vsnprintf(nullptr, 0, format, values)), '\0');
  std::vsnprintf(text.data(), text.size() + 1, format, again);
  va_end(values);
  va_end(again);
  return text;
}

inline std::string lower_case(std::string text) {
  for (char& letter : text) letter = static_cast<char>(std::tolower(static_cast<unsigned char>(letter)));
  return text;
}

/// "640×480"
inline std::string size_text(int width, int height) {
  return std::to_string(width) + "×" + std::to_string(height);
}

/// "a, b, c and 4 more": the names of at most `max_items` of a range.
template <class Range, class Name = std::identity>
std::string listed(const Range& items, std::size_t max_items = std::numeric_limits<std::size_t>::max(),
                   Name name = {}) {
  std::string text;
  std::size_t count = 0;
  for (const auto& item : items)
    if (count++ < max_items) text.append(text.empty() ? "" : ", ").append(std::invoke(name, item));
  return count > max_items ? text + " and " + std::to_string(count - max_items) + " more" : text;
}

}  // namespace refield
