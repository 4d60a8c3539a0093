// SPDX-License-Identifier: Apache-2.0
// Light sources of domes and light stages: their lists, light maps and import.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <set>

#include "acquire/capture/scene_mask.h"
#include "acquire/hdr/bracket_files.h"
#include "acquire/import/import_series.h"
#include "core/base/files.h"
#include "core/base/rng.h"
#include "core/base/units.h"
#include "core/session/capture_session.h"
#include "tests/support/message_of.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using test::message_of;
using test::TemporaryFolder;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;

class LightList : public ::testing::Test {
 protected:
  fs::path write(const std::string& name, const std::string& text) const {
    write_text_atomically(folder_ / name, text);
    return folder_ / name;
  }
  std::string refusal(const std::string& text) const {
    const fs::path file = write("list", text);
    return message_of([&] { read_light_stage(file); });
  }
  const TemporaryFolder folder_;
};

TEST_F(LightList, NamesAndAxesOfAnRtiList) {
  const LightStage stage =
      read_light_stage(write("dome.lp",
                             "\xEF\xBB\xBF"
                             "4\r\nC:\\dome\\right 1.jpg\t1 0 0\r\nup.jpg 0 +1 0\r\n"
                             "\r\ncamera.jpg 0 0 1.0e0\r\nshots/behind.jpg 0.6 0 -0.8\r\n"));
  ASSERT_EQ(stage.sources.size(), 4U);
  EXPECT_EQ(stage.sources[0].photograph, "right 1.jpg");
  EXPECT_EQ(stage.sources[3].photograph, "behind.jpg");
  EXPECT_EQ(stage.sources[3].line, 6);
  // Towards the camera is against the viewing direction, which is +Z of a lat-long map.
  EXPECT_TRUE(stage.sources[2].direction.isApprox(Eigen::Vector3d(0, 0, -1)));
  EXPECT_TRUE(stage.sources[3].direction.isApprox(Eigen::Vector3d(0.6, 0, 0.8)));
  EXPECT_EQ(stage.domain, (LightDomain{256, 128, Parameterisation::lat_long}));
  EXPECT_EQ(stage.sources[0].column, 192);  // +X, a quarter right of the centre column
  EXPECT_EQ(stage.sources[1].row, 0);
  EXPECT_EQ(stage.sources[2].column, 0);  // −Z, the left edge
  EXPECT_EQ(stage.sources[2].row, 64);
}

TEST_F(LightList, DirectionsWithNamesAndIntensities) {
  write("Filenames.txt", "001.png\n002.png\n");  // in any letters
  write("light_intensities.TXT", "1.5 2 2.5\n3\n");
  const LightStage stage = read_light_stage(write("light_directions.txt", "0 0.6 0.8\n-0.6 0 0.8\n"));
  ASSERT_EQ(stage.sources.size(), 2U);
  EXPECT_EQ(stage.sources[1].photograph, "002.png");
  const Image map = light_map_of(stage, 0);
  EXPECT_EQ(std::ranges::count_if(map.values, [](float value) { return value != 0.0f; }), 3)
      << "the channels of one texel";
  // The texel's irradiance on a surface that faces the source; its solid angle is (2π/256) · (π/128) · sin θ.
  const double solid_angle = 2.0 * M_PI / 256.0 * M_PI / 128.0 * 0.8;  // of the direction (0, 0.6, 0.8)
  EXPECT_NEAR(solid_angle * map.at(stage.sources[0].column, stage.sources[0].row, 2), 2.5, 0.03);
  EXPECT_EQ(stage.sources[1].intensity, (std::array<float, 3>{3.0f, 3.0f, 3.0f}));
  fs::remove(folder_ / "light_intensities.TXT");
  write("light_intensities.txt", "1.5 2 2.5\n0 1 1\n");
  EXPECT_THAT(message_of([&] { read_light_stage(folder_ / "light_directions.txt"); }),
              HasSubstr("light_intensities.txt:2: the intensity 0 is not positive"));
  write("light_intensities.txt", "1\n1\n");
  EXPECT_EQ(read_light_stage(write("lights.txt", "2\n0 0.6 0.8\n-0.6 0 0.8\n")).sources[1].photograph,
            "002.png");
  EXPECT_THAT(message_of([&] { read_light_stage(write("lights.txt", "3\n0 0.6 0.8\n-0.6 0 0.8\n")); }),
              HasSubstr("lights.txt:1: states 3 light sources, but the file lists 2"));
  write("filenames.txt", "001.png\n");
  EXPECT_THAT(message_of([&] { read_light_stage(folder_ / "light_directions.txt"); }),
              AllOf(HasSubstr("filenames.txt: has 1 lines"), HasSubstr("has 2 directions")));
}

