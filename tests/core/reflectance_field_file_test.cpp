// SPDX-License-Identifier: Apache-2.0
#include "core/field_io/reflectance_field_file.h"

#include <gmock/gmock.h>
#include <hdf5.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <fstream>
#include <functional>
#include <limits>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/field/light_error.h"
#include "core/field_io/field_shard.h"
#include "tests/fuzz/hdf5_checksums.h"
#include "tests/support/isolating_run.h"
#include "tests/support/message_of.h"
#include "tests/support/random_data.h"
#include "tests/support/small_disk.h"
#include "tests/support/temporary_folder.h"

static int flock_error = 0;

/// The system's, or one that fails as on network file systems, for libraries, too.
extern "C" int flock(int descriptor, int operation) {
  if (flock_error == 0) return static_cast<int>(::syscall(SYS_flock, descriptor, operation));
  errno = flock_error;
  return -1;
}

namespace refield {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

ReflectanceField sample_field() {
  Rng rng(1);
  ReflectanceField field = test::random_field(rng, 12, 9, {16, 8, Parameterisation::lat_long}, 60, 7);
  field.provenance = R"({"kernels": 7, "note": "Übung"})";
  return field;
}

void write_bytes(const fs::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

/// Changes a number attribute of the file's root in place, as any HDF5 tool can.
void set_number(const fs::path& path, const char* name, int value) {
  const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  const hid_t attribute = H5Aopen(file, name, H5P_DEFAULT);
  ASSERT_GE(H5Awrite(attribute, H5T_NATIVE_INT, &value), 0);
  H5Aclose(attribute);
  H5Fclose(file);
}

template <class T>
void set_first_values(const fs::path& path, const char* name, hid_t type, std::vector<T> first) {
  const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  const hid_t set = H5Dopen2(file, name, H5P_DEFAULT);
  const hid_t space = H5Dget_space(set);
  std::vector<T> values(static_cast<std::size_t>(H5Sget_simple_extent_npoints(space)));
  ASSERT_GE(H5Dread(set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()), 0);
  std::ranges::copy(first, values.begin());
  ASSERT_GE(H5Dwrite(set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()), 0);
  H5Adelete(set, "crc32");  // as a program would leave it that does not know of checksums
  H5Sclose(space);
  H5Dclose(set);
  H5Fclose(file);
}

std::string message_of(const fs::path& path) {
  return test::message_of<FormatError>([&] { read_reflectance_field(path); });
}

std::string message_of_writing(const fs::path& path, const ReflectanceField& field) {
  return test::message_of<SolverError>([&] { write_reflectance_field(path, field); });
}

TEST(ReflectanceFieldFile, KeepsWeightsOfBothSigns) {
  const test::TemporaryFolder folder;
  ReflectanceField field = sample_field();
  for (std::size_t i = 0; i < field.transfer.weight.size(); i += 2) field.transfer.weight[i] *= -1.0f;
  write_reflectance_field(folder / "signed.rfield", field);
  EXPECT_EQ(read_reflectance_field(folder / "signed.rfield").transfer.weight, field.transfer.weight);
  field.transfer.weight[3] = std::numeric_limits<float>::infinity();
  EXPECT_THAT(message_of_writing(folder / "infinite.rfield", field), HasSubstr("transfer/weight"));
}

TEST(ReflectanceFieldFile, RoundTripIsBitExact) {
  const test::TemporaryFolder folder;
  const ReflectanceField field = sample_field();
  write_reflectance_field(folder / "a.rfield", field);
  const ReflectanceField back = read_reflectance_field(folder / "a.rfield");
  EXPECT_EQ(back.width, field.width);
  EXPECT_EQ(back.height, field.height);
  EXPECT_EQ(back.basis.domain, field.basis.domain);
  EXPECT_EQ(back.basis.boxes, field.basis.boxes);
  EXPECT_EQ(back.transfer.row_start, field.transfer.row_start);
  EXPECT_EQ(back.transfer.column, field.transfer.column);
  EXPECT_EQ(back.transfer.weight, field.transfer.weight);
  EXPECT_EQ(back.quality.training_error, field.quality.training_error);
  EXPECT_EQ(back.provenance, field.provenance);
}

TEST(ReflectanceFieldFile, ATransferThatStaysInTheFileIsTheSame) {
  const test::TemporaryFolder folder;
  const fs::path path = folder / "f.rfield";
  const ReflectanceField field = sample_field();
  write_reflectance_field(path, field);
  constexpr std::uint64_t map_all = 0;
  ReflectanceField mapped = read_reflectance_field(path, {}, map_all);
  EXPECT_TRUE(mapped.transfer.weight.get_allocator().is_mapped());
  EXPECT_EQ(mapped.transfer.row_start, field.transfer.row_start);
  LightMap light{Image(16, 8, 3), Parameterisation::lat_long};
  Rng rng(3);
  for (float& value : light.radiance.values) value = static_cast<float>(rng.uniform());
  const Image expected = field.relight(light);
  EXPECT_EQ(mapped.relight(light).values, expected.values);
  EXPECT_EQ(mapped.relight(light).values, expected.values) << "the second pass";

  fs::remove(path);  // as a file does that another one replaces
  ReflectanceField copy = mapped;
  EXPECT_FALSE(copy.transfer.weight.get_allocator().is_mapped());
  copy.transfer.append_row({}, {});
  copy.transfer.weight.assign(copy.transfer.weight.size(), 0.0f);
  EXPECT_EQ(mapped.relight(light).values, expected.values);
  const ReflectanceField moved = std::move(mapped);
  EXPECT_TRUE(moved.transfer.weight.get_allocator().is_mapped());
  EXPECT_EQ(moved.relight(light).values, expected.values);

  write_reflectance_field(path, field);
  set_first_values<std::uint32_t>(path, "transfer/column", H5T_NATIVE_UINT32, {60});
  EXPECT_THAT(test::message_of<FormatError>([&] { read_reflectance_field(path, {}, map_all); }),
              HasSubstr("does not exist"));
}

TEST(ReflectanceFieldFile, AFieldWithoutKernelsOrErrorsRoundTrips) {
  const test::TemporaryFolder folder;
  ReflectanceField field;
  field.width = 2;
  field.height = 1;
  field.basis.domain = {4, 4};
  field.transfer.append_row({}, {});
  field.transfer.append_row({}, {});
  write_reflectance_field(folder / "a.rfield", field);
  const ReflectanceField back = read_reflectance_field(folder / "a.rfield");
  EXPECT_EQ(back.transfer.rows(), 2u);
  EXPECT_TRUE(back.quality.training_error.empty());
}

TEST(ReflectanceFieldFile, PredictedErrorsRoundTrip) {
  const test::TemporaryFolder folder;
  ReflectanceField field = sample_field();
  std::vector<ErrorEvidence> evidence;
  const CrossValidationLattice lattice(field.width, field.height);
  for (int y = 0; y < field.height; ++y)
    for (int x = 0; x < field.width; ++x) {
      ErrorEvidence& pixel = evidence.emplace_back();
      pixel.leave_one_out = 1e-4f * static_cast<float>(x + 1);
      pixel.noise = 1e-5f;
      pixel.samples = 90.0f;
      if (lattice.holds(x, y)) pixel.cross_validated = 2e-4f;
    }
  predict_errors(field, evidence);
  field.quality.learning_curve = {{0.25f, 0.04f}, {0.5f, 0.03f}, {0.8f, 0.02f}};
  write_reflectance_field(folder / "a.rfield", field);
  const ReflectanceField back = read_reflectance_field(folder / "a.rfield");
  EXPECT_EQ(back.quality.predicted_error, field.quality.predicted_error);
  EXPECT_EQ(back.quality.photograph_noise, field.quality.photograph_noise);
  ASSERT_EQ(back.quality.learning_curve.size(), 3u);
  EXPECT_EQ(back.quality.learning_curve[1].error, field.quality.learning_curve[1].error);
  const RowRange rows{0, field.height};
  write_field_part(folder / "part.rfield", {field, rows, field.height, "job", evidence});
  FieldPart part = read_field_part(folder / "part.rfield");
  predict_errors(part.field, part.error_evidence);  // that the file kept
  EXPECT_EQ(part.field.quality.predicted_error, field.quality.predicted_error);
  part.error_evidence.pop_back();
  EXPECT_THAT(test::message_of<SolverError>([&] { write_field_part(folder / "part.rfield", part); }),
              HasSubstr("error_evidence"));

  set_first_values<float>(folder / "a.rfield", "statistics/predicted_error", H5T_NATIVE_FLOAT, {-1.0f});
  EXPECT_THAT(message_of(folder / "a.rfield"), HasSubstr("predicted_error"));
  field.quality.predicted_error.pop_back();
  EXPECT_THAT(message_of_writing(folder / "a.rfield", field), HasSubstr("predicted_error"));
}

TEST(ReflectanceFieldFile, TheModelOfTheErrorRoundTrips) {
  const test::TemporaryFolder folder;
  ReflectanceField field = sample_field();
  const std::size_t pixels = field.transfer.rows();
  FieldQuality& quality = field.quality;
  quality.predicted_error.assign(pixels, 0.1f);
  quality.photograph_noise.assign(pixels, 0.0f);
  quality.training_signal.assign(pixels, 2.0f);
  quality.light_error.cells = {{0, 0, 1, 1}, {1, 0, 2, 1}};
  quality.light_error.directions = {1.0f, 2.0f, 3.0f, 4.0f};
  quality.light_error.variances = {1.0f, 0.0f, 0.0f, 0.5f};
  quality.light_class.assign(pixels, 0);
  quality.light_class[1] = 1;
  write_reflectance_field(folder / "a.rfield", field);
  const ReflectanceField back = read_reflectance_field(folder / "a.rfield");
  EXPECT_EQ(back.quality.light_error.cells, quality.light_error.cells);
  EXPECT_EQ(back.quality.light_class, quality.light_class);
  Image light(field.basis.domain.width, field.basis.domain.height, 3);
  for (int c = 0; c < 3; ++c) light.at(0, 0, c) = light.at(1, 0, c) = 1.0f;
  // Error² × signal² is 0.04; the light has the effects 3 and 7 along the two directions.
  const std::vector<double> own = own_squared_error_under(back, light);
  EXPECT_NEAR(own[0], 0.04 * 9.0, 1e-6);
  EXPECT_NEAR(own[1], 0.04 * 0.5 * 49.0, 1e-6);

  quality.light_class[0] = 2;
  EXPECT_THAT(message_of_writing(folder / "a.rfield", field), HasSubstr("light_class"));
  quality.light_class.clear();
  EXPECT_THAT(message_of_writing(folder / "a.rfield", field), HasSubstr("light_class"));
  quality.light_error.directions.pop_back();
  EXPECT_THAT(message_of_writing(folder / "a.rfield", field), HasSubstr("light_directions"));
}

// An estimation of hours shall not end in a file that every verb refuses.
TEST(ReflectanceFieldFile, WhatCouldNotBeReadIsNotWritten) {
  const test::TemporaryFolder folder;
  const fs::path path = folder / "a.rfield";
  write_reflectance_field(path, sample_field());
  const std::string before = read_text(path);
  const auto expect_refused = [&](const std::function<void(ReflectanceField&)>& damage, const char* word) {
    ReflectanceField field = sample_field();
    damage(field);
    EXPECT_THAT(message_of_writing(path, field), AllOf(HasSubstr("a.rfield"), HasSubstr(word)));
    EXPECT_TRUE(read_text(path) == before) << "the old field was touched";
  };
  expect_refused([](ReflectanceField& field) { field.transfer.weight[5] = INFINITY; }, "weight");
  expect_refused([](ReflectanceField& field) { field.transfer.weight[5] = NAN; }, "weight");
  expect_refused([](ReflectanceField& field) { field.transfer.column[5] = 60; }, "does not exist");
  expect_refused([](ReflectanceField& field) { field.quality.training_error.assign(108, NAN); },
                 "training_error");
  expect_refused([](ReflectanceField& field) { field.basis.domain.width = 1 << 17; }, "light map");
}

TEST(ReflectanceFieldFile, MonitorPlacementsRoundTrip) {
  const test::TemporaryFolder folder;
  Rng rng(1);
  ReflectanceField field = test::random_field(rng, 4, 3, {16, 8, Parameterisation::monitor}, 20, 5);
  field.monitors = {{520, 320, 600, {90, -5.5, 0.1}, 10, -20}, {520, 320, 450}};
  write_reflectance_field(folder / "f.rfield", field);
  EXPECT_EQ(read_reflectance_field(folder / "f.rfield").monitors, field.monitors);
  set_first_values<double>(folder / "f.rfield", "basis/monitors", H5T_NATIVE_DOUBLE, {0.0});
  EXPECT_THAT(message_of(folder / "f.rfield"), AllOf(HasSubstr("basis/monitors"), HasSubstr("width")));
  field.monitors[1].width_mm = 0.0;
  EXPECT_THAT(message_of_writing(folder / "f.rfield", field), HasSubstr("basis/monitors"));
}

TEST(ReflectanceFieldFile, ColourSpaceRoundTrips) {
  const test::TemporaryFolder folder;
  ReflectanceField field = sample_field();
  write_reflectance_field(folder / "camera.rfield", field);
  EXPECT_EQ(read_reflectance_field(folder / "camera.rfield").colour_space, ColourSpace::camera);
  field.colour_space = ColourSpace::rec709;
  write_reflectance_field(folder / "rec709.rfield", field);
  EXPECT_EQ(read_reflectance_field(folder / "rec709.rfield").colour_space, ColourSpace::rec709);
}

TEST(ReflectanceFieldFile, ObservedLightRoundTrips) {
  const test::TemporaryFolder folder;
  Rng rng(1);
  ReflectanceField field = test::random_field(rng, 4, 3, {16, 8, Parameterisation::monitor}, 20, 5);
  field.observed_light = {{0, 0, 1, 1}, {14, 6, 16, 8}};
  write_reflectance_field(folder / "f.rfield", field);
  EXPECT_EQ(read_reflectance_field(folder / "f.rfield").observed_light, field.observed_light);
  set_first_values<std::int32_t>(folder / "f.rfield", "basis/observed_light", H5T_NATIVE_INT32, {5, 5, 5, 6});
  EXPECT_THAT(message_of(folder / "f.rfield"),
              AllOf(HasSubstr("basis/observed_light"), HasSubstr("outside the light map")));
  field.observed_light = {{0, 0, 16, 8}, {14, 6, 16, 8}};
  write_reflectance_field(folder / "f.rfield", field);
  EXPECT_THAT(message_of(folder / "f.rfield"),
              AllOf(HasSubstr("basis/observed_light"), HasSubstr("overlap")));
}

TEST(ReflectanceFieldFile, InterpolationRoundTrips) {
  const test::TemporaryFolder folder;
  Rng rng(1);
  ReflectanceField field = test::random_field(rng, 4, 3, {16, 8, Parameterisation::lat_long}, 20, 5);
  field.observed_light = {{0, 3, 1, 4}, {6, 5, 8, 6}};
  field.basis.interpolation = LightInterpolation{field.observed_light, 1.6, 0.01, 0.05, 0.4};
  write_reflectance_field(folder / "f.rfield", field);
  EXPECT_EQ(read_reflectance_field(folder / "f.rfield").basis.interpolation, field.basis.interpolation);
  set_first_values<double>(folder / "f.rfield", "basis/interpolation", H5T_NATIVE_DOUBLE, {-1.0});
  EXPECT_THAT(message_of(folder / "f.rfield"),
              AllOf(HasSubstr("basis/interpolation"), HasSubstr("impossible length")));
}

TEST(ReflectanceField, UnobservedShareIsOfTheLightsEnergy) {
  ReflectanceField field = sample_field();
  Image light(16, 8, 3);
  std::ranges::fill(light.values, 1.0f);
  EXPECT_EQ(field.light_shares(light).unobserved, 0.0) << "where nothing is stated";
  field.observed_light = {{0, 0, 4, 8}, {8, 0, 12, 4}};
  EXPECT_NEAR(field.light_shares(light).unobserved, 1.0 - (32.0 + 16.0) / 128.0, 1e-12);
  for (int c = 0; c < 3; ++c) light.at(2, 3, c) = 81.0f;
  EXPECT_NEAR(field.light_shares(light).unobserved, 80.0 / 208.0, 1e-12);
  EXPECT_EQ(field.light_shares(Image(16, 8, 3)).unobserved, 0.0) << "of darkness";
}

TEST(ReflectanceFieldFile, EqualFieldsGiveEqualBytes) {
  const test::TemporaryFolder folder;
  write_reflectance_field(folder / "a.rfield", sample_field());
  write_reflectance_field(folder / "b.rfield", sample_field());
  EXPECT_EQ(read_text(folder / "a.rfield"), read_text(folder / "b.rfield"));
}

TEST(ReflectanceFieldFile, RefusesOtherFiles) {
  const test::TemporaryFolder folder;
  write_bytes(folder / "text.rfield", "just some text, by mistake\n");
  EXPECT_THAT(message_of(folder / "text.rfield"),
              AllOf(HasSubstr("text.rfield"), HasSubstr("not a reflectance field")));
  write_bytes(folder / "empty.rfield", "");
  EXPECT_THAT(message_of(folder / "empty.rfield"), HasSubstr("not a reflectance field"));
  EXPECT_THAT(message_of(folder.path()), HasSubstr("not a reflectance field"));
  EXPECT_THROW(read_reflectance_field(folder / "missing.rfield"), DeviceError);
  const hid_t other = H5Fcreate((folder / "other.rfield").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  H5Fclose(other);
  EXPECT_THAT(message_of(folder / "other.rfield"), HasSubstr("an HDF5 file but not a reflectance field"));
}

TEST(ReflectanceFieldFile, NamesAnotherVersion) {
  const test::TemporaryFolder folder;
  write_reflectance_field(folder / "a.rfield", sample_field());
  set_number(folder / "a.rfield", "version", 7);
  EXPECT_THAT(message_of(folder / "a.rfield"), AllOf(HasSubstr("version 7"), HasSubstr("reads version 2")));
}

TEST(ReflectanceFieldFile, RefusesImpossibleContent) {
  const test::TemporaryFolder folder;
  const fs::path path = folder / "a.rfield";
  const auto expect_refused = [&](const std::function<void()>& damage, const char* word) {
    write_reflectance_field(path, sample_field());
    damage();
    EXPECT_THAT(message_of(path), HasSubstr(word));
  };
  expect_refused([&] { set_number(path, "width", 13); }, "row_start");
  expect_refused([&] { set_number(path, "width", -12); }, "impossible dimensions");
  expect_refused([&] { set_number(path, "light_width", 3); }, "outside the light map");
  for (const int width : {65537, std::numeric_limits<int>::max()})
    expect_refused([&] { set_number(path, "light_width", width); }, "more than any");
  expect_refused(
      [&] {
        set_number(path, "light_width", 65536);
        set_number(path, "light_height", 65536);
      },
      "more than any");
  expect_refused(
      [&] {
        set_first_values<std::int32_t>(path, "basis/boxes", H5T_NATIVE_INT32, {5, 5, 5, 6});
      },
      "outside the light map");
  expect_refused([&] { set_first_values<std::uint32_t>(path, "transfer/column", H5T_NATIVE_UINT32, {60}); },
                 "a kernel that does not exist");
  expect_refused([&] { set_first_values<float>(path, "transfer/weight", H5T_NATIVE_FLOAT, {INFINITY}); },
                 "weight");
  expect_refused([&] { set_first_values<float>(path, "transfer/weight", H5T_NATIVE_FLOAT, {NAN}); },
                 "weight");
  expect_refused(
      [&] {
        set_first_values<std::uint64_t>(path, "transfer/row_start", H5T_NATIVE_UINT64, {0, 1u << 20});
      },
      "row_start");
}

/// Replaces a link of a file by what `make` puts there.
void replace_link(const fs::path& path, const char* name, const std::function<void(hid_t)>& make) {
  const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  ASSERT_GE(H5Lmove(file, name, file, "was", H5P_DEFAULT, H5P_DEFAULT), 0);
  make(file);
  ASSERT_GE(H5Lexists(file, name, H5P_DEFAULT), 0);
  H5Fclose(file);
}

// An external link would have any file opened that it names: another user's field, a pipe.
TEST(ReflectanceFieldFile, ContentInAnotherPlaceIsNotFollowed) {
  const test::TemporaryFolder folder;
  const fs::path path = folder / "a.rfield", other = folder / "other.rfield", pipe = folder / "pipe";
  write_reflectance_field(other, sample_field());
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  const auto expect_refused = [&](const char* name, const char* what,
                                  const std::function<void(hid_t)>& make) {
    write_reflectance_field(path, sample_field());
    replace_link(path, name, make);
    EXPECT_THAT(message_of(path), AllOf(HasSubstr(name), HasSubstr(what)));
  };
  const auto link_to = [&](const fs::path& target, const char* place, const char* name) {
    return [=](hid_t file) {
      ASSERT_GE(H5Lcreate_external(target.c_str(), place, file, name, H5P_DEFAULT, H5P_DEFAULT), 0);
    };
  };
  expect_refused("transfer/weight", "a link", link_to(other, "/transfer/weight", "transfer/weight"));
  expect_refused("transfer", "a link", link_to(other, "/transfer", "transfer"));
  expect_refused("transfer/weight", "a link", link_to(pipe, "/transfer/weight", "transfer/weight"));
  expect_refused("statistics/training_error", "a link", link_to(other, "/x", "statistics/training_error"));
  expect_refused("transfer/weight", "a link", [](hid_t file) {
    ASSERT_GE(H5Lcreate_soft("/was", file, "transfer/weight", H5P_DEFAULT, H5P_DEFAULT), 0);
  });
  expect_refused("transfer/weight", "in another file", [&](hid_t file) {
    const hsize_t extent[] = {4, 3};
    const hid_t space = H5Screate_simple(2, extent, nullptr), creation = H5Pcreate(H5P_DATASET_CREATE);
    ASSERT_GE(H5Pset_external(creation, other.c_str(), 0, H5F_UNLIMITED), 0);
    H5Dclose(H5Dcreate2(file, "transfer/weight", H5T_IEEE_F32LE, space, H5P_DEFAULT, creation, H5P_DEFAULT));
    H5Pclose(creation);
    H5Sclose(space);
  });
}

TEST(ReflectanceFieldFile, NeedsNoLocksOfTheFileSystem) {
  const test::TemporaryFolder folder;
  constexpr int no_support = 524;  // the kernel's ENOTSUPP
  for (const int error : {ENOLCK, EOPNOTSUPP, ENOSYS, no_support}) {
    flock_error = error;
    EXPECT_NO_THROW(write_reflectance_field(folder / "a.rfield", sample_field())) << error;
    EXPECT_NO_THROW(read_reflectance_field(folder / "a.rfield")) << error;
    flock_error = 0;
  }
}

TEST(ReflectanceFieldFile, TextsMayHaveVariableLength) {
  const test::TemporaryFolder folder;
  const fs::path path = folder / "a.rfield";
  write_reflectance_field(path, sample_field());
  const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDWR, H5P_DEFAULT), type = H5Tcopy(H5T_C_S1);
  const hid_t space = H5Screate(H5S_SCALAR);
  H5Tset_size(type, H5T_VARIABLE);
  for (const auto& [name, text] :
       {std::pair{"format", "refield reflectance field"}, {"provenance", "{\"by\": \"h5py\"}"}}) {
    H5Adelete(file, name);
    const hid_t attribute = H5Acreate2(file, name, type, space, H5P_DEFAULT, H5P_DEFAULT);
    ASSERT_GE(H5Awrite(attribute, type, &text), 0) << name;
    H5Aclose(attribute);
  }
  H5Sclose(space);
  H5Tclose(type);
  H5Fclose(file);
  EXPECT_EQ(read_reflectance_field(path).provenance, "{\"by\": \"h5py\"}");
}

TEST(ReflectanceFieldFile, NamesTheTypeOfValuesThatItDoesNotRead) {
  const test::TemporaryFolder folder;
  write_reflectance_field(folder / "a.rfield", sample_field());
  const hid_t file = H5Fopen((folder / "a.rfield").c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  const hid_t old = H5Dopen2(file, "transfer/weight", H5P_DEFAULT), space = H5Dget_space(old);
  H5Dclose(old);
  H5Ldelete(file, "transfer/weight", H5P_DEFAULT);
  const hid_t doubles =
      H5Dcreate2(file, "transfer/weight", H5T_IEEE_F64LE, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
  const std::vector<double> values(static_cast<std::size_t>(H5Sget_simple_extent_npoints(space)), 0.5);
  ASSERT_GE(H5Dwrite(doubles, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()), 0);
  H5Dclose(doubles);
  H5Sclose(space);
  H5Fclose(file);
  EXPECT_THAT(message_of(folder / "a.rfield"), HasSubstr("holds f8 where f4 is expected"));
}

TEST(ReflectanceFieldFile, ContentOfAnotherProgramNeedsNoChecksums) {
  const test::TemporaryFolder folder;
  write_reflectance_field(folder / "a.rfield", sample_field());
  set_first_values<float>(folder / "a.rfield", "transfer/weight", H5T_NATIVE_FLOAT, {0.5f});
  EXPECT_EQ(read_reflectance_field(folder / "a.rfield").transfer.weight[0], 0.5f);
}

TEST(DamagedField, TruncatedAtAnyLength) {
  const test::TemporaryFolder folder;
  write_reflectance_field(folder / "whole.rfield", sample_field());
  const std::string bytes = read_text(folder / "whole.rfield");
  for (std::size_t length = 0; length < bytes.size(); length += 1 + bytes.size() / 300) {
    write_bytes(folder / "cut.rfield", bytes.substr(0, length));
    EXPECT_THAT(message_of(folder / "cut.rfield"), HasSubstr("cut.rfield"))
        << "cut to " << length << " bytes";
  }
}

void flip_some_bits(std::string& bytes, Rng& rng) {
  const std::uint64_t flips = 1 + rng.below(4);
  for (std::uint64_t i = 0; i < flips; ++i)
    bytes[rng.below(bytes.size())] ^= static_cast<char>(1 << rng.below(8));
}

// One wrong bit anywhere in the data must not pass unseen; damage to HDF5's own structures must not crash or
// hang.
TEST(DamagedField, FlippedBytesAreFoundOrHarmless) {
  const test::TemporaryFolder folder;
  const ReflectanceField field = sample_field();
  write_reflectance_field(folder / "whole.rfield", field);
  const std::string bytes = read_text(folder / "whole.rfield");
  Rng rng(2);
  for (int round = 0; round < test::fuzz_rounds(); ++round) {
    std::string damaged = bytes;
    flip_some_bits(damaged, rng);
    write_bytes(folder / "damaged.rfield", damaged);
    try {
      const ReflectanceField back = read_reflectance_field(folder / "damaged.rfield", test::isolating_run());
      // What is read after all was hit in padding alone.
      EXPECT_EQ(back.transfer.weight, field.transfer.weight) << "round " << round;
      EXPECT_EQ(back.transfer.column, field.transfer.column) << "round " << round;
      EXPECT_EQ(back.basis.boxes, field.basis.boxes) << "round " << round;
      EXPECT_EQ(back.quality.training_error, field.quality.training_error) << "round " << round;
    } catch (const Error&) {
      continue;
    }
  }
}

// Whoever means harm makes HDF5's checksums anew. The library crashes on about one such file in a thousand;
// the reader must not.
TEST(DamagedField, ForgedStructuresAreRefusedOrRead) {
  const test::TemporaryFolder folder;
  write_reflectance_field(folder / "whole.rfield", sample_field());
  const std::string bytes = read_text(folder / "whole.rfield");
  Rng rng(3);
  for (int round = 0; round < test::fuzz_rounds(); ++round) {
    std::string forged = bytes;
    flip_some_bits(forged, rng);
    fuzz::renew_hdf5_checksums({reinterpret_cast<std::uint8_t*>(forged.data()), forged.size()});
    write_bytes(folder / "forged.rfield", forged);
    try {
      read_reflectance_field(folder / "forged.rfield", test::isolating_run());
    } catch (const Error&) {
      continue;
    }
  }
}

TEST(ReflectanceFieldFile, KeepsTheOldFieldOnAFullDisk) {
  const test::SmallDisk disk(512);
  if (!disk.mounted()) GTEST_SKIP() << test::needs_mounting;
  write_reflectance_field(disk / "a.rfield", sample_field());
  const std::string old = read_text(disk / "a.rfield");
  Rng rng(3);
  const ReflectanceField large = test::random_field(rng, 100, 100, {64, 64}, 500, 25);
  try {
    write_reflectance_field(disk / "a.rfield", large);
    FAIL() << "wrote more than the disk holds";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.error_number(), ENOSPC);
  }
  EXPECT_EQ(read_text(disk / "a.rfield"), old);
  EXPECT_EQ(disk.files(), 1);
}

}  // namespace
}  // namespace refield
