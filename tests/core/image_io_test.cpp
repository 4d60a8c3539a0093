// SPDX-License-Identifier: Apache-2.0
#include "core/image/image_io.h"

#include <OpenImageIO/imageio.h>
#include <gmock/gmock.h>

#include <chrono>
#include <cmath>
#include <fstream>
#include <functional>
#include <limits>
#include <numbers>
#include <regex>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/light/cube_map.h"
#include "tests/support/message_of.h"
#include "tests/support/random_data.h"
#include "tests/support/small_disk.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr float infinity = std::numeric_limits<float>::infinity();
constexpr double half_rounding = 1.0 / 2048.0;  // 11 bits of significand, relative

void write_with_openimageio(const fs::path& path, const OIIO::ImageSpec& spec,
                            const std::vector<float>& values) {
  auto output = OIIO::ImageOutput::create(path.string());
  ASSERT_TRUE(output && output->open(path.string(), spec) &&
              output->write_image(OIIO::TypeDesc::FLOAT, values.data()) && output->close())
      << OIIO::geterror();
}

TEST(Exr, FloatRoundTripIsExact) {
  const test::TemporaryFolder folder;
  Rng rng(1);
  const Image image = test::random_image(rng, 37, 19, 3, -1.0, 1e6);
  write_exr(folder / "a.exr", image);
  const Image back = read_image(folder / "a.exr");
  EXPECT_TRUE(back.same_shape(image));
  EXPECT_EQ(back.values, image.values);
}

TEST(Exr, HalfRoundTripKeepsElevenBits) {
  const test::TemporaryFolder folder;
  Rng rng(2);
  const Image image = test::random_image(rng, 37, 19, 3, 0.001, 1000.0);
  write_exr(folder / "a.exr", image, Precision::half);
  const Image back = read_image(folder / "a.exr");
  for (std::size_t i = 0; i < image.values.size(); ++i)
    ASSERT_NEAR(back.values[i], image.values[i], half_rounding * image.values[i]);
}

TEST(Exr, GreyIsRepeatedInAllChannels) {
  const test::TemporaryFolder folder;
  Image grey(2, 1, 1);
  grey.values = {0.25f, 4.0f};
  write_exr(folder / "grey.exr", grey);
  EXPECT_EQ(read_image(folder / "grey.exr").values,
            (std::vector<float>{0.25f, 0.25f, 0.25f, 4.0f, 4.0f, 4.0f}));
}

TEST(Exr, HoldsNoDate) {
  const test::TemporaryFolder folder;
  Rng rng(3);
  write_exr(folder / "a.exr", test::random_image(rng, 16, 16, 3));
  const std::string bytes = read_text(folder / "a.exr");
  EXPECT_EQ(bytes.find("capDate"), std::string::npos);
  // OpenImageIO writes "2026:11:27 11:05:15".
  EXPECT_FALSE(std::regex_search(bytes, std::regex("[0-9]{4}:[0-9]{2}:[0-9]{2} ")));
}

TEST(Photographs, NoiseRoundTripsWithItsInfinities) {
  const test::TemporaryFolder folder;
  Rng rng(4);
  Photograph photograph{test::random_image(rng, 9, 5, 3), test::random_image(rng, 9, 5, 3)};
  photograph.sigma.at(3, 2, 1) = infinity;
  for (const Precision precision : {Precision::single, Precision::half}) {
    write_photograph(folder / "a.exr", photograph, precision);
    EXPECT_TRUE(read_image_header(folder / "a.exr").has_sigma);
    const Photograph back = read_photograph(folder / "a.exr");
    ASSERT_TRUE(back.sigma.same_shape(photograph.sigma));
    EXPECT_EQ(back.sigma.at(3, 2, 1), infinity);
    if (precision == Precision::single) {
      EXPECT_EQ(back.radiance.values, photograph.radiance.values);
      EXPECT_EQ(back.sigma.values, photograph.sigma.values);
    }
  }
}

