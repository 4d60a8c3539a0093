// SPDX-License-Identifier: Apache-2.0
// The file format is public: the documentation's Python program, which knows nothing of refield, must come to
// the same image.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <optional>

#include "core/base/files.h"
#include "core/field_io/packed_field.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "relight/pack/pack.h"
#include "tests/relight/mixed_field.h"
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

class ReflectanceFieldFormat : public testing::Test {
 protected:
  void SetUp() override {
    if (!python_) GTEST_SKIP() << "no Python with h5py and NumPy here (Debian: python3-h5py)";
  }
  /// Runs the documentation's program; what it prints on standard error.
  int run(const std::string& field, const std::string& light, const std::string& out) {
    const std::string command = *python_ + " " REFIELD_SOURCE_DIR "/docs/examples/relight_with_h5py.py " +
                                (folder_ / field).string() + " " + (folder_ / light).string() + " " +
                                (folder_ / out).string() + " 2>" + (folder_ / "messages").string();
    return std::system(command.c_str());
  }
  std::string messages() { return read_text(folder_ / "messages"); }
  /// Runs the documentation's program on a field and light.npy. Each value may differ from the expected one
  /// by a share of it, `relative`, and by `absolute`.
  void relights_to(const Image& expected, const std::string& field, double relative, double absolute) {
    ASSERT_EQ(run(field, "light.npy", "out.npy"), 0) << messages();
    const std::vector<float> found = read_npy(folder_ / "out.npy");
    ASSERT_EQ(found.size(), expected.values.size());
    for (std::size_t i = 0; i < found.size(); ++i)
      ASSERT_NEAR(found[i], expected.values[i], relative * std::abs(expected.values[i]) + absolute) << i;
  }

  const test::TemporaryFolder folder_;
  const std::optional<std::string> python_ = python_with_h5py();
};

constexpr double float_rounding = 1e-5;  // relative; some ten terms in float here, in double there

TEST_F(ReflectanceFieldFormat, H5pyRelightsAsTheDocumentationSays) {
  Rng rng(1);
  ReflectanceField field = test::random_field(rng, 14, 9, {20, 11}, 50, 8);
  for (std::size_t i = 0; i < field.transfer.weight.size(); i += 7) field.transfer.weight[i] *= -0.5f;
  const LightMap light = test::random_light(rng, field.basis.domain);
  write_reflectance_field(folder_ / "f.rfield", field);
  write_npy(folder_ / "light.npy", light.radiance);
  const Image expected = field.relight(light);
  relights_to(expected, "f.rfield", float_rounding, 1e-4);
  // Radiance pictures there and back: 8 bits of mantissa.
  ASSERT_EQ(run("f.rfield", "light.npy", "out.hdr"), 0) << messages();
  const Image shown = read_image(folder_ / "out.hdr");
  ASSERT_EQ(shown.values.size(), expected.values.size());
  for (std::size_t i = 0; i < shown.values.size(); ++i)
    if (expected.values[i] > 0.0f) {
      const std::size_t p = i / 3 * 3;
      const float largest = std::max({expected.values[p], expected.values[p + 1], expected.values[p + 2]});
      ASSERT_NEAR(shown.values[i], expected.values[i], largest / 128) << i;
    }
}

TEST_F(ReflectanceFieldFormat, H5pyInterpolatesBetweenLightSources) {
  Rng rng(4);
  ReflectanceField field = test::random_field(rng, 14, 9, {32, 16, Parameterisation::lat_long}, 50, 8);
  for (int x = 0; x < 32; x += 3) field.observed_light.push_back({x, x % 4 + 5, x + 1 + x % 2, x % 4 + 6});
  field.basis.interpolation = LightInterpolation{field.observed_light, 0.8, 0.1, 0.1, 0.5};
  const LightMap light = test::random_light(rng, field.basis.domain);
  write_reflectance_field(folder_ / "f.rfield", field);
  write_npy(folder_ / "light.npy", light.radiance);
  const Image expected = field.relight(light);
  const float largest = *std::ranges::max_element(expected.values);  // weights of both signs cancel
  relights_to(expected, "f.rfield", 0.0, float_rounding * largest);
}

// Whole and cut tiles, sparse and dense weights, common and own kernels, grey tiles and coloured ones.
TEST_F(ReflectanceFieldFormat, H5pyReadsPackedFields) {
  ReflectanceField grey = test::mixed_field(37, 35, {50, 40});
  for (std::size_t e = 0; e < grey.transfer.entries(); ++e)
    grey.transfer.weight[3 * e] = grey.transfer.weight[3 * e + 1] = grey.transfer.weight[3 * e + 2];
  Rng rng(2);
  const LightMap light = test::random_light(rng, grey.basis.domain);
  write_npy(folder_ / "light.npy", light.radiance);
  for (const ReflectanceField& field : {grey, test::with_both_signs(test::mixed_field(37, 35, {50, 40}))})
    for (const double error : {1e-2, 3e-5}) {
      write_packed_field(folder_ / "p.rfield", pack_field(field, error).field);
      const Image expected = read_reflectance_field(folder_ / "p.rfield").relight(light);
      relights_to(expected, "p.rfield", float_rounding, 1e-4);
    }
}

TEST_F(ReflectanceFieldFormat, H5pySaysWhatItCannotRead) {
  Rng rng(3);
  const ReflectanceField field = test::random_field(rng, 4, 3, {8, 5}, 5, 3);
  write_reflectance_field(folder_ / "f.rfield", field);
  write_npy(folder_ / "small.npy", Image(7, 5, 3));
  EXPECT_NE(run("f.rfield", "small.npy", "out.npy"), 0);
  EXPECT_THAT(messages(), testing::HasSubstr("(5, 8, 3)"));
  EXPECT_NE(run("f.rfield", "light.png", "out.npy"), 0);
  EXPECT_THAT(messages(), testing::HasSubstr("light.png: is neither"));
  EXPECT_NE(run("none.rfield", "small.npy", "out.npy"), 0);
  EXPECT_THAT(messages(), testing::AllOf(testing::HasSubstr("none.rfield"),
                                         testing::Not(testing::HasSubstr("Traceback"))));
}

}  // namespace
}  // namespace refield
