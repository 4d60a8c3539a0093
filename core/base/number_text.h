// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <charconv>
#include <optional>
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

}  // namespace refield
