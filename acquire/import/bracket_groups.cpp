// SPDX-License-Identifier: Apache-2.0
#include "acquire/import/bracket_groups.h"

#include <algorithm>
#include <cmath>
#include <regex>

#include "core/errors.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

/// The pattern as a regular expression; {light} is its only group.
std::regex expression_of(const std::string& pattern) {
  static const std::string name = "{light}";
  const auto at = pattern.find(name);
  if (at == std::string::npos || pattern.find(name, at + 1) != std::string::npos)
    throw InputError("--pattern '" + pattern +
                     "': must contain {light} exactly once, at the position of the view's name");
  std::string expression;
  for (std::size_t i = 0; i < pattern.size(); ++i) {
    if (i == at) {
      expression += "(.+)";
      i += name.size() - 1;
    } else if (pattern[i] == '*') {
      expression += ".*";
    } else if (pattern[i] == '?') {
      expression += '.';
    } else {
      if (!std::isalnum(static_cast<unsigned char>(pattern[i])) && pattern[i] != '_') expression += '\\';
      expression += pattern[i];
    }
  }
  return std::regex(expression);
}

std::vector<BracketGroup> by_pattern(const std::vector<fs::path>& files, const std::string& pattern) {
  const std::regex expression = expression_of(pattern);
  std::vector<BracketGroup> groups;
  for (const fs::path& file : files) {
    std::smatch match;
    const std::string name = file.filename().string(), stem = file.stem().string();
    if (!std::regex_match(name, match, expression) && !std::regex_match(stem, match, expression))
      throw InputError(file.string() + ": does not match --pattern '" + pattern +
                       "'; correct the pattern, or remove the file from the folder");
    const std::string light = match[1].str();
    const auto group = std::ranges::find(groups, light, &BracketGroup::name);
    if (group == groups.end())
      groups.push_back({light, {file}});
    else
      group->paths.push_back(file);
  }
  return groups;
}

std::vector<BracketGroup> by_count(const std::vector<fs::path>& files, int count) {
  if (files.size() % static_cast<std::size_t>(count) != 0)
    throw InputError(files.back().string() + ": " + std::to_string(files.size()) +
                     " files do not make brackets of " + std::to_string(count) +
                     "; the last one is incomplete, or a file is missing before it");
  std::vector<BracketGroup> groups;
  for (std::size_t i = 0; i < files.size(); ++i) {
    if (i % static_cast<std::size_t>(count) == 0) groups.push_back({files[i].stem().string(), {}});
    groups.back().paths.push_back(files[i]);
  }
  return groups;
}

std::vector<BracketGroup> by_exposure(const std::vector<fs::path>& files,
                                      const std::vector<std::optional<Seconds>>& exposures) {
  std::vector<BracketGroup> groups;
  std::vector<double> seen;
  for (std::size_t i = 0; i < files.size(); ++i) {
    if (!exposures[i])
      throw InputError(files[i].string() +
                       ": does not contain its exposure time, so brackets cannot be detected; give --count "
                       "or --pattern, and --exposures");
    const double seconds = exposures[i]->count();
    constexpr double same = 0.02;  // metadata round
    const bool repeats =
        std::ranges::any_of(seen, [&](double s) { return std::abs(s - seconds) < same * s; });
    if (groups.empty() || repeats) {
      groups.push_back({files[i].stem().string(), {}});
      seen.clear();
    }
    groups.back().paths.push_back(files[i]);
    seen.push_back(seconds);
  }
  return groups;
}

}  // namespace

std::vector<BracketGroup> group_brackets(const std::vector<fs::path>& files,
                                         const std::vector<std::optional<Seconds>>& exposures,
                                         const GroupRule& rule) {
  if (files.empty()) throw InputError("there is no photograph to import");
  if (rule.count < 0) throw InputError("--count is " + std::to_string(rule.count) + "; give 1 or more");
  if (!rule.pattern.empty() && rule.count > 0) throw InputError("give --pattern or --count, not both");
  auto groups = !rule.pattern.empty() ? by_pattern(files, rule.pattern)
                : rule.count > 0      ? by_count(files, rule.count)
                                      : by_exposure(files, exposures);
  for (const BracketGroup& group : groups)
    if (group.paths.size() != groups.front().paths.size())
      throw InputError(group.paths.front().string() + ": its bracket has " +
                       std::to_string(group.paths.size()) + " exposures, the first one (" +
                       groups.front().paths.front().string() + ") has " +
                       std::to_string(groups.front().paths.size()) +
                       "; a file is missing or stray, or the brackets need --pattern or --count");
  return groups;
}

}  // namespace refield
