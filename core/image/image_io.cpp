// SPDX-License-Identifier: Apache-2.0
#include "core/image/image_io.h"

#include <png.h>

#include <cmath>
#include <map>
#include <new>
#include <numbers>
#include <set>

#include "core/base/files.h"
#include "core/base/number_text.h"
#include "core/image/image_facts.h"
#include "core/image/image_file.h"
#include "core/image/image_header.h"
#include "core/light/cube_map.h"

namespace refield {

namespace {

[[noreturn]] void fail_to_open(const fs::path& path, const std::string& why) {
  throw FormatError(path, "cannot be read as an image (", why, "); check that the file is complete");
}

/// The one decoder that the content asks for: OpenImageIO itself would try all of its decoders on a file that
/// the one of its name refuses, among them some that a hostile file can crash. RAW files are identified by
/// their names.
std::unique_ptr<ImageFile> open_with_decoder(const fs::path& path) {
  try {
    if (is_camera_raw(path)) return image_formats().open(path.string(), "");
    const auto format = image_format(path);
    if (!format) fail_to_open(path, "the format must be EXR, HDR, PNG, JPEG, TIFF or PFM");
    check_image_header(path, *format);
    if (*format == ImageFormat::exr) return open_exr(path);
    return image_formats().open(path.string(), name_of(*format));
  } catch (const Error&) {
    throw;
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    fail_to_open(path, error.what());
  }
}

/// Numbers of the named channels in a file.
std::optional<std::array<int, 3>> find_channels(const StoredImage& stored, const std::string& prefix) {
  std::array<int, 3> numbers{};
  for (std::size_t c = 0; c < 3; ++c) {
    const auto found = std::ranges::find(stored.channels, prefix + "RGB"[c]);
    if (found == stored.channels.end()) return std::nullopt;
    numbers[c] = static_cast<int>(found - stored.channels.begin());
  }
  return numbers;
}

/// Channels that may be meant as the image, and the name of their layer; "" for that without a name.
struct ColourLayer {
  std::string name;
  std::array<int, 3> channels{};
};

/// R, G, B without a layer's name are the image, whatever else there is. Else every layer that has R, G, B,
/// or Y (grey), is one possibility.
std::vector<ColourLayer> colour_layers(const StoredImage& stored) {
  if (const auto rgb = find_channels(stored, "")) return {{"", *rgb}};
  std::vector<ColourLayer> layers;
  for (int c = 0; c < static_cast<int>(stored.channels.size()); ++c) {
    const std::string& name = stored.channels[c];
    const std::size_t dot = name.rfind('.');
    const std::string prefix = dot == std::string::npos ? "" : name.substr(0, dot + 1);
    if (prefix == "sigma.") continue;
    const std::string layer = prefix.substr(0, prefix.empty() ? 0 : dot);
    const std::string last = name.substr(prefix.size());
    const auto rgb = find_channels(stored, prefix);
    if (last == "R" && rgb) layers.push_back({layer, *rgb});
    // Y beside X is of CIE XYZ, a normal or a position; beside RY and BY it is luminance.
    const bool is_grey = std::ranges::none_of(std::array{"X", "RY", "BY"}, [&](const char* other) {
      return std::ranges::find(stored.channels, prefix + other) != stored.channels.end();
    });
    if (last == "Y" && !rgb && is_grey) layers.push_back({layer, {c, c, c}});
  }
  return layers;
}

std::string joined(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text;
}

/// Throws FormatError unless the file says clearly which channels are the image.
std::array<int, 3> colour_channels(const StoredImage& stored, bool is_exr, const fs::path& path) {
  if (!is_exr && stored.channels.size() > 4)
    throw FormatError(path, "has ", stored.channels.size(),
                      " channels, of which none is named; export red, green and blue alone");
  const auto layers = colour_layers(stored);
  if (layers.size() == 1) return layers.front().channels;
  if (!is_exr && stored.channels.size() <= 2) return {0, 0, 0};  // grey, perhaps with alpha, however named
  if (layers.empty())
    throw FormatError(path, "has no colour: its channels are ", joined(stored.channels),
                      "; an image needs R, G and B, or Y for grey");
  std::vector<std::string> names;
  for (const ColourLayer& layer : layers) names.push_back("'" + layer.name + "'");
  throw FormatError(path, "has several layers, and none is the image without a name: ", joined(names),
                    "; export one of them alone");
}

/// An image file whose pixels are placed as its header says: an EXR file stores those of its data window,
/// which may be smaller or larger than the image, its display window.
struct PlacedFile {
  std::unique_ptr<ImageFile> file;
  bool is_exr = false;
  int width = 0;   ///< of the image, pixels
  int height = 0;  ///< rows
  int left = 0;    ///< column of the image where the stored pixels begin; below 0 for overscan
  int top = 0;     ///< row

