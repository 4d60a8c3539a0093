// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/image/metrics.h"

namespace refield {

/// The sums of two series of as many images.
inline SeriesError series_error(std::span<const Image> predicted, std::span<const Image> observed,
                                const Mask& mask = {}) {
  if (predicted.size() != observed.size()) throw InputError("two series of images differ in length");
  SeriesError error(mask);
  for (std::size_t i = 0; i < predicted.size(); ++i) error.add(predicted[i], observed[i]);
  return error;
}

inline double relative_rmse(std::span<const Image> predicted, std::span<const Image> observed) {
  return series_error(predicted, observed).relative_rmse();
}

inline Image relative_rmse_map(std::span<const Image> predicted, std::span<const Image> observed,
                               const Mask& mask = {}) {
  return series_error(predicted, observed, mask).relative_rmse_map();
}

}  // namespace refield