TEST(Photographs, RowsAreTheRowsOfTheWhole) {
  const test::TemporaryFolder folder;
  Rng rng(5);
  const Photograph whole{test::random_image(rng, 11, 40, 3), test::random_image(rng, 11, 40, 3)};
  write_photograph(folder / "a.exr", whole);
  const Photograph band = read_photograph_rows(folder / "a.exr", 13, 29);  // across ZIP's blocks of 16 rows
  ASSERT_EQ(band.radiance.height, 16);
  for (int y = 0; y < 16; ++y) {
    EXPECT_TRUE(std::ranges::equal(band.radiance.row(y), whole.radiance.row(y + 13)));
    EXPECT_TRUE(std::ranges::equal(band.sigma.row(y), whole.sigma.row(y + 13)));
  }
  EXPECT_THROW(read_photograph_rows(folder / "a.exr", 30, 41), InputError);
  EXPECT_THROW(read_photograph_rows(folder / "a.exr", 5, 5), InputError);
}

TEST(Photographs, MustBeSceneLinear) {
  const test::TemporaryFolder folder;
  write_png(folder / "a.png", Image(4, 4, 3, 0.5f));
  EXPECT_THAT(test::message_of<FormatError>([&] { read_photograph(folder / "a.png"); }),
              HasSubstr("scene-linear"));
}

TEST(ForeignExr, TiledFilesAreRead) {
  const test::TemporaryFolder folder;
  Rng rng(6);
  const Image image = test::random_image(rng, 70, 50, 3);
  OIIO::ImageSpec spec(70, 50, 3, OIIO::TypeDesc::FLOAT);
  spec.tile_width = spec.tile_height = 32;
  write_with_openimageio(folder / "tiled.exr", spec, image.values);
  EXPECT_EQ(read_image(folder / "tiled.exr").values, image.values);
  const Photograph band = read_photograph_rows(folder / "tiled.exr", 20, 45);
  for (int y = 20; y < 45; ++y) EXPECT_TRUE(std::ranges::equal(band.radiance.row(y - 20), image.row(y)));
  EXPECT_EQ(read_image_header(folder / "tiled.exr").block_rows, 32);
}

/// Bytes that this process has asked the system for.
std::uint64_t bytes_read_so_far() {
  std::ifstream status("/proc/self/io");
  std::uint64_t bytes = 0;
  for (std::string word; status >> word;)
    if (word == "rchar:") status >> bytes;
  return bytes;
}

// A cluster's shards read all photographs together: what one reads beyond its rows, all 64 read.
TEST(Photographs, NoMoreIsReadThanTheBlocksOfTheRows) {
#ifdef __SANITIZE_THREAD__
  GTEST_SKIP() << "the thread sanitizer reads the program's symbols meanwhile";
#endif
  constexpr int width = 600, height = 512;
  constexpr double max_ratio = 1.2;
  struct Layout {
    const char* compression;
    int tile, block_rows;
  };
  const test::TemporaryFolder folder;
  Rng rng(8);
  const Image image = test::random_image(rng, width, height, 3);
  for (const Layout& layout : {Layout{"none", 0, 1}, Layout{"zips", 0, 1}, Layout{"zip", 0, 16},
                               Layout{"piz", 0, 32}, Layout{"zip", 64, 64}, Layout{"none", 32, 32}}) {
    SCOPED_TRACE(std::string(layout.compression) + ", tiles of " + std::to_string(layout.tile));
    OIIO::ImageSpec spec(width, height, 3, OIIO::TypeDesc::FLOAT);
    spec.tile_width = spec.tile_height = layout.tile;
    spec.attribute("compression", layout.compression);
    write_with_openimageio(folder / "a.exr", spec, image.values);
    EXPECT_EQ(read_image_header(folder / "a.exr").block_rows, layout.block_rows);
    read_photograph_rows(folder / "a.exr", 0, 1);  // loads what the first image of a process does
    constexpr int first = 128, last = 256;         // blocks of all layouts begin there
    const std::uint64_t before = bytes_read_so_far();
    const Photograph band = read_photograph_rows(folder / "a.exr", first, last);
    const auto read = static_cast<double>(bytes_read_so_far() - before);
    const double needed = static_cast<double>(fs::file_size(folder / "a.exr")) * (last - first) / height;
    EXPECT_LE(read, max_ratio * needed);
    EXPECT_GE(read, 0.9 * needed) << "the system does not count what is read";
    std::printf("%s, tiles of %d: %.3f\n", layout.compression, layout.tile, read / needed);
    EXPECT_TRUE(
        std::ranges::equal(band.radiance.values,
                           std::span(image.values).subspan(3 * width * first, 3 * width * (last - first))));
  }
}