  const StoredImage& stored() const { return file->stored(); }
};

/// A file of several parts: goes to the one that holds colour.
void choose_part(ImageFile& file, const fs::path& path) {
  if (!file.select_part(1)) return;
  std::vector<int> with_colour;
  std::vector<std::string> names;
  for (int part = 0; file.select_part(part); ++part) {
    names.push_back("'" + file.stored().part + "' (" + joined(file.stored().channels) + ")");
    if (!colour_layers(file.stored()).empty()) with_colour.push_back(part);
  }
  if (with_colour.size() == 1 && file.select_part(with_colour.front())) return;
  throw FormatError(path, "has several parts, and which is the image is not clear: ", joined(names),
                    "; export one of them alone");
}

/// Sets the size of the image and the place of the stored pixels in it.
void place_data_window(PlacedFile& file, const fs::path& path) {
  const StoredImage& stored = file.stored();
  file.width = stored.width;
  file.height = stored.height;
  if (!file.is_exr) return;
  const auto text = [](int width, int height) {
    return std::to_string(width) + "×" + std::to_string(height);
  };
  const std::int64_t left = std::int64_t{stored.left} - stored.image_left,
                     top = std::int64_t{stored.top} - stored.image_top;
  if (left >= stored.image_width || top >= stored.image_height || left + stored.width <= 0 ||
      top + stored.height <= 0)
    throw FormatError(path, "stores no pixel of its display window of ",
                      text(stored.image_width, stored.image_height), "; export it with that window");
  // Pixels outside of the data window are zero and take no space in the file, but in memory.
  constexpr std::int64_t always_allowed = 1 << 24, max_side = 1 << 16, max_ratio = 64;
  const std::int64_t pixels = std::int64_t{stored.image_width} * stored.image_height;
  const std::int64_t stored_pixels = std::int64_t{stored.width} * stored.height;
  if (stored.image_width > max_side || stored.image_height > max_side ||
      (pixels > always_allowed && pixels / max_ratio > stored_pixels))
    throw FormatError(path, "stores ", text(stored.width, stored.height), " pixels of a display window of ",
                      text(stored.image_width, stored.image_height), "; crop that window");
  file.width = stored.image_width;
  file.height = stored.image_height;
  file.left = static_cast<int>(left);
  file.top = static_cast<int>(top);
}

void require_file(const fs::path& path) {
  std::error_code error;
  if (!fs::exists(path, error))
    throw DeviceError(path.string(), error ? error.value() : ENOENT, "cannot open the image");
  if (!fs::is_regular_file(path, error)) throw FormatError(path, "is not a file; name an image");
}

bool is_radiance(const fs::path& path) {
  require_file(path);
  return !is_camera_raw(path) && image_format(path) == ImageFormat::hdr;
}

PlacedFile place_image(const fs::path& path) {
  PlacedFile file{.file = open_image_file(path)};
  file.is_exr = file.stored().decoder == name_of(ImageFormat::exr);
  if (file.is_exr) choose_part(*file.file, path);
  const StoredImage& stored = file.stored();
  if (stored.depth > 1) throw FormatError(path, "has impossible dimensions: it is a volume, not an image");
  require_plausible(
      {stored.width, stored.height, static_cast<std::int64_t>(stored.channels.size()), stored.tile_pixels, 0},
      path);
  place_data_window(file, path);
  return file;
}

/// Orientation and encoding. EXR files have neither, and RAW files are developed to sRGB, upright.
ImageFacts facts_of(const PlacedFile& file, const fs::path& path) {
  return file.is_exr || is_camera_raw(path) ? ImageFacts{} : read_image_facts(path);
}

/// Whether a profile says that floating-point samples are not linear, as developing programs export them.
bool is_encoded(const ImageFacts& facts) {
  return !facts.response.empty() && facts.response != "linear";
}

/// The given channels of rows [first, last) of the image. Where the file stores no pixels, radiance is zero,
/// and noise infinite: nothing was measured there.
Image read_rows(PlacedFile& file, const fs::path& path, int first, int last, std::span<const int> channels) {
  const StoredImage& stored = file.stored();
  const auto count = static_cast<int>(channels.size());
  const int stored_first = std::clamp(first - file.top, 0, stored.height);
  const int stored_last = std::clamp(last - file.top, 0, stored.height);
  Image rows(stored.width, stored_last - stored_first, count);
  try {
    if (stored_first < stored_last)
      file.file->read_rows(stored_first, stored_last, channels, rows.values.data());
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    throw FormatError(path, "cannot read rows ", stored_first, " to ", stored_last, " (", error.what(),
                      "); the file is damaged or truncated: copy or capture it again");
  }
  if (file.left == 0 && file.width == stored.width && rows.height == last - first) return rows;
  Image image(file.width, last - first, count);
  for (int c = 0; c < count; ++c)
    if (stored.channels[channels[c]].starts_with("sigma."))
      for (std::size_t p = 0; p < image.pixel_count(); ++p)
        image.values[p * count + c] = std::numeric_limits<float>::infinity();
  const int x_first = std::max(file.left, 0), x_last = std::min(file.left + stored.width, file.width);
  for (int row = stored_first; row < stored_last; ++row)
    std::copy_n(&rows.at(x_first - file.left, row - stored_first, 0),
                static_cast<std::size_t>(x_last - x_first) * count,
                &image.at(x_first, row + file.top - first, 0));
  return image;
}

/// Leaves the other three.
std::vector<float> take_fourth_channel(Image& image) {
  Image others(image.width, image.height, 3);
  std::vector<float> taken(image.pixel_count());
  for (std::size_t p = 0; p < taken.size(); ++p) {
    std::copy_n(&image.values[4 * p], 3, &others.values[3 * p]);
    taken[p] = image.values[4 * p + 3];
  }
  image = std::move(others);
  return taken;
}

void write_channels(const fs::path& path, int width, int height, const std::vector<std::string>& names,
                    const float* values, Precision precision, ColourSpace space) {
  std::vector<float> xy;
  if (space == ColourSpace::rec709)
    for (const auto& point : rec709_chromaticities())
      for (const auto coordinate : {point[0], point[1]}) xy.push_back(static_cast<float>(coordinate));
  write_atomically(path, [&](const fs::path& temporary) {
    errno = 0;
    try {
      write_exr_channels(temporary, width, height, names, values, precision == Precision::half, xy);
    } catch (const std::exception& error) {
      throw DeviceError(path.string(), errno != 0 ? errno : EIO, "cannot write the image (", error.what(),
                        ")");
    }
  });
}

}  // namespace

std::unique_ptr<ImageFile> open_image_file(const fs::path& path) {
  require_file(path);
  return open_with_decoder(path);
}

ImageHeader read_image_header(const fs::path& path) {
  if (is_radiance(path)) {
    const RadianceHeader header = read_radiance_header(path);
    return {header.width, header.height, false, header.height};
  }
  const PlacedFile file = place_image(path);
  if (const int orientation = facts_of(file, path).orientation; orientation > 1)
    return orientation < 5 ? ImageHeader{file.width, file.height, false, file.height}
                           : ImageHeader{file.height, file.width, false, file.width};
  return {file.width, file.height, find_channels(file.stored(), "sigma.").has_value(),
          file.stored().block_rows};
}

Image v0_2::read_image(const fs::path& path) {
  return read_image(path, ImageUse::picture);
}

Image read_image(const fs::path& path, ImageUse use) {
  if (is_radiance(path)) return read_radiance(path);
  PlacedFile file = place_image(path);
  const StoredImage& stored = file.stored();
  const ImageFacts facts = facts_of(file, path);
  if (facts.is_raw)
    throw FormatError(path, "holds samples of a camera's sensor; develop it, or import it as a photograph");
  if (!facts.refusal.empty()) throw FormatError(path, facts.refusal);
  if (!file.is_exr && stored.samples == StoredSamples::other_integers)
    throw FormatError(
        path, "has integer samples of neither 8 nor 16 bits; convert it to one of them or to OpenEXR");
  const auto colour = colour_channels(stored, file.is_exr, path);
  std::vector<int> channels(colour.begin(), colour.end());
  const bool has_alpha = use == ImageUse::picture && stored.straight_alpha;
  if (has_alpha) channels.push_back(*stored.straight_alpha);
  Image image = read_rows(file, path, 0, file.height, channels);
  std::vector<float> alpha;
  if (has_alpha) alpha = take_fourth_channel(image);
  if (stored.samples != StoredSamples::floating_point)
    linearise(image, use == ImageUse::picture ? facts.response : "");
  else if (facts.response == "unknown")
    throw FormatError(path, unknown_encoding);
  else if (is_encoded(facts))
    linearise(image, facts.response);
  for (std::size_t p = 0; p < alpha.size(); ++p)
    for (std::size_t c = 0; c < 3; ++c) image.values[3 * p + c] *= alpha[p];
  if (use == ImageUse::texture) return image;
  return upright(image, facts.orientation);
}

Photograph read_photograph_rows(const fs::path& path, int first, int last) {
  const auto require_rows = [&](int height) {
    if (first < 0 || last > height || first >= last)
      throw InputError(path, ": has no rows ", first, " to ", last);
  };
  const auto rows_of = [&](const Image& whole) {  // these formats store no noise
    require_rows(whole.height);
    return Photograph{copied_rows(whole, first, last), {}};
  };
  if (is_radiance(path)) return rows_of(read_radiance(path));
  PlacedFile file = place_image(path);
  const StoredImage& stored = file.stored();
  const bool is_linear = stored.samples == StoredSamples::floating_point;
  if (is_linear)
    if (const ImageFacts facts = facts_of(file, path); facts.orientation > 1 || is_encoded(facts))
      return rows_of(read_image(path));
  require_rows(file.height);
  if (!is_linear)
    throw FormatError(path, "is not scene-linear; photographs must be OpenEXR or another float format");
  const auto colour = colour_channels(stored, file.is_exr, path);
  const auto sigma = find_channels(stored, "sigma.");
  if (!sigma) return {read_rows(file, path, first, last, colour), {}};
  const std::array both = {colour[0], colour[1], colour[2], (*sigma)[0], (*sigma)[1], (*sigma)[2]};
  const Image rows = read_rows(file, path, first, last, both);
  Photograph photograph{Image(rows.width, rows.height, 3), Image(rows.width, rows.height, 3)};
  for (std::size_t p = 0; p < rows.pixel_count(); ++p) {
    std::copy_n(&rows.values[6 * p], 3, &photograph.radiance.values[3 * p]);
    std::copy_n(&rows.values[6 * p + 3], 3, &photograph.sigma.values[3 * p]);
  }
  return photograph;
}

Photograph read_photograph(const fs::path& path) {
  return read_photograph_rows(path, 0, read_image_header(path).height);
}

namespace {

/// Solid angles in any unit: one per row of a lat-long map, one per texel of a cube's face; else none, as
/// texels count alike.
std::vector<double> solid_angles_of(const LightDomain& domain) {
  std::vector<double> angles;
  if (domain.parameterisation == Parameterisation::lat_long)
    for (int y = 0; y < domain.height; ++y)
      angles.push_back(std::cos(std::numbers::pi * y / domain.height) -
                       std::cos(std::numbers::pi * (y + 1) / domain.height));
  if (domain.parameterisation == Parameterisation::cube && domain.height == cube_faces * domain.width)
    for (const float angle : cube_solid_angles(domain.width)) angles.push_back(angle);
  return angles;
}

/// A note about one of the first light maps of a kind, once each.
void note_of_map(const RunContext& run, const fs::path& path, const std::string& kind,
                 const std::string& text) {
  static std::mutex mutex;
  static std::map<std::string, std::set<fs::path>> reported;
  constexpr std::size_t max_reports = 8;
  const std::scoped_lock lock(mutex);
  std::set<fs::path>& paths = reported[kind];
  if (paths.size() > max_reports || !paths.insert(path).second) return;
  if (paths.size() > max_reports)
    return run.note("more light maps ", kind, "; they are treated in the same way");
  run.note(path, ": ", text);
}

/// Negative texels of a light map: lossy compression leaves some around bright lights, other software many.
class NegativeTexels {
 public:
  NegativeTexels(LightMap& light, const fs::path& path)
      : image_(light.radiance),
        path_(path),
        angles_(solid_angles_of(light.domain())),
        is_lat_long_(light.parameterisation == Parameterisation::lat_long) {}

