// SPDX-License-Identifier: Apache-2.0
#include "core/base/json.h"

namespace refield {

Json json_from_text(const std::string& text) {
  return Json::parse(text);
}

Json json_if_valid(const std::string& text) {
  return Json::parse(text, nullptr, false);
}

std::string json_text(const Json& json, int indent) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

}  // namespace refield
