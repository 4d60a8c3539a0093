// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/gui/recent_files.h"

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <string>

#include "core/base/errors.h"
#include "core/base/files.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

constexpr std::size_t max_list_bytes = std::size_t{1} << 16;
constexpr std::size_t max_path_bytes = 4096;

bool is_path(const std::string& line) {
  return line.size() <= max_path_bytes && line.starts_with('/') &&
         std::ranges::none_of(line, [](char c) { return static_cast<unsigned char>(c) < ' ' || c == 127; });
}

std::vector<fs::path> read_list(const fs::path& list) {
  std::vector<fs::path> files;
  std::error_code error;
  if (!fs::is_regular_file(list, error)) return files;
  std::ifstream stream(list, std::ios::binary);
  std::string text(max_list_bytes, '\0');
  stream.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(std::max<std::streamsize>(stream.gcount(), 0)));
  for (std::size_t start = 0; start < text.size() && files.size() < RecentFiles::max_files;) {
    const std::size_t end = std::min(text.find('\n', start), text.size());
    const std::string line = text.substr(start, end - start);
    if (is_path(line) && std::ranges::find(files, fs::path(line)) == files.end()) files.emplace_back(line);
    start = end + 1;
  }
  return files;
}

}  // namespace

RecentFiles::RecentFiles(fs::path list) : list_(std::move(list)) {
  if (!list_.empty()) files_ = read_list(list_);
}

fs::path RecentFiles::list_from_environment() {
  const char* state = std::getenv("XDG_STATE_HOME");
  if (state != nullptr && *state == '/') return fs::path(state) / "refield" / "recent";
  const char* home = std::getenv("HOME");
  return home != nullptr && *home == '/' ? fs::path(home) / ".local" / "state" / "refield" / "recent"
                                         : fs::path();
}

void RecentFiles::add(const fs::path& file) {
  std::error_code error;
  const fs::path absolute = fs::absolute(file, error).lexically_normal();
  if (error || !is_path(absolute.string())) return;
  if (!list_.empty()) files_ = read_list(list_);  // another window may have added some
  std::erase(files_, absolute);
  files_.insert(files_.begin(), absolute);
  if (files_.size() > max_files) files_.resize(max_files);
  if (list_.empty()) return;
  std::string text;
  for (const fs::path& each : files_) text += each.string() + "\n";
  try {
    create_folders(list_.parent_path());
    write_text_atomically(list_, text);
  } catch (const Error&) {
    // Of a disk that is full or cannot be written: the list lasts until the window is closed.
  }
}

}  // namespace refield
