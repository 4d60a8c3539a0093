// SPDX-License-Identifier: Apache-2.0
#include "estimate/estimate_job.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "core/errors.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

/// What messages call the capture: its folder or, for one given by patterns, its first photograph's folder.
std::string name_of(const CaptureSession& session) {
  if (!session.folder.empty() || session.frames.empty()) return session.folder.string();
  return session.frames.front().observed.parent_path().string();
}

}  // namespace

EstimateJob open_job(const CaptureSession& session, const EstimateOptions& options) {
  options.check();
  EstimateJob job{session, session.frames_of(FrameRole::train), {}};
  const int images = static_cast<int>(job.frames.size());
  if (images < 2)
    throw InputError(name_of(session) + ": holds " +
                     (images == 0 ? "no training image" : "one training image only") +
                     "; a reflectance field needs many lights, about 100 for 25 kernels a pixel");
  if (images < options.kernels)
    throw InputError(name_of(session) + ": " + std::to_string(images) + " training images cannot determine " +
                     std::to_string(options.kernels) + " kernels a pixel; add images or give --kernels " +
                     std::to_string(images) + " or less");
  job.session.frames = job.frames;
  check_image_sizes(job.session);
  if (session.mask) job.mask = read_mask(*session.mask, job.session.width, job.session.height);
  return job;
}

std::string describe(const EstimateJob& job, const EstimateOptions& options) {
  nlohmann::ordered_json description = {{"program", "refield"},
                                        {"mode", name_of(options.mode)},
                                        {"kernels", options.kernels},
                                        {"spatial_passes", options.spatial_passes}};
  if (std::isfinite(options.clip_level)) description["clip_level"] = options.clip_level;
  const auto stamp = [](const fs::path& path) {
    return nlohmann::ordered_json{{"path", path.string()},
                                  {"bytes", fs::file_size(path)},
                                  {"modified", fs::last_write_time(path).time_since_epoch().count()}};
  };
  if (job.session.mask) description["mask"] = stamp(*job.session.mask);
  for (const CaptureFrame& frame : job.frames) {
    description["inputs"].push_back(stamp(frame.illumination));
    description["inputs"].push_back(stamp(frame.observed));
  }
  return description.dump(1);
}

std::string provenance_of(const EstimateJob& job, const EstimateOptions& options) {
  nlohmann::ordered_json provenance = {{"made_by", "refield estimate"},
                                       {"version", REFIELD_VERSION},
                                       {"method", "Matusik, Loper and Pfister 2004"},
                                       {"mode", name_of(options.mode)},
                                       {"kernels", options.kernels},
                                       {"spatial_passes", options.spatial_passes},
                                       {"images", job.frames.size()}};
  if (std::isfinite(options.clip_level)) provenance["clip_level"] = options.clip_level;
  if (!job.session.folder.empty()) provenance["session"] = job.session.folder.filename().string();
  for (const CaptureFrame& frame : job.frames) provenance["frames"].push_back(frame.name);
  return provenance.dump();
}

std::vector<fs::path> illumination_paths(const std::vector<CaptureFrame>& frames) {
  std::vector<fs::path> paths;
  for (const CaptureFrame& frame : frames) paths.push_back(frame.illumination);
  return paths;
}

}  // namespace refield
