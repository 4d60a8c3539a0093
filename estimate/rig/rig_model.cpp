// SPDX-License-Identifier: Apache-2.0
#include "estimate/rig/rig_model.h"

#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <map>

#include "core/base/files.h"
#include "core/base/json.h"

namespace refield {

bool RigModel::is_identity() const {
  return light_of.empty() && shift_px.empty() && turn.empty() && gain.empty() && room.empty() &&
         !mixes_colours() && !bends_tone();
}

std::string rig_text(const RigModel& rig) {
  Json json = {{"photographs", rig.photographs}};
  if (!rig.light_of.empty()) json["light_of"] = rig.light_of;
  if (!rig.shift_px.empty()) json["shift_px"] = rig.shift_px;
  if (!rig.turn.empty()) json["turn"] = rig.turn;
  if (rig.mixes_colours()) {
    auto rows = Json::array();
    for (int c = 0; c < 3; ++c) rows.push_back({rig.mixing(c, 0), rig.mixing(c, 1), rig.mixing(c, 2)});
    json["mixing"] = rows;
  }
  if (rig.bends_tone()) {
    json["tone"] = rig.tone;
    json["white"] = rig.white;
  }
  if (!rig.gain.empty()) json["gain"] = rig.gain;
  if (!rig.room.empty()) json["room"] = rig.room;
  if (rig.ambient_room) json["ambient_room"] = true;
  return json_text(json);
}

RigModel rig_from_text(const std::string& text, const std::string& name) try {
  const auto json = json_from_text(text);
  RigModel rig;
  json.at("photographs").get_to(rig.photographs);
  const std::size_t images = rig.photographs.size();
  const auto read = [&](const char* key, auto& values) {
    if (!json.contains(key)) return;
    json.at(key).get_to(values);
    if (values.size() != images)
      throw InputError(name + ": '" + key + "' has " + std::to_string(values.size()) + " entries, not " +
                       std::to_string(images) + " as 'photographs'");
  };
  read("light_of", rig.light_of);
  read("shift_px", rig.shift_px);
  read("turn", rig.turn);
  read("gain", rig.gain);
  read("room", rig.room);
  rig.ambient_room = json.value("ambient_room", false);
  if (json.contains("mixing")) {
    const auto rows = json.at("mixing").get<std::array<std::array<double, 3>, 3>>();
    for (int c = 0; c < 3; ++c)
      for (int k = 0; k < 3; ++k) rig.mixing(c, k) = rows[c][k];
  }
  if (json.contains("tone")) {
    json.at("tone").get_to(rig.tone);
    json.at("white").get_to(rig.white);
  }
  for (const int light : rig.light_of)
    if (light < -1 || light >= static_cast<int>(images))
      throw InputError(name + ": 'light_of' names frame " + std::to_string(light) + ", which is not there");
  if (!(std::abs(rig.mixing.determinant()) > 1e-3) || !(rig.white > 0.0))
    throw InputError(name + ": 'mixing' cannot be inverted, or 'white' is not above 0");
  return rig;
} catch (const Json::exception& error) {
  throw InputError(name + ": is not a rig model as 'refield estimate' writes it: " + error.what());
}

RigModel read_rig(const fs::path& path) {
  return rig_from_text(read_text(path), path.string());
}

void apply_rig(const RigModel& rig, const CaptureSession& session, std::vector<CaptureFrame>& frames) {
  if (rig.is_identity()) return;
  if (rig.ambient_room && !session.ambient)
    throw InputError(
        "the rig model's room light is a multiple of the ambient photograph, which this capture lacks; give "
        "a model of this capture, or estimate one");
  std::map<std::string, std::size_t> numbers;
  for (std::size_t j = 0; j < rig.photographs.size(); ++j) numbers[rig.photographs[j]] = j;
  std::map<std::string, const CaptureFrame*> by_name;
  const std::vector<CaptureFrame> before = frames;
  for (const CaptureFrame& frame : before) {
    by_name[frame.name] = &frame;
    if (!numbers.contains(frame.name))
      throw InputError("the rig model does not contain frame '" + frame.name +
                       "'; give a model of this capture, or estimate one");
  }
  const Eigen::Matrix3f unmix = rig.mixing.inverse().cast<float>();
  frames.clear();
  for (CaptureFrame frame : before) {
    const std::size_t j = numbers[frame.name];
    if (!rig.light_of.empty()) {
      if (rig.light_of[j] < 0) continue;
      const auto light = by_name.find(rig.photographs[static_cast<std::size_t>(rig.light_of[j])]);
      if (light == by_name.end()) continue;
      frame.illumination = light->second->illumination;
      if (frame.views) frame.views->light = light->second->views->light;
    }
    FrameCorrection correction;
    correction.width_px = session.width;
    correction.height_px = session.height;
    if (!rig.shift_px.empty()) correction.shift_px = rig.shift_px[j];
    if (!rig.turn.empty()) correction.turn = rig.turn[j];
    if (!rig.gain.empty()) std::ranges::copy(rig.gain[j], correction.gain.begin());
    if (!rig.room.empty()) correction.room = static_cast<float>(rig.room[j]);
    if (rig.ambient_room) correction.ambient = *session.ambient;
    correction.primaries_from_camera = unmix;
    if (!rig.mixes_colours()) correction.primaries_from_camera.setIdentity();
    std::ranges::copy(rig.tone, correction.tone.begin());
    correction.white = static_cast<float>(rig.white);
    frame.correction = std::make_shared<const FrameCorrection>(correction);
    frames.push_back(std::move(frame));
  }
}

namespace {

/// A training frame in the session.
struct KnownFrame {
  std::size_t place, photograph;  // in the session's frames, in the model
  double order;
};

/// How many frames further the lights are that the photographs around `place` show: what most of the five
/// nearest have, since pairs across a held-out frame are further apart.
int offset_around(const RigModel& rig, const std::vector<KnownFrame>& known, std::size_t place) {
  constexpr std::size_t neighbours = 5;
  std::map<std::size_t, std::size_t> place_of;  // by number in the model
  for (const KnownFrame& frame : known) place_of[frame.photograph] = frame.place;
  auto nearest = known;
  const auto distance = [&](const KnownFrame& f) {
    return std::max(f.place, place) - std::min(f.place, place);
  };
  std::ranges::stable_sort(nearest, {}, distance);
  std::map<int, int> votes;
  for (std::size_t i = 0; i < std::min(neighbours, nearest.size()); ++i)
    if (const int light = rig.light_of[nearest[i].photograph]; light >= 0)
      ++votes[static_cast<int>(place_of[static_cast<std::size_t>(light)]) -
              static_cast<int>(nearest[i].place)];
  if (votes.empty()) return 0;
  return std::ranges::max_element(votes, {}, [](const auto& vote) { return vote.second; })->first;
}

/// Of values of the model, linear between the nearest frames before and after, which are in the order of
/// time.
std::array<double, 2> value_at(const std::vector<std::array<double, 2>>& values,
                               const std::vector<KnownFrame>& known, double order) {
  if (values.empty()) return {};
  const auto after = std::ranges::lower_bound(known, order, {}, &KnownFrame::order);
  const auto before = after == known.begin() ? after : after - 1;
  const auto& first = values[before->photograph];
  if (after == known.end() || after == before || after->order == before->order) return first;
  const auto& last = values[after->photograph];
  const double t = (order - before->order) / (after->order - before->order);
  return {first[0] + t * (last[0] - first[0]), first[1] + t * (last[1] - first[1])};
}

}  // namespace

void correct_held_out(const std::string& provenance, CaptureSession& session) {
  const auto json = json_if_valid(provenance);
  if (!json.is_object() || !json.contains("rig")) return;
  const RigModel rig = rig_from_text(json_text(json["rig"]), "the field's rig model");
  std::map<std::string, std::size_t> numbers;
  for (std::size_t j = 0; j < rig.photographs.size(); ++j) numbers[rig.photographs[j]] = j;
  std::vector<KnownFrame> known;
  for (std::size_t i = 0; i < session.frames.size(); ++i)
    if (const auto found = numbers.find(session.frames[i].name); found != numbers.end())
      known.push_back({i, found->second, session.frames[i].order});
  if (known.empty() || known.size() != numbers.size()) return;
  std::ranges::stable_sort(known, {}, &KnownFrame::order);
  const std::vector<CaptureFrame> before = session.frames;
  session.frames.clear();
  for (std::size_t i = 0; i < before.size(); ++i) {
    CaptureFrame& frame = session.frames.emplace_back(before[i]);
    if (frame.role != FrameRole::test || numbers.contains(frame.name)) continue;
    const auto light =
        static_cast<std::ptrdiff_t>(i) + (rig.light_of.empty() ? 0 : offset_around(rig, known, i));
    if (light < 0 || light >= std::ssize(before)) {
      session.frames.pop_back();
      continue;
    }
    frame.illumination = before[static_cast<std::size_t>(light)].illumination;
    if (frame.views) frame.views->light = before[static_cast<std::size_t>(light)].views->light;
    FrameCorrection correction;
    correction.width_px = session.width;
    correction.height_px = session.height;
    correction.shift_px = value_at(rig.shift_px, known, frame.order);
    correction.turn = value_at(rig.turn, known, frame.order);
    std::ranges::copy(rig.tone, correction.tone.begin());
    correction.white = static_cast<float>(rig.white);
    frame.correction = std::make_shared<const FrameCorrection>(correction);
  }
}

}  // namespace refield
