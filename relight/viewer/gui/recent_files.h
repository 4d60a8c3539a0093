// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <vector>

namespace refield {

/// Files that were opened before, in a text file with one absolute path per line. Lines that cannot be paths
/// are left out and errors of the file system are ignored: at worst the list is empty.
class RecentFiles {
 public:
  static constexpr std::size_t max_files = 12;

  /// `list`: the text file; empty: nothing is remembered.
  explicit RecentFiles(std::filesystem::path list);
  /// $XDG_STATE_HOME/refield/recent, else ~/.local/state/refield/recent.
  static std::filesystem::path list_from_environment();

  /// The last one first.
  const std::vector<std::filesystem::path>& files() const { return files_; }
  /// Moves or puts a file to the front, in the list on disk, too.
  void add(const std::filesystem::path& file);

 private:
  std::filesystem::path list_;
  std::vector<std::filesystem::path> files_;
};

}  // namespace refield
