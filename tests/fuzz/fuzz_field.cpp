// SPDX-License-Identifier: Apache-2.0
// Any bytes as a reflectance field or part of one: a field that can be used, or an Error.
#include <cstddef>
#include <cstdint>

#include "core/base/errors.h"
#include "core/field_io/field_shard.h"
#include "core/field_io/reflectance_field_file.h"
#include "tests/fuzz/hdf5_checksums.h"
#include "tests/fuzz/memory_file.h"
#include "tests/support/isolating_run.h"

extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t max_size);

/// Most damage would end at HDF5's checksums; an attacker makes them anew.
extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size,
                                               unsigned seed) {
  size = LLVMFuzzerMutate(data, size, max_size);
  if (seed % 8 != 0) refield::fuzz::renew_hdf5_checksums({data, size});
  return size;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const refield::fuzz::MemoryFile file(data, size);
  try {
    const refield::ReflectanceField field =
        refield::read_reflectance_field(file.path(), refield::test::isolating_run());
    // What was read must be safe to use: a small light goes through all of it.
    const refield::LightDomain& domain = field.basis.domain;
    if (static_cast<std::int64_t>(domain.width) * domain.height <= 1 << 16 && field.basis.size() <= 1 << 16)
      field.relight({refield::Image(domain.width, domain.height, 3, 1.0f), domain.parameterisation});
  } catch (const refield::InputError&) {  // a part
    try {
      refield::read_field_part(file.path(), refield::test::isolating_run());
    } catch (const refield::Error&) {
    }
  } catch (const refield::Error&) {
  }
  return 0;
}