TEST(ForeignExr, AlphaIsIgnoredAndChannelOrderDoesNotMatter) {
  const test::TemporaryFolder folder;
  OIIO::ImageSpec spec(1, 1, 4, OIIO::TypeDesc::FLOAT);
  spec.channelnames = {"B", "G", "R", "A"};
  write_with_openimageio(folder / "a.exr", spec, {3.0f, 2.0f, 1.0f, 0.5f});
  EXPECT_EQ(read_image(folder / "a.exr").values, (std::vector<float>{1.0f, 2.0f, 3.0f}));
}

TEST(ForeignExr, ANamedLayerIsTaken) {
  const test::TemporaryFolder folder;
  OIIO::ImageSpec spec(1, 1, 3, OIIO::TypeDesc::FLOAT);
  spec.channelnames = {"Combined.R", "Combined.G", "Combined.B"};
  write_with_openimageio(folder / "a.exr", spec, {1.0f, 2.0f, 3.0f});
  EXPECT_EQ(read_image(folder / "a.exr").values, (std::vector<float>{1.0f, 2.0f, 3.0f}));
}

/// An EXR whose data window of 4×3 pixels begins at (x, y) of a display window, which begins at (1, 2)
/// itself.
void write_window(const fs::path& path, int x, int y, int display_width, int display_height, int tile = 0,
                  std::vector<std::string> channels = {"R", "G", "B"}) {
  OIIO::ImageSpec spec(4, 3, static_cast<int>(channels.size()), OIIO::TypeDesc::FLOAT);
  spec.channelnames = channels;
  spec.full_x = 1;
  spec.full_y = 2;
  spec.x = 1 + x;
  spec.y = 2 + y;
  spec.full_width = display_width;
  spec.full_height = display_height;
  spec.tile_width = spec.tile_height = tile;
  std::vector<float> values(4 * 3 * channels.size());
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<float>(1 + i);
  write_with_openimageio(path, spec, values);
}

/// What write_window() stored at a pixel of the display window, 0 where it stored none.
float stored_at(int column, int row, int x, int y, int channel) {
  const int u = column - x, v = row - y;
  return u < 0 || v < 0 || u >= 4 || v >= 3 ? 0.0f : static_cast<float>(1 + (v * 4 + u) * 3 + channel);
}

TEST(ForeignExr, PixelsArePlacedInTheDisplayWindow) {
  const test::TemporaryFolder folder;
  struct Case {
    int x, y, width, height, tile;
  };
  for (const auto& [x, y, width, height, tile] :
       {Case{2, 1, 8, 6, 0}, Case{2, 1, 8, 6, 16}, Case{0, 0, 4, 3, 0}, Case{-1, -1, 2, 2, 0},
        Case{-2, 1, 5, 3, 0}, Case{3, -2, 5, 9, 0}, Case{0, 2, 4, 9, 0}}) {
    SCOPED_TRACE(std::to_string(x) + "," + std::to_string(y));
    write_window(folder / "a.exr", x, y, width, height, tile);
    const Image image = read_image(folder / "a.exr");
    const ImageHeader header = read_image_header(folder / "a.exr");
    ASSERT_EQ(std::pair(image.width, image.height), std::pair(width, height));
    EXPECT_EQ(std::pair(header.width, header.height), std::pair(width, height));
    for (int row = 0; row < height; ++row) {
      const Photograph band = read_photograph_rows(folder / "a.exr", row, row + 1);
      for (int column = 0; column < width; ++column)
        for (int c = 0; c < 3; ++c) {
          EXPECT_EQ(image.at(column, row, c), stored_at(column, row, x, y, c)) << column << "," << row;
          EXPECT_EQ(band.radiance.at(column, 0, c), image.at(column, row, c)) << column << "," << row;
        }
    }
  }
}

TEST(ForeignExr, NothingIsMeasuredOutsideOfTheDataWindow) {
  const test::TemporaryFolder folder;
  write_window(folder / "a.exr", 1, 0, 6, 3, 0, {"R", "G", "B", "sigma.R", "sigma.G", "sigma.B"});
  const Photograph photograph = read_photograph(folder / "a.exr");
  EXPECT_EQ(photograph.radiance.at(0, 0, 0), 0.0f);
  EXPECT_EQ(photograph.sigma.at(0, 0, 0), infinity);
  EXPECT_EQ(photograph.sigma.at(1, 0, 0), 4.0f);
  EXPECT_EQ(photograph.sigma.at(5, 2, 2), infinity);
}

