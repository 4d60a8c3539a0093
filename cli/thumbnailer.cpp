// SPDX-License-Identifier: Apache-2.0
// refield-thumbnailer FIELD OUT SIZE: a PNG picture of a reflectance field under white light, at most SIZE
// pixels wide and high, as file managers ask for it.
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <string_view>

#include "cli/run_context.h"
#include "core/base/errors.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "core/image/tone_map.h"
#include "relight/field_pictures.h"
#include "relight/mesh/mesh_view.h"

namespace {

namespace fs = std::filesystem;

constexpr int max_side_px = 4096;
/// Opening a folder must not read gigabytes.
constexpr std::uintmax_t max_field_bytes = std::uintmax_t{1} << 30;

int side_from(std::string_view text) {
  int side = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), side);
  if (error != std::errc() || end != text.data() + text.size() || side < 1 || side > max_side_px)
    throw refield::InputError("SIZE is '" + std::string(text) + "'; give a number from 1 to " +
                              std::to_string(max_side_px));
  return side;
}

refield::Image picture_of(const refield::ReflectanceField& field, int side) {
  std::vector<refield::PinholeCamera> cameras;
  if (field.mesh) {
    cameras.push_back(refield::standard_camera(field));
    const int longer = std::max(cameras[0].width, cameras[0].height);
    cameras[0].width = std::max(1, cameras[0].width * side / longer);
    cameras[0].height = std::max(1, cameras[0].height * side / longer);
  }
  const refield::LightDomain& domain = field.basis.domain;
  const refield::LightMap white{refield::Image(domain.width, domain.height, 3, 1.0f),
                                domain.parameterisation};
  refield::Image picture = refield::FieldPictures(field, cameras).picture(white, 0, refield::run_context());
  const double scale = static_cast<double>(side) / std::max(picture.width, picture.height);
  if (scale >= 1.0) return picture;
  return refield::resample_area(picture, std::max(1, static_cast<int>(std::lround(scale * picture.width))),
                                std::max(1, static_cast<int>(std::lround(scale * picture.height))));
}

void run(const fs::path& path, const fs::path& output, std::string_view size) {
  const int side = side_from(size);
  if (fs::file_size(path) > max_field_bytes)
    throw refield::InputError(path.string() + ": is larger than 1 GiB; no picture is made");
  const refield::Image picture =
      picture_of(refield::read_reflectance_field(path, refield::run_context()), side);
  refield::ExposureMeter meter;
  meter.add(picture);
  // The extension chooses the file format, and the caller's name may have none.
  fs::path written = output;
  written += ".png";
  refield::write_png(written, picture, {meter.exposure()});
  fs::rename(written, output);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) {
    std::fprintf(stderr, "usage: refield-thumbnailer FIELD OUT SIZE\n");
    return 2;
  }
  try {
    refield::silence_progress();
    run(argv[1], argv[2], argv[3]);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "refield-thumbnailer: %s\n", error.what());
    return 2;
  }
}
