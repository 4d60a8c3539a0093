// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "refield/relight.h"
#include "relight/relight.h"

namespace refield {

struct VideoOptions {
  double frames_per_second = 30.0;
  std::optional<double> exposure{};  ///< factor on the radiance, as for PNG files; none: automatic

  /// Throws InputError naming the option and its range.
  void check() const;
};

/// Frames on their way into the program `ffmpeg`, which encodes them as they come (H.264, 4:2:0, BT.709).
/// Equal frames give equal files with equal versions of ffmpeg, on any number of cores.
class VideoWriter {
 public:
  /// Frames of width × height pixels go to `file`, whose name ends in .mp4. Throws DeviceError where ffmpeg
  /// is not installed or cannot be started.
  VideoWriter(const std::filesystem::path& file, int width, int height, double frames_per_second);
  /// Ends ffmpeg; what was written is of no use unless finish() was called.
  ~VideoWriter();
  VideoWriter(const VideoWriter&) = delete;
  VideoWriter& operator=(const VideoWriter&) = delete;

  /// One frame, [height × width × 3] bytes, sRGB. Throws DeviceError with ffmpeg's words when it gave up.
  void add(std::span<const std::uint8_t> frame, const RunContext& run = {});

  /// Waits until the file is complete. Throws DeviceError with ffmpeg's words when it failed.
  void finish();

 private:
  [[noreturn]] void fail();
  int wait();

  std::filesystem::path file_;
  int pipe_ = -1;      // our end of a socket pair: ffmpeg's standard input
  int messages_ = -1;  // ffmpeg's standard error, in memory
  int process_ = -1;
};

/// Relights `field` for each light in turn and writes the images as a video, with progress. Several images
/// are made at a time; none is kept once it is encoded. The file appears when it is complete. Throws
/// Interrupted between frames, DeviceError where ffmpeg is missing or fails, and what the lights throw.
ExposureReport relight_to_video(const FieldPictures& field, const std::vector<LightFunction>& lights,
                                const std::filesystem::path& output, const VideoOptions& options,
                                const RunContext& run = {});

}  // namespace refield
