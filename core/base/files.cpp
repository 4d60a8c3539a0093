// SPDX-License-Identifier: Apache-2.0
#include "core/base/files.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>

#include "core/base/number_text.h"

namespace refield {

namespace {

/// Flushes a file's or folder's content to the device.
void sync_to_device(const fs::path& path, int flags) {
  const int fd = ::open(path.c_str(), flags | O_CLOEXEC);
  // A folder in which files may be created need not be readable.
  if (fd < 0 && errno == EACCES && (flags & O_DIRECTORY)) return;
  if (fd < 0) throw DeviceError(path.string(), errno, "cannot open to flush it");
  const int status = ::fsync(fd);
  const int error_number = errno;
  ::close(fd);
  // Some file systems cannot sync; the rename is then as safe as they allow.
  if (status != 0 && error_number != EINVAL && error_number != ENOSYS && error_number != EOPNOTSUPP)
    throw DeviceError(path.string(), error_number, "cannot flush to disk");
}

fs::path folder_of(const fs::path& path) {
  return path.has_parent_path() ? path.parent_path() : fs::path(".");
}

/// Text that the wildcards of `pattern` stand for in `text`, joined by '/'; nullopt when it does not match.
/// Each `*` takes as little as it can. When the text does not fit, only the last `*` takes more: what stands
/// before it fits already, and at the earliest place. So the time is at most the product of the two lengths.
std::optional<std::string> match_wildcards(std::string_view pattern, std::string_view text) {
  struct Wildcard {
    std::size_t begin, end;  // in the text
  };
  std::vector<Wildcard> wildcards;
  struct LastStar {
    std::size_t after;  // in the pattern
    std::size_t wildcards;
  };
  std::optional<LastStar> star;
  std::size_t p = 0, t = 0;
  while (t < text.size() || p < pattern.size()) {
    if (p < pattern.size() && pattern[p] == '*') {
      wildcards.push_back({t, t});
      star = {++p, wildcards.size()};
    } else if (p < pattern.size() && t < text.size() && (pattern[p] == '?' || pattern[p] == text[t])) {
      if (pattern[p++] == '?') wildcards.push_back({t, t + 1});
      ++t;
    } else {
      if (!star) return std::nullopt;
      wildcards.resize(star->wildcards);
      if (wildcards.back().end == text.size()) return std::nullopt;
      t = ++wildcards.back().end;
      p = star->after;
    }
  }
  std::string joined;
  for (std::size_t i = wildcards.size(); i-- > 0;) {
    const auto [begin, end] = wildcards[i];
    joined = std::string(text.substr(begin, end - begin)) + (joined.empty() ? "" : "/" + joined);
  }
  return joined;
}

/// Creates an empty file beside `path`, named `.partial-RANDOM-NAME`. No one can predict that name, and an
/// existing file or link is never opened.
fs::path create_temporary(const fs::path& path) {
  constexpr std::size_t max_name = 255, max_tail = 200;
  const std::string name = path.filename().string();
  const auto fail = [&](int error_number) {
    throw DeviceError(path.string(), error_number, "cannot create");
  };
  if (name.size() > max_name) fail(ENAMETOOLONG);
  const std::string tail = name.size() > max_tail ? name.substr(name.size() - max_tail) : name;
  for (;;) {
    std::uint64_t random = 0;
    if (::getrandom(&random, sizeof random, 0) != sizeof random) fail(errno);
    fs::path temporary =
        folder_of(path) /
        (".partial-" + formatted("%016llx", static_cast<unsigned long long>(random)) + "-" + tail);
    const int fd = ::open(temporary.c_str(), O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0666);
    if (fd >= 0) {
      ::close(fd);
      return temporary;
    }
    if (errno != EEXIST) fail(errno);
  }
}

/// Whether the extension, in whatever case, is one of `known`.
bool has_extension(const fs::path& path, std::initializer_list<std::string_view> known) {
  return std::ranges::find(known, lower_case(path.extension())) != known.end();
}

bool is_image_file(const fs::path& path) {
  return has_extension(path, {".exr", ".hdr", ".png", ".jpg", ".jpeg", ".tif", ".tiff", ".pfm"}) ||
         is_camera_raw(path);
}

}  // namespace

bool is_camera_raw(const fs::path& path) {
  return has_extension(path, {".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf", ".rw2", ".pef"});
}

void write_atomically(const fs::path& path, const std::function<void(const fs::path&)>& write) {
  const fs::path temporary = create_temporary(path);
  try {
    write(temporary);
    sync_to_device(temporary, O_RDWR | O_NOFOLLOW);
    if (::rename(temporary.c_str(), path.c_str()) != 0)
      throw DeviceError(path.string(), errno, "cannot rename the finished file into place");
  } catch (...) {
    std::error_code ignored;
    fs::remove(temporary, ignored);
    throw;
  }
  sync_to_device(folder_of(path), O_RDONLY | O_DIRECTORY);
}

void write_text_atomically(const fs::path& path, std::string_view text) {
  write_atomically(path, [&](const fs::path& temporary) {
    std::FILE* file = std::fopen(temporary.c_str(), "wbe");
    if (!file) throw DeviceError(path.string(), errno, "cannot create");
    errno = 0;
    const bool written = std::fwrite(text.data(), 1, text.size(), file) == text.size();
    const bool closed = std::fclose(file) == 0;
    if (!written || !closed) throw DeviceError(path.string(), errno, "cannot write");
  });
}

std::string read_text(const fs::path& path) {
  if (fs::is_directory(path)) throw DeviceError(path.string(), EISDIR, "cannot read");
  // A pipe that no one writes to is not waited for.
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  std::FILE* file = descriptor < 0 ? nullptr : ::fdopen(descriptor, "rb");
  if (!file) throw DeviceError(path.string(), errno, "cannot open");
  // A regular file ends; what comes from a pipe or a device need not.
  constexpr std::size_t max_stream_bytes = std::size_t{64} << 20;
  const bool ends = fs::is_regular_file(path);
  std::string text;
  char buffer[1 << 16];
  if (!ends) {
    const ssize_t got = ::read(descriptor, buffer, sizeof buffer);
    if (got == 0 && fs::is_fifo(path)) {
      std::fclose(file);
      throw FormatError(path, "is a pipe that no program writes to; give a regular file");
    }
    if (got > 0) text.assign(buffer, static_cast<std::size_t>(got));
    ::fcntl(descriptor, F_SETFL, ::fcntl(descriptor, F_GETFL) & ~O_NONBLOCK);
  }
  while (const std::size_t got = std::fread(buffer, 1, sizeof buffer, file)) {
    text.append(buffer, got);
    if (ends || text.size() <= max_stream_bytes) continue;
    std::fclose(file);
    throw FormatError(path, "is not a regular file and is longer than 64 MiB; give a regular file");
  }
  const bool failed = std::ferror(file) != 0;
  const int error_number = errno;
  std::fclose(file);
  if (failed) throw DeviceError(path.string(), error_number, "cannot read");
  return text;
}

OpenFile::OpenFile(fs::path path)
    : path_(std::move(path)), descriptor_(::open(path_.c_str(), O_RDONLY | O_CLOEXEC)) {
  if (descriptor_ < 0) throw DeviceError(path_.string(), errno, "cannot open");
}

OpenFile::~OpenFile() {
  ::close(descriptor_);
}

void OpenFile::read(std::uint64_t offset, std::span<std::byte> piece) const {
  while (!piece.empty()) {
    const ssize_t count = ::pread(descriptor_, piece.data(), piece.size(), static_cast<off_t>(offset));
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) throw DeviceError(path_.string(), count < 0 ? errno : EIO, "cannot read");
    offset += static_cast<std::uint64_t>(count);
    piece = piece.subspan(static_cast<std::size_t>(count));
  }
}

