// SPDX-License-Identifier: Apache-2.0
#include "core/session/capture_session.h"

#include <gmock/gmock.h>

#include <cmath>
#include <fstream>
#include <functional>
#include <limits>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/image/image_io.h"
#include "tests/support/message_of.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

class CaptureSessionTest : public testing::Test {
 protected:
  /// A session of one training and one test frame, its images on disk.
  CaptureSession make_session() {
    CaptureSession session;
    session.folder = folder_.path();
    session.light = {8, 6, Parameterisation::lat_long};
    session.width = 5;
    session.height = 4;
    for (const auto& [name, role, kind] : {std::tuple{"train_000", FrameRole::train, "natural"},
                                           std::tuple{"test_000", FrameRole::test, "bar"}})
      session.frames.push_back({name, role, kind, folder_ / "illumination" / (name + std::string(".exr")),
                                folder_ / "observed" / (name + std::string(".exr"))});
    session.mask = folder_ / "mask.png";
    create_folders(folder_ / "illumination");
    create_folders(folder_ / "observed");
    for (const CaptureFrame& frame : session.frames) {
      write_exr(frame.illumination, Image(8, 6, 3, 1.0f));
      write_exr(frame.observed, Image(5, 4, 3, 1.0f));
    }
    write_png(*session.mask, Image(5, 4, 1, 1.0f));
    return session;
  }

  void write_manifest(const std::string& text) { std::ofstream(folder_ / session_manifest_name) << text; }

  test::TemporaryFolder folder_;
};

TEST_F(CaptureSessionTest, TheColourMatrixIsAppliedToPhotographsAndTheirNoise) {
  CaptureSession session = make_session();
  Photograph photograph{Image(5, 4, 3), Image(5, 4, 3, 0.1f)};
  for (std::size_t i = 0; i < photograph.radiance.values.size(); ++i)
    photograph.radiance.values[i] = static_cast<float>(1 + i % 3);
  const float unmeasured = std::numeric_limits<float>::infinity();
  photograph.sigma.at(2, 3, 1) = unmeasured;
  write_photograph(session.frames[0].observed, photograph);
  session.colour.emplace();
  session.colour->rec709_from_camera << 1.5, -0.5, 0.25, 0.0, 1.0, 0.0, -0.25, 0.0, 2.0;
  session.colour->chart = "white.exr";
  session.colour->median_delta_e = 0.25;
  session.colour->largest_delta_e = 1.5;
  write_session_manifest(session);

  CaptureSession back = read_capture_session(folder_.path());
  ASSERT_TRUE(back.colour);
  EXPECT_EQ(back.colour->rec709_from_camera, session.colour->rec709_from_camera);
  EXPECT_EQ(back.colour->chart, "white.exr");
  EXPECT_EQ(back.colour->largest_delta_e, 1.5);
  EXPECT_EQ(back.colour_space(), ColourSpace::rec709);
  const Photograph rows = read_observed_rows(back.frames[0], 3, 4);
  EXPECT_FLOAT_EQ(rows.radiance.at(0, 0, 0), 1.5f - 1.0f + 0.75f);
  EXPECT_FLOAT_EQ(rows.radiance.at(0, 0, 1), 2.0f);
  EXPECT_FLOAT_EQ(rows.radiance.at(0, 0, 2), 6.0f - 0.25f);
  EXPECT_FLOAT_EQ(rows.sigma.at(0, 0, 0), 0.1f * std::sqrt(2.25f + 0.25f + 0.0625f));
  for (int c = 0; c < 3; ++c) EXPECT_EQ(rows.sigma.at(2, 0, c), unmeasured) << "one channel is in all";
  // Drift is measured and divided out after it.
  back.frames[0].gain = {2.0f, 1.0f, 1.0f};
  EXPECT_FLOAT_EQ(read_observed(back.frames[0]).radiance.at(0, 0, 0), 0.5f * (1.5f - 1.0f + 0.75f));

  session.colour->rec709_from_camera.setOnes();
  write_session_manifest(session);
  EXPECT_THAT(test::message_of([&] { read_capture_session(folder_.path()); }),
              AllOf(HasSubstr("rec709_from_camera"), HasSubstr("determinant")));
}

