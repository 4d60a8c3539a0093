// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>
#include <string_view>

namespace refield::web {

/// One of the page's files, as it stood in cli/web when the program was built.
struct PageFile {
  const char* name;
  std::string_view content;
};

std::span<const PageFile> page_files();

}  // namespace refield::web
