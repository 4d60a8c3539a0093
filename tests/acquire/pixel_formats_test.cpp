// SPDX-License-Identifier: Apache-2.0
#include "acquire/devices/pixel_formats.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/videodev2.h>

#include <jpeglib.h>
#include <cstdio>

#include "core/base/errors.h"
#include "core/base/rng.h"

namespace refield {
namespace {

using testing::ElementsAre;
using Bytes = std::vector<std::uint8_t>;
using Samples = std::vector<std::uint16_t>;

Samples unpack(const Bytes& bytes, std::uint32_t fourcc, int width, int height, std::size_t bytes_per_line,
               std::optional<FrameWindow> window = std::nullopt, YuvCoding coding = {}) {
  return unpack_frame(bytes, find_v4l2_format(fourcc).value(), width, height, bytes_per_line,
                      window.value_or(FrameWindow{0, 0, width, height}), coding, "camera");
}

TEST(PixelFormats, CodesAreTextAndBack) {
  EXPECT_EQ(fourcc_from_text("RGGB"), V4L2_PIX_FMT_SRGGB8);
  EXPECT_EQ(fourcc_from_text("Y10"), V4L2_PIX_FMT_Y10);
  EXPECT_EQ(fourcc_text(V4L2_PIX_FMT_Y10), "Y10");
  EXPECT_THROW(fourcc_from_text(""), InputError);
  EXPECT_THROW(fourcc_from_text("RGGB8"), InputError);
  EXPECT_EQ(find_v4l2_format(V4L2_PIX_FMT_NV12), std::nullopt);
}

TEST(PixelFormats, EveryCodeIsThereOnceAndTheRawOnesComeFirst) {
  const auto formats = v4l2_formats();
  bool raw = true;
  for (std::size_t i = 0; i < formats.size(); ++i) {
    EXPECT_FALSE(formats[i].is_raw() && !raw) << fourcc_text(formats[i].fourcc);
    raw = formats[i].is_raw();
    for (std::size_t j = 0; j < i; ++j) EXPECT_NE(formats[i].fourcc, formats[j].fourcc);
  }
}

TEST(PixelFormats, BytesAndWordsWithLinePadding) {
  EXPECT_THAT(unpack({1, 2, 99, 3, 255, 99}, V4L2_PIX_FMT_GREY, 2, 2, 3), ElementsAre(1, 2, 3, 255));
  const Bytes words = {0x34, 0x12, 0xff, 0xff};
  EXPECT_THAT(unpack(words, V4L2_PIX_FMT_Y16, 2, 1, 4), ElementsAre(0x1234, 0xffff));
  EXPECT_THAT(unpack({0xff, 0x03, 0x01, 0x00}, V4L2_PIX_FMT_Y10, 2, 1, 4), ElementsAre(1023, 1));
  // Junk above the format's bits must not lie outside the tables that follow.
  EXPECT_THAT(unpack(words, V4L2_PIX_FMT_Y12, 2, 1, 4), ElementsAre(0x234, 0xfff));
}

TEST(PixelFormats, GenicamNames) {
  const auto check = [](const char* name, PixelLayout layout, int bits, SamplePacking packing) {
    const auto format = find_genicam_format(name);
    ASSERT_TRUE(format) << name;
    EXPECT_EQ(format->layout, layout) << name;
    EXPECT_EQ(format->bits, bits) << name;
    EXPECT_EQ(format->packing, packing) << name;
  };
  check("Mono8", PixelLayout::grey, 8, SamplePacking::bytes);
  check("Mono16", PixelLayout::grey, 16, SamplePacking::words);
  check("BayerGB14", PixelLayout::bayer_gbrg, 14, SamplePacking::words);
  check("BayerBG12p", PixelLayout::bayer_bggr, 12, SamplePacking::lsb_first);
  check("BayerRG10Packed", PixelLayout::bayer_rggb, 10, SamplePacking::gige_packed);
  check("RGB8", PixelLayout::rgb, 8, SamplePacking::bytes);
  check("BGR8Packed", PixelLayout::rgb, 8, SamplePacking::bgr);
  for (const char* name :
       {"Mono1p", "Mono8Signed", "Mono8p", "Mono16p", "Mono14Packed", "YUV422_8", "Coord3D_C16", ""})
    EXPECT_EQ(find_genicam_format(name), std::nullopt) << name;
}

TEST(PixelFormats, GenicamPackings) {
  const auto unpack_genicam = [](const Bytes& bytes, const char* name, int width) {
    const PixelFormat format = find_genicam_format(name).value();
    EXPECT_EQ(line_bytes(format, width), bytes.size()) << name;
    return unpack_frame(bytes, format, width, 1, bytes.size(), {0, 0, width, 1}, {}, "camera");
  };
  // Samples 0x155, 0x2aa, 0x3ff, 0x001, low bits first.
  EXPECT_THAT(unpack_genicam({0x55, 0xa9, 0xfa, 0x7f, 0x00}, "Mono10p", 4),
              ElementsAre(0x155, 0x2aa, 0x3ff, 0x001));
  EXPECT_THAT(unpack_genicam({0xbc, 0x3a, 0x12}, "Mono12p", 2), ElementsAre(0xabc, 0x123));
  EXPECT_THAT(unpack_genicam({0xff, 0x7f, 0x00, 0x00, 0xd0, 0xff, 0x8f}, "Mono14p", 4),
              ElementsAre(0x3fff, 0x0001, 0x3d00, 0x23ff));
  // High bytes outside, low bits between them.
  EXPECT_THAT(unpack_genicam({0xab, 0x3c, 0x12}, "Mono12Packed", 2), ElementsAre(0xabc, 0x123));
  EXPECT_THAT(unpack_genicam({0x55, 0x21, 0xaa}, "Mono10Packed", 2), ElementsAre(0x155, 0x2aa));
}

TEST(PixelFormats, PackedTenAndTwelveBits) {
  // Samples 0x3ff, 0x000, 0x155, 0x2aa.
  EXPECT_THAT(unpack({0xff, 0x00, 0x55, 0xaa, 0b10'01'00'11}, V4L2_PIX_FMT_Y10P, 4, 1, 5),
              ElementsAre(0x3ff, 0x000, 0x155, 0x2aa));
  // Samples 0xabc, 0x123.
  const Bytes two_lines = {0xab, 0x12, 0x3c, 0xab, 0x12, 0x3c};
  EXPECT_THAT(unpack(two_lines, V4L2_PIX_FMT_SBGGR12P, 2, 2, 3), ElementsAre(0xabc, 0x123, 0xabc, 0x123));
}

TEST(PixelFormats, ColoursInBothOrders) {
  EXPECT_THAT(unpack({1, 2, 3}, V4L2_PIX_FMT_RGB24, 1, 1, 3), ElementsAre(1, 2, 3));
  EXPECT_THAT(unpack({1, 2, 3}, V4L2_PIX_FMT_BGR24, 1, 1, 3), ElementsAre(3, 2, 1));
}

TEST(PixelFormats, YuyvOfKnownColours) {
  const auto yuyv = [](const Bytes& bytes, YuvCoding coding) {
    return unpack(bytes, V4L2_PIX_FMT_YUYV, 2, 2, 4, FrameWindow{0, 0, 2, 2}, coding);
  };
  // Lines of white and black, then of pure red. BT.601, range 16 to 235.
  EXPECT_THAT(yuyv({235, 128, 16, 128, 81, 90, 81, 240}, {}),
              ElementsAre(255, 255, 255, 0, 0, 0, 254, 0, 0, 254, 0, 0));
  // BT.709: red is Y 63, Cb 102, Cr 240. Full range BT.601: Y 76, Cb 85, Cr 255.
  EXPECT_THAT(yuyv({235, 128, 16, 128, 63, 102, 63, 240}, {.bt709 = true}),
              ElementsAre(255, 255, 255, 0, 0, 0, 255, 1, 0, 255, 1, 0));
  EXPECT_THAT(yuyv({255, 128, 0, 128, 76, 85, 76, 255}, {.full_range = true}),
              ElementsAre(255, 255, 255, 0, 0, 0, 254, 0, 0, 254, 0, 0));
}

TEST(PixelFormats, AWindowOfTheFrame) {
  const Bytes frame = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
  EXPECT_THAT(unpack(frame, V4L2_PIX_FMT_GREY, 4, 4, 4, FrameWindow{1, 2, 2, 1}), ElementsAre(9, 10));
  EXPECT_THAT(unpack(frame, V4L2_PIX_FMT_SGBRG8, 4, 4, 4, FrameWindow{2, 2, 2, 2}),
              ElementsAre(10, 11, 14, 15));
  EXPECT_THROW(unpack(frame, V4L2_PIX_FMT_SGBRG8, 4, 4, 4, FrameWindow{1, 2, 2, 2}), InputError);
  EXPECT_THROW(unpack(frame, V4L2_PIX_FMT_GREY, 4, 4, 4, FrameWindow{3, 0, 2, 1}), InputError);
}

TEST(PixelFormats, ATornFrameIsRefused) {
  EXPECT_THROW(unpack({1, 2, 3}, V4L2_PIX_FMT_GREY, 2, 2, 2), DeviceError);
  EXPECT_THROW(unpack({1, 2, 3, 4}, V4L2_PIX_FMT_GREY, 2, 2, 1), DeviceError);
}

Bytes jpeg_of(const Bytes& rgb, int width, int height) {
  jpeg_compress_struct encoder{};
  jpeg_error_mgr errors{};
  encoder.err = jpeg_std_error(&errors);
  jpeg_create_compress(&encoder);
  unsigned char* memory = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&encoder, &memory, &size);
  encoder.image_width = static_cast<JDIMENSION>(width);
  encoder.image_height = static_cast<JDIMENSION>(height);
  encoder.input_components = 3;
  encoder.in_color_space = JCS_RGB;
  jpeg_set_defaults(&encoder);
  jpeg_set_quality(&encoder, 100, TRUE);
  jpeg_start_compress(&encoder, TRUE);
  while (encoder.next_scanline < encoder.image_height) {
    auto* row = const_cast<JSAMPLE*>(rgb.data() + std::size_t{3} * width * encoder.next_scanline);
    jpeg_write_scanlines(&encoder, &row, 1);
  }
  jpeg_finish_compress(&encoder);
  Bytes jpeg(memory, memory + size);
  jpeg_destroy_compress(&encoder);
  std::free(memory);
  return jpeg;
}

TEST(PixelFormats, MjpegIsDecodedAndTornOnesAreRefused) {
  constexpr int width = 32, height = 16;
  Bytes rgb;
  for (int i = 0; i < width * height; ++i) rgb.insert(rgb.end(), {200, 100, 50});
  Bytes jpeg = jpeg_of(rgb, width, height);
  const Samples samples = unpack(jpeg, V4L2_PIX_FMT_MJPEG, width, height, 0, FrameWindow{8, 4, 2, 2});
  ASSERT_EQ(samples.size(), 12u);
  constexpr int rounding = 2;  // of JPEG's colour conversion
  for (std::size_t i = 0; i < samples.size(); ++i) EXPECT_NEAR(samples[i], rgb[i], rounding);
  EXPECT_THROW(unpack(jpeg, V4L2_PIX_FMT_MJPEG, 16, 16, 0), DeviceError);  // another size
  jpeg.resize(jpeg.size() * 3 / 4);
  EXPECT_THROW(unpack(jpeg, V4L2_PIX_FMT_MJPEG, width, height, 0), DeviceError);
  EXPECT_THROW(unpack({}, V4L2_PIX_FMT_MJPEG, width, height, 0), DeviceError);
}

}  // namespace
}  // namespace refield
