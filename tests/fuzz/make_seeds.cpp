// SPDX-License-Identifier: Apache-2.0
// Writes what the fuzzers start from: make_seeds FOLDER, one sub-folder a reader.
#include <OpenImageIO/imageio.h>
#include <hdf5.h>

#include <cstdio>
#include <stdexcept>
#include <string>

#include "core/base/files.h"
#include "core/field_io/field_shard.h"
#include "core/field_io/packed_field.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "core/session/capture_session.h"
#include "relight/pack/pack.h"
#include "tests/support/random_data.h"

namespace refield {
namespace {

namespace fs = std::filesystem;

void copy_attribute(hid_t source, hid_t target, const char* name) {
  const hid_t from = H5Aopen(source, name, H5P_DEFAULT);
  const hid_t type = H5Aget_type(from), space = H5Aget_space(from);
  const hid_t to = H5Acreate2(target, name, type, space, H5P_DEFAULT, H5P_DEFAULT);
  std::string value(H5Tget_size(type), '\0');
  if (H5Aread(from, type, value.data()) < 0 || H5Awrite(to, type, value.data()) < 0)
    throw std::runtime_error(std::string("cannot copy ") + name);
  H5Aclose(to);
  H5Sclose(space);
  H5Tclose(type);
  H5Aclose(from);
}

/// The same content in the structures of HDF5 1.6, which h5py and MATLAB write unless told otherwise.
void write_in_old_structures(const fs::path& from, const fs::path& to) {
  const hid_t source = H5Fopen(from.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  const hid_t target = H5Fcreate(to.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  for (const char* group : {"basis", "transfer", "statistics"})
    if (H5Ocopy(source, group, target, group, H5P_DEFAULT, H5P_DEFAULT) < 0)
      throw std::runtime_error(std::string("cannot copy ") + group);
  for (const char* name : {"format", "version", "width", "height", "light_width", "light_height",
                           "hat_columns", "hat_rows", "light_parameterisation", "provenance"})
    copy_attribute(source, target, name);
  H5Fclose(target);
  H5Fclose(source);
}

void make_fields(const fs::path& folder) {
  create_folders(folder);
  Rng rng(1);
  ReflectanceField field = test::random_field(rng, 4, 3, {8, 6, Parameterisation::lat_long}, 5, 3);
  write_reflectance_field(folder / "field.rfield", field);
  write_in_old_structures(folder / "field.rfield", folder / "old.rfield");
  write_packed_field(folder / "packed.rfield", pack_field(field, 1e-4).field);
  write_packed_field(folder / "pruned.rfield", pack_field(field, 0.1).field);
  field.quality.predicted_error.assign(12, 0.1f);
  field.quality.photograph_noise.assign(12, 0.05f);
  field.quality.learning_curve = {{0.5f, 0.2f}, {1.0f, 0.1f}};
  write_reflectance_field(folder / "statistics.rfield", field);
  write_field_part(folder / "part.rfield", {field, {2, 5}, 9, "{}", std::vector<ErrorEvidence>(12)});
  write_reflectance_field(folder / "black.rfield",
                          test::random_field(rng, 2, 2, {2, 2, Parameterisation::monitor}, 1, 0));
}

void write_image(const fs::path& path, const Image& image, OIIO::TypeDesc type, const char* compression,
                 int tile = 0) {
  OIIO::ImageSpec spec(image.width, image.height, image.channels, type);
  spec.attribute("compression", compression);
  spec.tile_width = spec.tile_height = tile;
  const auto output = OIIO::ImageOutput::create(path.string());
  if (!output || !output->open(path.string(), spec) ||
      !output->write_image(OIIO::TypeDesc::FLOAT, image.values.data()) || !output->close())
    throw std::runtime_error("cannot write " + path.string());
}

void make_images(const fs::path& folder) {
  create_folders(folder);
  Rng rng(2);
  const Image image = test::random_image(rng, 9, 5, 3);
  for (const char* compression :
       {"none", "rle", "zips", "zip", "piz", "pxr24", "b44", "b44a", "dwaa", "dwab"})
    write_image(folder / (std::string(compression) + ".exr"), image, OIIO::TypeDesc::HALF, compression);
  write_image(folder / "tiled.exr", image, OIIO::TypeDesc::FLOAT, "zip", 16);
  write_photograph(folder / "sigma.exr", {image, image});
  write_image(folder / "map.hdr", image, OIIO::TypeDesc::FLOAT, "");
  write_image(folder / "long.hdr", test::random_image(rng, 40, 3, 3), OIIO::TypeDesc::FLOAT, "");
  write_png(folder / "rgb.png", image);
  write_png(folder / "grey.png", test::random_image(rng, 6, 4, 1));
  write_image(folder / "deep.png", image, OIIO::TypeDesc::UINT16, "");
  write_image(folder / "rgb.jpg", image, OIIO::TypeDesc::UINT8, "jpeg:90");
}

void make_sessions(const fs::path& folder) {
  create_folders(folder);
  CaptureSession session;
  session.folder = folder;
  session.light = {8, 6, Parameterisation::monitor};
  session.width = 4;
  session.height = 3;
  session.frames = {{"train_0", FrameRole::train, "natural", folder / "a.exr", folder / "b.exr", 0.0, {}},
                    {"test_0", FrameRole::test, "bar", folder / "c.exr", folder / "d.exr", 1.5, {}}};
  write_session_manifest(session);
  fs::copy_file(fs::path(REFIELD_SOURCE_DIR) / "datasets_synthetic/tabletop/recipe.toml",
                folder / "recipe.toml", fs::copy_options::overwrite_existing);
}

/// The first byte is the format's number in fuzz_mesh.cpp.
void make_meshes(const fs::path& folder) {
  create_folders(folder);
  const auto seed = [&](const char* name, char format, const std::string& text) {
    write_text_atomically(folder / name, format + text);
  };
  seed("off", 0, "OFF\n4 3 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n");
  seed("coff", 0, "COFF\n3 1 0\n0 0 0 255 0 0 255\n1 0 0 0 255 0 255\n0 1 0 0 0 255 255\n3 0 1 2\n");
  seed("obj", 1, "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nvn 0 0 1\nf 1//1 2//1 3//1\n");
  const std::string properties =
      "property float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\n"
      "property uchar blue\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
  seed("ply", 2,
       "ply\nformat ascii 1.0\nelement vertex 3\n" + properties +
           "0 0 0 255 0 0\n1 0 0 0 128 0\n0 1 0 0 0 255\n3 0 1 2\n");
  seed("gltf", 3,
       R"({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
           "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
           "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
           "bufferViews": [{"buffer": 0, "byteLength": 36}],
           "buffers": [{"byteLength": 36, "uri": "data:application/octet-stream;base64,)"
       R"(AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}]})");
}

}  // namespace
}  // namespace refield

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: make_seeds FOLDER\n");
    return 2;
  }
  const std::filesystem::path folder = argv[1];
  refield::make_fields(folder / "field");
  refield::make_images(folder / "image");
  refield::make_meshes(folder / "mesh");
  refield::make_sessions(folder / "session");
}
