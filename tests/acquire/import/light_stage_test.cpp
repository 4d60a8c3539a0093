// SPDX-License-Identifier: Apache-2.0
// Light sources of domes and light stages: their lists, light maps and import.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "acquire/hdr/bracket_files.h"
#include "acquire/import/import_series.h"
#include "core/base/files.h"
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
  EXPECT_EQ(stage.domain, (LightDomain{64, 32, Parameterisation::lat_long}));
  EXPECT_EQ(stage.sources[0].column, 48);  // +X, a quarter right of the centre column
  EXPECT_EQ(stage.sources[1].row, 0);
  EXPECT_EQ(stage.sources[2].column, 0);  // −Z, the left edge
  EXPECT_EQ(stage.sources[2].row, 16);
}

TEST_F(LightList, DirectionsWithNamesAndIntensities) {
  write("filenames.txt", "001.png\n002.png\n");
  write("light_intensities.txt", "1.5 2 2.5\n3\n");
  const LightStage stage = read_light_stage(write("light_directions.txt", "0 0.6 0.8\n-0.6 0 0.8\n"));
  ASSERT_EQ(stage.sources.size(), 2U);
  EXPECT_EQ(stage.sources[1].photograph, "002.png");
  const Image map = light_map_of(stage, 0);
  double sum = 0.0;
  for (const float value : map.values) sum += value;
  EXPECT_EQ(sum, 6.0);  // nothing but the three channels of one texel
  EXPECT_EQ(map.at(stage.sources[0].column, stage.sources[0].row, 2), 2.5f);
  EXPECT_EQ(stage.sources[1].intensity, (std::array<float, 3>{3.0f, 3.0f, 3.0f}));
  write("light_intensities.txt", "1.5 2 2.5\n0 1 1\n");
  EXPECT_THAT(message_of([&] { read_light_stage(folder_ / "light_directions.txt"); }),
              HasSubstr("light_intensities.txt:2: the intensity 0 is not positive"));
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
       {std::pair<std::string, int>(text, 32), {"2\na 0.01 0.01 1\nb 0.03 0.03 1\n", 128}}) {
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

TEST_F(LightList, NamesFileLineValueAndRemedy) {
  EXPECT_THAT(refusal("3\na 0 0 1\nb 1 0 0\n"),
              AllOf(HasSubstr("list:1: states 3 light sources, but the file lists 2"), HasSubstr("correct")));
  EXPECT_THAT(refusal("-1\n"), HasSubstr("list:1: states -1"));
  EXPECT_THAT(refusal("0\n"), HasSubstr("list:1: states 0"));
  EXPECT_THAT(refusal(" \n"), HasSubstr("is empty"));
  EXPECT_THAT(refusal("photograph,x,y,z\n"), HasSubstr("list:1: 'photograph,x,y,z' is neither the number"));
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
                    Contains(HasSubstr("lat-long maps of 64×32"))));
  const CaptureSession session = read_capture_session(folder_ / "session");
  EXPECT_EQ(session.light, (LightDomain{64, 32, Parameterisation::lat_long}));
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

}  // namespace
}  // namespace refield
