// SPDX-License-Identifier: Apache-2.0
#include "acquire/capture/scene_mask.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/base/errors.h"
#include "core/base/rng.h"
#include "core/session/capture_session.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

constexpr int width = 40;
constexpr int height = 30;
constexpr float sigma = 0.01f;

bool in_object(int x, int y) {
  return x >= 10 && x < 25 && y >= 8 && y < 20;
}

/// A noisy photograph: an object before a backdrop.
Photograph photograph(float object, float backdrop, std::uint64_t seed) {
  Photograph p{Image(width, height, 3), Image(width, height, 3, sigma)};
  Rng noise(seed);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < 3; ++c)
        p.radiance.at(x, y, c) =
            (in_object(x, y) ? object : backdrop) + sigma * static_cast<float>(noise.normal());
  return p;
}

void expect_object(const Mask& mask) {
  int wrong = 0;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) wrong += (mask[y * width + x] != 0) != in_object(x, y);
  EXPECT_LE(wrong, 4);  // opening may round the corners
}

TEST(SceneMask, FindsWhatRespondsToTheMonitor) {
  expect_object(scene_mask(photograph(0.5f, 0.0f, 1)));
}

TEST(SceneMask, FindsWhatDiffersFromTheBackground) {
  const Photograph background = photograph(0.3f, 0.3f, 2);
  expect_object(scene_mask(photograph(0.5f, 0.3f, 3), &background));
  expect_object(scene_mask(photograph(0.1f, 0.3f, 3), &background));  // a dark object
}

TEST(SceneMask, CleansSpecksAndHoles) {
  Photograph noisy = photograph(0.5f, 0.0f, 4);
  for (int c = 0; c < 3; ++c) {
    noisy.radiance.at(35, 25, c) = 0.5f;  // a speck
    noisy.radiance.at(15, 12, c) = 0.0f;  // a hole
  }
  expect_object(scene_mask(noisy));
}

TEST(SceneMask, ClippedSamplesRespond) {
  Photograph clipped = photograph(0.5f, 0.0f, 5);
  for (int y = 8; y < 20; ++y)
    for (int x = 10; x < 25; ++x)
      for (int c = 0; c < 3; ++c) clipped.sigma.at(x, y, c) = INFINITY;
  expect_object(scene_mask(clipped));
}

TEST(SceneMask, SaysWhenNothingResponds) {
  EXPECT_THROW(scene_mask(photograph(0.0f, 0.0f, 6)), InputError);
  const Photograph other{Image(2, 2, 3), Image(2, 2, 3)};
  EXPECT_THROW(scene_mask(photograph(0.5f, 0.0f, 6), &other), InputError);
}

TEST(SceneMask, FileRoundTrip) {
  const test::TemporaryFolder folder;
  const Mask mask = scene_mask(photograph(0.5f, 0.0f, 7));
  write_mask(folder / "mask.png", mask, width, height);
  EXPECT_EQ(read_mask(folder / "mask.png", width, height), mask);
}

}  // namespace
}  // namespace refield