TEST(ForeignExr, WindowsThatMakeNoSenseAreRefused) {
  const test::TemporaryFolder folder;
  const auto refusal = [&](int x, int y, int width, int height) {
    write_window(folder / "a.exr", x, y, width, height);
    return test::message_of<FormatError>([&] { read_image(folder / "a.exr"); });
  };
  EXPECT_THAT(refusal(9, 0, 8, 6), HasSubstr("display window of 8×6"));
  EXPECT_THAT(refusal(0, -3, 8, 6), HasSubstr("display window of 8×6"));
  EXPECT_THAT(refusal(0, 0, 60000, 60000), HasSubstr("crop"));  // 43 GB for 12 pixels
}

TEST(ForeignExr, ChannelsThatAreNoImageAreNamed) {
  const test::TemporaryFolder folder;
  const auto refusal = [&](std::vector<std::string> channels) {
    OIIO::ImageSpec spec(1, 1, static_cast<int>(channels.size()), OIIO::TypeDesc::FLOAT);
    spec.channelnames = channels;
    write_with_openimageio(folder / "a.exr", spec, std::vector<float>(channels.size(), 0.5f));
    return test::message_of<FormatError>([&] { read_image(folder / "a.exr"); });
  };
  EXPECT_THAT(refusal({"Z"}), HasSubstr("its channels are Z"));
  EXPECT_THAT(refusal({"A", "Z"}), HasSubstr("A, Z"));
  EXPECT_THAT(refusal({"R", "G"}), HasSubstr("R, G"));
  EXPECT_THAT(refusal({"diffuse.B", "diffuse.G", "diffuse.R", "glossy.B", "glossy.G", "glossy.R"}),
              testing::AllOf(HasSubstr("'diffuse', 'glossy'"), HasSubstr("a.exr")));
  for (const auto& clear : {std::vector<std::string>{"Y"},
                            {"Y", "A"},
                            {"B", "G", "R", "Z", "mist.Y"},
                            {"B", "G", "R", "glossy.B", "glossy.G", "glossy.R"},
                            {"grey.Y"}})
    EXPECT_EQ(refusal(clear), "(nothing was thrown)") << clear[0];
}

TEST(ForeignExr, OfSeveralPartsTheOneWithColourIsRead) {
  const test::TemporaryFolder folder;
  const auto write_parts = [&](const std::vector<std::vector<std::string>>& parts) {
    std::vector<OIIO::ImageSpec> specs;
    for (const auto& channels : parts) {
      OIIO::ImageSpec& spec =
          specs.emplace_back(1, 1, static_cast<int>(channels.size()), OIIO::TypeDesc::FLOAT);
      spec.channelnames = channels;
      spec.attribute("oiio:subimagename", "part" + std::to_string(specs.size()));
    }
    auto output = OIIO::ImageOutput::create("exr");
    const std::string path = folder / "a.exr";
    ASSERT_TRUE(output->open(path, static_cast<int>(specs.size()), specs.data()));
    for (std::size_t i = 0; i < specs.size(); ++i) {
      const std::vector<float> values(specs[i].nchannels, static_cast<float>(i));
      if (i > 0) {
        ASSERT_TRUE(output->open(path, specs[i], OIIO::ImageOutput::AppendSubimage));
      }
      ASSERT_TRUE(output->write_image(OIIO::TypeDesc::FLOAT, values.data())) << output->geterror();
    }
    ASSERT_TRUE(output->close());
  };
  write_parts({{"Z"}, {"R", "G", "B"}});
  EXPECT_EQ(read_image(folder / "a.exr").at(0, 0, 0), 1.0f);
  write_parts({{"R", "G", "B"}, {"R", "G", "B"}});
  EXPECT_THAT(test::message_of<FormatError>([&] { read_image(folder / "a.exr"); }),
              testing::AllOf(HasSubstr("'part1' (B, G, R)"), HasSubstr("'part2'")));
}

TEST(Png, IsDecodedFromSrgb) {
  const test::TemporaryFolder folder;
  write_png(folder / "a.png", Image(3, 2, 3, 0.2140411f));  // sRGB 0.5 by IEC 61966-2-1
  const float value = read_image(folder / "a.png").values[0];
  constexpr double eight_bits = 0.5 / 255.0 * 1.0;  // half a step, slope below one there
  EXPECT_NEAR(value, 0.2140411f, eight_bits);
}