TEST_F(CaptureSessionTest, RoundTrip) {
  const CaptureSession session = make_session();
  write_session_manifest(session);
  const CaptureSession back = read_capture_session(folder_.path());
  EXPECT_EQ(back.light, session.light);
  EXPECT_EQ(back.width, 5);
  EXPECT_EQ(back.height, 4);
  EXPECT_EQ(back.mask, session.mask);
  EXPECT_FALSE(back.ambient);
  ASSERT_EQ(back.frames.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(back.frames[i].name, session.frames[i].name);
    EXPECT_EQ(back.frames[i].role, session.frames[i].role);
    EXPECT_EQ(back.frames[i].kind, session.frames[i].kind);
    EXPECT_EQ(back.frames[i].illumination, session.frames[i].illumination);
    EXPECT_EQ(back.frames[i].observed, session.frames[i].observed);
  }
  ASSERT_EQ(back.frames_of(FrameRole::test).size(), 1u);
  EXPECT_EQ(back.frames_of(FrameRole::test)[0].name, "test_000");
}

TEST_F(CaptureSessionTest, KnowsWhereTheMonitorStood) {
  CaptureSession session = make_session();
  session.light.parameterisation = Parameterisation::monitor;
  session.monitors = {{520, 320, 600, {90, -5.5, 0.1}, 10, -20}, {520, 320, 450}};
  write_session_manifest(session);
  EXPECT_EQ(read_capture_session(folder_.path()).monitors, session.monitors);

  const std::string text = read_text(folder_ / session_manifest_name);
  const auto with = [&](const std::string& old, const std::string& now) {
    std::string changed = text;
    changed.replace(changed.find(old), old.size(), now);
    write_manifest(changed);
    return test::message_of([&] { read_capture_session(folder_.path()); });
  };
  EXPECT_THAT(with("distance_mm", "distance"), HasSubstr("distance_mm"));
  EXPECT_THAT(with("width_mm = 520.0", "width_mm = -1"), HasSubstr("width_mm"));
  EXPECT_THAT(with("'monitor'", "'lat_long'"), HasSubstr("lat_long"));
}

TEST_F(CaptureSessionTest, MovesWithItsFolder) {
  write_session_manifest(make_session());
  EXPECT_EQ(read_text(folder_ / session_manifest_name).find(folder_.path().string()), std::string::npos);
}

TEST_F(CaptureSessionTest, NamesAMissingImage) {
  write_session_manifest(make_session());
  fs::remove(folder_ / "observed/train_000.exr");
  EXPECT_THAT(test::message_of([&] { read_capture_session(folder_.path()); }),
              AllOf(HasSubstr("observed/train_000.exr"), HasSubstr("missing")));
}

TEST_F(CaptureSessionTest, AFolderWithoutManifestIsNoSession) {
  EXPECT_THAT(test::message_of([&] { read_capture_session(folder_.path()); }), HasSubstr("--light"));
}

TEST_F(CaptureSessionTest, HostileManifests) {
  write_session_manifest(make_session());
  const std::string good = read_text(folder_ / session_manifest_name);
  const auto expect_refused = [&](const std::string& from, const std::string& to) {
    std::string text = good;
    const auto at = text.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    write_manifest(text.replace(at, from.size(), to));
    EXPECT_THAT(test::message_of([&] { read_capture_session(folder_.path()); }),
                HasSubstr(session_manifest_name))
        << from << " → " << to;
  };
  expect_refused("version = 1", "version = 2");
  expect_refused("version = 1", "version = 'one'");
  expect_refused("refield capture session", "something else");
  expect_refused("lat_long", "fisheye");
  expect_refused("'train'", "'training'");
  expect_refused("'test_000'", "'train_000'");  // twice the same name
  expect_refused("width = 5", "width = 0");
  expect_refused("width = 5", "width = -5");
  expect_refused("width = 5", "width = 99999999999");
  expect_refused("width = 5", "width = 1e30");  // toml++ would overflow
  expect_refused("version = 1", "version = 111111E22");
  expect_refused("width = 5", "wide = 5");
  expect_refused("name = 'train_000'", "name = 3");
  expect_refused("[camera]", "[camera");
}

