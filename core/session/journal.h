// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string_view>
#include <vector>

#include "core/base/errors.h"

namespace refield {

/// A finished file as the journal knows it.
struct JournalFile {
  std::string path;  ///< relative to the session folder, with '/'
  std::uint64_t bytes = 0;
  std::uint32_t crc32 = 0;
  bool operator==(const JournalFile&) const = default;
};

/// One finished step of a capture: "ambient", "mask" or the name of a frame, and the files that it left.
struct JournalEntry {
  std::string step;
  std::vector<JournalFile> files;
  bool operator==(const JournalEntry&) const = default;
};

/// CRC-32 as in zlib, PNG and Python's zlib.crc32.
std::uint32_t crc32_of(std::string_view bytes, std::uint32_t before = 0);

/// A checksum in eight hexadecimal digits, as files of a session state it.
std::string crc32_text(std::uint32_t value);

/// Size and checksum of folder/path as it is on disk. Throws DeviceError when it cannot be read.
JournalFile inspect_file(const fs::path& folder, const std::string& path);

/// True when the file is there with the size and checksum that the journal states.
bool is_intact(const fs::path& folder, const JournalFile& file);

/// Entries of a journal; none when there is no file. Lines that are torn or whose checksum is wrong are left
/// out: their steps count as not done.
std::vector<JournalEntry> read_journal(const fs::path& path);

/// Appends one line and flushes it to the device. Throws DeviceError when the system refuses.
void append_to_journal(const fs::path& path, const JournalEntry& entry);

/// Replaces a journal as a whole, atomically.
void write_journal(const fs::path& path, const std::vector<JournalEntry>& entries);

}  // namespace refield