MappedFile::MappedFile(const fs::path& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) throw DeviceError(path.string(), errno, "cannot open");
  struct stat status = {};
  int error_number = ::fstat(fd, &status) == 0 ? 0 : errno;
  if (error_number == 0 && status.st_size > 0) {  // nothing cannot be mapped
    size_ = static_cast<std::size_t>(status.st_size);
    memory_ = ::mmap(nullptr, size_, PROT_READ, MAP_PRIVATE, fd, 0);  // FUSE may refuse shared ones
    if (memory_ == MAP_FAILED) error_number = errno;
  }
  ::close(fd);
  if (error_number != 0) throw DeviceError(path.string(), error_number, "cannot read");
}

MappedFile::~MappedFile() {
  if (memory_) ::munmap(memory_, size_);
}

void create_folders(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw DeviceError(folder.string(), error.value(), "cannot create the folder");
}

void require_free_space(const fs::path& path, std::uint64_t bytes) {
  fs::path existing = fs::absolute(path);
  while (!fs::exists(existing) && existing.has_relative_path()) existing = existing.parent_path();
  std::error_code error;
  const auto space = fs::space(existing, error);
  if (error || space.available >= bytes) return;
  throw DeviceError(existing.string(), ENOSPC, "needs ", bytes / 1'000'000 + 1, " MB, has ",
                    space.available / 1'000'000, " MB free");
}

