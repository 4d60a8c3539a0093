// SPDX-License-Identifier: Apache-2.0
#pragma once

/// A capture session: the photographs of a scene and the lights that they were taken under, as a folder on
/// disk (docs/reference/capture-session-format.md) or as pairs of files.
///
/// Public: CaptureSession, CaptureFrame, FrameRole, read_capture_session(), write_session_manifest(),
/// pair_by_globs(), check_image_sizes(), read_illumination(), read_observed() and read_mask(). A broken
/// manifest throws FormatError, a missing file or images of different sizes InputError.
#include "core/session/capture_session.h"
