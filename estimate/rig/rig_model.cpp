// SPDX-License-Identifier: Apache-2.0
#include "estimate/rig/rig_model.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/json_text.h"

namespace refield {

bool RigModel::is_identity() const {
  return light_of.empty() && shift_px.empty() && gain.empty() && room.empty() && !mixes_colours() &&
         !bends_tone();
}

std::string rig_text(const RigModel& rig) {
  nlohmann::ordered_json json = {{"photographs", rig.photographs}};
  if (!rig.light_of.empty()) json["light_of"] = rig.light_of;
  if (!rig.shift_px.empty()) json["shift_px"] = rig.shift_px;
  if (rig.mixes_colours()) {
    auto rows = nlohmann::json::array();
    for (int c = 0; c < 3; ++c) rows.push_back({rig.mixing(c, 0), rig.mixing(c, 1), rig.mixing(c, 2)});
    json["mixing"] = rows;
  }
  if (rig.bends_tone()) {
    json["tone"] = rig.tone;
    json["white"] = rig.white;
  }
  if (!rig.gain.empty()) json["gain"] = rig.gain;
  if (!rig.room.empty()) json["room"] = rig.room;
  return json_text(json);
}

RigModel rig_from_text(const std::string& text, const std::string& name) try {
  const auto json = nlohmann::json::parse(text);
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
  read("gain", rig.gain);
  read("room", rig.room);
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
} catch (const nlohmann::json::exception& error) {
  throw InputError(name + ": is not a rig model as 'refield estimate' writes it: " + error.what());
}

RigModel read_rig(const std::filesystem::path& path) {
  return rig_from_text(read_text(path), path.string());
}

void apply_rig(const RigModel& rig, int height_px, std::vector<CaptureFrame>& frames) {
  if (rig.is_identity()) return;
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
    correction.height_px = height_px;
    if (!rig.shift_px.empty()) correction.shift_px = rig.shift_px[j];
    if (!rig.gain.empty()) std::ranges::copy(rig.gain[j], correction.gain.begin());
    if (!rig.room.empty()) correction.room.fill(static_cast<float>(rig.room[j]));
    correction.primaries_from_camera = unmix;
    if (!rig.mixes_colours()) correction.primaries_from_camera.setIdentity();
    std::ranges::copy(rig.tone, correction.tone.begin());
    correction.white = static_cast<float>(rig.white);
    frame.correction = std::make_shared<const FrameCorrection>(correction);
    frames.push_back(std::move(frame));
  }
}

int rig_margin(const FrameCorrection* correction) {
  if (!correction || correction->shift_px[1] == 0.0) return 0;
  return static_cast<int>(std::ceil(std::abs(correction->shift_px[1]))) + 2;
}

std::array<float, 4> cubic_weights(double t) {
  const double u = 1.0 - t;
  return {static_cast<float>(-0.5 * t * u * u), static_cast<float>(1.0 - t * t * (2.5 - 1.5 * t)),
          static_cast<float>(1.0 - u * u * (2.5 - 1.5 * u)), static_cast<float>(-0.5 * u * t * t)};
}

namespace {

/// Row `y` of the wanted picture, moved.
void interpolate_row(const Image& rows, int first_row, int y, const std::array<double, 2>& shift,
                     std::span<float> out) {
  const double x_floor = std::floor(shift[0]), y_floor = std::floor(shift[1]);
  const auto across = cubic_weights(shift[0] - x_floor), down = cubic_weights(shift[1] - y_floor);
  const int width = rows.width;
  std::vector<float> column_sums(std::size_t{3} * width, 0.0f);
  for (int i = 0; i < 4; ++i) {
    if (down[i] == 0.0f) continue;
    const int from = std::clamp(y + static_cast<int>(y_floor) + i - 1 - first_row, 0, rows.height - 1);
    const auto row = rows.row(from);
    for (std::size_t k = 0; k < row.size(); ++k) column_sums[k] += down[i] * row[k];
  }
  const int x_first = static_cast<int>(x_floor) - 1;
  for (int x = 0; x < width; ++x)
    for (int c = 0; c < 3; ++c) {
      float sum = 0.0f;
      for (int i = 0; i < 4; ++i)
        if (across[i] != 0.0f)
          sum += across[i] * column_sums[std::size_t{3} * std::clamp(x + x_first + i, 0, width - 1) + c];
      out[std::size_t{3} * x + c] = sum;
    }
}

}  // namespace

Image undo_rig(const Image& rows, int first_row, int first, int last, const FrameCorrection& correction) {
  Image result(rows.width, last - first, 3);
  const bool moves = correction.shift_px != std::array<double, 2>{};
  const bool mixes = correction.primaries_from_camera != Eigen::Matrix3f::Identity();
  for (int y = first; y < last; ++y) {
    const auto out = result.row(y - first);
    if (moves)
      interpolate_row(rows, first_row, y, correction.shift_px, out);
    else
      std::ranges::copy(rows.row(y - first_row), out.begin());
    for (std::size_t i = 0; i < out.size(); i += 3) {
      Eigen::Map<Eigen::Vector3f> pixel(&out[i]);
      for (int c = 0; c < 3; ++c) pixel[c] /= correction.gain[c];
      if (mixes) pixel = (correction.primaries_from_camera * pixel).eval();
    }
  }
  return result;
}

}  // namespace refield