TEST_F(LightList, TheMapIsLargeEnoughForOneTexelPerSource) {
  // A spiral of 240 sources over the half towards the camera, as on a dome; then one with a close neighbour.
  std::string text = "240\n";
  for (int i = 0; i < 240; ++i) {
    const double z = (i + 0.5) / 240.0, r = std::sqrt(1.0 - z * z), angle = 2.399963 * i;
    text += "p" + std::to_string(i) + ".png " + std::to_string(r * std::cos(angle)) + " " +
            std::to_string(r * std::sin(angle)) + " " + std::to_string(z) + "\n";
  }
  for (const auto& [list, lowest] :
       {std::pair<std::string, int>(text, 128), {"2\na 0.001 0.001 1\nb 0.01 0.01 1\n", 256}}) {
    const LightStage stage = read_light_stage(write("dome.lp", list));
    EXPECT_GE(stage.domain.height, lowest);
    EXPECT_EQ(stage.domain.width, 2 * stage.domain.height);
    std::set<std::pair<int, int>> texels;
    for (const LightSource& source : stage.sources) {
      texels.emplace(source.column, source.row);
      // The direction lies in the texel: at most half a diagonal from its centre.
      const Eigen::Vector3d centre =
          lat_long_direction(source.column + 0.5, source.row + 0.5, stage.domain.width, stage.domain.height);
      EXPECT_LT(std::acos(std::min(1.0, centre.dot(source.direction))), 0.71 * M_PI / stage.domain.height);
    }
    EXPECT_EQ(texels.size(), stage.sources.size());
  }
}

TEST_F(LightList, NotesWhatItCorrects) {
  const LightStage stage = read_light_stage(write("dome.lp", "3\na 0 0 2\nb 0.6 0 -0.8\nc 300 0 400\n"));
  EXPECT_THAT(stage.notes, Contains(AllOf(HasSubstr("light directions that were normalised: 2"),
                                          HasSubstr("dome.lp:2, length 2"))));
  EXPECT_THAT(stage.notes, Contains(AllOf(HasSubstr("light sources behind the object, z < 0: 1"),
                                          HasSubstr("dome.lp:3, z = -0.8"))));
  EXPECT_TRUE(stage.sources[2].direction.isApprox(Eigen::Vector3d(0.6, 0, -0.8)));
  EXPECT_THAT(read_light_stage(write("light_directions.txt", "0 0 1\n")).notes,
              AllOf(Contains(HasSubstr("filenames.txt does not exist")),
                    Contains(HasSubstr("light_intensities.txt does not exist")),
                    Not(Contains(HasSubstr("normalised"))), Not(Contains(HasSubstr("behind the object")))));
}

TEST_F(LightList, TableWithNamedColumns) {
  const LightStage stage =
      read_light_stage(write("dome.csv",
                             "\xEF\xBB\xBFz;\"file\";x;rack;y;b;g;r\r\n"
                             "1;\"/dome/a;1.png\";0;A1;0;3;2;1\r\n0.8; b.png ;-0.6;A2;0;1;1;1\r\n"));
  ASSERT_EQ(stage.sources.size(), 2U);
  EXPECT_EQ(stage.sources[0].photograph, "a;1.png");
  EXPECT_EQ(stage.sources[0].intensity, (std::array<float, 3>{1.0f, 2.0f, 3.0f}));
  EXPECT_EQ(stage.sources[1].photograph, "b.png");
  EXPECT_TRUE(stage.sources[1].direction.isApprox(Eigen::Vector3d(-0.6, 0, -0.8)));
  EXPECT_EQ(read_light_stage(write("tabs.csv", "file\tx\ty\tz\na b.png\t0\t0\t1\n")).sources[0].photograph,
            "a b.png");
}

TEST_F(LightList, NearSourcesFallWithTheSquareOfTheDistance) {
  // Millimetres; the object is 100 above the origin of the list.
  const fs::path list = write("dome.csv",
                              "file,x,y,z,r,g,b\na,0,0,300,1,1,1\nb,300,0,500,2,1,1\n"
                              "c,0,-300,100,1,1,1\n");
  const LightStage stage = read_light_stage(list, Eigen::Vector3d(0.0, 0.0, 100.0));
  const std::array<double, 3> distances = {200.0, 500.0, 300.0};
  constexpr double mean = 1000.0 / 3.0;
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_NEAR(stage.sources[i].intensity[1], std::pow(mean / distances[i], 2), 1e-6);
  EXPECT_NEAR(stage.sources[1].intensity[0], 2.0 * std::pow(mean / 500.0, 2), 1e-6);
  EXPECT_TRUE(stage.sources[1].direction.isApprox(Eigen::Vector3d(0.6, 0.0, -0.8)));
  EXPECT_TRUE(stage.sources[2].direction.isApprox(Eigen::Vector3d(0.0, -1.0, 0.0)));
  EXPECT_THAT(stage.notes, AllOf(Contains(HasSubstr("mean distance of 333.3 from the object")),
                                 Not(Contains(HasSubstr("normalised")))));
  EXPECT_THAT(message_of([&] { read_light_stage(list, Eigen::Vector3d(300.0, 0.0, 500.0)); }),
              HasSubstr("dome.csv:3: the light source 300 0 500 is at the position of the object"));
  EXPECT_THAT(read_light_stage(list).notes, Contains(HasSubstr("--object-at")));
  EXPECT_THAT(read_light_stage(write("dome.csv", "file,x,y,z,intensity\na,0,0,1,2\n")).notes,
              Contains(HasSubstr("that are ignored: 'intensity'; intensities are the columns r, g and b")));
}

