// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "cli/report/input.h"
#include "core/box.h"
#include "relight/held_out.h"

namespace refield::report {

/// An estimation from the session's first images.
struct StudyPoint {
  int images = 0;
  int kernels = 0;                   ///< fewer than the series' where images are fewer
  std::vector<HeldOutError> errors;  ///< against the study's reference
  std::vector<Image> predicted;      ///< [picture frames]
};

/// One way to estimate, over a growing number of images.
struct StudySeries {
  std::string name;
  EstimateOptions options;
  std::vector<StudyPoint> points;  ///< by rising number of images
};

/// Error against the number of images (Matusik et al. 2004, figure 7).
struct ImageCountStudy {
  Box window;                                ///< the pixels that were estimated
  Mask mask;                                 ///< of the window
  std::vector<CaptureFrame> picture_frames;  ///< held-out frames that are shown: a natural light and a bar
  std::vector<Image> reference;     ///< [picture frames], what predictions should look like, in the window
  std::vector<StudySeries> series;  ///< the fields' own ways first
};

/// Estimates from the first 25, 50, 75, 100 and all training images, for each way that the fields were made,
/// for paper mode, and for the first field's way without spatial correction. Of photographs larger than
/// `most_pixels` a typical window is taken. `scratch` takes the cut photographs. No series where the session
/// has no held-out frames or a single training image.
ImageCountStudy study_image_count(const ReportInput& input, std::size_t most_pixels,
                                  const std::filesystem::path& scratch);

}  // namespace refield::report