TEST(Srgb, KnownValuesAndRoundTrip) {
  EXPECT_NEAR(srgb_from_linear(0.18f), 0.4613561f, 1e-5);
  EXPECT_NEAR(linear_from_srgb(0.02f), 0.02f / 12.92f, 1e-7);
  for (float v = 0.0f; v <= 1.0f; v += 0.01f) EXPECT_NEAR(linear_from_srgb(srgb_from_linear(v)), v, 1e-5);
}

TEST(ToneMapped, ScalesAndClips) {
  Image image(4, 1, 1);
  image.values = {-1.0f, 0.5f, 2.0f, std::numeric_limits<float>::quiet_NaN()};
  const auto bytes = tone_mapped(image, {2.0});
  EXPECT_EQ(bytes[0], 0);
  EXPECT_EQ(bytes[1], 255);
  EXPECT_EQ(bytes[2], 255);
  EXPECT_EQ(bytes[3], 0) << "not a number shows as black";
}

// OpenImageIO alone multiplies the encoded values by alpha, which takes half-transparent pixels to a fifth.
TEST(ReadImage, AlphaMultipliesLinearLight) {
  const test::TemporaryFolder folder;
  const auto path = folder / "map.png";
  auto output = OIIO::ImageOutput::create("png");
  OIIO::ImageSpec spec(2, 1, 4, OIIO::TypeDesc::UINT8);
  spec.attribute("oiio:UnassociatedAlpha", 1);
  const std::vector<std::uint8_t> levels = {188, 128, 64, 128, 188, 128, 64, 255};
  ASSERT_TRUE(output && output->open(path.string(), spec) &&
              output->write_image(OIIO::TypeDesc::UINT8, levels.data()) && output->close());
  const Image image = read_image(path);
  for (int c = 0; c < 3; ++c) {
    const float opaque = linear_from_srgb(static_cast<float>(levels[c]) / 255.0f);
    EXPECT_NEAR(image.at(0, 0, c), opaque * 128.0f / 255.0f, 1e-6f);
    EXPECT_NEAR(image.at(1, 0, c), opaque, 1e-6f);
  }
}

TEST(LightMaps, NaNAndInfinityAreNamed) {
  const test::TemporaryFolder folder;
  Image image(4, 3, 3, 1.0f);
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), infinity, -infinity}) {
    image.at(1, 2, 1) = bad;
    write_exr(folder / "light.exr", image);
    EXPECT_THAT(test::message_of<InputError>(
                    [&] { read_light_map(folder / "light.exr", Parameterisation::monitor); }),
                testing::AllOf(HasSubstr("light.exr"), HasSubstr("(1, 2)")));
  }
}

// Around a sun, lossy compression leaves texels far below zero; setting them to zero alone would add light.
TEST(LightMaps, NegativesOfCompressionBecomeZeroAndTheMeanStays) {
  const test::TemporaryFolder folder;
  for (const LightDomain& domain :
       {LightDomain{64, 32, Parameterisation::lat_long}, LightDomain{12, 72, Parameterisation::cube},
        LightDomain{37, 21, Parameterisation::monitor}}) {
    Rng rng(11);
    Image image = test::random_image(rng, domain.width, domain.height, 3, 0.5, 1.0);
    image.at(20 % domain.width, 10, 0) = 2000.0f;
    image.at(21 % domain.width, 10, 0) = -300.0f;  // in the sun's block
    image.at(2, 20, 1) = -80.0f;                   // more than the light of its block
    image.at(5, 20, 2) = -1e-6f;
    write_exr(folder / "light.exr", image);
    std::string said;
    const LightMap light = read_light_map(folder / "light.exr", domain.parameterisation,
                                          {.on_note = [&](const std::string& note) { said += note; }});
    if (domain.parameterisation == Parameterisation::lat_long) {
      EXPECT_THAT(said, testing::AllOf(HasSubstr("light.exr"), HasSubstr("-300"), HasSubstr("mean")));
    }
    EXPECT_EQ(light.domain(), domain);
    EXPECT_EQ(light.radiance.at(21 % domain.width, 10, 0), 0.0f);
    for (int c = 0; c < 3; ++c) {
      double before = 0.0, after = 0.0;
      for (int y = 0; y < domain.height; ++y)
        for (int x = 0; x < domain.width; ++x) {
          double weight = 1.0;
          if (domain.parameterisation == Parameterisation::lat_long)
            weight = std::cos(std::numbers::pi * y / domain.height) -
                     std::cos(std::numbers::pi * (y + 1) / domain.height);
          if (domain.parameterisation == Parameterisation::cube)
            weight = cube_solid_angle(x, y, domain.width);
          EXPECT_GE(light.radiance.at(x, y, c), 0.0f);
          before += weight * image.at(x, y, c);
          after += weight * light.radiance.at(x, y, c);
        }
      constexpr double float_rounding = 1e-6;
      EXPECT_NEAR(after, before, float_rounding * before) << name_of(domain.parameterisation) << " " << c;
    }
    // What lies far away from them is not touched.
    EXPECT_EQ(light.radiance.at(domain.width - 1, domain.height - 1, 0),
              image.at(domain.width - 1, domain.height - 1, 0));
  }
}