TEST_F(LightList, WarnsOfMoreSourcesThanHaveAWeight) {
  const auto notes_of = [&](int count) {
    std::string text = std::to_string(count) + "\n";
    for (int i = 0; i < count; ++i) {
      const double z = (i + 0.5) / count, r = std::sqrt(1.0 - z * z), angle = 2.399963 * i;
      text += "p" + std::to_string(i) + ".png " + std::to_string(r * std::cos(angle)) + " " +
              std::to_string(r * std::sin(angle)) + " " + std::to_string(z) + "\n";
    }
    return read_light_stage(write("dome.lp", text)).notes;
  };
  EXPECT_THAT(notes_of(max_single_light_cells), Not(Contains(HasSubstr("a weight of its own"))));
  EXPECT_THAT(notes_of(max_single_light_cells + 1), Contains(HasSubstr("a weight of its own")));
}

TEST_F(LightList, NamesFileLineValueAndRemedy) {
  EXPECT_THAT(refusal("3\na 0 0 1\nb 1 0 0\n"),
              AllOf(HasSubstr("list:1: states 3 light sources, but the file lists 2"), HasSubstr("correct")));
  EXPECT_THAT(refusal("-1\n"), HasSubstr("list:1: states -1"));
  EXPECT_THAT(refusal("0\n"), HasSubstr("list:1: states 0"));
  EXPECT_THAT(refusal(" \n"), HasSubstr("is empty"));
  EXPECT_THAT(refusal("a.png,0,0,1\n"), HasSubstr("list:1: 'a.png,0,0,1' is neither the number"));
  EXPECT_THAT(refusal("photograph,x,y,z\n"), HasSubstr("list:1: 'photograph,x,y,z' has no column 'file'"));
  EXPECT_THAT(refusal("file,x,y,z,r,b\na,0,0,1,1,1\n"), HasSubstr("list:1: 'file,x,y,z,r,b' has only some"));
  EXPECT_THAT(refusal("file,x,y,z\n"), HasSubstr("list:1: no light source follows"));
  EXPECT_THAT(refusal("file,x,y,z\na,0,0\n"), HasSubstr("list:2: 'a,0,0' has 3 fields"));
  EXPECT_THAT(refusal("file,x,y,z\n,0,0,1\n"), HasSubstr("list:2: names no file"));
  EXPECT_THAT(refusal("file;x;y;z\na;0;0,5;1\n"), HasSubstr("list:2: '0,5' is not a finite number"));
  EXPECT_THAT(refusal("file,x,y,z,r,g,b\na,0,0,1,1,-1,1\n"), HasSubstr("list:2: the intensity -1"));
  EXPECT_THAT(refusal("2\na 0 0 1\nb 0 1\n"), HasSubstr("list:3: 'b 0 1' is not 'name x y z'"));
  EXPECT_THAT(refusal("1\na\rb\v1\f2"), HasSubstr("list:2: "));
  EXPECT_THAT(refusal("2\na 0 0 1\nb 0 nan 1\n"), HasSubstr("list:3: 'nan' is not a finite number"));
  EXPECT_THAT(refusal("2\na 0 0 1\nb 0 1e999 1\n"), HasSubstr("list:3: '1e999' is not a finite number"));
  EXPECT_THAT(refusal("1\na 0 0 0\n"), HasSubstr("list:2: the direction 0 0 0 has no length"));
  EXPECT_THAT(refusal("0 0 1\n0 1\n"), HasSubstr("list:2: '0 1' is not a direction"));
  EXPECT_THAT(refusal("2\na.png 0 0 1\na.png 1 0 0\n"),
              HasSubstr("list:3: 'a.png' also belongs to the light source of line 2"));
  // Duplicates with another length, and in two texels on the two sides of an edge.
  EXPECT_THAT(refusal("2\na 0 0 1\nb 0 0 3\n"),
              HasSubstr("list:3: the light source is 0° from that of line 2"));
  EXPECT_THAT(refusal("2\na 0.0001 0 1\nb -0.0001 0 1\n"),
              HasSubstr("list:3: the light source is 0.0115° from"));
  EXPECT_THAT(refusal("2\na 0.002 0.001 1\nb 0.004 0.001 1\n"), HasSubstr("too close to have a texel"));
  EXPECT_THAT(message_of([&] { read_light_stage(folder_ / "none.lp"); }), HasSubstr("none.lp"));
  EXPECT_THAT(message_of([&] { read_light_stage(folder_.path()); }), HasSubstr(folder_.path().string()));
}