TEST_F(CaptureSessionTest, KeysThatNobodyReadsAreRefused) {
  write_session_manifest(make_session());
  const std::string good = read_text(folder_ / session_manifest_name);
  const auto refusal = [&](const std::string& before, const std::string& added) {
    std::string text = good;
    write_manifest(text.insert(text.find(before), added + "\n"));
    return test::message_of([&] { read_capture_session(folder_.path()); });
  };
  EXPECT_THAT(refusal("format", "maks = 'mask.png'"),
              AllOf(HasSubstr("session.toml:1: "), HasSubstr("'maks'"), HasSubstr("did you mean 'mask'?")));
  EXPECT_THAT(refusal("format", "ambiant = 'a.exr'"), HasSubstr("'ambient'"));
  const auto refusal_of_mask = [&](const std::string& value) {
    std::string text = good;
    const std::size_t at = text.find("mask = ");
    write_manifest(text.replace(at, text.find('\n', at) - at, "mask = " + value));
    return test::message_of([&] { read_capture_session(folder_.path()); });
  };
  EXPECT_THAT(refusal_of_mask("7"), HasSubstr("mask = 7: give a string in quotes"));
  EXPECT_THAT(refusal_of_mask("\"m\\u0000.png\""),
              AllOf(HasSubstr("mask = "), HasSubstr("string in quotes")));
  EXPECT_THAT(refusal("[light]", "[lights]"), HasSubstr("did you mean 'light'?"));
  const auto in_table = [&](const std::string& table, const std::string& added) {
    std::string text = good;
    const auto line = text.find('\n', text.find(table)) + 1;
    write_manifest(text.insert(line, added + "\n"));
    return test::message_of([&] { read_capture_session(folder_.path()); });
  };
  EXPECT_THAT(in_table("[camera]", "hight = 4"),
              AllOf(HasSubstr("[camera] hight = 4: "), HasSubstr("'height'")));
  EXPECT_THAT(in_table("[light]", "gamma = 2.2"),
              HasSubstr("[light] gamma = 2.2: is not a known key; known are"));
  EXPECT_THAT(in_table("[[frame]]", "weight = 2"), HasSubstr("[frame] weight = 2: is not a known key"));
  EXPECT_THAT(in_table("[[frame]]", "orders = 2"), HasSubstr("did you mean 'order'?"));
}

TEST_F(CaptureSessionTest, AManifestCutAnywhereIsRefusedOrHasFewerFrames) {
  write_session_manifest(make_session());
  const std::string good = read_text(folder_ / session_manifest_name);
  for (std::size_t length = 0; length < good.size(); length += 7) {
    write_manifest(good.substr(0, length));
    try {
      EXPECT_LE(read_capture_session(folder_.path()).frames.size(), 2u);
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), HasSubstr(folder_.path().string()));
    }
  }
}

TEST_F(CaptureSessionTest, ImageSizesMustAgree) {
  CaptureSession session = make_session();
  EXPECT_NO_THROW(check_image_sizes(session));
  write_exr(session.frames[1].observed, Image(6, 4, 3));
  EXPECT_THAT(test::message_of([&] { check_image_sizes(session); }),
              AllOf(HasSubstr("observed/test_000.exr"), HasSubstr("6×4"), HasSubstr("5×4")));
}

TEST_F(CaptureSessionTest, SizesAreFilledInWhereTheSessionHasNone) {
  CaptureSession session = make_session();
  session.width = session.height = session.light.width = session.light.height = 0;
  check_image_sizes(session);
  EXPECT_EQ(session.width, 5);
  EXPECT_EQ(session.light.height, 6);
}

