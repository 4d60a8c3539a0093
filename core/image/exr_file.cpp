// SPDX-License-Identifier: Apache-2.0
#include <ImfChannelList.h>
#include <ImfFloatAttribute.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfInputPart.h>
#include <ImfIntAttribute.h>
#include <ImfMultiPartInputFile.h>
#include <ImfOutputFile.h>
#include <ImfRationalAttribute.h>
#include <ImfStandardAttributes.h>
#include <ImfStdIO.h>
#include <ImfStringAttribute.h>
#include <ImfThreading.h>
#include <ImfTileDescription.h>
#include <ImfVersion.h>
#include <ImfXdr.h>

#include <algorithm>
#include <thread>

#include "core/image/image_file.h"
#include "core/image/image_header.h"

namespace refield {

namespace {

constexpr const char* deep_text = "is a deep image, which has no single colour per pixel; flatten it";
constexpr std::size_t max_parts = 1024;

/// OpenEXR's own threads, which compress and decompress blocks of rows, start with the first file.
int exr_threads() {
  static const int count = [] {
    const int cores = static_cast<int>(std::thread::hardware_concurrency());
    Imf::setGlobalThreadCount(cores);
    return cores;
  }();
  return count;
}

/// OpenEXR's names of what OpenImageIO calls otherwise.
std::string own_name(const std::string& attribute) {
  if (attribute == "ExposureTime") return "expTime";
  if (attribute == "FNumber") return "aperture";
  if (attribute == "DateTime") return "capDate";
  return attribute;
}

/// See ImageHeader::block_rows. Source: "Technical Introduction to OpenEXR", Scan Line Files: compression.
int rows_stored_together(const Imf::Header& header) {
  if (header.hasTileDescription()) return static_cast<int>(header.tileDescription().ySize);
  switch (header.compression()) {
    case Imf::ZIP_COMPRESSION:
    case Imf::PXR24_COMPRESSION:
      return 16;
    case Imf::PIZ_COMPRESSION:
    case Imf::B44_COMPRESSION:
    case Imf::B44A_COMPRESSION:
    case Imf::DWAA_COMPRESSION:
      return 32;
    case Imf::DWAB_COMPRESSION:
      return 256;
    default:
      return 1;
  }
}

class ExrFile final : public ImageFile {
 public:
  explicit ExrFile(const fs::path& path) : file_(path.c_str(), exr_threads()) { select_part(0); }

  bool select_part(int part) override {
    if (part >= file_.parts()) return false;
    const Imf::Header& header = file_.header(part);
    StoredImage stored;
    stored.decoder = name_of(ImageFormat::exr);
    stored.part = header.hasName() ? header.name() : std::to_string(part);
    set_windows(stored, header);
    stored.block_rows = rows_stored_together(header);
    if (header.hasTileDescription())
      stored.tile_pixels =
          static_cast<std::int64_t>(header.tileDescription().xSize) * header.tileDescription().ySize;
    bool has_floats = false;
    for (auto channel = header.channels().begin(); channel != header.channels().end(); ++channel) {
      stored.channels.emplace_back(channel.name());
      has_floats |= channel.channel().type != Imf::UINT;
    }
    if (!has_floats) stored.samples = StoredSamples::other_integers;
    stored_ = std::move(stored);
    part_ = part;
    return true;
  }

  void read_rows(int first, int last, std::span<const int> channels, float* values) override {
    const std::size_t count = channels.size();
    Imf::FrameBuffer buffer;
    const auto repeated = [&](std::size_t i) {
      return static_cast<std::size_t>(std::ranges::find(channels, channels[i]) - channels.begin());
    };
    for (std::size_t i = 0; i < count; ++i)
      if (repeated(i) == i)
        buffer.insert(
            stored_.channels[channels[i]],
            Imf::Slice::Make(Imf::FLOAT, values + i, {stored_.left, stored_.top + first}, stored_.width,
                             last - first, count * sizeof(float), count * sizeof(float) * stored_.width));
    Imf::InputPart input(file_, part_);
    input.setFrameBuffer(buffer);
    input.readPixels(stored_.top + first, stored_.top + last - 1);
    const std::size_t pixels = static_cast<std::size_t>(stored_.width) * (last - first);
    for (std::size_t i = 0; i < count; ++i)
      if (const std::size_t from = repeated(i); from != i)
        for (std::size_t p = 0; p < pixels; ++p) values[p * count + i] = values[p * count + from];
  }