/// Four light sources and their 16-bit photographs of 3×2 pixels; photograph i has the sample 1000·(i + 1) +
/// pixel.
class LightStageImport : public ::testing::Test {
 protected:
  static constexpr int sources = 4, width = 3, height = 2;
  static std::uint16_t sample(int source, std::size_t i) {
    return static_cast<std::uint16_t>(1000 * (source + 1) + static_cast<int>(i));
  }
  void photograph(const std::string& name, int source, int columns = width) const {
    RawFrame frame;
    frame.width = columns;
    frame.height = height;
    for (std::size_t i = 0; i < static_cast<std::size_t>(3 * columns * height); ++i)
      frame.samples.push_back(sample(source, i));
    write_raw_frame(folder_ / "shots" / name, frame);
  }
  void SetUp() override {
    fs::create_directories(folder_ / "shots");
    for (int i = 0; i < sources; ++i) photograph(std::to_string(i) + ".png", i);
    // Not in the order of names, and in another format than the list says.
    write_text_atomically(folder_ / "dome.lp", "4\n3.tif 0 0 1\n2.tif 1 0 0\n1.tif 0 1 0\n0.tif -1 0 0\n");
  }
  ImportRequest request(const std::string& list = "dome.lp") const {
    ImportRequest request;
    request.photographs = expand_globs({(folder_ / "shots").string()});
    request.stage = read_light_stage(folder_ / list);
    request.folder = folder_ / "session";
    return request;
  }
  std::string refusal() const {
    return message_of([&] { import_series(request()); });
  }
  const TemporaryFolder folder_;
};

TEST_F(LightStageImport, MakesASessionOfOneLitTexelPerPhotograph) {
  photograph("mask.png", 0, 7);  // left out, whatever its size
  const ImportSummary summary = import_series(request());
  EXPECT_EQ(summary.photographs, 4U);
  EXPECT_THAT(summary.notes,
              AllOf(Contains(AllOf(HasSubstr("photographs without a light source, which were left out: 1"),
                                   HasSubstr("mask.png"))),
                    Contains(HasSubstr("do not state their exposure times")),
                    Contains(HasSubstr("lat-long maps of 256×128"))));
  const CaptureSession session = read_capture_session(folder_ / "session");
  EXPECT_EQ(session.light, (LightDomain{256, 128, Parameterisation::lat_long}));
  ASSERT_EQ(session.frames.size(), 4U);
  for (int i = 0; i < sources; ++i) {
    const CaptureFrame& frame = session.frames[static_cast<std::size_t>(i)];
    EXPECT_EQ(frame.name, std::to_string(sources - 1 - i));
    const LightMap light = read_illumination(frame, session.light.parameterisation, {});
    EXPECT_EQ(light.radiance.values, light_map_of(request().stage, static_cast<std::size_t>(i)).values);
    const Photograph observed = read_observed(frame);
    for (std::size_t k = 0; k < observed.radiance.values.size(); ++k)
      EXPECT_NEAR(observed.radiance.values[k], sample(sources - 1 - i, k) / 65535.0, 1e-7);
  }
  // The same import continues; another list does not.
  ImportRequest again = request();
  again.if_exists = IfExists::resume;
  EXPECT_EQ(import_series(again).found_done, 4U);
  again.stage.sources[0].intensity[1] = 2.0f;
  EXPECT_THAT(message_of([&] { import_series(again); }), HasSubstr("begun with other"));
}

TEST_F(LightStageImport, DirectionsWithoutNamesFollowTheOrderOfNames) {
  write_text_atomically(folder_ / "light_directions.txt", "0 0 1\n1 0 0\n0 1 0\n-1 0 0\n");
  import_series(request("light_directions.txt"));
  EXPECT_EQ(read_capture_session(folder_ / "session").frames[3].name, "3");
  fs::remove_all(folder_ / "session");
  write_text_atomically(folder_ / "light_directions.txt", "0 0 1\n1 0 0\n");
  EXPECT_THAT(message_of([&] { import_series(request("light_directions.txt")); }),
              AllOf(HasSubstr("4 photographs"), HasSubstr("2 light sources"), HasSubstr("filenames.txt")));
}

