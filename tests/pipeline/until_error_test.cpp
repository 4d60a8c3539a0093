// SPDX-License-Identifier: Apache-2.0
// A capture that ends when its field would be good enough, and the order of its lights.
#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "core/base/files.h"
#include "core/session/capture_session.h"
#include "tests/pipeline/program.h"
#include "tests/pipeline/tiny_recipe.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using namespace test;
using testing::HasSubstr;

constexpr int planned = 40, primaries = 3;

class UntilError : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new test::TemporaryFolder;
    std::string recipe = tiny_recipe;
    recipe.replace(recipe.find("train = 10"), 10, "train = " + std::to_string(planned));
    write_text_atomically(*folder_ / "recipe.toml", recipe);
    ASSERT_EQ(run_program({"simulate", *folder_ / "recipe.toml", "-o", *folder_ / "truth"}, *folder_ / "log"),
              0);
  }
  static void TearDownTestSuite() { delete folder_; }

  int acquire(const std::string& session, std::vector<std::string> more) {
    std::vector<std::string> words = {"acquire",          "run", *folder_ / "recipe.toml", "--truth",
                                      *folder_ / "truth", "-o",  *folder_ / session};
    words.insert(words.end(), more.begin(), more.end());
    return run_program(words, *folder_ / "log");
  }
  static std::string log() { return read_text(*folder_ / "log"); }
  static std::vector<std::string> names_of(const std::string& session, FrameRole role) {
    std::vector<std::string> names;
    for (const CaptureFrame& frame : read_capture_session(*folder_ / session).frames_of(role))
      names.push_back(frame.name);
    return names;
  }

  static test::TemporaryFolder* folder_;
};
test::TemporaryFolder* UntilError::folder_ = nullptr;

TEST_F(UntilError, StopsWhenReachedAndKeepsHeldOutFrames) {
  ASSERT_EQ(acquire("easy", {"--until-error", "50%", "--min-images", "12"}), 0) << log();
  EXPECT_EQ(names_of("easy", FrameRole::train).size(), 12u);
  EXPECT_EQ(names_of("easy", FrameRole::train).front(), "primary_red");
  EXPECT_FALSE(names_of("easy", FrameRole::reference).empty());
  EXPECT_EQ(names_of("easy", FrameRole::test).size(), 5u);
  EXPECT_THAT(log(), HasSubstr("reached, 31 lights skipped"));
  // Complete: the same command again has nothing to do.
  ASSERT_EQ(acquire("easy", {"--until-error", "50%", "--min-images", "12", "--resume"}), 0) << log();
  EXPECT_THAT(log(), HasSubstr("already complete"));
  EXPECT_EQ(acquire("easy", {"--until-error", "10%", "--min-images", "12", "--resume"}), 2)
      << "another rule is another capture";
}

TEST_F(UntilError, TakesAllWhenItIsNotReached) {
  ASSERT_EQ(acquire("hard", {"--until-error", "0.0001%", "--min-images", "20"}), 0) << log();
  EXPECT_EQ(names_of("hard", FrameRole::train).size(), static_cast<std::size_t>(planned + primaries));
  EXPECT_THAT(log(), HasSubstr("after 40 photographs"));
  EXPECT_THAT(log(), HasSubstr("noise of the photographs is"));
}

TEST_F(UntilError, UsefulOrderIsAnotherOrderOfTheSameLights) {
  ASSERT_EQ(acquire("given", {}), 0) << log();
  ASSERT_EQ(acquire("useful", {"--order", "useful"}), 0) << log();
  auto given = names_of("given", FrameRole::train);
  auto useful = names_of("useful", FrameRole::train);
  EXPECT_NE(given, useful);
  EXPECT_TRUE(std::ranges::is_permutation(given, useful));
  // The photographs themselves do not depend on the order.
  EXPECT_EQ(read_text(*folder_ / "given/observed" / (useful.front() + ".exr")),
            read_text(*folder_ / "useful/observed" / (useful.front() + ".exr")));
}

TEST_F(UntilError, RefusesWhatItCannotMean) {
  EXPECT_EQ(acquire("bad", {"--until-error", "2 apples"}), 2);
  EXPECT_THAT(log(), HasSubstr("such as 2%"));
  EXPECT_EQ(acquire("bad", {"--until-error", "150%"}), 2);
  EXPECT_EQ(acquire("bad", {"--until-error", "2%", "--min-images", "3"}), 2);
  EXPECT_EQ(acquire("bad", {"--order", "best"}), 2);
  EXPECT_THAT(log(), HasSubstr("useful, given or random"));
}

}  // namespace
}  // namespace refield
