// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>

#include "core/box.h"
#include "core/capture_session.h"
#include "core/reflectance_field.h"

namespace refield::report {

/// The part of the picture, of its proportions and at most `most_pixels` large, that stands for the whole
/// best: the quantiles of the pixels' training errors and of the spreads of their kernels are most like those
/// of all pixels. The whole picture where it is no larger. Pixels outside the mask do not count.
Box typical_window(const ReflectanceField& field, const Mask& mask, std::size_t most_pixels);

Image cropped(const Image& image, const Box& window);
Mask cropped(const Mask& mask, int width, const Box& window);
/// The field of the window's pixels.
ReflectanceField cropped(const ReflectanceField& field, const Box& window);

/// The session with its photographs and mask cut to the window and written to `folder`; itself, unchanged,
/// where the window is the whole picture.
CaptureSession cropped(const CaptureSession& session, const Box& window, const std::filesystem::path& folder);

}  // namespace refield::report