TEST_F(LightStageImport, BracketsBelongToTheLightSourceOfAnyOfTheirFiles) {
  // Two exposures per light source: 0 and 1, 2 and 3; the list names the second of the first, the first of
  // the second.
  write_text_atomically(folder_ / "pairs.lp", "2\n1.png 0 0 1\n2.png 1 0 0\n");
  ImportRequest pairs = request("pairs.lp");
  pairs.rule.count = 2;
  pairs.exposures = {Seconds(1.0), Seconds(2.0)};
  import_series(pairs);
  const auto frames = read_capture_session(folder_ / "session").frames;
  ASSERT_EQ(frames.size(), 2U);
  EXPECT_EQ(frames[1].name, "2");
  EXPECT_NEAR(read_observed(frames[0]).radiance.values[0], 1000.0 / 65535.0, 1e-5);
  // Both files of one bracket.
  write_text_atomically(folder_ / "pairs.lp", "2\n0.png 0 0 1\n1.png 1 0 0\n");
  pairs.stage = read_light_stage(folder_ / "pairs.lp");
  pairs.folder = folder_ / "twice";
  EXPECT_THAT(message_of([&] { import_series(pairs); }),
              AllOf(HasSubstr("0.png: belongs to two light sources"), HasSubstr("the second is '1.png'")));
}

TEST_F(LightStageImport, MissingOrUnfitPhotographs) {
  photograph("1.png", 1, 4);
  EXPECT_THAT(refusal(), AllOf(HasSubstr("1.png: is 4×2×3"), HasSubstr("are 3×2")));
  fs::remove(folder_ / "shots/1.png");
  fs::remove_all(folder_ / "session");
  EXPECT_THAT(refusal(), AllOf(HasSubstr("dome.lp:4: the photograph '1.tif' is not among the 3 given"),
                               HasSubstr("take its light source out")));
  ImportRequest both = request();
  both.lights = {folder_ / "light.exr"};
  EXPECT_THAT(message_of([&] { import_series(both); }), HasSubstr("not both"));
}

TEST_F(LightStageImport, WarnsOfEightBitsTakenAsLinear) {
  for (int i = 0; i < sources; ++i)
    write_png(folder_ / "shots" / (std::to_string(i) + ".png"),
              Image(width, height, 3, 0.05f * static_cast<float>(i + 1)));
  ImportRequest linear = request();
  linear.camera.response = "linear";
  EXPECT_THAT(import_series(linear).notes, Contains(HasSubstr("8-bit photographs are treated as linear")));
  // By default they are decoded from sRGB.
  ImportRequest decoded = request();
  decoded.folder = folder_ / "decoded";
  EXPECT_THAT(import_series(decoded).notes, AllOf(Not(Contains(HasSubstr("treated as linear"))),
                                                  Contains(HasSubstr("taken to have the sRGB curve"))));
  const auto frames = read_capture_session(folder_ / "decoded").frames;
  constexpr double rounding = 0.01;  // of 8 bits at these brightnesses, relative
  EXPECT_NEAR(read_observed(frames[0]).radiance.values[0], 0.2, 0.2 * rounding);
}

/// 16 bits, full scale 1.
void write_sixteen_bits(const fs::path& path, const Image& radiance) {
  RawFrame frame;
  frame.width = radiance.width;
  frame.height = radiance.height;
  for (const float value : radiance.values)
    frame.samples.push_back(static_cast<std::uint16_t>(std::lround(65535.0 * std::clamp(value, 0.0f, 1.0f))));
  write_raw_frame(path, frame);
}

/// Four near light sources, through a lens with vignetting; the object's reflection depends on pixel and
/// source.
class FlatFieldImport : public ::testing::Test {
 protected:
  static constexpr int sources = 4, width = 120, height = 90;
  static constexpr double white = 0.9;  // of the card
  const std::array<Eigen::Vector3d, sources> directions_ = {
      {{0.0, 0.0, 1.0}, {0.6, 0.0, 0.8}, {0.0, 0.8, 0.6}, {-0.8, 0.0, 0.6}}};

  /// Of a diffuser that faces the source, with vignetting; red is brightest.
  static double irradiance(int source, int x, int y, int c) {
    const double u = (x + 0.5) / width - 0.5, v = (y + 0.5) / height - 0.5;
    const double distance = 1.0 + 0.3 * source + 0.4 * u - 0.2 * v;
    return 0.5 / (distance * distance) * (1.0 - 0.5 * (u * u + v * v)) * (1.0 - 0.2 * c);
  }
  static double reflection(int source, int x, int y) {
    return 0.1 + 0.8 * ((x / 8 + y / 8 + source) % 2) * (source + 1.0) / sources;
  }
  void photograph(const fs::path& folder, int source, bool card, double exposure = 1.0, int left = 0) const {
    Image image(width, height, 3);
    for (int y = 0; y < height; ++y)
      for (int x = left; x < width; ++x)
        for (int c = 0; c < 3; ++c)
          image.at(x, y, c) = static_cast<float>(
              exposure * irradiance(source, x, y, c) *
              (card ? white * directions_[static_cast<std::size_t>(source)].z() : reflection(source, x, y)));
    write_sixteen_bits(folder_ / folder / (std::to_string(source) + ".png"), image);
  }
  void SetUp() override {
    std::string list = "file,x,y,z,r,g,b\n";
    for (int i = 0; i < sources; ++i) {
      const Eigen::Vector3d& d = directions_[static_cast<std::size_t>(i)];
      list += std::to_string(i) + ".png," + std::to_string(d.x()) + "," + std::to_string(d.y()) + "," +
              std::to_string(d.z()) + ",2,1,1\n";
    }
    write_text_atomically(folder_ / "dome.csv", list);
    for (const char* folder : {"shots", "cards"}) {
      fs::create_directories(folder_ / folder);
      for (int i = 0; i < sources; ++i) photograph(folder, i, folder == std::string("cards"));
    }
  }
  ImportRequest request(const std::string& cards = "cards") const {
    ImportRequest request;
    request.photographs = expand_globs({(folder_ / "shots").string()});
    request.flat_fields = expand_globs({(folder_ / cards).string()});
    request.stage = read_light_stage(folder_ / "dome.csv");
    request.folder = folder_ / "session";
    return request;
  }
  std::string refusal() const {
    fs::remove_all(folder_ / "session");
    return message_of([&] { import_series(request()); });
  }
  const TemporaryFolder folder_;
};

