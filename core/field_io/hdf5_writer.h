// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <initializer_list>
#include <span>

#include "core/base/errors.h"

namespace refield {

/// Writes a new HDF5 file of attributes of the root and data sets in one piece, each with a checksum. Holds
/// no time, so that equal content gives equal bytes. Throws DeviceError where the disk refuses.
class Hdf5Writer {
 public:
  /// Creates `file`; errors name `destination`.
  Hdf5Writer(const fs::path& file, const fs::path& destination);
  ~Hdf5Writer();
  Hdf5Writer(const Hdf5Writer&) = delete;
  Hdf5Writer& operator=(const Hdf5Writer&) = delete;

  /// Makes a group for data sets.
  void group(const char* name) const;
  void text(const char* name, const std::string& value) const;
  void number(const char* name, std::int32_t value) const;
  /// T: float, double, std::int32_t, std::uint32_t or std::uint64_t.
  template <class T>
  void dataset(const char* name, const T* values, std::initializer_list<std::uint64_t> shape) const;
  /// Closes the file, all of it written.
  void finish();

 private:
  template <class T>
  friend class Hdf5DataSetWriter;
  void check(bool ok) const;
  fs::path destination_;
  std::int64_t file_;
};

/// Writes a data set piece by piece. The file equals, byte for byte, the one that Hdf5Writer::dataset() makes
/// of the whole, also where several data sets are written in turn: each takes its place in the file when it
/// is created.
template <class T>
class Hdf5DataSetWriter {
 public:
  /// `shape` of the whole. The writer must outlive this object.
  Hdf5DataSetWriter(const Hdf5Writer& writer, const char* name, std::initializer_list<std::uint64_t> shape);
  ~Hdf5DataSetWriter();
  Hdf5DataSetWriter(const Hdf5DataSetWriter&) = delete;
  Hdf5DataSetWriter& operator=(const Hdf5DataSetWriter&) = delete;

  /// Whole rows, which follow those before.
  void append(std::span<const T> values);
  /// Writes the checksum; to be called when all rows are there.
  void finish();

 private:
  void write(const T* values, std::uint64_t rows) const;

  const Hdf5Writer& writer_;
  std::uint64_t rows_, columns_;
  bool is_matrix_;
  std::int64_t set_;
  std::uint64_t done_ = 0;  // rows
  std::uint32_t crc_ = 0;
};

/// CRC-32 as zlib, PNG and Python's zlib.crc32 define it, of values that follow those which gave `before`.
/// HDF5 guards its own structures by checksums, not the values.
std::uint32_t crc32_of(const void* values, std::size_t bytes, std::uint32_t before = 0);
/// That of values which gave `first`, followed by that many bytes that gave `second`.
std::uint32_t crc32_joined(std::uint32_t first, std::uint32_t second, std::size_t second_bytes);
inline constexpr const char* hdf5_crc_name = "crc32";

}  // namespace refield
