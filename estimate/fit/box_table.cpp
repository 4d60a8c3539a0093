// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/box_table.h"

#include <tbb/parallel_for.h>

#include <cmath>
#include <cstdio>

#include "core/base/run_context.h"
#include "core/image/image_io.h"
#include "estimate/fit/vector_kernels.h"
#include "estimate/job/observations.h"

namespace refield {

namespace {

/// Lights are scattered into the table this many at a time: one cache line of doubles.
constexpr int group_size = 8;

}  // namespace

void require_usable(const LightMap& light, const LightDomain& domain, const std::string& name) {
  if (light.domain() != domain)
    throw InputError(name + ": the light map is " + shape_text(light.radiance) + ", the others are " +
                     std::to_string(domain.width) + "×" + std::to_string(domain.height) + "; resample it");
  const auto& values = light.radiance.values;
  const auto beyond = std::ranges::find_if(values, [](float v) { return !(v <= largest_radiance); });
  if (beyond != values.end()) {
    const auto texel = static_cast<int>((beyond - values.begin()) / 3);
    char text[160];
    std::snprintf(
        text, sizeof text,
        ": texel (%d, %d) of the light map has an impossible radiance of %.4g; repair it or remove the image",
        texel % domain.width, texel / domain.width, static_cast<double>(*beyond));
    throw InputError(name + text);
  }
  if (std::ranges::all_of(values, [](float v) { return v == 0.0f; }))
    throw InputError(name + ": the light map is black everywhere and contains no information; remove it");
}

BoxTable::BoxTable(LightDomain domain, int images, HatGrid hats)
    : domain_(domain),
      images_(images),
      stored_images_(images),
      stride_(padded_length(images)),
      hats_(hats),
      weights_(images, 1.0f),
      hat_sums_(std::size_t{3} * hats.count() * images) {
  const auto values = std::make_shared<AlignedDoubles>(size());
  prefix_ = {values, values->data()};
}

BoxTable BoxTable::subset(const std::vector<int>& images) const {
  BoxTable part = *this;
  part.selected_.clear();
  for (const int j : images) part.selected_.push_back(selected_.empty() ? j : selected_[j]);
  part.images_ = static_cast<int>(images.size());
  part.stride_ = padded_length(part.images_);
  part.weights_.clear();
  for (const int j : images) part.weights_.push_back(weights_[j]);
  part.hat_sums_.clear();
  for (int i = 0; i < 3 * hats_.count(); ++i)
    for (const int j : images) part.hat_sums_.push_back(hat_sums_[static_cast<std::size_t>(i) * images_ + j]);
  return part;
}

BoxTable::BoxTable(std::span<const CaptureFrame> frames, LightDomain domain, HatGrid hats,
                   const RunContext& run)
    : BoxTable(domain, static_cast<int>(frames.size()), hats) {
  Progress progress(run, "light maps", frames.size());
  const int groups = (images_ + group_size - 1) / group_size;
  std::vector<LightSketch> sketches(frames.size());
  tbb::parallel_for(0, groups, [&](int group) {
    std::vector<LightMap> held;
    const int first = group * group_size;
    for (int j = first; j < std::min(first + group_size, images_); ++j) {
      run.throw_if_stopped();
      held.push_back(read_illumination(frames[j], domain.parameterisation, run));
      require_usable(held.back(), domain, frames[j].illumination.string());
      progress.advance();
    }
    fill(held, first, sketches);
  });
  groups_ = refield::light_groups(sketches);
  light_rank_ = refield::light_rank(sketches);
  integrate(run);
}

BoxTable::BoxTable(std::span<const LightMap> lights, HatGrid hats, const RunContext& run)
    : BoxTable(lights.empty() ? throw InputError("no light maps were given") : lights[0].domain(),
               static_cast<int>(lights.size()), hats) {
  for (const LightMap& light : lights) require_usable(light, domain_, "light map");
  std::vector<LightSketch> sketches(lights.size());
  for (int first = 0; first < images_; first += group_size)
    fill(lights.subspan(first, std::min(group_size, images_ - first)), first, sketches);
  groups_ = refield::light_groups(sketches);
  light_rank_ = refield::light_rank(sketches);
  integrate(run);
}

void BoxTable::fill(std::span<const LightMap> lights, int first, std::span<LightSketch> sketches) {
  for (std::size_t j = 0; j < lights.size(); ++j) {
    sketches[first + j] = sketch_of(lights[j].radiance);
    const auto sums = hats_.project(lights[j]);
    for (std::size_t i = 0; i < sums.size(); ++i) hat_sums_[i * images_ + first + j] = sums[i];
  }
  for (int y = 0; y < domain_.height; ++y)
    for (int x = 0; x < domain_.width; ++x) {
      double* entry = writable() + (corner(x + 1, y + 1) - prefix_.get());
      for (int c = 0; c < 3; ++c)
        for (std::size_t j = 0; j < lights.size(); ++j)
          entry[static_cast<std::size_t>(c) * images_ + first + j] = lights[j].radiance.at(x, y, c);
    }
}

void BoxTable::integrate(const RunContext& run) {
  const std::size_t entry = std::size_t{3} * images_;
  const std::size_t row = entry * (domain_.width + 1);
  // Along rows, then down columns; both walk contiguous memory.
  tbb::parallel_for(1, domain_.height + 1, [&](int y) {
    run.throw_if_stopped();
    double* current = writable() + row * y + entry;
    for (std::size_t i = 0; i < row - 2 * entry; ++i) current[entry + i] += current[i];
  });
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, row, 4096), [&](const auto& range) {
    run.throw_if_stopped();
    for (int y = 1; y <= domain_.height; ++y) {
      const double* above = prefix_.get() + row * (y - 1);
      double* current = writable() + row * y;
      for (std::size_t i = range.begin(); i != range.end(); ++i) current[i] += above[i];
    }
  });
  choose_unit();
}

