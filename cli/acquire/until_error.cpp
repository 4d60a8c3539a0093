// SPDX-License-Identifier: Apache-2.0
#include "cli/acquire/until_error.h"

#include <Eigen/Dense>
#include <cmath>

#include "cli/run_context.h"
#include "core/base/number_text.h"
#include "core/image/image_io.h"

namespace refield::cli {

double error_from_text(const std::string& text) {
  double value = 0.0;
  const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), value);
  const std::string unit(end, text.data() + text.size());
  if (unit == "%") value /= 100.0;
  if (problem != std::errc() || (!unit.empty() && unit != "%") || !(value > 0.0 && value < 1.0))
    throw InputError("--until-error ", text,
                     ": give a relative error between 0 and 100 %, such as 2% or 0.02");
  return value;
}

UntilError::UntilError(double error, int min_images, int check_every)
    : error_(error), min_images_(min_images), check_every_(check_every), follower_(EstimateOptions()) {
  if (min_images < 10)
    throw InputError("--min-images is ", min_images,
                     "; give 10 or more, since the prediction needs that many images");
  if (check_every < 1) throw InputError("--check-every is ", check_every, "; give 1 or more");
}

void UntilError::attach(CaptureRequest& request) {
  std::vector<LightMap> natural;
  constexpr std::size_t max_lights = 12;
  for (const CaptureLight& light : request.lights) {
    if (light.role != FrameRole::test || natural.size() == max_lights) continue;
    LightMap map = read_light_map(light.wanted, Parameterisation::monitor, run_context());
    if (kind_of_light(map.radiance) == "natural") natural.push_back(std::move(map));
  }
  follower_.expect(std::move(natural));
  request.is_enough = [this](const CaptureFrame& frame) { return is_enough(frame); };
  if (error_ == 0.0) return;
  request.stop_rule =
      formatted("predicted error %.6g, from %d images, every %d", error_, min_images_, check_every_);
}

bool UntilError::is_enough(const CaptureFrame& frame) {
  follower_.add(frame, Parameterisation::monitor, run_context());
  const int images = follower_.images();
  if (images < min_images_ || (images - min_images_) % check_every_ != 0) return false;
  last_ = follower_.predict(run_context());
  if (!last_.predicted) {
    run_context().note(formatted(
        "after %d photographs: the error cannot be predicted from %d lights that differ; it takes %d", images,
        last_.lights, min_lights_for_errors));
    return false;
  }
  const double predicted = *last_.predicted;
  if (error_ == 0.0) {
    run_context().note(formatted("after %d photographs: predicted error %.2f %%", images, 100.0 * predicted));
    return false;
  }
  reached_ = predicted <= error_;
  const int needed = reached_ ? 0 : follower_.images_for(error_);
  run_context().note(formatted("after %d photographs: predicted error %.2f %% (target: %.2f %%)", images,
                               100.0 * predicted, 100.0 * error_),
                     needed > 0 ? formatted(", about %d photographs are needed", needed) : "");
  return reached_;
}

bool is_of_the_devices(const VerdictRow& row) {
  return row.property == "colour" || row.property == "tone curve" || row.property == "drift";
}