  /// Sets them to zero; the mean of each channel over the solid angle stays as it was. Throws InputError
  /// where they are no artefact of compression.
  void remove(const RunContext& run) {
    count();
    require_few();
    if (share_of_light() > reported_share) report(run);
    for (int c = 0; c < 3; ++c) remove(c);
  }

 private:
  // Seven of 26 published panoramas (DWA) add 3 to 17 % of irradiance when their negative texels become zero;
  // at most 2.8 % of their texels are negative, and 1.4 % by more than a tenth of the mean radiance.
  static constexpr double reported_share = 1e-4;
  static constexpr double strong = 0.1, max_strong_texels = 0.1, max_share_of_light = 0.5;
  static constexpr int block_size = 8;  // of the cosine transform; its mean survives compression

  double weight(std::size_t texel) const {
    if (angles_.empty()) return 1.0;
    return is_lat_long_ ? angles_[texel / image_.width] : angles_[texel % angles_.size()];
  }
  float lowest(std::size_t texel) const {
    return std::min({image_.values[3 * texel], image_.values[3 * texel + 1], image_.values[3 * texel + 2]});
  }
  /// What zero in place of negative values adds to the light.
  double share_of_light() const { return *std::ranges::max_element(added_); }

  void count() {
    std::array<double, 3> positive{}, negative{};
    double sum = 0.0, total_weight = 0.0;
    for (std::size_t t = 0; t < image_.pixel_count(); ++t) {
      for (std::size_t c = 0; c < 3; ++c) {
        const double value = weight(t) * image_.values[3 * t + c];
        (value < 0.0 ? negative : positive)[c] += std::abs(value);
        sum += std::abs(value) / 3.0;
      }
      total_weight += weight(t);
      if (lowest(t) < 0.0f) ++texels_;
      if (lowest(t) < lowest(worst_)) worst_ = t;
    }
    for (std::size_t t = 0; t < image_.pixel_count(); ++t)
      if (lowest(t) < -strong * sum / total_weight) ++strong_texels_;
    for (std::size_t c = 0; c < 3; ++c)
      added_[c] = negative[c] > 0.0 ? negative[c] / std::max(positive[c] - negative[c], 1e-9 * sum) : 0.0;
    is_mostly_negative_ = negative[0] + negative[1] + negative[2] >
                          max_share_of_light * (positive[0] + positive[1] + positive[2]);
  }