TEST_F(FlatFieldImport, RemovesFallOffIntensityAndVignetting) {
  const ImportSummary summary = import_series(request());
  EXPECT_THAT(summary.notes, Contains(HasSubstr("those of the list are not used")));
  const CaptureSession session = read_capture_session(folder_ / "session");
  for (int i = 0; i < sources; ++i) {
    const CaptureFrame& frame = session.frames[static_cast<std::size_t>(i)];
    const LightMap light = read_illumination(frame, session.light.parameterisation, {});
    double irradiance = 0.0;
    for (int y = 0; y < light.radiance.height; ++y)
      for (int x = 0; x < light.radiance.width; ++x)
        irradiance +=
            light.radiance.at(x, y, 0) * lat_long_solid_angle(y, light.radiance.width, light.radiance.height);
    EXPECT_NEAR(irradiance, 1.0, 1e-6);
    const Image observed = read_observed(frame).radiance;
    double worst = 0.0;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        for (int c = 0; c < 3; ++c)
          worst = std::max(worst, std::abs(observed.at(x, y, c) * white / reflection(i, x, y) - 1.0));
    EXPECT_LT(worst, 0.003);  // rounding to 16 bits; the card is fitted piecewise bilinear
  }
}

TEST_F(FlatFieldImport, CardsOfOtherNamesFollowTheOrder) {
  fs::create_directories(folder_ / "white");
  for (int i = 0; i < sources; ++i)
    fs::copy(folder_ / "cards" / (std::to_string(i) + ".png"),
             folder_ / "white" / ("card" + std::to_string(i) + ".png"));
  EXPECT_THAT(import_series(request("white")).notes, Contains(HasSubstr("assigned in the order of names")));
  fs::remove(folder_ / "white/card2.png");
  fs::remove_all(folder_ / "session");
  EXPECT_THAT(
      message_of([&] { import_series(request("white")); }),
      AllOf(HasSubstr("0.png: none of the 3 photographs of a white card"), HasSubstr("one card for each")));
}

TEST_F(FlatFieldImport, MissingOrUnfitCards) {
  photograph("cards", 2, true, 12.0);
  EXPECT_THAT(refusal(), AllOf(HasSubstr("2.png: the white card is clipped in"), HasSubstr("shorter")));
  photograph("cards", 2, true, 1.0, 40);
  EXPECT_THAT(refusal(), AllOf(HasSubstr("2.png: the white card is dark in 3"), HasSubstr("larger card")));
  // Outside the mask no card is needed, and nothing is measured.
  Mask right(static_cast<std::size_t>(width) * height, 0);
  for (std::size_t p = 0; p < right.size(); ++p) right[p] = p % width >= 45;
  write_mask(folder_ / "mask.png", right, width, height);
  ImportRequest masked = request();
  masked.mask = folder_ / "mask.png";
  masked.if_exists = IfExists::replace;
  import_series(masked);
  const Photograph seen = read_observed(read_capture_session(folder_ / "session").frames[2]);
  EXPECT_TRUE(std::isinf(seen.sigma.at(5, 5, 0)));
  EXPECT_TRUE(std::isfinite(seen.sigma.at(60, 5, 0)));
  photograph("cards", 2, true, 0.0);
  EXPECT_THAT(refusal(), HasSubstr("2.png: the white card is dark in 100.0 %"));
  write_sixteen_bits(folder_ / "cards/2.png", Image(width, 80, 3, 0.5f));
  EXPECT_THAT(refusal(), AllOf(HasSubstr("2.png: is 120×80"), HasSubstr("120×90")));
  fs::remove(folder_ / "cards/2.png");
  EXPECT_THAT(refusal(), AllOf(HasSubstr("2.png: none of the 3"), HasSubstr("is named '2'")));
  // A source behind the card.
  photograph("cards", 2, true);
  ImportRequest behind = request();
  behind.stage.sources[1].direction.z() = 0.1;
  EXPECT_THAT(message_of([&] { import_series(behind); }),
              HasSubstr("1.png: the light source is not in front"));
}

