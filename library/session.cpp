// SPDX-License-Identifier: Apache-2.0
#include "refield/session.h"

#include <map>

#include "core/session/capture_session.h"
#include "relight/held_out.h"

namespace refield {

namespace {

CaptureSession pairs_of(std::span<const fs::path> lights, std::span<const fs::path> observed,
                        Parameterisation parameterisation) {
  if (lights.size() != observed.size())
    throw InputError(lights.size(), " light maps and ", observed.size(),
                     " photographs do not belong together; give one light map for each photograph");
  if (lights.empty()) throw InputError("light and observed are empty; give the files of a capture");
  CaptureSession session;
  session.light.parameterisation = parameterisation;
  std::map<fs::path, fs::path> light_of;
  for (std::size_t j = 0; j < lights.size(); ++j) {
    if (const fs::path& light = light_of.emplace(observed[j], lights[j]).first->second; light != lights[j])
      throw InputError("observed: ", observed[j], " is given for ", light, " and for ", lights[j],
                       "; give each photograph once");
    session.frames.push_back(
        {lights[j].stem().string(), FrameRole::train, "", lights[j], observed[j], static_cast<double>(j)});
  }
  return session;
}

CaptureSession with_sizes(CaptureSession&& session) {
  check_image_sizes(session);
  return std::move(session);
}

const CaptureFrame& frame_of(const CaptureSession& session, std::size_t i) {
  if (i >= session.frames.size())
    throw InputError("frame ", i, " does not exist; the session has ", session.frames.size(),
                     ", counted from 0");
  return session.frames[i];
}

/// Replaces a session by a changed copy.
template <class Change>
void change(std::shared_ptr<const CaptureSession>& session, const Change& with) {
  CaptureSession changed = *session;
  with(changed);
  session = std::make_shared<const CaptureSession>(std::move(changed));
}

}  // namespace

Session::Session(CaptureSession&& session)
    : session_(std::make_shared<const CaptureSession>(std::move(session))) {}
Session::Session(const fs::path& folder) : Session(read_capture_session(folder)) {}
Session::Session(std::span<const fs::path> lights, std::span<const fs::path> observed,
                 Parameterisation parameterisation)
    : Session(with_sizes(pairs_of(lights, observed, parameterisation))) {}
Session::Session(const std::string& lights, const std::string& observed, Parameterisation parameterisation)
    : Session(with_sizes(pair_by_globs(lights, observed, parameterisation))) {}

const fs::path& Session::folder() const {
  return session_->folder;
}
int Session::width() const {
  return session_->width;
}
int Session::height() const {
  return session_->height;
}
LightDomain Session::light_domain() const {
  return session_->light;
}
ColourSpace Session::colour_space() const {
  return session_->colour_space();
}
std::size_t Session::size() const {
  return session_->frames.size();
}

SessionFrame Session::frame(std::size_t i) const {
  const CaptureFrame& frame = frame_of(*session_, i);
  return {frame.name, frame.role, frame.kind, frame.illumination, frame.observed};
}

LightMap Session::light(std::size_t i, const RunContext& run) const {
  return read_illumination(frame_of(*session_, i), session_->light.parameterisation, run);
}

Photograph Session::observed(std::size_t i) const {
  return read_observed(frame_of(*session_, i));
}

Mask Session::mask() const {
  return session_->mask ? read_mask(*session_->mask, session_->width, session_->height) : Mask();
}

void Session::hold_out(int every) {
  change(session_, [&](CaptureSession& session) { hold_out_every(session, every); });
}

void Session::set_mask(const fs::path& file) {
  change(session_, [&](CaptureSession& session) { session.mask = file; });
}

void Session::set_monitors(std::vector<MonitorPlacement> monitors) {
  change(session_, [&](CaptureSession& session) { session.monitors = std::move(monitors); });
}

}  // namespace refield