  std::vector<std::uint16_t> read_samples() override {
    throw std::runtime_error("OpenEXR files have no samples of 8 or 16 bits");
  }

  std::string text(const std::string& attribute) const override {
    const auto* found = find<Imf::StringAttribute>(attribute);
    return found ? found->value() : "";
  }

  std::optional<double> number(const std::string& attribute) const override {
    if (const auto* real = find<Imf::FloatAttribute>(attribute)) return real->value();
    if (const auto* integer = find<Imf::IntAttribute>(attribute)) return integer->value();
    if (const auto* ratio = find<Imf::RationalAttribute>(attribute)) return double{ratio->value()};
    return std::nullopt;
  }

 private:
  static void set_windows(StoredImage& stored, const Imf::Header& header) {
    const auto &data = header.dataWindow(), &display = header.displayWindow();
    stored.left = data.min.x;
    stored.top = data.min.y;
    stored.width = data.max.x - data.min.x + 1;
    stored.height = data.max.y - data.min.y + 1;
    stored.image_left = display.min.x;
    stored.image_top = display.min.y;
    stored.image_width = display.max.x - display.min.x + 1;
    stored.image_height = display.max.y - display.min.y + 1;
  }

  template <class Attribute>
  const Attribute* find(const std::string& name) const {
    const Imf::Header& header = file_.header(part_);
    if (const auto* found = header.findTypedAttribute<Attribute>(name)) return found;
    return header.findTypedAttribute<Attribute>(own_name(name));
  }

