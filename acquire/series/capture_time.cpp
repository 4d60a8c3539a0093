// SPDX-License-Identifier: Apache-2.0
#include "acquire/series/capture_time.h"

#include <chrono>
#include <cmath>
#include <regex>
#include <sstream>

#include "core/base/files.h"
#include "core/base/number_text.h"
#include "core/image/image_file.h"

namespace refield {

namespace {

/// nullopt unless it is a date of the calendar and a time of day.
std::optional<ClockSeconds> clock_seconds(int year, int month, int day, int hour, int minute, double second) {
  const std::chrono::year_month_day date{std::chrono::year(year),
                                         std::chrono::month(static_cast<unsigned>(month)),
                                         std::chrono::day(static_cast<unsigned>(day))};
  if (!date.ok() || year < 1970 || hour > 23 || minute > 59 || second >= 61.0) return std::nullopt;
  const auto days = std::chrono::sys_days(date).time_since_epoch().count();
  return static_cast<double>(days) * 86400.0 + hour * 3600.0 + minute * 60.0 + second;
}

std::optional<ClockSeconds> from_match(const std::smatch& match) {
  const auto number = [&](int i) { return std::stoi(match[i].str()); };
  const double fraction = match[7].matched ? std::stod("0." + match[7].str()) : 0.0;
  return clock_seconds(number(1), number(2), number(3), number(4), number(5), number(6) + fraction);
}

}  // namespace

std::optional<ClockSeconds> clock_seconds_from_text(const std::string& text) {
  static const std::regex pattern(R"((\d{4})[-:](\d\d)[-:](\d\d)[ T_](\d\d):(\d\d):(\d\d)(?:\.(\d+))?)");
  std::smatch match;
  if (!std::regex_match(text, match, pattern)) return std::nullopt;
  return from_match(match);
}

std::string text_from_clock_seconds(ClockSeconds seconds) {
  const double milliseconds = std::round(seconds * 1e3);
  const auto whole = static_cast<std::int64_t>(std::floor(milliseconds / 1e3));
  const auto day = static_cast<std::int64_t>(std::floor(static_cast<double>(whole) / 86400.0));
  const std::chrono::year_month_day date{std::chrono::sys_days(std::chrono::days(day))};
  const auto in_day = static_cast<int>(whole - day * 86400);
  return formatted("%04d-%02u-%02uT%02d:%02d:%02d.%03d", static_cast<int>(date.year()),
                   static_cast<unsigned>(date.month()), static_cast<unsigned>(date.day()), in_day / 3600,
                   in_day / 60 % 60, in_day % 60,
                   static_cast<int>(milliseconds - static_cast<double>(whole) * 1e3));
}

std::optional<ClockSeconds> clock_seconds_from_name(const std::string& name) {
  // Not within a longer run of digits; milliseconds are three digits.
  static const std::regex pattern(
      R"((?:^|\D)(\d{4})[-_.:]?(\d\d)[-_.:]?(\d\d)[-_.: T]?(\d\d)[-_.:h]?(\d\d)[-_.:m]?(\d\d)(?:[-_.,]?(\d{3}))?(?!\d))");
  for (auto match = std::sregex_iterator(name.begin(), name.end(), pattern); match != std::sregex_iterator();
       ++match)
    if (const auto seconds = from_match(*match)) return seconds;
  return std::nullopt;
}

std::optional<ClockSeconds> capture_time(const fs::path& image) {
  try {
    const auto file = open_image_file(image);
    for (const auto& [key, fraction] : {std::pair{"Exif:DateTimeOriginal", "Exif:SubsecTimeOriginal"},
                                        std::pair{"DateTime", "Exif:SubsecTime"}}) {
      std::string text = file->text(key);
      if (text.empty()) continue;
      if (const std::string digits = file->text(fraction); !digits.empty()) text += "." + digits;
      if (const auto seconds = clock_seconds_from_text(text)) return seconds;
    }
  } catch (const Error&) {
    // What it shows is checked where it is read.
  }
  return clock_seconds_from_name(image.stem().string());
}

std::map<std::string, ClockSeconds> read_times(const fs::path& folder) {
  std::map<std::string, ClockSeconds> times;
  const fs::path path = folder / times_file_name;
  if (!fs::is_regular_file(path)) return times;
  std::istringstream lines(read_text(path));
  std::string line;
  for (int number = 1; std::getline(lines, line); ++number) {
    if (line.empty() || line.front() == '#') continue;
    const auto tab = line.find('\t');
    const auto seconds =
        tab == std::string::npos ? std::nullopt : clock_seconds_from_text(line.substr(tab + 1));
    if (!seconds)
      throw FormatError(path, "line " + std::to_string(number) + ", '" + line.substr(0, 80) +
                                  "', is not NAME<tab>TIME with a time as 2004-06-21T12:30:05.25");
    times[line.substr(0, tab)] = *seconds;
  }
  return times;
}

void write_times(const fs::path& folder, const std::map<std::string, ClockSeconds>& times) {
  std::string text;
  for (const auto& [name, seconds] : times) text += name + "\t" + text_from_clock_seconds(seconds) + "\n";
  write_text_atomically(folder / times_file_name, text);
}

}  // namespace refield
