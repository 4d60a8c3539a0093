// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <map>

#include "core/base/aligned_memory.h"
#include "core/base/run_context.h"

namespace refield {

/// An identifier of the HDF5 library (hid_t), of any kind.
class Hdf5Id {
 public:
  explicit Hdf5Id(std::int64_t id) : id_(id) {}
  ~Hdf5Id();  ///< of hdf5_describe.cpp
  Hdf5Id(const Hdf5Id&) = delete;
  Hdf5Id& operator=(const Hdf5Id&) = delete;
  operator std::int64_t() const { return id_; }
  bool valid() const { return id_ >= 0; }

 private:
  std::int64_t id_;
};

/// Where in an HDF5 file a data set's values lie, in one piece.
struct Hdf5DataSet {
  std::string type;  ///< "f4", "f8", "i4", "u4", "u8": little-endian; else ""
  std::vector<std::uint64_t> shape;
  std::uint64_t offset = 0;            ///< bytes from the file's begin; of no meaning where nothing is stored
  std::uint64_t bytes = 0;             ///< stored
  std::optional<std::uint32_t> crc32;  ///< the attribute of that name
};

/// What stands in an HDF5 file, without the values of its data sets.
struct Hdf5Outline {
  std::map<std::string, std::int64_t> numbers;  ///< attributes of the root: scalar integers
  std::map<std::string, std::string> texts;     ///< and scalar texts of fixed length
  std::map<std::string, Hdf5DataSet> data_sets;
  /// Named data sets that are there but not read, and what they are: "a link to another place or file".
  std::map<std::string, std::string> refused;
};

/// Reads attributes of the root and the named data sets, where present. HDF5's library (1.10) crashes on many
/// damaged files, so where files may be hostile, run.read_isolated calls it in another process; the caller
/// reads the values itself. nullopt where the file is no HDF5 file or the library did not survive it. Links
/// that lead elsewhere (soft, external) are not followed; they and data sets that are not stored in one piece
/// in this very file (chunked, compressed, external, virtual) are refused.
std::optional<Hdf5Outline> read_hdf5_outline(const fs::path& path, std::span<const char* const> data_sets,
                                             const RunContext& run);

/// Reads values from a reflectance field's HDF5 file, whose outline is known; checks all that is asked for.
/// Throws FormatError.
struct Hdf5Values {
  Hdf5Outline outline;
  fs::path path;

  [[noreturn]] void fail(const std::string& what) const;
  bool has(const char* name) const { return outline.data_sets.contains(name); }
  const std::string& text(const char* name) const;
  bool has_number(const char* name) const { return outline.numbers.contains(name); }
  std::int32_t number(const char* name) const;

  /// A data set of `columns` columns. T: float, double, std::int32_t, std::uint32_t or std::uint64_t.
  template <class T>
  std::vector<T> dataset(const char* name, std::size_t columns) const;
  /// A dataset as a vector; values of `map_from` bytes or more stay in the file until they are read.
  template <class T>
  FileVector<T> file_vector(const char* name, std::size_t columns, std::uint64_t map_from) const;
  /// A data set of that many columns as type "f4", "f8", "i4", "u4" or "u8", all of which lies in the file.
  const Hdf5DataSet& locate(const char* name, const char* type, std::size_t columns) const;
};

/// Reads a data set piece by piece, each with all threads.
class Hdf5Pieces {
 public:
  Hdf5Pieces(const Hdf5Values& values, const char* name, const Hdf5DataSet& set);
  void read(std::span<std::byte> piece);
  /// Takes the whole data set where it stands for read.
  template <class T>
  void check(const FileVector<T>& values);
  /// Checks what was read, if all of it was, against the file's checksum; another program may have left that
  /// out.
  void finish() const;

 private:
  [[noreturn]] void fail(const char* what) const;
  template <class SumOf>
  void sum_parts(std::size_t bytes, const SumOf& sum_of);
  const Hdf5Values& values_;
  const char* name_;
  const Hdf5DataSet& set_;
  std::uint64_t done_ = 0;  // bytes
  std::uint32_t crc_ = 0;
};

/// What read_hdf5_outline() finds, as CBOR; the arguments are the file and the names of the data sets. HDF5's
/// library (1.10) crashes on many damaged files: where files may be hostile, call it in a process of its own.
/// Not for several threads at once. Throws where the file is no HDF5 file.
std::string describe_hdf5(const std::vector<std::string>& arguments);

}  // namespace refield
