// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "core/image/image.h"
#include "core/image/image_io.h"

namespace refield {

/// A smooth factor over an image of any size, such as the vignetting of a lens: values at the nodes of a
/// regular grid that reaches from edge to edge, bilinear in between. Empty: 1 everywhere.
struct RelativeMap {
  int columns = 0;  ///< of nodes, at least 2 unless empty
  int rows = 0;
  std::vector<float> values;  ///< [rows × columns], top row first, above 0

  bool empty() const { return values.empty(); }
  /// `u` and `v` from 0 at the left and upper edge to 1 at the others.
  float at(double u, double v) const;
  /// At the centre of a pixel of an image.
  float at_pixel(int x, int y, const Image& image) const {
    return at((x + 0.5) / image.width, (y + 0.5) / image.height);
  }
  /// Throws InputError naming `where` when the sizes do not fit or a value is not finite and above 0.
  void check(const std::string& where) const;
};

/// The smooth map nearest to an image in the sense of weighted least squares, scaled so that its largest
/// value is 1. `weight` [height × width × 1] is 0 where the image says nothing; nodes without data follow
/// from their neighbours by a weak pull towards straightness. `image` has one channel. Throws InputError when
/// there is nothing to fit.
RelativeMap fit_relative_map(const Image& image, const Image& weight, int columns, int rows);

/// All channels of each pixel times or through the map's value there. Nothing happens for an empty map.
void multiply(Image& image, const RelativeMap& map);
void divide(Photograph& photograph, const RelativeMap& map);

}  // namespace refield