bool comes_before(const fs::path& one, const fs::path& other) {
  const std::string &a = one.native(), &b = other.native();
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  const auto digits_from = [&](const std::string& text, std::size_t& at) {
    while (at < text.size() && text[at] == '0') ++at;
    const std::size_t first = at;
    while (at < text.size() && is_digit(text[at])) ++at;
    return std::string_view(text).substr(first, at - first);
  };
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (is_digit(a[i]) && is_digit(b[j])) {
      const std::string_view left = digits_from(a, i), right = digits_from(b, j);
      if (left.size() != right.size()) return left.size() < right.size();
      if (left != right) return left < right;
    } else {
      if (a[i] != b[j]) return static_cast<unsigned char>(a[i]) < static_cast<unsigned char>(b[j]);
      ++i, ++j;
    }
  }
  const std::size_t left = a.size() - i, right = b.size() - j;
  return left != right ? left < right : a < b;  // equal but for zeros before numbers
}

std::vector<GlobMatch> expand_glob(const std::string& pattern) {
  fs::path path(pattern);
  std::vector<GlobMatch> matches;
  if (fs::is_directory(path)) {
    std::string other;
    for (const auto& entry : fs::directory_iterator(path)) {
      const std::string name = entry.path().filename().string();
      if (!entry.is_regular_file() || name[0] == '.') continue;
      if (is_image_file(entry.path()))
        matches.push_back({entry.path(), entry.path().stem().string()});
      else if (other.empty() || comes_before(name, other))
        other = name;
    }
    if (matches.empty())
      throw InputError(pattern,
                       ": the folder contains no images (EXR, HDR, PNG, JPEG, TIFF, PFM, camera RAW)",
                       other.empty() ? "" : ", but other files, for example " + other,
                       "; check its name or convert the files");
  } else if (fs::is_directory(folder_of(path))) {
    for (const auto& entry : fs::directory_iterator(folder_of(path))) {
      const std::string name = entry.path().filename().string();
      if (name[0] == '.' && pattern[0] != '.') continue;
      if (auto wildcard = match_wildcards(path.filename().string(), name))
        matches.push_back({path.has_parent_path() ? entry.path() : fs::path(name), *wildcard});
    }
  }
  if (matches.empty())
    throw InputError("no file matches '", pattern, "'; quote the pattern and check the folder's name");
  std::ranges::sort(matches, comes_before, &GlobMatch::path);
  return matches;
}

std::vector<fs::path> expand_globs(const std::vector<std::string>& patterns) {
  std::vector<fs::path> paths;
  for (const std::string& pattern : patterns) {
    if (fs::is_regular_file(pattern))
      paths.emplace_back(pattern);
    else
      for (const GlobMatch& match : expand_glob(pattern)) paths.push_back(match.path);
  }
  return paths;
}

}  // namespace refield
