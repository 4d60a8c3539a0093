// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/session/capture_session.h"

namespace refield {

/// How bright one reference frame came out, against the first.
struct DriftPoint {
  std::string frame;
  double order = 0.0;                         ///< when it was taken, see CaptureFrame::order
  std::array<double, 3> gain{1.0, 1.0, 1.0};  ///< of each channel; the first frame's is 1
  std::array<double, 3> uncertainty{};        ///< standard error of the gain
  bool used = true;                           ///< false: it breaks the curve that its neighbours draw
};

/// Slow change of the brightness of monitor or camera over a capture, as its reference frames show it.
struct Drift {
  std::vector<DriftPoint> points;  ///< in order; empty: the session has fewer than two reference frames
  bool significant = false;        ///< beyond its own uncertainty and 0.05 %, and no mere scatter
  double largest = 0.0;            ///< largest |gain − 1| of a point that is used

  /// The gain at a moment: linear between the points used, constant before the first and after the last.
  std::array<float, 3> gain_at(double order) const;
};

/// Measures drift: the gain of each reference frame and channel is the weighted median, over pixels inside
/// the mask that every reference frame measured, of its ratio to the median reference. Bright pixels weigh
/// more. A frame that one of its neighbours' line alone misses (a flicker while it was taken) is not used.
/// Throws InputError when reference frames show different lights.
Drift measure_drift(const CaptureSession& session, const RunContext& run = {});

/// Sets the gain of every frame of the session to what measure_drift() found, where that is significant; else
/// leaves them at one. Changes nothing where there are fewer than two reference frames. Readers of
/// photographs divide by it (read_observed()).
Drift remove_drift(CaptureSession& session, const RunContext& run = {});

}  // namespace refield