  std::string percent(double share) const {
    return formatted(share < 0.1 ? "%.2g %%" : "%.3g %%", 100.0 * share);
  }
  double share_of_texels(std::size_t texels) const {
    return static_cast<double>(texels) / static_cast<double>(image_.pixel_count());
  }
  std::string lowest_text() const { return formatted("%.4g", lowest(worst_)); }

  void require_few() const {
    if (!is_mostly_negative_ && share_of_texels(strong_texels_) <= max_strong_texels) return;
    throw InputError(path_, ": texel (", worst_ % image_.width, ", ", worst_ / image_.width, ") is ",
                     lowest_text(), ", and ", percent(share_of_texels(texels_)),
                     " of the texels are negative, more than lossy compression explains; radiance must not "
                     "be negative: export the light map again");
  }

  void report(const RunContext& run) const {
    note_of_map(run, path_, "have negative texels",
                percent(share_of_texels(texels_)) + " of its texels are negative (lowest " + lowest_text() +
                    "), as caused by lossy compression; they are set to zero and their neighbours are "
                    "reduced to preserve the mean radiance (setting them to zero alone would add " +
                    percent(share_of_light()) + ")");
  }

  /// Takes what zero adds off the positive texels of the same block, and what these lack off the blocks of
  /// twice the size, up to the whole map.
  void remove(int c) {
    int columns = (image_.width + block_size - 1) / block_size;
    int rows = (image_.height + block_size - 1) / block_size;
    std::vector<double> debt(static_cast<std::size_t>(columns) * rows);
    for (int y = 0; y < image_.height; ++y)
      for (int x = 0; x < image_.width; ++x) {
        float& value = image_.at(x, y, c);
        if (!(value < 0.0f)) continue;
        debt[static_cast<std::size_t>(y / block_size) * columns + x / block_size] -=
            weight(static_cast<std::size_t>(y) * image_.width + x) * value;
        value = 0.0f;
      }
    for (int size = block_size;; size *= 2) {
      const int next_columns = (columns + 1) / 2, next_rows = (rows + 1) / 2;
      std::vector<double> next(static_cast<std::size_t>(next_columns) * next_rows);
      for (int row = 0; row < rows; ++row)
        for (int column = 0; column < columns; ++column)
          next[static_cast<std::size_t>(row / 2) * next_columns + column / 2] += unpaid(
              column * size, row * size, size, c, debt[static_cast<std::size_t>(row) * columns + column]);
      if (columns == 1 && rows == 1) return;
      debt = std::move(next);
      columns = next_columns;
      rows = next_rows;
    }
  }