/// Photographs of a mirror ball beside a plain background, by the law of reflection, under light sources of
/// 1.2° at 200 radii of the ball. The camera looks along +z, and the ball is near a corner of the picture.
class ChromeBallImport : public ::testing::Test {
 protected:
  static constexpr int width = 320, height = 240, sources = 12;
  static constexpr double field_of_view = 40.0, distance = 12.0;  // of the ball, in its radii

  static double focal_px() { return 0.5 * width / std::tan(radians_from_degrees(field_of_view) / 2.0); }
  static Eigen::Vector3d ray(double x, double y) {
    return Eigen::Vector3d(x - width / 2.0, height / 2.0 - y, focal_px()).normalized();
  }
  static Eigen::Vector3d ball_centre() { return distance * ray(75.0, 170.0); }
  /// Towards the camera's side, in camera axes.
  static Eigen::Vector3d direction(int source) {
    const double z = 0.25 + 0.72 * (source + 0.5) / sources, r = std::sqrt(1.0 - z * z);
    return {r * std::cos(2.399963 * source), r * std::sin(2.399963 * source), -z};
  }
  double radiance(const Eigen::Vector3d& along, const std::vector<Eigen::Vector3d>& lights) const {
    const Eigen::Vector3d centre = ball_centre();
    const double b = along.dot(centre), root = b * b - centre.squaredNorm() + 1.0;
    if (root < 0.0) return 0.08;  // the background
    const Eigen::Vector3d point = (b - std::sqrt(root)) * along, normal = point - centre;
    const Eigen::Vector3d mirrored = along - 2.0 * along.dot(normal) * normal;
    double sum = 0.01 + 0.005 * mirrored.y();  // the room
    for (const Eigen::Vector3d& light : lights) {
      const Eigen::Vector3d towards = (centre + 200.0 * light - point).normalized();
      if (towards.dot(mirrored) > std::cos(radians_from_degrees(0.6))) sum += source_radiance_;
    }
    return sum;
  }
  void photograph(const std::string& name, const std::vector<Eigen::Vector3d>& lights) const {
    Image image(width, height, 3);
    Rng random(5);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        // The lens blurs like a tent over two pixels.
        double sum = 0.0, total = 0.0;
        const int side = std::abs(x - 75) < 45 && std::abs(y - 170) < 45 ? 12 : 1;
        for (int i = 0; i < side * side; ++i) {
          const double dx = 2.0 * (i % side + 0.5) / side - 1.0, dy = 2.0 * (i / side + 0.5) / side - 1.0;
          const double weight = (1.0 - std::abs(dx)) * (1.0 - std::abs(dy));
          sum += weight * radiance(ray(x + 0.5 + dx, y + 0.5 + dy), lights);
          total += weight;
        }
        for (int c = 0; c < 3; ++c)
          image.at(x, y, c) = static_cast<float>(sum / total + 5e-4 * random.normal());
      }
    write_sixteen_bits(folder_ / "shots" / name, image);
  }
  void SetUp() override { fs::create_directories(folder_ / "shots"); }
  double source_radiance_ = 6.0;  // not clipped: the highlight is smaller than a pixel
  static std::string name(int source) { return std::string(1, static_cast<char>('a' + source)) + ".png"; }
  ImportRequest request(std::optional<ImageCircle> circle, bool with_view = true) const {
    ImportRequest request;
    request.photographs = expand_globs({(folder_ / "shots").string()});
    request.ball = ChromeBall{circle, std::nullopt};
    if (with_view) request.ball->field_of_view_degrees = field_of_view;
    request.folder = folder_ / "session";
    request.if_exists = IfExists::replace;
    return request;
  }
  /// Of the brightest texel of each light map, and the largest angle from the light sources in degrees.
  double worst_angle(const Eigen::Matrix3d& turn) const {
    const CaptureSession session = read_capture_session(folder_ / "session");
    double worst = 0.0;
    for (int i = 0; i < sources; ++i) {
      const Image light =
          read_illumination(session.frames[static_cast<std::size_t>(i)], session.light.parameterisation, {})
              .radiance;
      for (int y = 0; y < light.height; ++y)
        for (int x = 0; x < light.width; ++x)
          if (light.at(x, y, 0) > 0.0f) {
            const double cosine =
                lat_long_direction(x + 0.5, y + 0.5, light.width, light.height).dot(turn * direction(i));
            worst = std::max(worst, degrees_from_radians(std::acos(std::min(1.0, cosine))));
          }
    }
    return worst;
  }
  const TemporaryFolder folder_;
};

