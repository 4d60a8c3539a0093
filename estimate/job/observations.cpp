// SPDX-License-Identifier: Apache-2.0
#include "estimate/job/observations.h"

#include <tbb/parallel_for.h>

#include <cmath>

#include "core/base/number_text.h"
#include "core/base/run_context.h"
#include "core/image/image_io.h"
#include "core/session/capture_session.h"
#include "estimate/fit/vector_kernels.h"

namespace refield {

namespace {

/// Images are transposed this many at a time: a cache line of floats.
constexpr int group_size = 16;
constexpr float unknown = std::numeric_limits<float>::quiet_NaN();

/// A photograph's rows. `unmeasured` [samples] tells which show no more than a lower bound.
Photograph read_measured_rows(const CaptureFrame& frame, int width, int first_row, int last_row,
                              float clip_level, std::vector<char>& unmeasured) {
  Photograph photograph = read_observed_rows(frame, first_row, last_row);
  const Image& radiance = photograph.radiance;
  if (radiance.width != width)
    throw InputError(frame.observed, ": is ", radiance.width, " pixels wide, not ", width);
  const auto refuse = [&](std::size_t i, const char* quantity, float value, const char* remedy) {
    static constexpr const char* channels[] = {"red", "green", "blue"};
    throw InputError(frame.observed, ": pixel (", i / 3 % width, ", ",
                     first_row + static_cast<int>(i / 3) / width, "), ", channels[i % 3], ", has a ",
                     quantity, " of ", formatted("%.4g", static_cast<double>(value)), "; ", remedy);
  };
  unmeasured.assign(radiance.values.size(), 0);
  for (std::size_t i = 0; i < radiance.values.size(); ++i) {
    const float value = radiance.values[i];
    const float sigma = photograph.sigma.empty() ? 0.0f : photograph.sigma.values[i];
    if (!(sigma >= 0.0f))
      refuse(i, "noise estimate (sigma)", sigma,
             "a standard deviation is 0 or more, and infinite where nothing was measured");
    // The camera clips before drift is divided out.
    const bool clipped = std::isfinite(clip_level) && value * frame.gain[i % 3] >= clip_level;
    unmeasured[i] = clipped || std::isinf(sigma);
    if (!unmeasured[i] && !(std::abs(value) <= largest_radiance))
      refuse(i, "radiance", value,
             "repair it, leave the image out, or mark the sample as unmeasured (sigma = inf)");
  }
  return photograph;
}

/// Adds σ² of measured samples to `squared_noise`, [pixels], from sample `first` on.
void add_noise(const Image& sigma, const std::vector<char>& unmeasured, std::size_t first,
               std::span<float> squared_noise) {
  if (sigma.empty()) {
    std::ranges::fill(squared_noise, unknown);
    return;
  }
  for (std::size_t i = 0; i < 3 * squared_noise.size(); ++i)
    if (!unmeasured[first + i]) squared_noise[i / 3] += sigma.values[first + i] * sigma.values[first + i];
}

/// The same without what the rig did, but for the room light; NaN where not measured. Adds σ² to
/// `squared_noise`, [rows × width]: as the camera states it, before channels were unmixed and pixels moved.
Image read_checked_rows(const CaptureFrame& frame, int width, int first_row, int last_row, float clip_level,
                        std::span<float> squared_noise) {
  std::vector<char> unmeasured;
  if (!frame.correction) {
    auto [rows, sigma] = read_measured_rows(frame, width, first_row, last_row, clip_level, unmeasured);
    add_noise(sigma, unmeasured, 0, squared_noise);
    for (std::size_t i = 0; i < unmeasured.size(); ++i)
      if (unmeasured[i]) rows.values[i] = unknown;
    return std::move(rows);
  }
  const int margin = rig_margin(frame.correction.get());
  const int first = std::max(0, first_row - margin),
            last = std::min(frame.correction->height_px, last_row + margin);
  const auto [rows, sigma] = read_measured_rows(frame, width, first, last, clip_level, unmeasured);
  add_noise(sigma, unmeasured, std::size_t{3} * (first_row - first) * width, squared_noise);
  return undo_rig(rows, unmeasured, first, first_row, last_row, *frame.correction);
}

/// Rows of the ambient photograph that a frame's correction names, for its primaries.
Image room_picture(const CaptureFrame& frame, const ObservationBand& band) {
  CaptureFrame dark = frame;
  dark.observed = frame.correction->ambient;
  dark.gain = {1.0f, 1.0f, 1.0f};
  dark.views.reset();
  FrameCorrection unmixing;
  unmixing.width_px = frame.correction->width_px;
  unmixing.height_px = frame.correction->height_px;
  unmixing.primaries_from_camera = frame.correction->primaries_from_camera;
  dark.correction = std::make_shared<const FrameCorrection>(unmixing);
  std::vector<float> squared_noise(static_cast<std::size_t>(band.last_row() - band.first_row()) *
                                   band.width());
  return read_checked_rows(dark, band.width(), band.first_row(), band.last_row(),
                           std::numeric_limits<float>::infinity(), squared_noise);
}

/// Photograph j loses room_j times the ambient photograph or, without, the grey mean of all photographs.
void remove_room_light(std::span<const CaptureFrame> frames, ObservationBand& band) {
  const auto lit = std::ranges::find_if(
      frames, [](const CaptureFrame& frame) { return frame.correction && frame.correction->room != 0.0f; });
  if (lit == frames.end()) return;
  Image ambient;
  if (!lit->correction->ambient.empty()) ambient = room_picture(*lit, band);
  tbb::parallel_for(band.first_row(), band.last_row(), [&](int y) {
    for (int x = 0; x < band.width(); ++x) {
      double sum = 0.0;
      int count = 0;
      for (int c = 0; c < 3; ++c)
        for (int j = 0; j < band.images(); ++j)
          if (const float value = band.samples(x, y, c)[j]; std::isfinite(value)) {
            sum += value;
            ++count;
          }
      const auto mean = static_cast<float>(count > 0 ? sum / count : 0.0);
      for (int c = 0; c < 3; ++c) {
        const float shown = ambient.empty() ? mean : ambient.at(x, y - band.first_row(), c);
        const float room = std::isfinite(shown) ? shown : 0.0f;
        for (int j = 0; j < band.images(); ++j)
          if (frames[j].correction) band.samples(x, y, c)[j] -= frames[j].correction->room * room;
      }
    }
  });
}

}  // namespace

ObservationBand::ObservationBand(int width, int first_row, int last_row, int images)
    : width_(width),
      first_row_(first_row),
      last_row_(last_row),
      images_(images),
      stride_(padded_length(images)),
      samples_(static_cast<std::size_t>(last_row - first_row) * width * 3 * stride_),
      squared_noise_(static_cast<std::size_t>(last_row - first_row) * width, 0.0) {}

std::optional<double> ObservationBand::squared_noise(int x, int y) const {
  const double squared = squared_noise_[static_cast<std::size_t>(y - first_row_) * width_ + x];
  return squared > 0.0 ? std::optional(squared) : std::nullopt;
}

void ObservationBand::add_noise(std::span<const float> squared) {
  std::ranges::transform(squared_noise_, squared, squared_noise_.begin(), std::plus<double>());
}

void ObservationBand::weight_images(std::span<const float> weights) {
  tbb::parallel_for(first_row_, last_row_, [&](int y) {
    for (int x = 0; x < width_; ++x)
      for (int c = 0; c < 3; ++c) {
        float* values = samples(x, y, c);
        for (int j = 0; j < images_; ++j) values[j] *= weights[j];
      }
  });
}

std::uint64_t ObservationBand::bytes(int width, int rows, int images) {
  return static_cast<std::uint64_t>(width) * rows * 3 * padded_length(images) * sizeof(float);
}

ObservationBand read_observations(std::span<const CaptureFrame> frames, int width, int first_row,
                                  int last_row, float clip_level, const RunContext& run) {
  const int images = static_cast<int>(frames.size());
  ObservationBand band(width, first_row, last_row, images);
  const int groups = (images + group_size - 1) / group_size;
  std::vector<std::vector<float>> squared_noise(groups);  // added in their order, whichever is read first
  tbb::parallel_for(0, groups, [&](int group) {
    squared_noise[group].assign(static_cast<std::size_t>(last_row - first_row) * width, 0.0f);
    const int first = group * group_size;
    const int last = std::min(first + group_size, images);
    std::vector<Image> held;
    for (int j = first; j < last; ++j) {
      run.throw_if_stopped();
      held.push_back(
          read_checked_rows(frames[j], width, first_row, last_row, clip_level, squared_noise[group]));
    }
    for (int y = first_row; y < last_row; ++y)
      for (int x = 0; x < width; ++x)
        for (int c = 0; c < 3; ++c) {
          float* samples = band.samples(x, y, c) + first;
          for (int j = first; j < last; ++j) samples[j - first] = held[j - first].at(x, y - first_row, c);
        }
  });
  for (const std::vector<float>& of_group : squared_noise) band.add_noise(of_group);
  remove_room_light(frames, band);
  return band;
}

}  // namespace refield
