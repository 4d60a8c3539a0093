// SPDX-License-Identifier: Apache-2.0
#include "core/field_io/hdf5_writer.h"

#include <hdf5.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>

#include "core/field_io/hdf5_reader.h"

namespace refield {

namespace {

/// In files, and in memory, too: values are written, and their checksums made, as they stand.
template <class T>
hid_t type_of() {
  static_assert(std::endian::native == std::endian::little);
  if constexpr (std::is_same_v<T, float>)
    return H5T_IEEE_F32LE;
  else if constexpr (std::is_same_v<T, double>)
    return H5T_IEEE_F64LE;
  else if constexpr (std::is_same_v<T, std::int32_t>)
    return H5T_STD_I32LE;
  else if constexpr (std::is_same_v<T, std::uint32_t>)
    return H5T_STD_U32LE;
  else
    return H5T_STD_U64LE;
}

/// A file that could not be written to its end stays open in the library, whose cleaning up at exit crashes
/// on it (HDF5 1.10). Complete files are closed by finish(), so nothing is left to clean. This must come
/// before the library's first use.
[[maybe_unused]] const bool no_cleaning_at_exit = H5dont_atexit() >= 0;

hid_t create(const fs::path& file) {
  H5Eset_auto2(H5E_DEFAULT, nullptr,
               nullptr);  // its error stack would be printed; ours go through exceptions
  const Hdf5Id access(H5Pcreate(H5P_FILE_ACCESS));
  H5Pset_libver_bounds(access, H5F_LIBVER_V18, H5F_LIBVER_V110);
  H5Pset_file_locking(access, false, true);  // network file systems may refuse flock(); OutputLock holds ours
  const Hdf5Id timeless(H5Pcreate(H5P_FILE_CREATE));
  H5Pset_obj_track_times(timeless, false);
  return H5Fcreate(file.c_str(), H5F_ACC_TRUNC, timeless, access);
}

}  // namespace

std::uint32_t crc32_of(const void* values, std::size_t bytes, std::uint32_t before) {
  return static_cast<std::uint32_t>(crc32_z(before, static_cast<const Bytef*>(values), bytes));
}

std::uint32_t crc32_joined(std::uint32_t first, std::uint32_t second, std::size_t second_bytes) {
  return static_cast<std::uint32_t>(crc32_combine(first, second, static_cast<z_off_t>(second_bytes)));
}

Hdf5Writer::Hdf5Writer(const fs::path& file, const fs::path& destination) : destination_(destination) {
  static_assert(std::is_same_v<hid_t, std::int64_t> || sizeof(hid_t) == sizeof(std::int64_t));
  errno = 0;
  file_ = create(file);
  check(file_ >= 0);
}

void Hdf5Writer::group(const char* name) const {
  // HDF5 keeps times of creation for groups by default.
  const Hdf5Id timeless(H5Pcreate(H5P_GROUP_CREATE));
  H5Pset_obj_track_times(timeless, false);
  check(Hdf5Id(H5Gcreate2(file_, name, H5P_DEFAULT, timeless, H5P_DEFAULT)).valid());
}

Hdf5Writer::~Hdf5Writer() {
  if (file_ >= 0) H5Fclose(file_);
}

void Hdf5Writer::check(bool ok) const {
  if (!ok)
    throw DeviceError(destination_.string(), errno != 0 ? errno : EIO, "cannot write the reflectance field");
}

void Hdf5Writer::finish() {
  check(H5Fflush(file_, H5F_SCOPE_GLOBAL) >= 0);
  const herr_t status = H5Fclose(file_);
  file_ = -1;
  check(status >= 0);
}

template <class T>
void Hdf5Writer::dataset(const char* name, const T* values,
                         std::initializer_list<std::uint64_t> shape) const {
  std::size_t count = 1;
  for (const std::uint64_t extent : shape) count *= extent;
  Hdf5DataSetWriter<T> set(*this, name, shape);
  set.append({values, count});
  set.finish();
}

template <class T>
Hdf5DataSetWriter<T>::Hdf5DataSetWriter(const Hdf5Writer& writer, const char* name,
                                        std::initializer_list<std::uint64_t> shape)
    : writer_(writer),
      rows_(shape.begin()[0]),
      columns_(shape.size() > 1 ? shape.begin()[1] : 1),
      is_matrix_(shape.size() > 1),
      set_(-1) {
  const std::vector<hsize_t> extent(shape.begin(), shape.end());
  const Hdf5Id space(H5Screate_simple(static_cast<int>(extent.size()), extent.data(), nullptr));
  const Hdf5Id creation(H5Pcreate(H5P_DATASET_CREATE));
  H5Pset_obj_track_times(creation, false);
  set_ = H5Dcreate2(writer.file_, name, type_of<T>(), space, H5P_DEFAULT, creation, H5P_DEFAULT);
  writer_.check(set_ >= 0);
  // The library gives the whole data set its place at the first write.
  const std::vector<T> blank(columns_);
  if (rows_ * columns_ > 0) write(blank.data(), 1);
  const Hdf5Id scalar(H5Screate(H5S_SCALAR));
  const Hdf5Id sum(H5Acreate2(set_, hdf5_crc_name, H5T_STD_U32LE, scalar, H5P_DEFAULT, H5P_DEFAULT));
  writer_.check(sum.valid() && H5Awrite(sum, H5T_NATIVE_UINT32, &crc_) >= 0);
}

template <class T>
Hdf5DataSetWriter<T>::~Hdf5DataSetWriter() {
  if (set_ >= 0) H5Dclose(set_);
}

template <class T>
void Hdf5DataSetWriter<T>::write(const T* values, std::uint64_t rows) const {
  const std::array<hsize_t, 2> first{done_, 0}, extent{rows, columns_};
  const int rank = is_matrix_ ? 2 : 1;
  const Hdf5Id file_space(H5Dget_space(set_));
  const Hdf5Id memory_space(H5Screate_simple(rank, extent.data(), nullptr));
  writer_.check(
      H5Sselect_hyperslab(file_space, H5S_SELECT_SET, first.data(), nullptr, extent.data(), nullptr) >= 0 &&
      H5Dwrite(set_, type_of<T>(), memory_space, file_space, H5P_DEFAULT, values) >= 0);
}

template <class T>
void Hdf5DataSetWriter<T>::append(std::span<const T> values) {
  if (values.empty()) return;
  const std::uint64_t rows = values.size() / columns_;
  write(values.data(), rows);
  done_ += rows;
  crc_ = crc32_of(values.data(), values.size_bytes(), crc_);
}

template <class T>
void Hdf5DataSetWriter<T>::finish() {
  const Hdf5Id sum(H5Aopen(set_, hdf5_crc_name, H5P_DEFAULT));
  writer_.check(done_ == rows_ && sum.valid() && H5Awrite(sum, H5T_NATIVE_UINT32, &crc_) >= 0);
  const herr_t status = H5Dclose(set_);
  set_ = -1;
  writer_.check(status >= 0);
}

void Hdf5Writer::text(const char* name, const std::string& value) const {
  const Hdf5Id type(H5Tcopy(H5T_C_S1));
  H5Tset_size(type, std::max<std::size_t>(value.size(), 1));
  H5Tset_strpad(type, H5T_STR_NULLPAD);
  H5Tset_cset(type, H5T_CSET_UTF8);
  const Hdf5Id space(H5Screate(H5S_SCALAR));
  const Hdf5Id attribute(H5Acreate2(file_, name, type, space, H5P_DEFAULT, H5P_DEFAULT));
  check(attribute.valid() && H5Awrite(attribute, type, value.c_str()) >= 0);
}

void Hdf5Writer::number(const char* name, std::int32_t value) const {
  const Hdf5Id space(H5Screate(H5S_SCALAR));
  const Hdf5Id attribute(H5Acreate2(file_, name, H5T_STD_I32LE, space, H5P_DEFAULT, H5P_DEFAULT));
  check(attribute.valid() && H5Awrite(attribute, H5T_NATIVE_INT32, &value) >= 0);
}

template void Hdf5Writer::dataset(const char*, const float*, std::initializer_list<std::uint64_t>) const;
template void Hdf5Writer::dataset(const char*, const double*, std::initializer_list<std::uint64_t>) const;
template void Hdf5Writer::dataset(const char*, const std::int32_t*,
                                  std::initializer_list<std::uint64_t>) const;
template void Hdf5Writer::dataset(const char*, const std::uint32_t*,
                                  std::initializer_list<std::uint64_t>) const;
template void Hdf5Writer::dataset(const char*, const std::uint64_t*,
                                  std::initializer_list<std::uint64_t>) const;
template class Hdf5DataSetWriter<float>;
template class Hdf5DataSetWriter<std::uint32_t>;

}  // namespace refield
