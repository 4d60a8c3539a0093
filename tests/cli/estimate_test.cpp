// SPDX-License-Identifier: Apache-2.0
// What estimation refuses: the message names the file and the remedy, and no output is touched.
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "core/base/files.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "tests/cli/matchers.h"
#include "tests/support/small_disk.h"
#include "tests/support/synthetic_capture.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

namespace fs = std::filesystem;
using test::RefusedNaming;
using test::run_refield;
using test::Succeeded;

constexpr int images = test::SmallCapture::images;
constexpr LightDomain domain = test::SmallCapture::domain;

class EstimateVerb : public testing::Test {
 protected:
  EstimateVerb() {
    const test::SmallCapture capture(1);
    create_folders(folder_ / "light");
    create_folders(folder_ / "observed");
    for (int i = 0; i < images; ++i) {
      write_exr(light_file(i), capture.lights[i].radiance);
      write_exr(photograph_file(i), capture.truth.relight(capture.lights[i]));
    }
    std::ofstream(output_) << "old";
  }

  std::string light_file(int i) { return folder_ / ("light/t_" + std::to_string(i) + ".exr"); }
  std::string photograph_file(int i) { return folder_ / ("observed/t_" + std::to_string(i) + ".exr"); }

  test::CommandResult estimate(const std::vector<std::string>& more = {"--max-kernels", "4"}) {
    std::vector<std::string> arguments = {
        "estimate", "--light", folder_ / "light/t_*.exr", "--observed", folder_ / "observed/t_*.exr",
        "-o",       output_};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return run_refield(arguments);
  }

  void expect_refused(const std::string& file, const std::string& remedy,
                      const std::vector<std::string>& more = {"--max-kernels", "4"}) {
    EXPECT_THAT(estimate(more), RefusedNaming(file, remedy));
    EXPECT_TRUE(read_text(output_) == "old") << "the output was touched";
  }

  /// Replaces the value of one sample of an image.
  static void spoil(const fs::path& path, int x, int y, float value) {
    Image image = read_image(path);
    image.at(x, y, 1) = value;
    write_exr(path, image);
  }

  test::TemporaryFolder folder_;
  const std::string output_ = folder_ / "f.rfield";
};

TEST_F(EstimateVerb, GoodInputReplacesTheOutput) {
  const auto result = estimate({"--max-kernels", "4", "--json"});
  ASSERT_THAT(result, Succeeded());
  EXPECT_EQ(nlohmann::json::parse(result.out)["images"], images);
  EXPECT_EQ(read_reflectance_field(output_).width, 6);
}

TEST_F(EstimateVerb, HoldsOutEveryThirdPairAndMeasuresTheErrorOnThem) {
  const auto result = estimate({"--max-kernels", "4", "--json", "--hold-out", "3"});
  ASSERT_THAT(result, Succeeded());
  const auto log = nlohmann::json::parse(result.out);
  EXPECT_EQ(log["images"], images - images / 3);
  const auto& errors = log["held_out"]["errors"]["all"];
  ASSERT_EQ(errors["images"], images / 3);
  // In the order of names: t_0, t_1, t_10, t_11, t_2, ...
  EXPECT_EQ(errors["per_image"][0]["name"], "t_10");
  const auto provenance = nlohmann::json::parse(read_reflectance_field(output_).provenance);
  EXPECT_EQ(provenance["held_out"], nlohmann::json({"t_10", "t_3", "t_6", "t_9"}));
  EXPECT_EQ(provenance["frames"].size(), std::size_t{images - images / 3});
  // Comparing needs no option: the field says which pairs it has not seen.
  const auto compared = run_refield({"compare", output_, "--light", folder_ / "light/t_*.exr", "--observed",
                                     folder_ / "observed/t_*.exr", "--json"});
  ASSERT_THAT(compared, Succeeded());
  EXPECT_EQ(nlohmann::json::parse(compared.out)["held_out"]["all"]["per_image"], errors["per_image"]);
  EXPECT_THAT(estimate({"--hold-out", "1"}), RefusedNaming("--hold-out 1", "2 or more"));
}

TEST_F(EstimateVerb, AMissingImageInASeries) {
  fs::remove(photograph_file(7));
  expect_refused("light/t_7.exr", "add the missing image");
}

TEST_F(EstimateVerb, APhotographOrLightOfTheWrongSize) {
  write_exr(photograph_file(3), Image(7, 5, 3, 1.0f));
  expect_refused("observed/t_3.exr", "7×5");
  write_exr(photograph_file(3), Image(6, 5, 3, 1.0f));
  write_exr(light_file(5), Image(8, 7, 3, 1.0f));
  expect_refused("light/t_5.exr", "8×7");
}

