// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/field/view_state.h"

namespace refield {

namespace {

/// Of the visible width and height at each side, so that small moves need no reading.
constexpr double margin = 0.125;

std::int64_t pixel_count(const PixelGrid& grid) {
  return std::int64_t{grid.width()} * grid.height();
}

int stride_at(double scale) {
  return std::max(1, static_cast<int>(std::lround(1.0 / scale)));
}

bool covers(const Box& outer, const Box& inner) {
  return outer.x0 <= inner.x0 && outer.y0 <= inner.y0 && outer.x1 >= inner.x1 && outer.y1 >= inner.y1;
}

/// A region with a share of its size more at each side, where the image goes on.
Box widened(const Box& region, double share, const FieldOutline& image) {
  const int dx = static_cast<int>(share * region.width()), dy = static_cast<int>(share * region.height());
  return {std::max(0, region.x0 - dx), std::max(0, region.y0 - dy), std::min(image.width, region.x1 + dx),
          std::min(image.height, region.y1 + dy)};
}

std::shared_ptr<FieldPixels> read_pixels(const FieldSampler& file, const PixelGrid& grid,
                                         const RunContext& run) {
  return std::make_shared<FieldPixels>(file.read(grid, run), grid);
}

}  // namespace

DetailLoader::DetailLoader(std::unique_ptr<const FieldSampler> file, const RunContext& run)
    : file_(std::move(file)),
      run_(run),
      whole_(file_->whole_image(max_coarse_pixels)),
      coarse_(read_pixels(*file_, file_->whole_image(max_first_pixels), run)) {}

PixelGrid DetailLoader::grid_for(const VisibleRegion& visible) const {
  PixelGrid grid{widened(visible.region, margin, outline()), stride_at(visible.scale)};
  while (pixel_count(grid) > max_detail_pixels) ++grid.stride;
  grid.region.x0 -= grid.region.x0 % grid.stride;
  grid.region.y0 -= grid.region.y0 % grid.stride;
  return grid;
}

bool DetailLoader::is_good(const PixelGrid& grid, const VisibleRegion& visible) const {
  return grid.stride == grid_for(visible).stride &&
         covers(grid.region, widened(visible.region, 0.5 * margin, outline()));
}

std::optional<PixelGrid> DetailLoader::wanted(const std::optional<VisibleRegion>& visible) const {
  const auto is_useful = [&](const PixelGrid& grid) {
    return grid.stride < coarse_->grid.stride && !(has_failed_ && grid == reading_);
  };
  if (is_useful(whole_)) return whole_;
  if (!visible || (detail_ && is_good(detail_->grid, *visible))) return std::nullopt;
  const PixelGrid grid = grid_for(*visible);
  return is_useful(grid) ? std::optional(grid) : std::nullopt;
}

std::shared_ptr<FieldPixels> DetailLoader::show(const std::optional<VisibleRegion>& visible) {
  take_read();
  is_at_rest_ = std::exchange(visible_, visible) == visible;
  const bool needs_detail = visible && stride_at(visible->scale) < coarse_->grid.stride;
  if (job_) {
    if (reading_ != whole_ && !(needs_detail && is_good(reading_, *visible))) job_->cancel();
  } else if (const auto grid = wanted(visible)) {
    read(*grid);
  }
  return needs_detail && detail_ && covers(detail_->grid.region, visible->region) ? detail_ : coarse_;
}

void DetailLoader::read(const PixelGrid& grid) {
  reading_ = grid;
  has_failed_ = false;
  job_ = std::make_unique<BackgroundJob<std::shared_ptr<FieldPixels>>>(
      [this, grid] { return read_pixels(*file_, grid, run_); });
}

void DetailLoader::take_read() {
  if (!job_ || !job_->wait_for(std::chrono::microseconds(0))) return;
  const auto job = std::exchange(job_, nullptr);
  if (job->is_cancelled()) return;
  has_failed_ = true;
  (reading_ == whole_ ? coarse_ : detail_) = job->take();
  has_failed_ = false;
}

void DetailLoader::wait_at_rest() const {
  constexpr std::chrono::milliseconds moment(50);  // input waits no longer
  if (job_ && is_at_rest_) job_->wait_for(moment);
}

}  // namespace refield
