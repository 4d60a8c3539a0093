// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/field/reflectance_field.h"
#include "core/image/metrics.h"
#include "core/session/capture_session.h"
#include "refield/compare.h"

namespace refield {

/// Measures of a series from its images' errors; see core/image/metrics.h.
ErrorSpread spread_of(const std::vector<HeldOutImage>& images);
/// `series` holds the images of `per_image`.
HeldOutError error_of(const SeriesError& series, std::vector<HeldOutImage> per_image,
                      const std::string& kind = "", std::optional<std::size_t> trained_on = 0);

/// What messages and pages call a capture: its folder, or that of its photographs.
std::string text_of(const CaptureSession& session);

/// Gives every `every`-th training frame the role test. Throws
/// InputError for fewer than 2, or where that leaves none or takes none.
void hold_out_every(CaptureSession& session, int every);

/// Tells which frames a field was not estimated from, by the names that its provenance holds. Of a session's
/// frames, those that the estimate held out take the role test, too. Pairs of which none has that role, if
/// all frames of the estimate are among them: those train, the others are the test. Else all pairs are the
/// test.
void mark_held_out(CaptureSession& session, const std::string& provenance);

/// What to say of errors on images that the field was estimated from, or may have been; empty if on none.
std::string training_warning(const std::vector<HeldOutError>& errors);

/// Relights `field` with each of the session's frames of a role and compares by kind of light, kinds in order
/// of first appearance; the session's mask is respected and samples that were not measured are left out. With
/// `truth`, another field's noise-free images stand in for the photographs. Throws InputError when there is
/// no such frame or sizes differ.
///
/// A field's predicted error holds for photographs as noisy as its training images. What these photographs
/// add is put in its place: their sigma where they carry it, else `noise_scale` times the training images'
/// noise; nothing with `truth`. The check leaves out pixels that are black in all frames.
std::vector<HeldOutError> held_out_errors(const ReflectanceField& field, const CaptureSession& session,
                                          const ReflectanceField* truth = nullptr,
                                          FrameRole role = FrameRole::test, double noise_scale = 1.0,
                                          const RunContext& run = {});

}  // namespace refield
