// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "acquire/capture/capture.h"
#include "estimate/quality/error_follower.h"

namespace refield::cli {

/// Puts the training lights first, in the given order: "given", "random" or "useful" (max_useful_order()).
/// Throws InputError for another word.
void order_lights(std::vector<CaptureLight>& lights, const std::string& order, std::uint64_t seed);

/// "2%" or "0.02" as 0.02. Throws InputError outside (0, 1).
double error_from_text(const std::string& text);

/// Predicts the error while a capture goes on; with an error above 0, the rule by which it ends early.
class UntilError {
 public:
  UntilError(double error, int min_images, int check_every);

  /// Makes `request` ask this rule, which must outlive the capture. The error is that under the request's
  /// held-out natural lights, if there are any.
  void attach(CaptureRequest& request);
  bool reached() const { return reached_; }
  double target() const { return error_; }
  const FollowedError& last() const { return last_; }
  int images_for() const { return follower_.images_for(error_); }

 private:
  bool is_enough(const CaptureFrame& frame);
  double error_;
  int min_images_, check_every_;
  ErrorFollower follower_;
  FollowedError last_;
  bool reached_ = false;
};

}  // namespace refield::cli
