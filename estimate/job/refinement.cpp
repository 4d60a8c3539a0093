// SPDX-License-Identifier: Apache-2.0
#include "estimate/job/refinement.h"

#include "core/base/json.h"
#include "core/base/number_text.h"
#include "core/field_io/reflectance_field_file.h"

namespace refield {

namespace {

/// Names of the frames that a field was made from.
std::set<std::string> frames_of(const ReflectanceField& field, const fs::path& path) {
  const auto provenance = json_if_valid(field.provenance);
  std::set<std::string> names;
  if (provenance.is_object() && provenance.contains("frames") && provenance["frames"].is_array())
    for (const auto& name : provenance["frames"])
      if (name.is_string()) names.insert(name.get<std::string>());
  if (names.empty())
    throw InputError(
        path,
        ": does not contain the names of its training images; refine a field written by 'refield estimate'");
  return names;
}

}  // namespace

Refinement::Refinement(const fs::path& path, const CaptureSession& session,
                       std::span<const CaptureFrame> frames, const RunContext& run)
    : path_(path), field_(read_reflectance_field(path, run)) {
  if (field_.width != session.width || field_.height != session.height)
    throw InputError(path, ": is a field of ", size_text(field_.width, field_.height),
                     " pixels, the photographs are ", size_text(session.width, session.height),
                     "; refine a field of the same capture");
  if (field_.basis.domain != session.light)
    throw InputError(path, ": takes light maps of ",
                     size_text(field_.basis.domain.width, field_.basis.domain.height), " (",
                     name_of(field_.basis.domain.parameterisation), "), the capture's are ",
                     size_text(session.light.width, session.light.height), " (",
                     name_of(session.light.parameterisation), "); refine a field of the same capture");
  if (field_.colour_space != session.colour_space())
    throw InputError(path, ": is in ", name_of(field_.colour_space), ", the photographs are in ",
                     name_of(session.colour_space()), "; estimate without --refine");
  known_names_ = frames_of(field_, path);
  std::set<std::string> missing = known_names_;
  for (const CaptureFrame& frame : frames) missing.erase(frame.name);
  if (!missing.empty())
    throw InputError(path, ": was estimated from frame '", *missing.begin(), "'",
                     missing.size() > 1 ? " and " + std::to_string(missing.size() - 1) + " more" : "",
                     " that is missing in the capture; refine with all old images and the new ones");
  use_frames(frames);
  if (std::ranges::count(is_new_, 1) == 0)
    throw InputError(path, ": was estimated from all ", frames.size(),
                     " training images already; there are no new images");
}

void Refinement::use_frames(std::span<const CaptureFrame> frames) {
  is_new_.clear();
  for (const CaptureFrame& frame : frames) is_new_.push_back(known_names_.contains(frame.name) ? 0 : 1);
}

std::vector<Box> Refinement::boxes(std::size_t pixel) const {
  const SparseTransfer& transfer = field_.transfer;
  std::vector<Box> boxes;
  for (std::uint64_t e = transfer.row_start[pixel]; e < transfer.row_start[pixel + 1]; ++e)
    if (!field_.basis.is_smooth(transfer.column[e])) boxes.push_back(field_.basis.box(transfer.column[e]));
  return boxes;
}

}  // namespace refield
