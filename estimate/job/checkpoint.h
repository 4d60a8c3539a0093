// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "estimate/job/estimate_band.h"

namespace refield {

/// Finished bands of a running estimation, kept in the folder `output`.partial until the field is complete.
/// Every file lands whole or not at all and carries a checksum, so a crash costs at most the bands in flight.
class Checkpoint {
 public:
  /// `description` is a text that names options and inputs; bands made under another description are not
  /// taken over.
  Checkpoint(const fs::path& output, std::string description);

  /// Throws InputError when what is there was made under another description.
  void resume() const;
  /// Removes the bands that are there, and the folder unless another user's files lie in it. The folder
  /// comes into being with the first band.
  void remove() const;

  void store(RowRange rows, const std::vector<PixelKernels>& kernels) const;
  /// Whether the band is there and not damaged.
  bool has(RowRange rows) const { return content_of(rows).has_value(); }
  /// The band's kernels, or nothing when it is not there or damaged.
  std::optional<std::vector<PixelKernels>> load(RowRange rows, int width) const;

 private:
  /// The bytes of a band without their checksum, which they have; else nothing.
  std::optional<std::string> content_of(RowRange rows) const;
  fs::path band_path(RowRange rows) const;
  fs::path folder_;
  std::string description_;
};

}  // namespace refield
