// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <map>

#include "acquire/capture/capture.h"
#include "estimate/quality/error_follower.h"
#include "estimate/rig/verdict.h"

namespace refield::cli {

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

/// Whether a row of a verdict is about colours or the tone curve: the same in all photographs and in another
/// capture, and corrected.
bool is_of_the_devices(const VerdictRow& row);

/// How the last photograph of the reference light differs from the first, of `photographs` in their order: a
/// row where the picture moved, else one where light was added to all of it. Measured directly, to first
/// order in the shift, so it needs no other photograph; brightness alone is drift and no row.
std::vector<VerdictRow> compare_references(const std::vector<fs::path>& photographs);

/// Checks the photographs while a capture goes on, so that a person can still do something.
class CaptureWatch {
 public:
  /// After each `every` training photographs.
  explicit CaptureWatch(int every) : every_(every) {}

  /// Makes `request`, whose other functions are set, end with an InputError when a check finds what the one
  /// before did not, unless is_of_the_devices().
  /// The capture can be resumed; then the photographs that there are are taken as they are.
  void attach(CaptureRequest& request);

 private:
  using Findings = std::map<std::string, std::string>;  // what a row measured, by its property
  Findings findings() const;
  void check(const CaptureFrame& frame);
  int every_;
  std::vector<CaptureFrame> frames_;
  std::vector<fs::path> references_;  ///< that may be there already
  bool taken_ = false;                ///< a photograph, by this run
  std::optional<Findings> known_;
};

}  // namespace refield::cli
