// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/peers/peer_data.h"

#include <tbb/parallel_for.h>

#include <cmath>
#include <limits>

#include "cli/run_context.h"
#include "core/base/errors.h"
#include "core/image/image_io.h"

namespace refield::peers {

namespace {

Photograph read_checked(const CaptureFrame& frame, const CaptureSession& session, float clip_level) {
  Photograph photograph = read_photograph(frame.observed);
  Image& radiance = photograph.radiance;
  if (radiance.width != session.width || radiance.height != session.height)
    throw InputError(frame.observed.string() + ": is " + shape_text(radiance) + ", other photographs are " +
                     std::to_string(session.width) + "×" + std::to_string(session.height));
  for (std::size_t i = 0; i < radiance.values.size(); ++i)
    if (radiance.values[i] >= clip_level ||
        (!photograph.sigma.empty() && std::isinf(photograph.sigma.values[i])))
      radiance.values[i] = std::numeric_limits<float>::quiet_NaN();
    else if (!std::isfinite(radiance.values[i]))
      throw InputError(frame.observed.string() + ": pixel " + std::to_string(i / 3) + " is " +
                       std::to_string(radiance.values[i]) + "; repair it or leave the image out");
  return photograph;
}

}  // namespace

PeerData read_peer_data(const CaptureSession& session, int images, float clip_level) {
  const auto frames = session.frames_of(FrameRole::train);
  if (images < 2 || static_cast<std::size_t>(images) > frames.size())
    throw InputError(std::to_string(images) + " images were asked for; the capture has " +
                     std::to_string(frames.size()) + " training images, and at least 2 are needed");
  CaptureSession checked = session;
  checked.frames.assign(frames.begin(), frames.begin() + images);
  check_image_sizes(checked);
  PeerData data;
  data.domain = checked.light;
  data.width = checked.width;
  data.height = checked.height;
  if (session.mask) data.mask = read_mask(*session.mask, data.width, data.height);
  data.lights.resize(images);
  data.observed.resize(images, 3 * static_cast<Eigen::Index>(data.pixels()));
  tbb::parallel_for(0, images, [&](int j) {
    run_context().throw_if_stopped();
    data.lights[j] = read_light_map(frames[j].illumination, checked.light.parameterisation, run_context());
    const Photograph photograph = read_checked(frames[j], checked, clip_level);
    data.observed.row(j) =
        Eigen::Map<const Eigen::RowVectorXf>(photograph.radiance.values.data(), data.observed.cols());
  });
  return data;
}

}  // namespace refield::peers
