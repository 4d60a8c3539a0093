// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

namespace refield {

/// A JSON value as text, indented by `indent` spaces a level; -1: on one line. Names of files need not be
/// UTF-8, which JSON must be: bytes that are not become U+FFFD.
template <class Json>
std::string json_text(const Json& json, int indent = -1) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

}  // namespace refield