TEST_F(EstimateVerb, ATruncatedImage) {
  for (const std::string& path : {photograph_file(2), light_file(9)}) {
    const std::string bytes = read_text(path);
    for (const double part : {0.0, 0.3, 0.9}) {
      std::ofstream(path, std::ios::binary) << bytes.substr(0, static_cast<std::size_t>(part * bytes.size()));
      expect_refused(fs::path(path).filename(), "");
    }
    std::ofstream(path, std::ios::binary) << bytes;
  }
}

TEST_F(EstimateVerb, PixelsThatAreNoNumbers) {
  for (const float bad : {NAN, INFINITY, -INFINITY}) {
    spoil(photograph_file(4), 2, 3, bad);
    expect_refused("observed/t_4.exr", "(2, 3)");
  }
  spoil(photograph_file(4), 2, 3, 1.0f);
  spoil(light_file(6), 5, 1, NAN);
  expect_refused("light/t_6.exr", "(5, 1)");
}

// Of one such sample the whole estimation would be lost: its square is infinite in single precision.
TEST_F(EstimateVerb, SamplesAndTexelsOfAbsurdSize) {
  for (const float bad : {1e20f, 3e38f, -1e20f, -3e38f}) {
    spoil(photograph_file(4), 2, 3, bad);
    expect_refused("observed/t_4.exr", "(2, 3), green");
  }
  spoil(photograph_file(4), 2, 3, 1.0f);
  spoil(light_file(6), 5, 1, 3e38f);
  expect_refused("light/t_6.exr", "(5, 1)");
}

TEST_F(EstimateVerb, PhotographsOfAbsurdBrightness) {
  for (const float brightness : {1e-39f, 1e8f}) {
    for (int i = 0; i < images; ++i)
      write_exr(photograph_file(i), Image(6, 5, 3, brightness * static_cast<float>(i + 1)));
    expect_refused("observed", "scale all photographs");
  }
}

/// Relative radiance and cd/m² alike: what is not refused is estimated as well at any scale.
TEST_F(EstimateVerb, TheScaleOfRadianceDoesNotMatter) {
  ASSERT_THAT(estimate(), Succeeded());
  const ReflectanceField usual = read_reflectance_field(output_);
  std::vector<Image> photographs, lights;
  for (int i = 0; i < images; ++i) {
    photographs.push_back(read_image(photograph_file(i)));
    lights.push_back(read_image(light_file(i)));
  }
  const auto scaled = [](Image image, float scale) {
    for (float& value : image.values) value *= scale;
    return image;
  };
  for (const auto& [of_photographs, of_lights] :
       {std::pair{0x1p-24f, 1.0f}, {0x1p16f, 0x1p30f}, {1.0f, 0x1p-40f}, {0x1p-24f, 0x1p-40f}}) {
    SCOPED_TRACE(testing::PrintToString(std::pair(of_photographs, of_lights)));
    for (int i = 0; i < images; ++i) {
      write_exr(photograph_file(i), scaled(photographs[i], of_photographs));
      write_exr(light_file(i), scaled(lights[i], of_lights));
    }
    ASSERT_THAT(estimate(), Succeeded());
    const ReflectanceField field = read_reflectance_field(output_);
    const Image expected = usual.relight({lights[0], domain.parameterisation});
    const Image relit = field.relight({scaled(lights[0], of_lights), domain.parameterisation});
    for (std::size_t i = 0; i < expected.values.size(); ++i)
      EXPECT_NEAR(relit.values[i] / of_photographs, expected.values[i], 1e-4f * expected.values[i] + 1e-6f);
  }
}

TEST_F(EstimateVerb, ANoiseEstimateThatIsNone) {
  for (const float bad : {NAN, -1.0f, -INFINITY}) {
    Photograph photograph{Image(6, 5, 3, 1.0f), Image(6, 5, 3, 0.1f)};
    photograph.sigma.at(2, 3, 1) = bad;
    write_photograph(photograph_file(4), photograph);
    expect_refused("observed/t_4.exr", "sigma");
  }
}

TEST_F(EstimateVerb, PhotographsThatShowNothing) {
  const auto write_all = [&](const Image& radiance, const Image& sigma) {
    for (int i = 0; i < images; ++i) write_photograph(photograph_file(i), {radiance, sigma});
  };
  for (const std::vector<std::string>& more :
       {std::vector<std::string>{"--max-kernels", "4"}, {"--mode", "paper", "--max-kernels", "4"}}) {
    write_all(Image(6, 5, 3), {});
    expect_refused("observed", "black", more);
    write_all(Image(6, 5, 3, 1.0f), Image(6, 5, 3, INFINITY));
    expect_refused("observed", "sigma = inf", more);
  }
  write_all(Image(6, 5, 3, 1.0f), {});
  expect_refused("observed", "--clip", {"--max-kernels", "4", "--clip", "0.5"});
  write_exr(folder_ / "mask.exr", Image(6, 5, 3));
  expect_refused("mask.exr", "dark everywhere", {"--max-kernels", "4", "--mask", folder_ / "mask.exr"});
}

