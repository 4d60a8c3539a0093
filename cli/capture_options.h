// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <CLI/CLI.hpp>
#include <string>

#include "core/capture_session.h"
#include "core/reflectance_field.h"

namespace refield::cli {

/// What estimate, compare and report work on: a capture session, or pairs of images of other tools.
struct CaptureOptions {
  std::string session;
  std::string light;
  std::string observed;
  std::string parameterisation = "monitor";
  std::string mask;
  int hold_out = 0;  ///< 0: as the session says

  bool by_pairs() const { return !light.empty() || !observed.empty(); }
};

/// Adds --light, --observed, --parameterisation, --mask and --hold-out; the session is the verb's own
/// argument. `held_out`: what the verb does with the images that are held out.
void add_capture_options(CLI::App& verb, CaptureOptions& options, const std::string& held_out);

/// Reads the session or pairs the files, with the mask and the images held out that the options name. Throws
/// InputError unless exactly one of both is given.
CaptureSession open_capture(const CaptureOptions& options);

/// Which frames `field` was not estimated from, where the options do not say (mark_held_out()). Prints a
/// warning where pairs may be those of the training.
void find_held_out(const CaptureOptions& options, const ReflectanceField& field, CaptureSession& session);

}  // namespace refield::cli