void BoxTable::choose_unit() {
  // Lights of 100 000 texels, as displays and cameras measure them, need none.
  constexpr double min_total = 0x1p-10, max_total = 0x1p24, too_dim = 1e-20;
  const double* totals = corner(domain_.width, domain_.height);
  const double largest = *std::max_element(totals, totals + std::size_t{3} * images_);
  if (largest >= min_total && largest <= max_total) return;
  if (!(largest > too_dim))
    throw InputError(
        "the texels of each light map add up to less than 1e-20, too little for the computation; scale all "
        "light maps by the same factor");
  unit_ = std::exp2(std::ilogb(largest));
  const double factor = 1.0 / unit_;
  for (double& sum : hat_sums_) sum *= factor;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, size(), 1 << 16), [&](const auto& range) {
    for (std::size_t i = range.begin(); i != range.end(); ++i) writable()[i] *= factor;
  });
}

void BoxTable::weight_images(std::span<const float> weights) {
  const auto multiply = [&](double* sums) {
    for (int j = 0; j < images_; ++j) sums[j] *= weights[j];
  };
  for (int i = 0; i < 3 * hats_.count(); ++i)
    multiply(hat_sums_.data() + static_cast<std::size_t>(i) * images_);
  const std::size_t vectors = size() / images_;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, vectors, 1 << 10), [&](const auto& range) {
    for (std::size_t i = range.begin(); i != range.end(); ++i) multiply(writable() + i * images_);
  });
  for (int j = 0; j < images_; ++j) weights_[j] *= weights[j];
}

void BoxTable::column(const Box& box, float* column, std::size_t extent) const {
  for (int channel = 0; channel < 3; ++channel) channel_column(box, channel, column + channel * extent);
}

std::array<const double*, 4> BoxTable::corners(const Box& box, int channel) const {
  const std::size_t offset = static_cast<std::size_t>(channel) * stored_images_;
  return {corner(box.x0, box.y0) + offset, corner(box.x1, box.y0) + offset, corner(box.x0, box.y1) + offset,
          corner(box.x1, box.y1) + offset};
}

void BoxTable::channel_column(const Box& box, int channel, float* values) const {
  const auto at = corners(box, channel);
  if (!selected_.empty())
    for (int i = 0; i < images_; ++i) {
      const int j = selected_[i];
      values[i] = static_cast<float>((at[3][j] - at[2][j]) - (at[1][j] - at[0][j]));
    }
  else
    corner_sums(at, images_, values);
  std::fill(values + images_, values + stride_, 0.0f);
}

void BoxTable::products(const Box& box, int channel, const float* vector, float& with_vector,
                        float& squared) const {
  if (selected_.empty()) {
    corner_products(corners(box, channel), images_, vector, with_vector, squared);
    return;
  }
  AlignedFloats column(stride_);
  channel_column(box, channel, column.data());
  const float* others[2] = {vector, column.data()};
  float both[2];
  dots(column.data(), others, 2, stride_, both);
  with_vector = both[0];
  squared = both[1];
}

void BoxTable::prefetch(int x, int y, int first, int last) const {
  constexpr int line = 64 / sizeof(double);
  const double* at = corner(x, y);
  for (int i = first * stored_images_; i < last * stored_images_; i += line) __builtin_prefetch(at + i);
}

std::uint64_t BoxTable::bytes(const LightDomain& domain, std::uint64_t images) {
  return static_cast<std::uint64_t>(domain.width + 1) * (domain.height + 1) * 3 * images * sizeof(double);
}

}  // namespace refield