TEST_F(CaptureSessionTest, MaskIsWhereAnyChannelExceedsOneHalf) {
  Image painted(3, 1, 3);
  painted.at(0, 0, 2) = 1.0f;
  painted.at(1, 0, 1) = 0.4f;
  write_exr(folder_ / "mask.exr", painted);
  EXPECT_THAT(read_mask(folder_ / "mask.exr", 3, 1), ElementsAre(1, 0, 0));
  EXPECT_THAT(test::message_of([&] { read_mask(folder_ / "mask.exr", 4, 1); }), HasSubstr("mask.exr"));
}

class PairByGlobs : public testing::Test {
 protected:
  void touch(const std::string& name) {
    fs::create_directories((folder_ / name).parent_path());
    std::ofstream(folder_ / name) << "x";
  }
  CaptureSession pair(const std::string& light, const std::string& observed) {
    return pair_by_globs((folder_ / light).string(), (folder_ / observed).string());
  }
  test::TemporaryFolder folder_;
};

TEST_F(PairByGlobs, ByWhatTheWildcardsStandFor) {
  for (const char* name : {"l/map_2.exr", "l/map_10.exr", "o/photo-10.exr", "o/photo-2.exr"}) touch(name);
  const CaptureSession session = pair("l/map_*.exr", "o/photo-*.exr");
  ASSERT_EQ(session.frames.size(), 2u);
  EXPECT_EQ(session.frames[0].illumination.filename(), "map_10.exr");
  EXPECT_EQ(session.frames[0].observed.filename(), "photo-10.exr");
  EXPECT_EQ(session.frames[1].observed.filename(), "photo-2.exr");
  EXPECT_EQ(session.frames[0].role, FrameRole::train);
}

TEST_F(PairByGlobs, ByStemWhenNoWildcardIsShared) {
  for (const char* name : {"l/train_1.exr", "l/train_2.exr", "o/train_1.exr", "o/train_2.exr"}) touch(name);
  const CaptureSession session = pair("l/train_*.exr", "o/*.exr");
  ASSERT_EQ(session.frames.size(), 2u);
  EXPECT_EQ(session.frames[1].observed.filename(), "train_2.exr");
}

TEST_F(PairByGlobs, Folders) {
  for (const char* name : {"l/a.exr", "o/a.exr", "o/readme.txt"}) touch(name);
  EXPECT_EQ(pair("l", "o").frames.size(), 1u);
}

TEST_F(PairByGlobs, TwoSingleFiles) {
  for (const char* name : {"light.exr", "photo.exr"}) touch(name);
  EXPECT_EQ(pair("light.exr", "photo.exr").frames.size(), 1u);
}

TEST_F(PairByGlobs, NamesTheFileWithoutAPartner) {
  for (const char* name : {"l/t_1.exr", "l/t_2.exr", "l/t_3.exr", "o/t_1.exr", "o/t_3.exr"}) touch(name);
  EXPECT_THAT(test::message_of([&] { pair("l/t_*.exr", "o/t_*.exr"); }),
              AllOf(HasSubstr("l/t_2.exr"), HasSubstr("photograph"), HasSubstr("add the missing image")));
  fs::remove(folder_ / "l/t_2.exr");
  fs::remove(folder_ / "l/t_1.exr");
  EXPECT_THAT(test::message_of([&] { pair("l/t_*.exr", "o/t_*.exr"); }),
              AllOf(HasSubstr("o/t_1.exr"), HasSubstr("light map")));
}

TEST_F(PairByGlobs, NamesTwoFilesThatWouldShareAPartner) {
  for (const char* name : {"l/a.exr", "o/a.exr", "o/a.png"}) touch(name);
  EXPECT_THAT(test::message_of([&] { pair("l", "o"); }), AllOf(HasSubstr("a.png"), HasSubstr("a.exr")));
}

}  // namespace
}  // namespace refield