  /// Dims a block by `debt`; returns what it lacks.
  double unpaid(int x0, int y0, int size, int c, double debt) {
    if (debt <= 0.0) return 0.0;
    const int x1 = std::min(x0 + size, image_.width), y1 = std::min(y0 + size, image_.height);
    double light = 0.0;
    for (int y = y0; y < y1; ++y)
      for (int x = x0; x < x1; ++x)
        light += weight(static_cast<std::size_t>(y) * image_.width + x) * image_.at(x, y, c);
    const double factor = light > debt ? (light - debt) / light : 0.0;
    for (int y = y0; y < y1; ++y)
      for (int x = x0; x < x1; ++x) image_.at(x, y, c) = static_cast<float>(image_.at(x, y, c) * factor);
    return std::max(debt - light, 0.0);
  }

  Image& image_;
  const fs::path& path_;
  std::vector<double> angles_;
  bool is_lat_long_;
  std::size_t texels_ = 0, strong_texels_ = 0, worst_ = 0;
  std::array<double, 3> added_{};  // by channel, relative to the map's own light
  bool is_mostly_negative_ = false;
};

}  // namespace

namespace {

bool are_of_rec709(const Chromaticities& stated) {
  // Radiance states its own primaries, which all programs take for those of Rec.709.
  static const Chromaticities of_radiance = {Eigen::Vector2d(0.64, 0.33), Eigen::Vector2d(0.29, 0.60),
                                             Eigen::Vector2d(0.15, 0.06), Eigen::Vector2d(0.333, 0.333)};
  constexpr double rounding = 2e-3, visible = 5e-3;
  // The primaries of ICC profiles are those of another white.
  if ((rgb_from_rgb(stated, rec709_chromaticities()) - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() <
      visible)
    return true;
  return std::ranges::any_of(std::array{rec709_chromaticities(), of_radiance}, [&](const auto& known) {
    return std::ranges::equal(stated, known, [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
      return (a - b).cwiseAbs().maxCoeff() < rounding;
    });
  });
}

void treat_primaries(const Chromaticities& stated, Primaries primaries, Image& light, const fs::path& path,
                     const RunContext& run) {
  if (are_of_rec709(stated)) return;
  std::string text = "its primaries are not those of Rec.709 (x, y of red, green, blue, white:";
  for (const Eigen::Vector2d& xy : stated) {
    text += formatted(" %.4g, %.4g;", xy.x(), xy.y());
  }
  text.back() = ')';
  if (primaries == Primaries::as_stored)
    return note_of_map(
        run, path, "have other primaries than Rec.709",
        text + "; its values are used as they are, so photographs must have the same primaries");
  const Eigen::Matrix3d matrix = rgb_from_rgb(stated, rec709_chromaticities());
  if (!matrix.allFinite())
    throw FormatError(path, "states primaries that span no colours; correct its header");
  convert_colours(light, matrix.cast<float>());
  std::size_t outside = 0;
  for (float& value : light.values)
    if (value < 0.0f) {
      value = 0.0f;
      ++outside;
    }
  note_of_map(run, path, "were converted to the primaries of Rec.709",
              text + "; it is converted to linear Rec.709" +
                  (outside > 0 ? formatted(" (%.2g %% of the values, outside of that gamut, became zero)",
                                           100.0 * static_cast<double>(outside) /
                                               static_cast<double>(light.values.size()))
                               : ""));
}

}  // namespace

LightMap v0_2::read_light_map(const fs::path& path, Parameterisation parameterisation,
                              const RunContext& run) {
  return read_light_map(path, parameterisation, run, Primaries::as_stored);
}

LightMap read_light_map(const fs::path& path, Parameterisation parameterisation, const RunContext& run,
                        Primaries primaries) {
  LightMap light{read_image(path), parameterisation};
  const ImageFacts facts = is_camera_raw(path) ? ImageFacts{} : read_image_facts(path);
  if (facts.response == "unknown") throw FormatError(path, unknown_encoding);
  if (facts.is_cube && parameterisation != Parameterisation::monitor &&
      *facts.is_cube != (parameterisation == Parameterisation::cube))
    throw InputError(path, ": its attribute envmap says that it is a ", *facts.is_cube ? "cube" : "lat-long",
                     " map, which contradicts its use as a ", name_of(parameterisation), " map of ",
                     shape_text(light.radiance));
  if (facts.is_cube.value_or(false) && parameterisation == Parameterisation::cube)
    light.radiance = from_openexr_cube(light.radiance);
  repair_light_map(light, path, run);
  if (facts.chromaticities) treat_primaries(*facts.chromaticities, primaries, light.radiance, path, run);
  return light;
}

void repair_light_map(LightMap& light, const fs::path& name, const RunContext& run) {
  require_finite(light.radiance, name.string(), true, "repair that texel in the light map");
  if (std::ranges::any_of(light.radiance.values, [](float value) { return value < 0.0f; }))
    NegativeTexels(light, name).remove(run);
  for (float& value : light.radiance.values) value = std::max(value, 0.0f);  // −0
}

void v0_2::write_exr(const fs::path& path, const Image& image, Precision precision, ColourSpace space) {
  std::vector<std::string> names = {"R", "G", "B", "A"};
  if (image.channels == 1)
    names = {"Y"};
  else if (image.channels == 3)
    names.pop_back();
  else if (image.channels != 4)
    throw InputError("an EXR of 1, 3 or 4 channels can be written");
  write_channels(path, image.width, image.height, names, image.values.data(), precision, space);
}

void write_photograph(const fs::path& path, const Photograph& photograph, Precision precision) {
  const Image& radiance = photograph.radiance;
  if (photograph.sigma.empty()) return write_exr(path, radiance, precision);
  if (!radiance.same_shape(photograph.sigma)) throw InputError("radiance and sigma differ in shape");
  std::vector<float> six(radiance.pixel_count() * 6);
  for (std::size_t p = 0; p < radiance.pixel_count(); ++p)
    for (int c = 0; c < 3; ++c) {
      six[6 * p + c] = radiance.values[3 * p + c];
      six[6 * p + 3 + c] = photograph.sigma.values[3 * p + c];
    }
  write_channels(path, radiance.width, radiance.height, {"R", "G", "B", "sigma.R", "sigma.G", "sigma.B"},
                 six.data(), precision, ColourSpace::camera);
}

std::vector<std::uint8_t> encode_png(const ScreenImage& image) {
  static constexpr std::array<png_uint_32, 4> formats = {PNG_FORMAT_GRAY, PNG_FORMAT_GA, PNG_FORMAT_RGB,
                                                         PNG_FORMAT_RGBA};
  if (image.channels < 1 || image.channels > static_cast<int>(formats.size()))
    throw InputError("a PNG of 1 to 4 channels can be encoded");
  png_image header{};
  header.version = PNG_IMAGE_VERSION;
  header.width = static_cast<png_uint_32>(image.width);
  header.height = static_cast<png_uint_32>(image.height);
  header.format = formats[static_cast<std::size_t>(image.channels) - 1];
  std::vector<std::uint8_t> file(PNG_IMAGE_PNG_SIZE_MAX(header));
  png_alloc_size_t size = file.size();
  if (png_image_write_to_memory(&header, file.data(), &size, 0, image.levels.data(), 0, nullptr) == 0)
    throw InputError("cannot encode a PNG: ", header.message);
  file.resize(size);
  return file;
}

std::vector<std::uint8_t> encode_png(const Image& image, const ToneMapping& mapping) {
  return encode_png(ScreenImage{image.width, image.height, image.channels, tone_mapped(image, mapping)});
}

void write_png(const fs::path& path, const ScreenImage& image) {
  const auto file = encode_png(image);
  write_text_atomically(path, {reinterpret_cast<const char*>(file.data()), file.size()});
}

void write_png(const fs::path& path, const Image& image, const ToneMapping& mapping) {
  write_png(path, ScreenImage{image.width, image.height, image.channels, tone_mapped(image, mapping)});
}

}  // namespace refield
