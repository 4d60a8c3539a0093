// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/files.h"
#include "core/base/run_context.h"
#include "core/field/reflectance_field.h"
#include "core/field_io/hdf5_reader.h"
#include "core/field_io/reflectance_field_file.h"

namespace refield {

/// Column and row of a pixel.
struct PixelPosition {
  int x = 0;
  int y = 0;
  bool operator==(const PixelPosition&) const = default;
};

/// Every `stride`-th pixel of a region of an image in both directions, from its first pixel on.
struct PixelGrid {
  Box region;  ///< pixels of the image
  int stride = 1;

  int width() const { return (region.width() + stride - 1) / stride; }
  int height() const { return (region.height() + stride - 1) / stride; }
  /// Position on the grid of a pixel of the image, or of the nearest one before it. Nothing outside
  /// the region.
  std::optional<PixelPosition> position_of(const PixelPosition& pixel) const {
    if (!region.contains(pixel.x, pixel.y)) return std::nullopt;
    return PixelPosition{(pixel.x - region.x0) / stride, (pixel.y - region.y0) / stride};
  }
  int x_of(int column) const { return region.x0 + column * stride; }
  int y_of(int row) const { return region.y0 + row * stride; }
  bool operator==(const PixelGrid&) const = default;
};

/// The file of a field too large for memory, of which some pixels are read at a time.
class FieldSampler {
 public:
  /// Nothing where the transfer of a file takes less than `from_bytes`, and for fields that are not rows of
  /// pixels under a monitor or lat-long map: packed, over a mesh or a cube map, and shards. Throws what
  /// read_reflectance_field() throws for faults outside transfer and statistics, which are not read yet.
  static std::unique_ptr<const FieldSampler> open(const fs::path& path, const RunContext& run = {},
                                                  std::uint64_t from_bytes = large_transfer_bytes);

  /// Without the transfer's boxes and statistics of pixels.
  const FieldOutline& outline() const { return outline_; }

  /// Entries of the transfer, over all pixels.
  std::uint64_t entries() const { return column_.shape[0]; }
  /// All of the image, by the smallest stride that leaves at most `max_pixels` (1 or more).
  PixelGrid whole_image(std::int64_t max_pixels) const;

  /// These pixels as a field of their own, with those of the boxes that they use. Checks all that it reads,
  /// but not the checksums of the file; throws FormatError, DeviceError, and InputError for a region outside
  /// the image.
  ReflectanceField read(const PixelGrid& grid, const RunContext& run = {}) const;

 private:
  FieldSampler(Hdf5Values values, FieldOutline outline);
  template <class T>
  void read_values(const Hdf5DataSet& set, std::uint64_t first, std::span<T> values) const;
  template <class T>
  void read_map(const char* name, const char* type, const PixelGrid& grid, std::vector<T>& map) const;
  void read_transfer(const PixelGrid& grid, SparseTransfer& transfer, const RunContext& run) const;
  void take_boxes(ReflectanceField& field) const;

  Hdf5Values values_;
  FieldOutline outline_;
  OpenFile file_;
  std::vector<Box> boxes_;
  Hdf5DataSet row_start_, column_, weight_;
};

}  // namespace refield
