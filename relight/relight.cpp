// SPDX-License-Identifier: Apache-2.0
#include "relight/relight.h"

#include <tbb/parallel_for.h>

#include "core/errors.h"
#include "core/image_io.h"
#include "core/interrupt.h"
#include "core/progress.h"

namespace refield {

void relight_to_files(const FieldPictures& field, const std::vector<RelightJob>& jobs, double exposure) {
  for (const RelightJob& job : jobs)
    if (job.output.extension() != ".exr" && job.output.extension() != ".png")
      throw InputError(job.output.string() +
                       ": images are written as .exr or .png; give the output such a name");
  Progress progress("relight", jobs.size());
  // One task an image: compressing and writing files takes longer than the product T L, and so it overlaps
  // too. Memory stays at one image a core.
  tbb::parallel_for(std::size_t{0}, jobs.size(), [&](std::size_t i) {
    throw_if_interrupted();
    const Image image = field.picture(jobs[i].light(), i);
    if (jobs[i].output.extension() == ".png")
      write_png(jobs[i].output, image, {exposure});
    else
      write_exr(jobs[i].output, image);
    progress.advance();
  });
}

}  // namespace refield
