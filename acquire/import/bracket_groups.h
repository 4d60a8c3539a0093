// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/units.h"

namespace refield {

/// The files of one view.
struct BracketGroup {
  std::string name;  ///< what `{light}` stood for, else the first file's stem
  std::vector<std::filesystem::path> paths;
};

/// How files of a folder fall into brackets.
struct GroupRule {
  /// File names (with or without extension) with {light} where the view's name stands and * or ? for anything
  /// else:
  /// "{light}_e*.tif". Within a bracket files are sorted by name.
  std::string pattern;
  int count = 0;  ///< without a pattern: so many files, in the order of names, make a bracket
  /// Without either, an exposure time that the bracket has already begins the next one: then each file must
  /// state its time.
};

/// Groups files, which come sorted by name; brackets come in that order. `exposures`: of each file where
/// known. Throws InputError naming the file and the rule: a name that does not match, a count that does not
/// go up, an unknown exposure, or brackets whose numbers of exposures differ.
std::vector<BracketGroup> group_brackets(const std::vector<std::filesystem::path>& files,
                                         const std::vector<std::optional<Seconds>>& exposures,
                                         const GroupRule& rule);

}  // namespace refield
