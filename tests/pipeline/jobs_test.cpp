// SPDX-License-Identifier: Apache-2.0
// Estimation as jobs: bands of rows estimated by processes of their own join into the bytes of one run;
// memory stays within what was estimated; logs are plain lines.
#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>

#include "core/base/files.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "tests/pipeline/program.h"
#include "tests/support/random_data.h"
#include "tests/support/synthetic_capture.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using namespace test;

std::vector<std::string> words(std::initializer_list<std::string> first,
                               const std::vector<std::string>& more) {
  std::vector<std::string> all(first);
  all.insert(all.end(), more.begin(), more.end());
  return all;
}

class Jobs : public testing::Test {
 protected:
  Jobs() {
    const auto lights = random_lights(40, 24, 18, 7);
    write_capture(
        folder_ / "session",
        field_of_boxes(16, 37, lights[0].domain(), {{0, 0, 12, 9}, {8, 6, 20, 11}, {5, 3, 7, 5}}, 2), lights,
        0.02);
  }
  int estimate(const std::string& field, const std::vector<std::string>& more) {
    return run_program(words({"estimate", folder_ / "session", "-o", folder_ / field}, more), log_);
  }
  std::string log() const { return read_text(log_); }

  test::TemporaryFolder folder_;
  const std::filesystem::path log_ = folder_ / "log";
};

TEST_F(Jobs, PartsJoinIntoTheBytesOfOneRun) {
  for (const std::vector<std::string>& options :
       {std::vector<std::string>{}, {"--mode", "fast"}, {"--mode", "paper", "--max-kernels", "8"}}) {
    ASSERT_EQ(estimate("whole.rfield", options), 0) << log();
    std::vector<std::string> merge = {"merge", "-o", folder_ / "joined.rfield"};
    int number = 0;
    for (const std::string rows : {":3", "3:4", "4:30", "30:"}) {
      const std::string part = "part" + std::to_string(number++) + ".rfield";
      ASSERT_EQ(estimate(part, words({"--rows", rows}, options)), 0) << log();
      merge.push_back(folder_ / part);
    }
    ASSERT_EQ(run_program(merge, log_), 0) << log();
    EXPECT_TRUE(read_text(folder_ / "joined.rfield") == read_text(folder_ / "whole.rfield"))
        << testing::PrintToString(options);
  }
}

TEST_F(Jobs, ShardsShareTheCheckOfFrames) {
  const auto flickered = folder_ / "session/observed/train_011.exr";
  Image photograph = read_image(flickered);
  for (float& value : photograph.values) value *= 1.7f;
  write_exr(flickered, photograph);
  const std::vector<std::string> options = {"--max-kernels", "4"};
  ASSERT_EQ(estimate("whole.rfield", options), 0) << log();
  const auto file = folder_ / "frame-check.json";
  EXPECT_FALSE(std::filesystem::exists(file)) << "for shards only";
  ASSERT_EQ(estimate("a.rfield", words({"--rows", "1/2"}, options)), 0) << log();
  const std::string check = read_text(file);
  ASSERT_EQ(estimate("b.rfield", words({"--rows", "2/2"}, options)), 0) << log();
  EXPECT_NE(log().find("train_011 is left out"), std::string::npos) << log();
  ASSERT_EQ(run_program(
                {"merge", folder_ / "a.rfield", folder_ / "b.rfield", "-o", folder_ / "joined.rfield"}, log_),
            0)
      << log();
  EXPECT_TRUE(read_text(folder_ / "joined.rfield") == read_text(folder_ / "whole.rfield"));

  // Whether a shard took the findings over shows in a figure that is changed in the file.
  auto changed = nlohmann::json::parse(check);
  changed["typical_residual"] = 0.125;
  const auto found_by = [&](const std::vector<std::string>& more) {
    EXPECT_EQ(estimate("b.rfield", words({"--rows", "2/2"}, more)), 0) << log();
    return nlohmann::json::parse(read_text(folder_ / "b.rfield.log.json")).at("typical_frame_residual");
  };
  write_text_atomically(file, changed.dump());
  EXPECT_EQ(found_by(options), 0.125);
  EXPECT_NE(found_by({"--max-kernels", "5"}), 0.125) << "another job";
  write_text_atomically(file, changed.dump().substr(0, check.size() / 2));
  EXPECT_NE(found_by(options), 0.125) << "damaged";
  EXPECT_TRUE(read_text(file) == check);
  write_text_atomically(file, changed.dump());
  photograph.at(3, 4, 0) += 0.1f;
  write_exr(flickered, photograph);
  EXPECT_NE(found_by(options), 0.125) << "another photograph";
}