TEST_F(EstimateVerb, ACubeMapThatIsNone) {
  expect_refused("light/t_0.exr", "8×6", {"--max-kernels", "4", "--parameterisation", "cube"});
}

TEST_F(EstimateVerb, AnAllBlackLight) {
  write_exr(light_file(8), Image(domain.width, domain.height, 3));
  expect_refused("light/t_8.exr", "remove it");
}

TEST_F(EstimateVerb, OneImageOnly) {
  for (int i = 1; i < images; ++i) {
    fs::remove(light_file(i));
    fs::remove(photograph_file(i));
  }
  expect_refused("observed", "needs many lights", {"--max-kernels", "1"});
}

TEST_F(EstimateVerb, FewerImagesThanKernels) {
  expect_refused("observed", "--max-kernels 12", {"--max-kernels", "25"});
}

TEST_F(EstimateVerb, OptionsOutOfRange) {
  for (const std::vector<std::string>& more : {std::vector<std::string>{"--max-kernels", "-1"},
                                               {"--max-kernels", "256"},
                                               {"--mode", "best"},
                                               {"--memory", "-1"},
                                               {"--memory", "0.001"},
                                               {"--parameterisation", "fisheye"}}) {
    EXPECT_EQ(estimate(more).status, 2) << testing::PrintToString(more);
    EXPECT_TRUE(read_text(output_) == "old") << "the output was touched";
  }
}

TEST_F(EstimateVerb, ASessionThatIsNone) {
  EXPECT_THAT(run_refield({"estimate", folder_.path(), "-o", output_}),
              RefusedNaming(folder_.path().string(), "--observed"));
  EXPECT_THAT(run_refield({"estimate", folder_ / "none", "-o", output_}),
              RefusedNaming("none", "capture session"));
}

/// The program under a limit of the system, its output left to the test's own.
int status_under_limit(__rlimit_resource resource, rlim_t value, std::vector<std::string> words) {
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  const pid_t child = ::fork();
  if (child == 0) {
    // Limits of processes do not hold root.
    if (resource == RLIMIT_NPROC && ::geteuid() == 0 && ::setresuid(4242, 4242, 4242) != 0) ::_exit(2);
    const rlimit limit{value, value}, no_core{0, 0};
    ::setrlimit(RLIMIT_CORE, &no_core);
    ::setrlimit(resource, &limit);
    ::execv(REFIELD_PROGRAM, argv.data());
    ::_exit(127);
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

// Libraries throw while they are loaded where no one can catch it; oneTBB where a thread is refused.
TEST_F(EstimateVerb, LimitsOfTheSystemEndItWithAMessage) {
  const std::vector<std::string> words = {"refield",
                                          "estimate",
                                          "--light",
                                          folder_ / "light/t_*.exr",
                                          "--observed",
                                          folder_ / "observed/t_*.exr",
                                          "--max-kernels",
                                          "4",
                                          "-o",
                                          output_};
  fs::permissions(folder_.path(), fs::perms::all);    // also for whom root becomes below
  const auto ended_well = testing::AnyOf(0, 2, 127);  // 127: the loader itself lacked memory
  for (const rlim_t mebibytes : {460, 480, 500, 540})
    EXPECT_THAT(status_under_limit(RLIMIT_AS, mebibytes << 20, words), ended_well) << mebibytes << " MiB";
  for (const rlim_t processes : {1, 2, 4, 6})
    EXPECT_THAT(status_under_limit(RLIMIT_NPROC, processes, words), ended_well) << processes << " processes";
}

TEST_F(EstimateVerb, AFullDisk) {
  const test::SmallDisk disk(256);
  if (!disk.mounted()) GTEST_SKIP() << test::needs_mounting;
  std::ofstream(disk / "f.rfield") << "old";
  disk.fill_leaving(8);
  const auto result = run_refield({"estimate", "--light", folder_ / "light", "--observed",
                                   folder_ / "observed", "--max-kernels", "4", "-o", disk / "f.rfield"});
  EXPECT_THAT(result, RefusedNaming("", "free some space"));
  EXPECT_TRUE(read_text(disk / "f.rfield") == "old") << "the output was touched";
}

}  // namespace
}  // namespace refield
