// SPDX-License-Identifier: Apache-2.0
// Hostile image files: they promise more than they hold, and must be refused before a decoder sees them.
#include "core/image/image_header.h"

#include <gmock/gmock.h>

#include <cstring>
#include <functional>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/image/image_io.h"
#include "tests/support/random_data.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using testing::HasSubstr;

class HostileImage : public testing::Test {
 protected:
  std::string small_exr() {
    Rng rng(1);
    write_exr(folder_ / "small.exr", test::random_image(rng, 9, 5, 3));
    return read_text(folder_ / "small.exr");
  }

  std::string error_of(const std::string& bytes, const char* name = "hostile.exr") {
    write_text_atomically(folder_ / name, bytes);
    try {
      read_image(folder_ / name);
    } catch (const FormatError& error) {
      return error.what();
    }
    return "no error";
  }

  /// Little-endian values in place of the first bytes of an EXR attribute.
  static std::string with_attribute(std::string bytes, const std::string& name_and_type,
                                    const std::vector<std::int32_t>& values) {
    const auto at = bytes.find(name_and_type);
    EXPECT_NE(at, std::string::npos);
    std::memcpy(bytes.data() + at + name_and_type.size() + 4, values.data(), values.size() * 4);
    return bytes;
  }

  static std::string big_endian(std::uint32_t value) {
    std::string bytes;
    for (int shift = 24; shift >= 0; shift -= 8) bytes.push_back(static_cast<char>(value >> shift));
    return bytes;
  }

  static std::string png(std::uint32_t width, std::uint32_t height) {
    return "\x89PNG\r\n\x1a\n" + big_endian(13) + "IHDR" + big_endian(width) + big_endian(height) +
           std::string("\x08\x02\0\0\0", 5) + big_endian(0);
  }

  const std::string data_window_ = std::string("dataWindow\0box2i\0", 17);
  const test::TemporaryFolder folder_;
};

TEST_F(HostileImage, ExrOfImpossibleSize) {
  const auto with_window = [&](std::vector<std::int32_t> window) {
    return error_of(with_attribute(small_exr(), data_window_, window));
  };
  EXPECT_EQ(with_window({0, 0, 8, 4}), "no error");
  EXPECT_THAT(with_window({0, 0, 999'999'999, 999'999'999}),
              HasSubstr("impossible dimensions 1000000000×1000000000"));
  EXPECT_THAT(with_window({-2147483647, -2147483647, 2147483647, 2147483647}),
              HasSubstr("impossible dimensions"));
  EXPECT_THAT(with_window({5, 5, 3, 3}), HasSubstr("impossible dimensions"));
  EXPECT_THAT(with_window({0, 0, 60'000, 60'000}), HasSubstr("too small for the 60001×60001"));
  // Few enough pixels, but the table of their chunks alone is larger than the file.
  EXPECT_THAT(with_window({0, 0, 0, 60'000}), HasSubstr("too small"));
}

TEST_F(HostileImage, ExrWithImpossibleAttributes) {
  const std::string chlist("channels\0chlist\0", 16);
  std::string bytes = small_exr();
  const auto size_at = bytes.find(chlist) + chlist.size();
  bytes.replace(size_at, 4, "\xff\xff\xff\x7f");
  EXPECT_THAT(error_of(bytes), HasSubstr("'channels' of impossible size"));
  // Memory that the library would reserve before it reads: of a text, and of a small picture larger than its
  // bytes.
  const auto preceded_by = [this](const std::string& name_and_type, std::vector<std::int32_t> values) {
    std::string exr = small_exr();
    exr.insert(8, name_and_type + std::string(4 * values.size(), '\0'));
    std::memcpy(exr.data() + 8 + name_and_type.size(), values.data(), 4 * values.size());
    return exr;
  };
  EXPECT_THAT(error_of(preceded_by(std::string("owner\0string\0", 13), {1'900'000'000})),
              HasSubstr("'owner' of impossible size"));
  EXPECT_THAT(error_of(preceded_by(std::string("preview\0preview\0", 16), {8, 20'000, 20'000})),
              HasSubstr("'preview' of impossible size"));
  bytes = small_exr();
  bytes[5] = 0x08;  // flag of deep images
  EXPECT_THAT(error_of(bytes), HasSubstr("deep"));
  EXPECT_THAT(error_of(small_exr().substr(0, 20)), HasSubstr("truncated"));
}

TEST_F(HostileImage, PngBomb) {
  EXPECT_THAT(error_of(png(1'000'000'000, 1'000'000'000), "bomb.png"), HasSubstr("impossible dimensions"));
  EXPECT_THAT(error_of(png(60'000, 60'000), "bomb.png"), HasSubstr("too small for the 60000×60000"));
}

TEST_F(HostileImage, HdrBomb) {
  const auto hdr = [](const std::string& size) {
    return "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n" + size + "\n";
  };
  EXPECT_THAT(error_of(hdr("-Y 900000000 +X 900000000"), "bomb.hdr"), HasSubstr("impossible dimensions"));
  EXPECT_THAT(error_of(hdr("-Y 60000 +X 60000"), "bomb.hdr"), HasSubstr("too small"));
  EXPECT_THAT(error_of(hdr("-Y -4 +X 4"), "bomb.hdr"), HasSubstr("impossible dimensions"));
  EXPECT_THAT(error_of(hdr("what?"), "bomb.hdr"), HasSubstr("no resolution"));
  EXPECT_THAT(error_of("#?RADIANCE\n", "bomb.hdr"), HasSubstr("ends within its header"));
}

TEST_F(HostileImage, JpegOfManyScans) {
  const std::string frame("\xff\xd8\xff\xc2\0\x11\x08\x10\0\x10\0\x03\x01\x11\0\x02\x11\0\x03\x11\0", 21);
  std::string scans;
  for (int i = 0; i < 101; ++i) scans += std::string("\xff\xda\0\x08\x01\x01\0\0\0\0", 10);
  EXPECT_THAT(error_of(frame + scans, "slow.jpg"), HasSubstr("more than 100 scans"));
}

TEST_F(HostileImage, IsToldByItsContentNotItsName) {
  EXPECT_EQ(error_of(small_exr(), "photograph.jpg"), "no error");
  // A TGA has no signature: OpenImageIO would have found it by trying.
  EXPECT_THAT(error_of(std::string("\0\0\x02\0\0\0\0\0\0\0\0\0\x10\0\x10\0\x18\0", 18), "a.exr"),
              HasSubstr("the format must be EXR, HDR, PNG, JPEG, TIFF or PFM"));
}

}  // namespace
}  // namespace refield