TEST_F(Jobs, PartsOfARefinementJoinToo) {
  ASSERT_EQ(run_program({"estimate", "--light", folder_ / "session/illumination/train_0?0.exr", "--observed",
                         folder_ / "session/observed/train_0?0.exr", "--max-kernels", "3", "-o",
                         folder_ / "few.rfield"},
                        log_),
            0)
      << log();
  const std::vector<std::string> refine = {"--max-kernels", "6", "--refine", folder_ / "few.rfield"};
  ASSERT_EQ(estimate("whole.rfield", refine), 0) << log();
  ASSERT_EQ(estimate("top.rfield", words({"--rows", ":17"}, refine)), 0) << log();
  ASSERT_EQ(estimate("bottom.rfield", words({"--rows", "17:"}, refine)), 0) << log();
  ASSERT_EQ(run_program(
                {"merge", folder_ / "top.rfield", folder_ / "bottom.rfield", "-o", folder_ / "joined.rfield"},
                log_),
            0)
      << log();
  EXPECT_TRUE(read_text(folder_ / "joined.rfield") == read_text(folder_ / "whole.rfield"));
}

TEST_F(Jobs, EqualBandsCoverThePicture) {
  std::vector<std::string> merge = {"merge", "-o", folder_ / "joined.rfield"};
  for (int i = 1; i <= 5; ++i) {
    const std::string part = "part" + std::to_string(i) + ".rfield";
    ASSERT_EQ(estimate(part, {"--rows", std::to_string(i) + "/5", "--max-kernels", "3"}), 0) << log();
    merge.push_back(folder_ / part);
  }
  EXPECT_EQ(run_program(merge, log_), 0) << log();
}

TEST_F(Jobs, PartsOfOtherOptionsOrCapturesAreRefused) {
  ASSERT_EQ(estimate("a.rfield", {"--rows", "1/2", "--max-kernels", "4"}), 0) << log();
  ASSERT_EQ(estimate("b.rfield", {"--rows", "2/2", "--max-kernels", "5"}), 0) << log();
  EXPECT_EQ(
      run_program({"merge", folder_ / "a.rfield", folder_ / "b.rfield", "-o", folder_ / "w.rfield"}, log_),
      2);
  EXPECT_NE(log().find("b.rfield"), std::string::npos) << log();
  write_exr(folder_ / "session/observed/train_003.exr", Image(16, 37, 3, 0.5f));
  ASSERT_EQ(estimate("b.rfield", {"--rows", "2/2", "--max-kernels", "4"}), 0) << log();
  EXPECT_EQ(
      run_program({"merge", folder_ / "a.rfield", folder_ / "b.rfield", "-o", folder_ / "w.rfield"}, log_),
      2);
  EXPECT_NE(log().find("different captures"), std::string::npos) << log();
  EXPECT_FALSE(std::filesystem::exists(folder_ / "w.rfield"));
}

TEST_F(Jobs, PartsOfACaptureWithTheSameNamesAndSizesAreRefused) {
  const auto photograph = folder_ / "session/observed/train_003.exr";
  // Uncompressed, so that other values take as many bytes.
  const auto write = [&](float value) {
    OIIO::ImageSpec spec(16, 37, 3, OIIO::TypeDesc::FLOAT);
    spec.attribute("compression", "none");
    const std::vector<float> values(std::size_t{16} * 37 * 3, value);
    auto output = OIIO::ImageOutput::create(photograph.string());
    ASSERT_TRUE(output && output->open(photograph.string(), spec) &&
                output->write_image(OIIO::TypeDesc::FLOAT, values.data()) && output->close());
  };
  const std::vector<std::string> options = {"--max-kernels", "4", "--keep-outliers"};
  write(0.5f);
  const auto size = std::filesystem::file_size(photograph);
  ASSERT_EQ(estimate("a.rfield", words({"--rows", "1/2"}, options)), 0) << log();
  write(0.25f);
  ASSERT_EQ(std::filesystem::file_size(photograph), size);
  ASSERT_EQ(estimate("b.rfield", words({"--rows", "2/2"}, options)), 0) << log();
  EXPECT_EQ(
      run_program({"merge", folder_ / "a.rfield", folder_ / "b.rfield", "-o", folder_ / "w.rfield"}, log_),
      2);
  EXPECT_NE(log().find("a.rfield"), std::string::npos) << log();
  EXPECT_NE(log().find("b.rfield"), std::string::npos) << log();
  EXPECT_NE(log().find("different captures"), std::string::npos) << log();
}

