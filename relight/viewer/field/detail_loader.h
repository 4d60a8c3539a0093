// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "core/base/run_context.h"
#include "core/field_io/field_sampler.h"
#include "relight/viewer/field/view_relighter.h"
#include "relight/viewer/gui/background_job.h"

namespace refield {

/// What a window shows of a large image: a rectangle of it, at `scale` window pixels per image pixel.
struct VisibleRegion {
  Box region;
  double scale = 1.0;
  bool operator==(const VisibleRegion&) const = default;
};

/// Pixels of a large field for a window: every n-th of the whole image, which stay, and those of the visible
/// region at the resolution of the window. A window waits for a few of the first only; a job in the
/// background reads the others. Every n-th pixel, not the mean of n × n: means would need all entries of the
/// region, n² times as many bytes of the file.
class DetailLoader {
 public:
  /// Pixels of the whole image, which a window waits for, of it later, and of a region, at most.
  static constexpr std::int64_t max_first_pixels = std::int64_t{3} << 15;
  static constexpr std::int64_t max_coarse_pixels = std::int64_t{3} << 18;
  static constexpr std::int64_t max_detail_pixels = std::int64_t{9} << 18;

  /// Reads the first pixels. Throws what FieldSampler::read() throws.
  DetailLoader(std::unique_ptr<const FieldSampler> file, const RunContext& run);

  const FieldOutline& outline() const { return file_->outline(); }
  /// Of the whole image, as read so far.
  const std::shared_ptr<FieldPixels>& coarse() const { return coarse_; }
  /// The best pixels read so far that cover what is visible; starts to read better ones. Called once a frame.
  /// Throws what reading threw, once.
  std::shared_ptr<FieldPixels> show(const std::optional<VisibleRegion>& visible);
  bool is_reading() const { return job_ != nullptr; }
  /// Until reading ends, for a moment, if the last two calls of show() were for the same region: frames that
  /// show nothing new must not slow the reading.
  void wait_at_rest() const;

 private:
  PixelGrid grid_for(const VisibleRegion& visible) const;
  /// What is to be read for a window that shows a region, or none; nothing where that has been read or
  /// failed.
  std::optional<PixelGrid> wanted(const std::optional<VisibleRegion>& visible) const;
  /// Whether a grid shows a region with room for a move, at the resolution of the window.
  bool is_good(const PixelGrid& grid, const VisibleRegion& visible) const;
  void take_read();
  void read(const PixelGrid& grid);

  std::unique_ptr<const FieldSampler> file_;
  RunContext run_;
  PixelGrid whole_;  // of the coarse pixels, in the end
  std::shared_ptr<FieldPixels> coarse_, detail_;
  std::optional<VisibleRegion> visible_;  // in the last show()
  bool is_at_rest_ = false;
  PixelGrid reading_;  // of the job, or of the last one, which may have failed
  bool has_failed_ = false;
  std::unique_ptr<BackgroundJob<std::shared_ptr<FieldPixels>>> job_;
};

}  // namespace refield
