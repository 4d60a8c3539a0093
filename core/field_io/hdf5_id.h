// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>

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

}  // namespace refield
