// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

namespace refield::report {

/// The whole HTML document around a body: one file, nothing loaded from elsewhere, no script. Follows the
/// reader's light or dark scheme and prints on white. `made_by`: the command.
std::string page_html(const std::string& title, const std::string& body,
                      const std::string& made_by = "refield report");

}  // namespace refield::report