TEST_F(Jobs, ShardsFromOtherMountPointsAreMerged) {
  ASSERT_EQ(estimate("a.rfield", {"--rows", "1/2", "--max-kernels", "4"}), 0) << log();
  std::filesystem::create_directory(folder_ / "elsewhere");
  std::filesystem::copy(folder_ / "session", folder_ / "elsewhere/session",
                        std::filesystem::copy_options::recursive);  // with the time of now
  ASSERT_EQ(run_program({"estimate", folder_ / "elsewhere/session", "--rows", "2/2", "--max-kernels", "4",
                         "-o", folder_ / "b.rfield"},
                        log_),
            0)
      << log();
  EXPECT_EQ(
      run_program({"merge", folder_ / "a.rfield", folder_ / "b.rfield", "-o", folder_ / "w.rfield"}, log_), 0)
      << log();
}

TEST_F(Jobs, ADamagedShardIsNamed) {
  ASSERT_EQ(estimate("a.rfield", {"--rows", "1/2", "--max-kernels", "4"}), 0) << log();
  ASSERT_EQ(estimate("b.rfield", {"--rows", "2/2", "--max-kernels", "4"}), 0) << log();
  const std::vector<std::string> merge = {"merge", folder_ / "a.rfield", folder_ / "b.rfield", "-o",
                                          folder_ / "w.rfield"};
  ASSERT_EQ(run_program(merge, log_), 0) << log();
  const std::string whole = read_text(folder_ / "w.rfield");
  const std::string good = read_text(folder_ / "b.rfield");
  int refused = 0;
  constexpr int rounds = 12;
  for (int round = 0; round < rounds; ++round) {
    std::string damaged = good;
    damaged[damaged.size() * (2 * round + 1) / (2 * rounds)] ^= 0x10;
    write_text_atomically(folder_ / "b.rfield", damaged);
    if (run_program(merge, log_) == 0) {  // hit in padding alone
      EXPECT_TRUE(read_text(folder_ / "w.rfield") == whole) << "round " << round;
      continue;
    }
    ++refused;
    EXPECT_NE(log().find("b.rfield"), std::string::npos) << log();
  }
  EXPECT_GT(refused, rounds / 2);
}

TEST_F(Jobs, RowsThatAreNoneAreRefused) {
  for (const char* rows :
       {"5", "5:5", "9:3", "0:38", "-1:4", "0/4", "5/4", "1/0", "/3", "a:b", "1/38", "1:2:3"})
    EXPECT_EQ(estimate("x.rfield", {"--rows", rows}), 2) << rows << ": " << log();
  EXPECT_FALSE(std::filesystem::exists(folder_ / "x.rfield"));
}

TEST_F(Jobs, ADryRunChecksAndForeseesButWritesNothing) {
  ASSERT_EQ(estimate("x.rfield", {"--dry-run", "--json", "--quiet", "--rows", "10:20"}), 0) << log();
  const auto figures = nlohmann::json::parse(log());
  EXPECT_EQ(figures["images"], 40);
  EXPECT_EQ(figures["rows"], nlohmann::json({10, 20}));
  EXPECT_GT(figures["estimated_memory_bytes"].get<double>(), 0);
  EXPECT_GT(figures["estimated_seconds_fit"].get<double>(), 0.0);
  EXPECT_GT(figures["estimated_seconds"].get<double>(), figures["estimated_seconds_fit"].get<double>());
  EXPECT_EQ(figures["sampled_pixels"], 160);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "x.rfield"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "x.rfield.log.json"));
  write_exr(folder_ / "session/observed/train_031.exr", Image(16, 36, 3, 0.5f));
  EXPECT_EQ(estimate("x.rfield", {"--dry-run"}), 2);
  EXPECT_NE(log().find("train_031.exr"), std::string::npos);
}

