// SPDX-License-Identifier: Apache-2.0
// What the viewer's window is made of, without the window.
#include <gtest/gtest.h>
#include <tbb/parallel_for.h>

#include <atomic>
#include <chrono>
#include <latch>
#include <thread>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/run_context.h"
#include "relight/viewer/field/light_painter.h"
#include "relight/viewer/gui/background_job.h"
#include "relight/viewer/gui/canvas.h"
#include "relight/viewer/gui/gl_window.h"
#include "relight/viewer/gui/viewer_window.h"
#include "tests/support/random_data.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

double mean(const Image& image) {
  double sum = 0.0;
  for (const float value : image.values) sum += value;
  return sum / static_cast<double>(image.values.size());
}

TEST(FitLight, ResamplesByAreaAndSaysSo) {
  Rng rng{4};
  const Image map = test::random_image(rng, 64, 32, 3);
  const LightDomain sphere{20, 10, Parameterisation::lat_long};
  const FittedLight smaller = fit_light(map, sphere);
  EXPECT_EQ(smaller.light.domain(), sphere);
  EXPECT_EQ(smaller.note, "64×32 to 20×10, by area");
  EXPECT_NEAR(mean(smaller.light.radiance), mean(map), 1e-6);
  const FittedLight same = fit_light(map, {64, 32, Parameterisation::monitor});
  EXPECT_EQ(same.light.radiance.values, map.values);
  EXPECT_EQ(same.note, "");
  EXPECT_EQ(fit_light(map, {8, 6, Parameterisation::monitor}).note, "64×32 to 8×6, by area, sides cropped");
  EXPECT_EQ(fit_light(map, {30, 10, Parameterisation::monitor}).note,
            "64×32 to 30×10, by area, top and bottom cropped");
}

TEST(FitLight, RefusesMapsOfAnotherKind) {
  EXPECT_THROW(fit_light(Image(30, 30, 3), {20, 10, Parameterisation::lat_long}), InputError);
  EXPECT_THROW(fit_light(Image(64, 32, 3), {8, 48, Parameterisation::cube}), InputError);
  EXPECT_NO_THROW(fit_light(Image(16, 96, 3), {8, 48, Parameterisation::cube}));
}

TEST(InputQueue, KeepsClicksApart) {
  using Kind = InputEvent::Kind;
  InputQueue queue;
  for (const Kind kind : {Kind::mouse_move, Kind::mouse_move, Kind::mouse_button, Kind::other,
                          Kind::mouse_move, Kind::mouse_button, Kind::mouse_button})
    queue.push({.kind = kind});
  std::vector<std::size_t> frames;
  while (!queue.is_empty()) frames.push_back(queue.take_frame().size());
  EXPECT_EQ(frames, (std::vector<std::size_t>{4, 2, 1}));
}

TEST(Canvas, FitsZoomsAndPans) {
  Canvas canvas;
  const Area area{10, 20, 400, 300};
  canvas.lay_out(area, 100, 50);
  EXPECT_DOUBLE_EQ(canvas.scale(), 4.0);
  const Point middle = canvas.window_from_image({50, 25});
  EXPECT_NEAR(middle.x, 210, 1.0);
  EXPECT_NEAR(middle.y, 170, 1.0);
  const Point fixed{100, 120}, before = canvas.image_from_window(fixed);
  canvas.zoom_about(fixed, 2.0);
  EXPECT_DOUBLE_EQ(canvas.scale(), 8.0);
  EXPECT_NEAR(canvas.image_from_window(fixed).x, before.x, 1e-9);
  EXPECT_NEAR(canvas.image_from_window(fixed).y, before.y, 1e-9);
  canvas.zoom_to(1.0);
  canvas.pan(3.4, 0.0);
  canvas.lay_out(area, 100, 50);
  EXPECT_DOUBLE_EQ(canvas.scale(), 1.0);
  EXPECT_DOUBLE_EQ(canvas.origin().x, std::round(canvas.origin().x));  // pixel on pixel
  canvas.lay_out(area, 200, 50);                                       // another image: as large as fits
  EXPECT_DOUBLE_EQ(canvas.scale(), 2.0);
  canvas.zoom_about(fixed, 1e9);
  EXPECT_DOUBLE_EQ(canvas.scale(), 64.0);
}

TEST(BackgroundJob, GivesResultsAndErrors) {
  BackgroundJob<int> sum([] { return 2 + 3; });
  sum.wait();
  EXPECT_TRUE(sum.wait_for(std::chrono::microseconds(0)));
  EXPECT_EQ(sum.take(), 5);
  BackgroundJob<int> failing([]() -> int { throw InputError("no such map"); });
  EXPECT_THROW(failing.take(), InputError);
}

// Parallel loops within it end early, and no one takes what they left behind.
TEST(BackgroundJob, EndsSoonOnceCancelled) {
  std::atomic<int> begun{0};
  std::latch cancelled(1);
  BackgroundJob<int> job([&] {
    tbb::parallel_for(0, 1000, [&](int) {
      RunContext{}.throw_if_stopped();
      ++begun;
      cancelled.wait();
    });
    RunContext{}.throw_if_stopped();
    return 1;
  });
  while (begun == 0) std::this_thread::yield();
  EXPECT_FALSE(job.wait_for(std::chrono::microseconds(0)));
  job.cancel();
  cancelled.count_down();
  EXPECT_THROW(job.take(), Interrupted);
  EXPECT_LE(begun, tbb::this_task_arena::max_concurrency());
  EXPECT_NO_THROW(RunContext{}.throw_if_stopped());  // here nothing was cancelled
}

TEST(BackgroundJob, WorkThatMustBeCompleteIsNotCutShort) {
  std::atomic<int> done{0};
  std::atomic<bool> is_begun{false};
  std::latch cancelled(1);
  BackgroundJob<int> job([&] {
    run_uncancelled([&] {
      tbb::parallel_for(0, 40, [&](int) {
        is_begun = true;
        cancelled.wait();
        RunContext{}.throw_if_stopped();
        ++done;
      });
    });
    return 1;
  });
  while (!is_begun) std::this_thread::yield();
  job.cancel();
  cancelled.count_down();
  EXPECT_THROW(job.take(), Interrupted);
  EXPECT_EQ(done, 40);
}

TEST(FileDialog, ListsWhatCanBeOpened) {
  const test::TemporaryFolder folder;
  std::filesystem::create_directory(folder / "maps");
  for (const char* name : {"sky.exr", "a.rfield", "notes.txt", ".hidden.exr", "maps/b.hdr"})
    write_text_atomically(folder / name, "");
  using Files = std::vector<std::filesystem::path>;
  FileDialog dialog(FileDialog::Purpose::open, folder.path());
  EXPECT_EQ(dialog.folders, Files{folder / "maps"});
  EXPECT_EQ(dialog.files, (Files{folder / "a.rfield", folder / "sky.exr"}));
  dialog.go_to(folder / "maps/");
  EXPECT_EQ(dialog.folder, folder / "maps");
  EXPECT_EQ(dialog.files, Files{folder / "maps/b.hdr"});
  dialog.go_to(folder / "none");
  EXPECT_TRUE(dialog.files.empty() && dialog.folders.empty());
}

}  // namespace
}  // namespace refield