  Imf::MultiPartInputFile file_;
  int part_ = 0;
};

}  // namespace

void write_exr_channels(const fs::path& path, int width, int height, const std::vector<std::string>& names,
                        const float* values, bool as_half, std::span<const float> chromaticities) {
  Imf::Header header(width, height);
  header.compression() = Imf::ZIP_COMPRESSION;
  const Imf::PixelType type = as_half ? Imf::HALF : Imf::FLOAT;
  for (const std::string& name : names) header.channels().insert(name, Imf::Channel(type));
  if (chromaticities.size() == 8) {
    const auto xy = [&](std::size_t i) {
      return Imath::V2f(chromaticities[2 * i], chromaticities[2 * i + 1]);
    };
    Imf::addChromaticities(header, {xy(0), xy(1), xy(2), xy(3)});
  }
  std::vector<half> halves;
  if (as_half) halves.assign(values, values + names.size() * width * height);
  const void* stored = as_half ? static_cast<const void*>(halves.data()) : values;
  const std::size_t sample = as_half ? sizeof(half) : sizeof(float), pixel = names.size() * sample;
  Imf::FrameBuffer buffer;
  for (std::size_t i = 0; i < names.size(); ++i)
    buffer.insert(names[i], Imf::Slice::Make(type, static_cast<const char*>(stored) + i * sample, {0, 0},
                                             width, height, pixel, pixel * width));
  Imf::OutputFile output(path.c_str(), header, exr_threads());
  output.setFrameBuffer(buffer);
  output.writePixels(height);
}

namespace {

PromisedImage promised_by(const Imf::Header& header, const fs::path& path) {
  if (header.hasType() && header.type().starts_with("deep")) throw FormatError(path, deep_text);
  const auto& window = header.dataWindow();
  const std::int64_t width = std::int64_t{window.max.x} - window.min.x + 1,
                     height = std::int64_t{window.max.y} - window.min.y + 1;
  PromisedImage promised{.width = width, .height = height};
  for (auto channel = header.channels().begin(); channel != header.channels().end(); ++channel) {
    ++promised.channels;
    const auto& [type, x_sampling, y_sampling, is_linear] = channel.channel();
    if (x_sampling != 1 || y_sampling != 1)
      throw FormatError(path, "has sub-sampled channels (luminance and chroma); export it as RGB");
    const std::string name = channel.name(), last = name.substr(name.rfind('.') + 1);
    if (type == Imf::UINT && (last == "R" || last == "G" || last == "B" || last == "Y"))
      throw FormatError(path, "stores '", name,
                        "' as whole numbers (uint), not as light; export half or float");
  }
  if (Imf::hasChromaticities(header)) {
    const Imf::Chromaticities& stated = Imf::chromaticities(header);
    promised.chromaticities.emplace();
    std::ranges::transform(std::array{stated.red, stated.green, stated.blue, stated.white},
                           promised.chromaticities->begin(),
                           [](const auto& xy) { return Eigen::Vector2d(xy.x, xy.y); });
  }
  if (Imf::hasEnvmap(header)) promised.is_cube = Imf::envmap(header) == Imf::ENVMAP_CUBE;
  if (width <= 0 || height <= 0) return promised;  // refused for that
  std::int64_t columns = width;                    // of what is stored together
  if (header.hasTileDescription()) {
    columns = header.tileDescription().xSize;
    promised.tile_pixels = columns * header.tileDescription().ySize;
  }
  const std::int64_t rows = rows_stored_together(header);
  // Above this, products of two sizes might overflow.
  constexpr std::int64_t largest = 1 << 24;
  if (columns < 1 || rows < 1 || (header.hasTileDescription() && std::max(columns, rows) > largest))
    throw FormatError(path, "has impossibly large tiles, or none; the file is damaged or truncated");
  constexpr std::uint64_t least_chunk_bytes = 16;  // in a table, and row number and size
  promised.least_bytes = static_cast<std::uint64_t>((width + columns - 1) / columns) *
                         static_cast<std::uint64_t>((height + rows - 1) / rows) * least_chunk_bytes;
  return promised;
}

/// OpenEXR reserves the memory that an attribute states before it reads it: what exceeds the file is refused
/// first.
void require_possible_attributes(FileBytes& file, std::uint64_t at, const fs::path& path) {
  constexpr std::uint64_t longest_name = 255;
  const auto next_text = [&] {
    std::string text = file.text(at, longest_name + 1);
    text.resize(std::min(text.find('\0'), text.size()));
    at += text.size() + 1;
    return text;
  };
  for (std::string name = next_text(); !name.empty(); name = next_text()) {
    const std::string type = next_text();
    const std::uint64_t size = file.number(at, 4, false);
    at += 4;
    const bool is_preview = type == "preview";
    const std::uint64_t pixels = is_preview ? file.number(at, 4, false) * file.number(at + 4, 4, false) : 0;
    if (at > file.size() || size > file.size() - at || (is_preview && size != 8 + 4 * pixels))
      throw FormatError(path, "has an attribute '", name,
                        "' of impossible size; the file is damaged or truncated");
    at += size;
  }
}

}  // namespace

std::vector<PromisedImage> read_exr_headers(const fs::path& path) {
  try {
    Imf::StdIFStream file(path.c_str());
    int magic = 0, version = 0;
    Imf::Xdr::read<Imf::StreamIO>(file, magic);
    Imf::Xdr::read<Imf::StreamIO>(file, version);
    if (Imf::getVersion(version) != Imf::EXR_VERSION)
      throw FormatError(path, "is of an unknown version of OpenEXR; the file is damaged or truncated");
    if (Imf::isNonImage(version)) throw FormatError(path, deep_text);
    FileBytes bytes(path);
    std::vector<PromisedImage> parts;
    for (;;) {
      require_possible_attributes(bytes, file.tellg(), path);
      Imf::Header header;
      header.readFrom(file, version);
      if (header.readsNothing()) return parts;
      parts.push_back(promised_by(header, path));
      if (!Imf::isMultiPart(version)) return parts;
      if (parts.size() > max_parts)
        throw FormatError(path, "has more than ", max_parts, " parts; the file is damaged");
    }
  } catch (const Error&) {
    throw;
  } catch (const std::exception& error) {
    throw FormatError(path, "has a damaged header (", error.what(), "); check that the file is complete");
  }
}

std::unique_ptr<ImageFile> open_exr(const fs::path& path) {
  return std::make_unique<ExrFile>(path);
}

}  // namespace refield
