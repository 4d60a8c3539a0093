// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/hdf5_outline.h"

namespace refield {

/// Reads values from a reflectance field's HDF5 file, whose outline is known; checks all that is asked for.
/// Throws FormatError.
struct Hdf5Values {
  Hdf5Outline outline;
  std::filesystem::path path;

  [[noreturn]] void fail(const std::string& what) const;
  bool has(const char* name) const { return outline.data_sets.contains(name); }
  const std::string& text(const char* name) const;
  bool has_number(const char* name) const { return outline.numbers.contains(name); }
  std::int32_t number(const char* name) const;

  /// A data set of `columns` columns. T: float, double, std::int32_t, std::uint32_t or std::uint64_t.
  template <class T>
  std::vector<T> dataset(const char* name, std::size_t columns) const;
  /// A data set of so many columns as type "f4", "f8", "i4", "u4" or "u8", all of which lies in the file.
  const Hdf5DataSet& locate(const char* name, const char* type, std::size_t columns) const;
};

/// Reads a data set piece by piece, each with all threads.
class Hdf5Pieces {
 public:
  Hdf5Pieces(const Hdf5Values& values, const char* name, const Hdf5DataSet& set);
  void read(std::span<std::byte> piece);
  /// Checks what was read, if all of it was, against the file's checksum; another program may have left that
  /// out.
  void finish() const;

 private:
  [[noreturn]] void fail(const char* what) const;
  const Hdf5Values& values_;
  const char* name_;
  const Hdf5DataSet& set_;
  std::uint64_t done_ = 0;  // bytes
  std::uint32_t crc_ = 0;
};

}  // namespace refield
