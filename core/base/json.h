// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <nlohmann/json.hpp>
#include <string>

namespace refield {

/// One kind of JSON for the whole program. Objects keep the order in which they were written.
using Json = nlohmann::ordered_json;

/// Reads JSON. Throws Json::parse_error.
Json json_from_text(const std::string& text);

/// The same for text that need not be JSON, as what other programs wrote: a discarded value where it is not,
/// which is neither an object nor an array.
Json json_if_valid(const std::string& text);

/// A JSON value as text, indented by `indent` spaces a level; -1: on one line. Names of files need not be
/// UTF-8, which JSON must be: bytes that are not become U+FFFD.
std::string json_text(const Json& json, int indent = -1);

}  // namespace refield
