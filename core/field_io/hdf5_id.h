// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <hdf5.h>

namespace refield {

/// An identifier of the HDF5 library, of any kind.
class Hdf5Id {
 public:
  explicit Hdf5Id(hid_t id) : id_(id) {}
  ~Hdf5Id() {
    if (valid()) H5Idec_ref(id_);
  }
  Hdf5Id(const Hdf5Id&) = delete;
  Hdf5Id& operator=(const Hdf5Id&) = delete;
  operator hid_t() const { return id_; }
  bool valid() const { return id_ >= 0; }

 private:
  hid_t id_;
};

}  // namespace refield
