// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <map>

#include "core/base/errors.h"

namespace refield {

/// When a photograph was taken by the clock of its camera: seconds since 1970-01-01 00:00:00 as that clock
/// counts, without regard to time zones. Clocks of two cameras are brought together by matching.
using ClockSeconds = double;

inline constexpr const char* times_file_name = "times.tsv";

/// "2004-06-21 12:30:05.25", "2004:06:21 12:30:05" (EXIF) or the same with T or _ between; fractions of a
/// second optional. nullopt for anything else.
std::optional<ClockSeconds> clock_seconds_from_text(const std::string& text);

/// "2004-06-21T12:30:05.250": what clock_seconds_from_text() reads.
std::string text_from_clock_seconds(ClockSeconds seconds);

/// The time that a file name holds: YYYYMMDD, hhmmss and perhaps milliseconds, with any or no separators
/// between
/// ("IMG_20040621_123005.jpg", "sky-2004-06-21T12.30.05.exr"). nullopt when there is none.
std::optional<ClockSeconds> clock_seconds_from_name(const std::string& name);

/// The time that an image's metadata state (EXIF DateTimeOriginal with SubSecTimeOriginal, else DateTime),
/// else its name. nullopt where neither does.
std::optional<ClockSeconds> capture_time(const fs::path& image);

/// times.tsv of a folder: lines "NAME<tab>TIME", NAME without extension. Light maps and merged photographs no
/// longer hold their camera's metadata; this file does. Empty when there is none. Throws FormatError naming
/// the line.
std::map<std::string, ClockSeconds> read_times(const fs::path& folder);
void write_times(const fs::path& folder, const std::map<std::string, ClockSeconds>& times);

}  // namespace refield
