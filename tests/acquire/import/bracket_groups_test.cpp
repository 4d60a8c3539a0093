// SPDX-License-Identifier: Apache-2.0
#include "acquire/import/import_series.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/base/errors.h"

namespace refield {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Paths = std::vector<std::filesystem::path>;
using Times = std::vector<std::optional<Seconds>>;

Times seconds(std::initializer_list<double> values) {
  Times times;
  for (double value : values) times.push_back(value > 0.0 ? std::optional(Seconds(value)) : std::nullopt);
  return times;
}

std::string refusal(const Paths& files, const Times& times, const GroupRule& rule) {
  try {
    group_brackets(files, times, rule);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(BracketGroups, ByPattern) {
  const Paths files = {"train_1_e0.tif", "train_1_e1.tif", "train_2_e0.tif", "train_2_e1.tif"};
  for (const char* pattern : {"{light}_e?.tif", "{light}_e*"}) {
    const auto groups = group_brackets(files, Times(4), {pattern, 0});
    ASSERT_EQ(groups.size(), 2U);
    EXPECT_EQ(groups[0].name, "train_1");
    EXPECT_THAT(groups[1].paths, ElementsAre("train_2_e0.tif", "train_2_e1.tif"));
  }
  EXPECT_THAT(refusal(files, Times(4), {"{light}_x*", 0}),
              HasSubstr("train_1_e0.tif: does not match --names"));
  EXPECT_THAT(refusal(files, Times(4), {"train_*", 0}), HasSubstr("{light} exactly once"));
  EXPECT_THAT(refusal(files, Times(4), {"{light}.(tif", 0}),
              HasSubstr("does not match"));  // no regular expression
  EXPECT_THAT(refusal({"a_e0.tif", "a_e1.tif", "b_e0.tif"}, Times(3), {"{light}_e*", 0}),
              HasSubstr("b_e0.tif: its bracket has 1 exposures"));
}

TEST(BracketGroups, ByCount) {
  const Paths files = {"1.jpg", "2.jpg", "3.jpg", "4.jpg", "5.jpg", "6.jpg"};
  const auto groups = group_brackets(files, Times(6), {"", 3});
  ASSERT_EQ(groups.size(), 2U);
  EXPECT_EQ(groups[1].name, "4");
  EXPECT_THAT(refusal(files, Times(6), {"", 4}), HasSubstr("do not make brackets of 4"));
  EXPECT_THAT(refusal(files, Times(6), {"{light}", 4}), HasSubstr("not both"));
}

TEST(BracketGroups, ByExposureTimesThatComeAgain) {
  const Paths files = {"1.jpg", "2.jpg", "3.jpg", "4.jpg", "5.jpg", "6.jpg"};
  // Metadata round: 0.0333 and 0.0334 are one time.
  const auto groups = group_brackets(files, seconds({0.0333, 0.125, 0.5, 0.0334, 0.125, 0.5}), {});
  ASSERT_EQ(groups.size(), 2U);
  EXPECT_THAT(groups[1].paths, ElementsAre("4.jpg", "5.jpg", "6.jpg"));
  EXPECT_THAT(refusal(files, seconds({0.1, 0.2, 0.0, 0.1, 0.2, 0.4}), {}),
              HasSubstr("3.jpg: does not contain its exposure time"));
  // One frame was lost: its bracket is identified by its length.
  EXPECT_THAT(refusal(files, seconds({0.1, 0.2, 0.4, 0.1, 0.4, 0.1}), {}),
              HasSubstr("4.jpg: its bracket has 2"));
}

}  // namespace
}  // namespace refield