TEST(LightMaps, ManyNegativesAreRefused) {
  const test::TemporaryFolder folder;
  Rng rng(12);
  Image image = test::random_image(rng, 24, 16, 3);
  for (std::size_t p = 0; p < image.pixel_count(); p += 3) image.values[3 * p] = -3.0f;
  image.at(5, 2, 1) = -3.5f;
  write_exr(folder / "light.exr", image);
  EXPECT_THAT(
      test::message_of<InputError>([&] { read_light_map(folder / "light.exr", Parameterisation::monitor); }),
      testing::AllOf(HasSubstr("light.exr"), HasSubstr("(5, 2) is -3.5"), HasSubstr("33.6 %")));
}

// Whatever is cut off, reading must end in an error that names the file, never in a crash or a black image.
TEST(DamagedExr, TruncatedAtAnyLength) {
  const test::TemporaryFolder folder;
  Rng rng(7);
  write_exr(folder / "whole.exr", test::random_image(rng, 24, 40, 3));
  const std::string bytes = read_text(folder / "whole.exr");
  for (std::size_t length = 0; length < bytes.size(); length += 1 + bytes.size() / 150) {
    std::ofstream(folder / "cut.exr", std::ios::binary) << bytes.substr(0, length);
    EXPECT_THAT(test::message_of<FormatError>([&] { read_image(folder / "cut.exr"); }), HasSubstr("cut.exr"))
        << "cut to " << length << " of " << bytes.size() << " bytes";
  }
}

TEST(DamagedExr, FlippedBytesNeverCrash) {
  const test::TemporaryFolder folder;
  Rng rng(8);
  write_exr(folder / "whole.exr", test::random_image(rng, 24, 40, 3));
  const std::string bytes = read_text(folder / "whole.exr");
  for (int round = 0; round < 200; ++round) {
    std::string damaged = bytes;
    // Headers are the first few hundred bytes; damage them more often than their size deserves.
    const std::size_t reach = round % 2 ? 400 : damaged.size();
    for (int flips = 0; flips < 3; ++flips) damaged[rng.below(reach)] = static_cast<char>(rng.below(256));
    std::ofstream(folder / "damaged.exr", std::ios::binary) << damaged;
    try {
      read_image(folder / "damaged.exr");
    } catch (const Error&) {
      continue;
    }
  }
}

TEST(DamagedExr, OtherKindsOfFileAreRefused) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "text.exr") << "this is no image";
  EXPECT_THAT(test::message_of<FormatError>([&] { read_image_header(folder / "text.exr"); }),
              HasSubstr("text.exr"));
  EXPECT_THAT(test::message_of<DeviceError>([&] { read_image_header(folder / "none.exr"); }),
              HasSubstr("none.exr"));
  EXPECT_THROW(read_image(folder.path()), FormatError);
}

TEST(WriteExr, KeepsTheOldImageOnAFullDisk) {
  const test::SmallDisk disk(512);
  if (!disk.mounted()) GTEST_SKIP() << test::needs_mounting;
  Rng rng(9);
  write_exr(disk / "a.exr", Image(8, 8, 3, 1.0f));
  const std::string old = read_text(disk / "a.exr");
  EXPECT_THAT(
      test::message_of<DeviceError>([&] { write_exr(disk / "a.exr", test::random_image(rng, 512, 512, 3)); }),
      testing::AllOf(HasSubstr("a.exr"), HasSubstr("free some space")));
  EXPECT_EQ(read_text(disk / "a.exr"), old);
  EXPECT_EQ(disk.files(), 1) << "a temporary file was left behind";
}

}  // namespace
}  // namespace refield
