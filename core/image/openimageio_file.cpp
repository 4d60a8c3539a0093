// SPDX-License-Identifier: Apache-2.0
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/image/image_file.h"

namespace refield {

namespace {

class OpenImageIoFile final : public ImageFile {
 public:
  OpenImageIoFile(const std::string& path, const std::string& decoder) {
    // Debian's OpenImageIO prints debugging notes to standard error unless told not to.
    static const bool silent = OIIO::attribute("debug", 0);
    static_cast<void>(silent);
    OIIO::ImageSpec spec, config;
    config.attribute("oiio:UnassociatedAlpha", 1);  // else it multiplies encoded values by alpha
    if (decoder.empty()) {
      input_ = OIIO::ImageInput::open(path, &config);
      if (!input_) throw std::runtime_error(OIIO::geterror());
    } else {
      input_ = OIIO::ImageInput::create(decoder);
      if (!input_) throw std::runtime_error(OIIO::geterror());
      if (!input_->open(path, spec, config)) throw std::runtime_error(input_->geterror());
    }
    describe();
  }

  bool select_part(int part) override { return part == 0; }

  void read_rows(int first, int last, std::span<const int> channels, float* values) override {
    const OIIO::ImageSpec& spec = input_->spec();
    const std::size_t row_size = static_cast<std::size_t>(spec.width) * spec.nchannels;
    // Tiles are read whole.
    const int step = spec.tile_width == 0 ? 1 : spec.tile_height;
    const int from = first / step * step, to = std::min((last + step - 1) / step * step, spec.height);
    std::vector<float> stored(row_size * (to - from));
    const bool done = spec.tile_width == 0
                          ? input_->read_scanlines(0, 0, spec.y + from, spec.y + to, 0, 0, spec.nchannels,
                                                   OIIO::TypeDesc::FLOAT, stored.data())
                          : input_->read_tiles(0, 0, spec.x, spec.x + spec.width, spec.y + from, spec.y + to,
                                               0, 1, 0, spec.nchannels, OIIO::TypeDesc::FLOAT, stored.data());
    if (!done) throw std::runtime_error(input_->geterror());
    const float* pixel = stored.data() + row_size * (first - from);
    const std::size_t pixels = static_cast<std::size_t>(spec.width) * (last - first);
    for (std::size_t p = 0; p < pixels; ++p, pixel += spec.nchannels)
      for (const int channel : channels) *values++ = pixel[channel];
  }

  std::vector<std::uint16_t> read_samples() override {
    if (stored_.samples == StoredSamples::uint16) return read_samples_of<std::uint16_t>();
    if (stored_.samples == StoredSamples::uint8) {
      const auto bytes = read_samples_of<std::uint8_t>();
      return {bytes.begin(), bytes.end()};
    }
    throw std::runtime_error("its samples have neither 8 nor 16 bits");
  }

  std::string text(const std::string& attribute) const override {
    return std::string(input_->spec().get_string_attribute(attribute));
  }

  std::optional<double> number(const std::string& attribute) const override {
    const float value =
        input_->spec().get_float_attribute(attribute, std::numeric_limits<float>::quiet_NaN());
    if (std::isnan(value)) return std::nullopt;
    return value;
  }

 private:
  void describe() {
    const OIIO::ImageSpec& spec = input_->spec();
    stored_.decoder = input_->format_name();
    stored_.part = "0";
    stored_.left = spec.x;
    stored_.top = spec.y;
    stored_.width = stored_.image_width = spec.width;
    stored_.height = stored_.image_height = spec.height;
    stored_.image_left = spec.x;
    stored_.image_top = spec.y;
    stored_.depth = spec.depth;
    stored_.channels = spec.channelnames;
    if (spec.alpha_channel >= 0 && spec.get_int_attribute("oiio:UnassociatedAlpha") != 0)
      stored_.straight_alpha = spec.alpha_channel;
    if (spec.format == OIIO::TypeDesc::UINT8)
      stored_.samples = StoredSamples::uint8;
    else if (spec.format == OIIO::TypeDesc::UINT16)
      stored_.samples = StoredSamples::uint16;
    else if (!spec.format.is_floating_point())
      stored_.samples = StoredSamples::other_integers;
    stored_.tile_pixels = static_cast<std::int64_t>(spec.tile_width) * spec.tile_height;
    if (spec.tile_width > 0) stored_.block_rows = spec.tile_height;
  }

  template <class T>
  std::vector<T> read_samples_of() {
    const OIIO::ImageSpec& spec = input_->spec();
    std::vector<T> samples(static_cast<std::size_t>(spec.width) * spec.height * spec.nchannels);
    if (!input_->read_image(0, 0, 0, spec.nchannels, OIIO::BaseTypeFromC<T>::value, samples.data()))
      throw std::runtime_error(input_->geterror());
    return samples;
  }

  std::unique_ptr<OIIO::ImageInput> input_;
};

void write_samples(const std::string& path, int width, int height, int channels,
                   const std::uint16_t* samples) {
  auto output = OIIO::ImageOutput::create(path);
  if (!output) throw std::runtime_error(OIIO::geterror());
  if (!output->open(path, OIIO::ImageSpec(width, height, channels, OIIO::TypeDesc::UINT16)) ||
      !output->write_image(OIIO::TypeDesc::UINT16, samples) || !output->close())
    throw std::runtime_error(output->geterror());
}

constexpr ImageFormats formats = {
    .open = [](const std::string& path, const std::string& decoder) -> std::unique_ptr<ImageFile> {
      return std::make_unique<OpenImageIoFile>(path, decoder);
    },
    .write_samples = write_samples,
};

}  // namespace

#if REFIELD_IMAGE_FORMATS_MODULE
extern "C" REFIELD_API const ImageFormats* refield_image_formats() {
  return &formats;
}
#else
const ImageFormats& image_formats() {
  return formats;
}
#endif

}  // namespace refield