TEST_F(Jobs, TheLogIsMadeOfPlainLinesThatCarryTheTime) {
  ASSERT_EQ(estimate("x.rfield", {"--rows", "0:8"}), 0);
  EXPECT_EQ(log().find_first_of("\r\033"), std::string::npos);
  EXPECT_TRUE(std::regex_search(
      log(), std::regex(R"(^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ estimate: 40 images, rows 0 to 7,)")))
      << log();
  const auto kept = nlohmann::json::parse(read_text(folder_ / "x.rfield.log.json"));
  EXPECT_GE(kept["threads"].get<double>(), 1);
  EXPECT_EQ(kept["rows"], nlohmann::json({0, 8}));
  EXPECT_GT(kept["estimated_memory_bytes"].get<double>(), 0);
  EXPECT_TRUE(kept.contains("version"));
}

/// Tables, photographs and fits each dominate once. A mask keeps the fits few where they shall not.
TEST(Memory, StaysWithinWhatWasForeseen) {
  struct Case {
    const char* name;
    int width, height, light_width, light_height, images;
    bool masked;
  };
  for (const Case& c :
       {Case{"lights", 8, 40, 320, 240, 30, true}, Case{"photographs", 1500, 64, 16, 12, 50, true},
        Case{"fits", 12, 12, 32, 24, 500, false}}) {
    SCOPED_TRACE(c.name);
    const test::TemporaryFolder folder;
    const auto lights = random_lights(c.images, c.light_width, c.light_height, 5);
    // What is different in every pixel fills the caches of the fits.
    Rng rng(3);
    write_capture(folder / "session",
                  c.masked ? field_of_boxes(c.width, c.height, lights[0].domain(), {{0, 0, 9, 9}}, 2)
                           : random_field(rng, c.width, c.height, lights[0].domain(), 2000, 9),
                  lights, 0.02);
    Image mask(c.width, c.height, 3);
    for (int x = 0; x < std::min(c.width, 64); ++x)
      for (int y = 0; y < c.height; y += 9)
        for (int channel = 0; channel < 3; ++channel) mask.at(x, y, channel) = 1.0f;
    write_png(folder / "mask.png", mask);
    const auto log = folder / "log";
    // One thread: what each one keeps ready shall be filled here.
    std::vector<std::string> arguments = {"estimate", folder / "session", "--threads", "1", "--quiet",
                                          "-o",       folder / "f.rfield"};
    if (c.masked) arguments.insert(arguments.end(), {"--mask", folder / "mask.png"});
    RunningProgram program(arguments, log);
    ASSERT_EQ(program.wait(), 0) << read_text(log);
    const auto kept = nlohmann::json::parse(read_text(folder / "f.rfield.log.json"));
    const auto estimated = kept["estimated_memory_bytes"].get<std::uint64_t>();
    const auto held = kept["peak_memory_bytes"].get<std::uint64_t>();
    EXPECT_LE(held, estimated);
    // Nor is the forecast idle caution: beyond what it holds ready for the program itself and for the caches,
    // which this small work does not fill, it is used.
    constexpr std::uint64_t allowance = 400ull << 20;
    EXPECT_GE(held + allowance, estimated);
    // What wait4() tells may be that of this test, which the program's process was copied from.
    EXPECT_LE(held, program.peak_memory_bytes());
    std::printf("%s: %.0f MiB estimated, %.0f MiB held\n", c.name, estimated / 1048576.0, held / 1048576.0);
  }
}

// Beside the full field, pack holds one packed field and what some rows of tiles need, for a picture of any
// height.
TEST(Memory, OfPackIsThatOfTheFieldAndOfItsTiles) {
  const test::TemporaryFolder folder;
  Rng rng(8);
  write_reflectance_field(folder / "full.rfield", random_field(rng, 200, 8000, {32, 24}, 500, 20));
  const auto log = folder / "log";
  RunningProgram program({"pack", folder / "full.rfield", "-o", folder / "packed.rfield"}, log);
  ASSERT_EQ(program.wait(), 0) << read_text(log);
  const double mib = 1 << 20, held = static_cast<double>(program.peak_memory_bytes()) / mib;
  const auto size = [&](const char* file) {
    return static_cast<double>(std::filesystem::file_size(folder / file)) / mib;
  };
  std::printf("%.0f and %.0f MiB in files, %.0f MiB held\n", size("full.rfield"), size("packed.rfield"),
              held);
  EXPECT_LE(held, size("full.rfield") + size("packed.rfield") + 256);
}

}  // namespace
}  // namespace refield
