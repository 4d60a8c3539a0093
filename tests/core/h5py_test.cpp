// SPDX-License-Identifier: Apache-2.0
// The file format is public: the documentation's Python program, which knows nothing of refield, must come to
// the same image.
#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>
#include <fstream>
#include <optional>

#include "core/files.h"
#include "core/reflectance_field_file.h"
#include "tests/support/random_data.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

/// A Python that has h5py.
std::optional<std::string> python_with_h5py() {
  for (const std::string python : {"python3", "/usr/bin/python3"})
    if (std::system((python + " -c 'import h5py, numpy' 2>/dev/null").c_str()) == 0) return python;
  return std::nullopt;
}

/// NumPy's file format, version 1.0: a magic word, a header of padded text, the values.
void write_npy(const std::filesystem::path& path, const Image& image) {
  std::string header = "{'descr': '<f4', 'fortran_order': False, 'shape': (" + std::to_string(image.height) +
                       ", " + std::to_string(image.width) + ", 3), }";
  header.append(64 - (10 + header.size() + 1) % 64, ' ').push_back('\n');
  std::ofstream file(path, std::ios::binary);
  file << "\x93NUMPY" << '\1' << '\0' << static_cast<char>(header.size() % 256)
       << static_cast<char>(header.size() / 256) << header;
  file.write(reinterpret_cast<const char*>(image.values.data()),
             static_cast<std::streamsize>(image.values.size() * sizeof(float)));
}

std::vector<float> read_npy(const std::filesystem::path& path) {
  const std::string bytes = read_text(path);
  const std::size_t start = bytes.find('\n') + 1;
  std::vector<float> values((bytes.size() - start) / sizeof(float));
  std::memcpy(values.data(), bytes.data() + start, values.size() * sizeof(float));
  return values;
}

TEST(ReflectanceFieldFormat, H5pyRelightsAsTheDocumentationSays) {
  const auto python = python_with_h5py();
  if (!python) GTEST_SKIP() << "no Python with h5py and NumPy here (Debian: python3-h5py)";
  const test::TemporaryFolder folder;
  Rng rng(1);
  const ReflectanceField field = test::random_field(rng, 14, 9, {20, 11}, 50, 8);
  const LightMap light = test::random_light(rng, field.basis.domain);
  write_reflectance_field(folder / "f.rfield", field);
  write_npy(folder / "light.npy", light.radiance);
  const std::string command = *python + " " REFIELD_SOURCE_DIR "/docs/examples/relight_with_h5py.py " +
                              (folder / "f.rfield").string() + " " + (folder / "light.npy").string() + " " +
                              (folder / "out.npy").string();
  ASSERT_EQ(std::system(command.c_str()), 0);
  const std::vector<float> found = read_npy(folder / "out.npy");
  const Image expected = field.relight(light);
  ASSERT_EQ(found.size(), expected.values.size());
  constexpr double float_rounding = 1e-5;  // relative; 8 terms in float here, in double there
  for (std::size_t i = 0; i < found.size(); ++i)
    ASSERT_NEAR(found[i], expected.values[i], float_rounding * expected.values[i]) << i;
}

}  // namespace
}  // namespace refield
