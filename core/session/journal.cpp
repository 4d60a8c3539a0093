// SPDX-License-Identifier: Apache-2.0
#include "core/session/journal.h"

#include <fcntl.h>
#include <unistd.h>
#include <zlib.h>

#include <fstream>

#include "core/base/files.h"
#include "core/base/number_text.h"

namespace refield {

namespace {

/// step, then path, bytes and checksum of each file, then the line's own checksum; separated by tabs.
std::string line_of(const JournalEntry& entry) {
  std::string line = entry.step;
  for (const JournalFile& file : entry.files)
    line += "\t" + file.path + "\t" + std::to_string(file.bytes) + "\t" + crc32_text(file.crc32);
  return line + "\t" + crc32_text(crc32_of(line)) + "\n";
}

std::optional<JournalEntry> entry_of(std::string_view line) {
  const auto last_tab = line.rfind('\t');
  if (last_tab == std::string_view::npos) return std::nullopt;
  if (number_from_text<std::uint32_t>(line.substr(last_tab + 1), 16) != crc32_of(line.substr(0, last_tab)))
    return std::nullopt;
  std::vector<std::string> fields(1);
  for (char c : line.substr(0, last_tab))
    if (c == '\t')
      fields.emplace_back();
    else
      fields.back() += c;
  if (fields.size() % 3 != 1) return std::nullopt;
  JournalEntry entry{fields[0], {}};
  for (std::size_t i = 1; i < fields.size(); i += 3) {
    const auto bytes = number_from_text<std::uint64_t>(fields[i + 1], 10);
    const auto checksum = number_from_text<std::uint32_t>(fields[i + 2], 16);
    if (!bytes || !checksum) return std::nullopt;
    entry.files.push_back({fields[i], *bytes, *checksum});
  }
  return entry;
}

}  // namespace

std::string crc32_text(std::uint32_t value) {
  return formatted("%08x", value);
}

std::uint32_t crc32_of(std::string_view bytes, std::uint32_t before) {
  return static_cast<std::uint32_t>(
      ::crc32_z(before, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

JournalFile inspect_file(const fs::path& folder, const std::string& path) {
  std::ifstream stream(folder / path, std::ios::binary);
  JournalFile file{path, 0, 0};
  std::vector<char> buffer(1 << 18);
  while (stream) {
    stream.read(buffer.data(), static_cast<std::streamsize>(buffer.size()));
    const auto count = static_cast<std::size_t>(stream.gcount());
    file.crc32 = crc32_of({buffer.data(), count}, file.crc32);
    file.bytes += count;
  }
  if (!stream.eof()) throw DeviceError((folder / path).string(), errno, "cannot read the file");
  return file;
}

bool is_intact(const fs::path& folder, const JournalFile& file) {
  std::error_code error;
  return fs::is_regular_file(folder / file.path, error) &&
         fs::file_size(folder / file.path, error) == file.bytes && !error &&
         inspect_file(folder, file.path) == file;
}

std::vector<JournalEntry> read_journal(const fs::path& path) {
  std::vector<JournalEntry> entries;
  if (!fs::exists(path)) return entries;
  const std::string text = read_text(path);
  for (std::size_t start = 0, end; (end = text.find('\n', start)) != std::string::npos; start = end + 1)
    if (auto entry = entry_of(std::string_view(text).substr(start, end - start))) entries.push_back(*entry);
  return entries;
}

void append_to_journal(const fs::path& path, const JournalEntry& entry) {
  const std::string line = line_of(entry);
  const int fd = ::open(path.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0644);
  if (fd < 0) throw DeviceError(path.string(), errno, "cannot open the journal");
  const auto written = ::write(fd, line.data(), line.size());
  const bool safe = written == static_cast<ssize_t>(line.size()) && ::fsync(fd) == 0;
  // A short write means that the device is full.
  const int error_number = written >= 0 && written < static_cast<ssize_t>(line.size()) ? ENOSPC : errno;
  ::close(fd);
  if (!safe) throw DeviceError(path.string(), error_number, "cannot write the journal");
}

void write_journal(const fs::path& path, const std::vector<JournalEntry>& entries) {
  std::string text;
  for (const JournalEntry& entry : entries) text += line_of(entry);
  write_text_atomically(path, text);
}

}  // namespace refield
