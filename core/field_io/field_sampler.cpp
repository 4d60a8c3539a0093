// SPDX-License-Identifier: Apache-2.0
#include "core/field_io/field_sampler.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <numeric>

#include "core/field_io/field_content.h"

namespace refield {

std::unique_ptr<const FieldSampler> FieldSampler::open(const fs::path& path, const RunContext& run,
                                                       std::uint64_t from_bytes) {
  std::error_code error;
  if (const auto bytes = fs::file_size(path, error); error || bytes < from_bytes) return nullptr;
  FieldFile file = open_field(path, run);
  if (file.part || file.version == packed_field_version) return nullptr;
  constexpr std::uint64_t bytes_per_entry = sizeof(std::uint32_t) + 3 * sizeof(float);
  if (file.values.locate("transfer/column", "u4", 1).shape[0] * bytes_per_entry < from_bytes) return nullptr;
  FieldOutline outline = read_outline(file.values);
  read_boxes(file.values, outline);
  if (outline.mesh || outline.basis.domain.parameterisation == Parameterisation::cube) return nullptr;
  return std::unique_ptr<const FieldSampler>(new FieldSampler(std::move(file.values), std::move(outline)));
}

FieldSampler::FieldSampler(Hdf5Values values, FieldOutline outline)
    : values_(std::move(values)),
      outline_(std::move(outline)),
      file_(values_.path),
      boxes_(std::exchange(outline_.basis.boxes, {})),
      row_start_(values_.locate("transfer/row_start", "u8", 1)),
      column_(values_.locate("transfer/column", "u4", 1)),
      weight_(values_.locate("transfer/weight", "f4", 3)) {
  if (row_start_.shape[0] != static_cast<std::uint64_t>(outline_.width) * outline_.height + 1)
    values_.fail("transfer/row_start does not fit the image size");
  if (weight_.shape[0] != column_.shape[0]) values_.fail("transfer/weight does not fit transfer/column");
}

PixelGrid FieldSampler::whole_image(std::int64_t max_pixels) const {
  PixelGrid grid{{0, 0, outline_.width, outline_.height}, 1};
  while (std::int64_t{grid.width()} * grid.height() > std::max<std::int64_t>(max_pixels, 1)) ++grid.stride;
  return grid;
}

ReflectanceField FieldSampler::read(const PixelGrid& grid, const RunContext& run) const {
  if (grid.stride < 1 || !grid.region.inside(outline_.width, outline_.height))
    throw InputError(values_.path, ": pixels outside the image were requested");
  ReflectanceField field{outline_, {}};
  field.width = grid.width();
  field.height = grid.height();
  read_map("statistics/training_error", "f4", grid, field.quality.training_error);
  read_map("statistics/predicted_error", "f4", grid, field.quality.predicted_error);
  read_map("statistics/photograph_noise", "f4", grid, field.quality.photograph_noise);
  read_map("statistics/training_signal", "f4", grid, field.quality.training_signal);
  read_map(light_class_name, "u4", grid, field.quality.light_class);
  read_transfer(grid, field.transfer, run);
  take_boxes(field);
  std::string fault = fault_of_rows(field);
  if (fault.empty()) fault = fault_of_statistics(field);
  if (!fault.empty()) values_.fail(fault);
  return field;
}

template <class T>
void FieldSampler::read_values(const Hdf5DataSet& set, std::uint64_t first, std::span<T> values) const {
  file_.read(set.offset + first * sizeof(T), std::as_writable_bytes(values));
}

/// A map that has a value for each pixel, or none.
template <class T>
void FieldSampler::read_map(const char* name, const char* type, const PixelGrid& grid,
                            std::vector<T>& map) const {
  if (!values_.has(name)) return;
  const Hdf5DataSet& set = values_.locate(name, type, 1);
  if (set.shape[0] == 0) return;
  if (set.shape[0] != static_cast<std::uint64_t>(outline_.width) * outline_.height)
    values_.fail(std::string(name) + " does not fit the image size");
  map.reserve(static_cast<std::size_t>(grid.width()) * grid.height());
  std::vector<T> row(grid.region.width());
  for (int y = 0; y < grid.height(); ++y) {
    read_values(set, grid.y_of(y) * static_cast<std::uint64_t>(outline_.width) + grid.region.x0,
                std::span(row));
    for (int x = 0; x < grid.width(); ++x) map.push_back(row[static_cast<std::size_t>(x) * grid.stride]);
  }
}

void FieldSampler::read_transfer(const PixelGrid& grid, SparseTransfer& transfer,
                                 const RunContext& run) const {
  const auto width = static_cast<std::size_t>(grid.width());
  const auto stride = static_cast<std::size_t>(grid.stride);
  // Rows are read, not mapped: a fault for each page takes ten times as long as copying it.
  struct Row {
    std::vector<std::uint64_t> start;
    std::vector<std::uint32_t> column;
    std::vector<float> weight;
  };
  tbb::enumerable_thread_specific<Row> rows;
  const auto read_start = [&](Row& row, int y) {
    row.start.resize(grid.region.width() + std::size_t{1});
    read_values(row_start_, grid.y_of(y) * static_cast<std::uint64_t>(outline_.width) + grid.region.x0,
                std::span(row.start));
  };
  transfer.row_start.assign(width * grid.height() + 1, 0);
  std::atomic<bool> is_sound = true;
  tbb::parallel_for(0, grid.height(), [&](int y) {
    Row& row = rows.local();
    read_start(row, y);
    if (!std::ranges::is_sorted(row.start) || row.start.back() > column_.shape[0]) is_sound = false;
    for (std::size_t x = 0; x < width; ++x)
      transfer.row_start[y * width + x + 1] = row.start[x * stride + 1] - row.start[x * stride];
  });
  run.throw_if_stopped();  // a loop that was cancelled leaves rows out
  if (!is_sound) values_.fail("transfer/row_start does not fit transfer/column");
  std::partial_sum(transfer.row_start.begin(), transfer.row_start.end(), transfer.row_start.begin());
  transfer.column.resize(transfer.row_start.back());
  transfer.weight.resize(3 * transfer.row_start.back());
  tbb::parallel_for(0, grid.height(), [&](int y) {
    Row& row = rows.local();
    read_start(row, y);
    const std::uint64_t first = row.start.front(), count = row.start[(width - 1) * stride + 1] - first;
    row.column.resize(count);
    row.weight.resize(3 * count);
    read_values(column_, first, std::span(row.column));
    read_values(weight_, 3 * first, std::span(row.weight));
    for (std::size_t x = 0; x < width; ++x) {
      const std::uint64_t from = row.start[x * stride] - first, to = transfer.row_start[y * width + x];
      const std::uint64_t entries = transfer.row_start[y * width + x + 1] - to;
      std::copy_n(row.column.data() + from, entries, transfer.column.data() + to);
      std::copy_n(row.weight.data() + 3 * from, 3 * entries, transfer.weight.data() + 3 * to);
    }
  });
  run.throw_if_stopped();
}

/// Gives a field, whose columns count all kernels of the file, those that it uses.
void FieldSampler::take_boxes(ReflectanceField& field) const {
  const std::size_t smooth = outline_.basis.smooth(), kernels = smooth + boxes_.size();
  std::size_t first = kernels, last = smooth;  // those used lie in [first, last): few of a small region
  for (const std::uint32_t kernel : field.transfer.column) {
    if (kernel >= kernels) values_.fail("transfer/column refers to a kernel that does not exist");
    if (kernel < smooth) continue;
    first = std::min<std::size_t>(first, kernel);
    last = std::max<std::size_t>(last, kernel + std::size_t{1});
  }
  std::vector<std::uint32_t> number(std::max(first, last) - first, 0);
  for (const std::uint32_t kernel : field.transfer.column)
    if (kernel >= smooth) number[kernel - first] = 1;
  for (std::size_t k = first; k < last; ++k) {
    if (number[k - first] == 0) continue;
    number[k - first] = static_cast<std::uint32_t>(smooth + field.basis.boxes.size());
    field.basis.boxes.push_back(boxes_[k - smooth]);
  }
  for (std::uint32_t& kernel : field.transfer.column)
    if (kernel >= smooth) kernel = number[kernel - first];
}

}  // namespace refield