std::vector<VerdictRow> compare_references(const std::vector<fs::path>& photographs) {
  if (photographs.size() < 2) return {};
  const Photograph first = read_photograph(photographs.front()), last = read_photograph(photographs.back());
  const auto level = [](const Photograph& photograph, int x, int y) {
    double sum = 0.0;
    for (int c = 0; c < 3; ++c) {
      const bool measured = photograph.sigma.empty() || std::isfinite(photograph.sigma.at(x, y, c));
      sum += measured ? photograph.radiance.at(x, y, c) : NAN;
    }
    return sum;
  };
  // last = (1 + gain) · first − shift · gradient + room, by least squares.
  Eigen::Matrix4d gram = Eigen::Matrix4d::Zero();
  Eigen::Vector4d moments = Eigen::Vector4d::Zero();
  double squares = 0.0, brightness = 0.0, count = 0.0;
  for (int y = 1; y + 1 < first.radiance.height; ++y)
    for (int x = 1; x + 1 < first.radiance.width; ++x) {
      const double here = level(first, x, y), change = level(last, x, y) - here;
      const Eigen::Vector4d row(here, 0.5 * (level(first, x - 1, y) - level(first, x + 1, y)),
                                0.5 * (level(first, x, y - 1) - level(first, x, y + 1)), 1.0);
      if (!row.allFinite() || !std::isfinite(change)) continue;
      gram += row * row.transpose();
      moments += change * row;
      squares += change * change;
      brightness += here;
      count += 1.0;
    }
  const Eigen::Vector4d found = gram.ldlt().solve(moments);
  const double variance = std::max(0.0, squares - found.dot(moments)) / std::max(1.0, count - 4.0);
  const Eigen::Vector4d deviation = (variance * gram.inverse().diagonal()).cwiseSqrt();
  constexpr double min_shift = 0.1, min_room = 0.02, significant = 5.0;
  const double shift = std::hypot(found[1], found[2]), room = found[3] * count / brightness;
  std::vector<VerdictRow> rows;
  const auto add = [&](const char* property, const char* format, const auto&... values) {
    rows.push_back({property, RigFinding::State::suspicious, formatted(format, values...), {}, {}, ""});
  };
  if (shift > min_shift && shift > significant * std::hypot(deviation[1], deviation[2])) {
    add("motion",
        "the picture of the reference light moved by about %.2f pixels (%.2f to the right, %.2f down)", shift,
        found[1], found[2]);
    rows.back().remedy = "fix the camera and photograph again";
  }
  // Behind edges that moved by more than a small part of a pixel, gain and room light are not separable.
  if (rows.empty() && std::abs(room) > min_room && std::abs(found[3]) > significant * deviation[3]) {
    add("room light", "all of the picture of the reference light has %.2g %% of its mean %s",
        100.0 * std::abs(room), room > 0.0 ? "more" : "less");
    rows.back().remedy = "darken the room and photograph again";
  }
  return rows;
}

void CaptureWatch::attach(CaptureRequest& request) {
  for (const CaptureLight& light : request.lights)
    if (light.role == FrameRole::reference)
      references_.push_back(request.folder / "observed" / (light.name + ".exr"));
  request.on_photograph = [this, others = std::move(request.on_photograph)](const Photograph& photograph) {
    taken_ = true;
    if (others) others(photograph);
  };
  request.is_enough = [this, others = std::move(request.is_enough)](const CaptureFrame& frame) {
    check(frame);
    return others && others(frame);
  };
}

CaptureWatch::Findings CaptureWatch::findings() const {
  std::vector<fs::path> references = references_;
  std::erase_if(references, [](const auto& path) { return !fs::exists(path); });
  std::vector<VerdictRow> rows = compare_references(references);
  if (static_cast<int>(frames_.size()) >= min_frames_for_rig) {
    CaptureSession session;
    session.light.parameterisation = Parameterisation::monitor;
    session.frames = frames_;
    const auto more = check_capture(session, {}, run_context()).rows;
    rows.insert(rows.end(), more.begin(), more.end());
  }
  Findings found;
  for (const VerdictRow& row : rows)
    if (row.state != RigFinding::State::good && !is_of_the_devices(row))
      found.emplace(row.property, row.property + ": " + row.measured + "; " + row.remedy);
  return found;
}

void CaptureWatch::check(const CaptureFrame& frame) {
  if (taken_ && !known_) known_ = findings();
  frames_.push_back(frame);
  if (!taken_ || static_cast<int>(frames_.size()) % every_ != 0) return;
  std::string news;
  for (const auto& [property, text] : findings())
    if (known_->emplace(property, text).second) news += "\n  " + text;
  if (!news.empty())
    throw InputError("the capture stopped after ", frames_.size(),
                     " training photographs, since a check of them found:", news,
                     "\n  --resume continues with these photographs, --force begins again");
}

}  // namespace refield::cli
