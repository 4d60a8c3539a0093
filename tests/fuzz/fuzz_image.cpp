// SPDX-License-Identifier: Apache-2.0
// Any bytes as an image: a light map or photograph of the size that its header states, or an Error.
#include <zlib.h>

#include <cstdlib>
#include <cstring>

#include "core/base/errors.h"
#include "core/image/image_io.h"
#include "tests/fuzz/memory_file.h"

extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t max_size);

namespace {

/// Makes the checksums of a PNG file's chunks fit their content again: an attacker would.
void renew_png_checksums(std::uint8_t* data, std::size_t size) {
  constexpr std::size_t signature = 8, around = 12;  // length, type and checksum of a chunk
  if (size < signature || std::memcmp(data, "\x89PNG\r\n\x1a\n", signature) != 0) return;
  for (std::size_t at = signature; at + around <= size;) {
    const std::size_t length =
        std::size_t{data[at]} << 24 | data[at + 1] << 16 | data[at + 2] << 8 | data[at + 3];
    if (length > size - at - around) return;
    const auto sum = static_cast<std::uint32_t>(crc32_z(0, data + at + 4, length + 4));
    for (int i = 0; i < 4; ++i) data[at + 8 + length + i] = static_cast<std::uint8_t>(sum >> (24 - 8 * i));
    at += length + around;
  }
}

template <class Read>
void expect_image_or_error(Read read) {
  try {
    read();
  } catch (const refield::Error&) {
  }
}

}  // namespace

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size,
                                               unsigned seed) {
  size = LLVMFuzzerMutate(data, size, max_size);
  if (seed % 8 != 0) renew_png_checksums(data, size);
  return size;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const refield::fuzz::MemoryFile file(data, size);
  expect_image_or_error([&] {
    const refield::ImageHeader header = refield::read_image_header(file.path());
    const refield::LightMap light = refield::read_light_map(file.path(), refield::Parameterisation::monitor);
    if (light.radiance.width != header.width || light.radiance.height != header.height) std::abort();
  });
  expect_image_or_error([&] { refield::read_photograph(file.path()); });
  return 0;
}
