// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cerrno>
#include <cstddef>
#include <cstdlib>
#include <span>
#include <string_view>
#include <vector>

#include "core/base/errors.h"

namespace refield {

/// Writes a file so that a crash at any moment leaves either the old content or the new one: `write` fills a
/// temporary file beside `path` (same extension), which is then flushed to the device and renamed onto
/// `path`. The temporary is removed when `write` throws. Throws DeviceError where the system refuses.
void write_atomically(const fs::path& path, const std::function<void(const fs::path& temporary)>& write);

void write_text_atomically(const fs::path& path, std::string_view text);

/// Whole file as text. Throws DeviceError when it cannot be read.
std::string read_text(const fs::path& path);

/// A file of which pieces are read, by any number of threads. What replaces it meanwhile is not seen.
class OpenFile {
 public:
  /// Throws DeviceError when it cannot be opened.
  explicit OpenFile(fs::path path);
  ~OpenFile();
  OpenFile(const OpenFile&) = delete;
  OpenFile& operator=(const OpenFile&) = delete;
  /// All of `piece` from a byte of the file on. Throws DeviceError when it cannot be read or ends before.
  void read(std::uint64_t offset, std::span<std::byte> piece) const;

 private:
  fs::path path_;
  int descriptor_;
};

/// A file as memory that is only read. All processes of a machine that map a file share its memory. It must
/// not be shortened meanwhile; write_atomically() replaces it without harm.
class MappedFile {
 public:
  /// Throws DeviceError when it cannot be read.
  explicit MappedFile(const fs::path& path);
  ~MappedFile();
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;
  std::span<const std::byte> bytes() const { return {static_cast<const std::byte*>(memory_), size_}; }

 private:
  void* memory_ = nullptr;
  std::size_t size_ = 0;
};

/// Whether a file's name is that of a camera's own format (DNG, CR2, NEF and others).
bool is_camera_raw(const fs::path& path);

/// Creates a folder and its parents. Throws DeviceError when the system refuses.
void create_folders(const fs::path& folder);

/// Throws DeviceError (ENOSPC) unless the file system that holds `path` has `bytes` free. Asked before long
/// work begins.
void require_free_space(const fs::path& path, std::uint64_t bytes);

/// A file that a pattern found, and what its wildcards stood for ("train_*.exr" on train_007.exr: "007").
struct GlobMatch {
  fs::path path;
  std::string wildcard;
};

/// The order of file names: numbers in them count as numbers, so that photo_9 comes before photo_10.
bool comes_before(const fs::path& one, const fs::path& other);

/// Files that match a pattern with `*` and `?` in its last component, as comes_before() sorts them. A folder
/// stands for all image files in it. Throws InputError when nothing matches.
std::vector<GlobMatch> expand_glob(const std::string& pattern);

/// What a list of files, folders and patterns names, in order; an existing file stands for itself.
std::vector<fs::path> expand_globs(const std::vector<std::string>& patterns);

/// A folder of its own among the system's temporary files, removed with all it holds at the end of its life.
class TemporaryFolder {
 public:
  /// Throws DeviceError where the system refuses.
  TemporaryFolder() {
    std::string name = fs::temp_directory_path() / "refield-XXXXXX";
    if (!::mkdtemp(name.data())) throw DeviceError(name, errno, "cannot create a temporary folder");
    path_ = name;
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

}  // namespace refield