TEST_F(ChromeBallImport, HighlightsShowTheDirections) {
  for (int i = 0; i < sources; ++i) photograph(name(i), {direction(i)});
  const ProbeCamera camera{focal_px(), {width / 2.0, height / 2.0}};
  const MirrorBall truth(camera, ball_centre().normalized(), distance);
  ImageCircle circle;  // around the outline, whose middle is not the image of the centre
  for (int i = 0; i < 360; ++i) circle.centre += truth.outline_point(radians_from_degrees(i)) / 360.0;
  for (int i = 0; i < 360; ++i)
    circle.radius += (truth.outline_point(radians_from_degrees(i)) - circle.centre).norm() / 360.0;
  // Of the highlight's direction, not of its texel, which is up to 4° away.
  constexpr double accuracy = 1.5;  // degrees, 0.4 pixels on a ball of 37 pixels radius
  const MirrorBall given = locate_ball({circle, field_of_view}, Image(width, height, 3));
  const MirrorBall far = locate_ball({circle, std::nullopt}, Image(width, height, 3));
  Image mean(width, height, 3);
  const Eigen::Vector3d towards = ball_centre().normalized();
  const Eigen::Matrix3d turn =  // of the ball to Z; Eigen's FromTwoVectors takes fifteen seconds to compile
      Eigen::Quaterniond(1.0 + towards.z(), towards.y(), -towards.x(), 0.0).normalized().toRotationMatrix();
  double worst = 0.0, worst_far = 0.0;
  const auto angle = [](const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
    return degrees_from_radians(std::atan2(a.cross(b).norm(), a.dot(b)));
  };
  const auto image_of = [&](const std::string& file) {
    const RawFrame frame = read_bracket_file(folder_ / "shots" / file).frame;
    Image image(width, height, 3);
    for (std::size_t k = 0; k < image.values.size(); ++k)
      image.values[k] = static_cast<float>(frame.samples[k]) / 65535.0f;
    return image;
  };
  for (int i = 0; i < sources; ++i) {
    const Image image = image_of(name(i));
    for (std::size_t k = 0; k < mean.values.size(); ++k) mean.values[k] += image.values[k];
    worst = std::max(worst, angle(light_direction(image, given), direction(i)));
    worst_far = std::max(worst_far, angle(light_direction(image, far), turn * direction(i)));
  }
  EXPECT_LT(worst, accuracy);
  // With a camera at infinity perspective is left out, which grows towards the rim of the ball.
  EXPECT_LT(worst_far, degrees_from_radians(std::asin(1.0 / distance)) + accuracy);
  // The centre of a clipped highlight of two by two pixels is not known better.
  source_radiance_ = 60.0;
  for (const int i : {1, 5, 9}) {
    photograph("clipped.png", {direction(i)});
    EXPECT_LT(angle(light_direction(image_of("clipped.png"), given), direction(i)), 2.0 * accuracy);
  }
  fs::remove(folder_ / "shots/clipped.png");
  const MirrorBall found = locate_ball({std::nullopt, field_of_view}, mean);
  EXPECT_LT((found.centre_px() - truth.centre_px()).norm(), 0.5);

  const ImportSummary summary = import_series(request(std::nullopt));
  EXPECT_EQ(summary.photographs, static_cast<std::size_t>(sources));
  EXPECT_THAT(summary.notes, Contains(HasSubstr("mirror ball at --ball 7")));
  EXPECT_LT(worst_angle(Eigen::Matrix3d::Identity()), accuracy + 4.0);
  const CaptureSession session = read_capture_session(folder_ / "session");
  const Mask mask = read_mask(*session.mask, width, height);
  EXPECT_EQ(mask[170 * width + 75], 0);
  EXPECT_NE(mask[60 * width + 200], 0);
}

TEST_F(ChromeBallImport, UnfitPhotographs) {
  const ImageCircle circle{{75.0, 170.0}, 37.0};
  const auto refusal = [&](const std::optional<ImageCircle>& at) {
    return message_of([&] { import_series(request(at)); });
  };
  photograph("a.png", {direction(3)});
  photograph("b.png", {});
  EXPECT_THAT(refusal(circle), AllOf(HasSubstr("b.png: the ball at 7"), HasSubstr("shows no highlight"),
                                     HasSubstr("leave the photograph out")));
  photograph("b.png", {direction(3), direction(9)});
  EXPECT_THAT(refusal(circle), HasSubstr("b.png: the ball shows two highlights"));
  photograph("b.png", {direction(3)});
  EXPECT_THAT(refusal(circle),
              AllOf(HasSubstr("b.png: the light source is 0° from that of"), HasSubstr("a.png")));
  EXPECT_THAT(refusal(ImageCircle{{20.0, 170.0}, 37.0}), HasSubstr("beyond the photograph"));
  ImportRequest both = request(circle);
  both.lights = {folder_ / "light.exr"};
  EXPECT_THAT(message_of([&] { import_series(both); }), HasSubstr("not both"));
}

}  // namespace
}  // namespace refield
