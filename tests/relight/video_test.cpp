// SPDX-License-Identifier: Apache-2.0
#include "relight/relight.h"

#include <gmock/gmock.h>

#include <cstdlib>
#include <fstream>
#include <iterator>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/image/image_io.h"
#include "tests/support/message_of.h"
#include "tests/support/random_data.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

constexpr LightDomain domain{24, 16, Parameterisation::monitor};
constexpr int frames = 12;

bool has_ffmpeg() {
  return std::system("ffmpeg -version >/dev/null 2>&1") == 0;
}

class Video : public testing::Test {
 protected:
  void SetUp() override {
    if (!has_ffmpeg()) GTEST_SKIP() << "ffmpeg is not installed";
  }
  std::vector<LightFunction> bar() const {
    std::vector<LightFunction> lights;
    for (int i = 0; i < frames; ++i)
      lights.emplace_back([i] { return sliding_bar(domain, 0.25, i, frames, 0.05f); });
    return lights;
  }

  Rng rng_{1};
  // Odd sizes, which 4:2:0 cannot hold as they are; 16×16 blocks of one value survive the compression.
  ReflectanceField field_ = smooth_field(33, 21);
  test::TemporaryFolder folder_;

 private:
  ReflectanceField smooth_field(int width, int height) {
    ReflectanceField field;
    field.width = width;
    field.height = height;
    field.basis = {domain, {}, {{0, 0, 12, 16}, {12, 0, 24, 16}}};
    for (int p = 0; p < width * height; ++p) {
      const auto share = static_cast<float>(p % width) / static_cast<float>(width);
      const std::vector<std::uint32_t> columns{0, 1};
      const std::vector<float> weights{share, 0.1f, 0.2f, 0.1f, 1.0f - share, 0.3f};
      field.transfer.append_row(columns, weights);
    }
    return field;
  }
};

TEST_F(Video, HoldsTheFramesInTheirOrder) {
  const ExposureReport report = relight_to_video(field_, bar(), folder_ / "bar.mp4", {});
  ASSERT_EQ(report.factors.size(), 1u);
  const std::string raw = folder_ / "raw.rgb";
  ASSERT_EQ(std::system(("ffmpeg -v error -i " + std::string(folder_ / "bar.mp4") +
                         " -f rawvideo -pix_fmt rgb24 " + raw)
                            .c_str()),
            0);
  const std::string decoded = read_text(raw);
  constexpr int width = 34, height = 22;
  ASSERT_EQ(decoded.size(), static_cast<std::size_t>(frames) * width * height * 3);
  const auto lights = bar();
  for (int f = 0; f < frames; ++f) {
    const auto expected = tone_mapped(field_.relight(std::get<LightMap>(lights[f]())), {report.factors[0]});
    double sum = 0.0;
    for (int y = 0; y < field_.height; ++y)
      for (int x = 0; x < 3 * field_.width; ++x) {
        const auto found =
            static_cast<unsigned char>(decoded[(static_cast<std::size_t>(f) * height + y) * 3 * width + x]);
        sum += std::abs(found - expected[static_cast<std::size_t>(y) * 3 * field_.width + x]);
      }
    EXPECT_LT(sum / static_cast<double>(expected.size()), 8.0) << "of 255, frame " << f;
  }
}

TEST_F(Video, EqualFramesGiveEqualFiles) {
  for (const char* name : {"a.mp4", "b.mp4"}) relight_to_video(field_, bar(), folder_ / name, {});
  EXPECT_EQ(read_text(folder_ / "a.mp4"), read_text(folder_ / "b.mp4"));
}

TEST_F(Video, LeavesNothingWhenItIsStopped) {
  std::ofstream(folder_ / "bar.mp4") << "old";
  auto lights = bar();
  lights[7] = []() -> LightMap { throw Interrupted(); };
  EXPECT_THROW(relight_to_video(field_, lights, folder_ / "bar.mp4", {}), Interrupted);
  EXPECT_EQ(read_text(folder_ / "bar.mp4"), "old");
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_.path()), {}), 1);
}

TEST_F(Video, TellsWhatFfmpegSays) {
  VideoWriter video(folder_ / "none/out.mp4", 16, 16, 30.0);
  EXPECT_THAT(test::message_of([&] {
                const std::vector<std::uint8_t> frame(16 * 16 * 3);
                for (int i = 0; i < 1000; ++i) video.add(frame);
                video.finish();
              }),
              AllOf(HasSubstr("out.mp4"), HasSubstr("No such file")));
}

TEST_F(Video, ChecksItsOptions) {
  EXPECT_THROW(relight_to_video(field_, bar(), folder_ / "a.mp4", {.frames_per_second = 0.0}), InputError);
}

TEST(VideoWithoutFfmpeg, SaysWhatToInstallOrToDoInstead) {
  const test::TemporaryFolder folder;
  const std::string path = std::getenv("PATH");
  setenv("PATH", folder.path().c_str(), 1);
  const std::string message = test::message_of([&] { VideoWriter(folder / "out.mp4", 16, 16, 30.0); });
  setenv("PATH", path.c_str(), 1);
  EXPECT_THAT(message, AllOf(HasSubstr("apt-get install ffmpeg"), HasSubstr("folder")));
}

}  // namespace
}  // namespace refield
