// SPDX-License-Identifier: Apache-2.0
#include "acquire/light_probe/light_probe.h"

#define TOML_EXCEPTIONS 1

#include <toml++/toml.h>

#include <cmath>
#include <sstream>

#include "acquire/series/capture_time.h"
#include "core/base/config_file.h"
#include "core/base/files.h"
#include "core/base/number_text.h"
#include "core/base/run_context.h"
#include "core/base/units.h"
#include "core/light/light_map.h"
#include "core/session/capture_session.h"

namespace refield {

namespace {

constexpr double least_radius_px = 32.0;

double luminance(const float* rgb) {
  return 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
}

std::string per_cent(double fraction) {
  return formatted("%.3g %%", 100.0 * fraction);
}

constexpr const char* report_name = "probe.toml";

Photograph read_probe_photograph(const fs::path& path, std::optional<double> saturation) {
  Photograph photograph = read_photograph(path);
  require_finite(photograph.radiance, path.string(), true, "repair that pixel, or merge the exposures anew");
  if (saturation && photograph.sigma.empty()) {
    photograph.sigma = photograph.radiance;
    for (float& sample : photograph.sigma.values)
      sample = sample >= *saturation ? std::numeric_limits<float>::infinity() : 0.0f;
  }
  return photograph;
}

ProbeOptics optics_of(const ProbeSide& side, int width, int height) {
  ProbeOptics optics;
  if (side.field_of_view_degrees) optics = ProbeOptics::of_view(*side.field_of_view_degrees, width, height);
  optics.distance_radii = side.distance_radii;
  optics.principal_px = Eigen::Vector2d(width, height) / 2.0;
  optics.check();
  return optics;
}

/// One side of the rig while its photographs are worked through.
class Side {
 public:
  Side(const ProbeSide& side, const ProbeRequest& request, std::vector<std::string>& notes,
       const RunContext& run)
      : side_(side), request_(request) {
    const ImageHeader header = read_image_header(side.photographs.front());
    width_ = header.width;
    height_ = header.height;
    optics_ = optics_of(side, width_, height_);
    if (side.hidden) hidden_ = read_mask(*side.hidden, width_, height_);
    if (!header.has_sigma && !request.saturation)
      notes.push_back(
          side.photographs.front().string() +
          ": does not state which samples clipped; over-exposed photographs are not noticed without "
          "--saturation");
    if (side.ball)
      ball_ = ball_from_circle(*side.ball, optics_);
    else if (!request.ball_moves)
      ball_ = find_in_series(notes, run);
    if (ball_) require_usable(*ball_, width_, height_, side.photographs.front().string());
  }

  /// `which` photograph, unwrapped to a map of that width (0: natural).
  SeenLight unwrapped(std::size_t which, UnwrapOptions options, ImageCircle& circle) const {
    const fs::path& path = side_.photographs[which];
    const Photograph photograph = read_probe_photograph(path, request_.saturation);
    if (photograph.radiance.width != width_ || photograph.radiance.height != height_)
      throw InputError(path.string() + ": is " + shape_text(photograph.radiance) +
                       ", the first photograph is " + std::to_string(width_) + "×" + std::to_string(height_) +
                       "; give photographs of one camera");
    const MirrorBall ball = ball_ ? *ball_ : found_in(path, photograph.radiance).ball;
    require_usable(ball, width_, height_, path.string());
    if (options.width == 0) options.width = natural_width(ball);
    circle = {ball.centre_px(), ball.radius_px()};
    return unwrap(photograph, ball, side_.turn, hidden_, options);
  }

 private:
  OutlineFit found_in(const fs::path& path, const Image& photograph) const {
    try {
      return find_ball(photograph, optics_);
    } catch (const InputError& error) {
      throw InputError(path.string() + ": " + error.what());
    }
  }

  /// The rig does not move: the middle one of the places found in a few photographs, of which some may be too
  /// dark.
  MirrorBall find_in_series(std::vector<std::string>& notes, const RunContext& run) const {
    constexpr std::size_t most = 9;
    const std::size_t count = std::min(most, side_.photographs.size());
    std::vector<OutlineFit> fits;
    std::string failure;
    for (std::size_t i = 0; i < count; ++i) {
      run.throw_if_stopped();
      const fs::path& path = side_.photographs[i * side_.photographs.size() / count];
      try {
        fits.push_back(found_in(path, read_probe_photograph(path, request_.saturation).radiance));
      } catch (const InputError& error) {
        failure = error.what();
      }
    }
    if (fits.empty()) throw InputError(failure);
    std::ranges::sort(fits, {}, [](const OutlineFit& fit) { return fit.ball.radius_px(); });
    const OutlineFit& middle = fits[fits.size() / 2];
    const Eigen::Vector2d centre = middle.ball.centre_px();
    notes.emplace_back(
        formatted("ball found at --ball %.2f,%.2f,%.2f: %.0f %% of its outline clear, within %.2f pixels; "
                  "seen in %zu of "
                  "%zu photographs tried",
                  centre.x(), centre.y(), middle.ball.radius_px(), 100.0 * middle.support, middle.rms_px,
                  fits.size(), count));
    constexpr double sure_support = 0.9, sure_px = 0.6;
    if (middle.support < sure_support || middle.rms_px > sure_px)
      notes.emplace_back(
          "the outline is not clear on all sides, so the position of the ball may be wrong by a pixel or "
          "more: check it in the photograph, and give --ball if necessary");
    for (const OutlineFit& fit : fits)
      if ((fit.ball.centre_px() - centre).norm() > 2.0) {
        notes.emplace_back(
            "photographs show the ball in places that differ by more than 2 pixels; where the camera "
            "or the ball moved, use --ball-moves");
        break;
      }
    return middle.ball;
  }

  const ProbeSide& side_;
  const ProbeRequest& request_;
  int width_ = 0;
  int height_ = 0;
  ProbeOptics optics_;
  Mask hidden_;
  std::optional<MirrorBall> ball_;
};

void check(const ProbeRequest& request) {
  if (request.sides.empty() || request.sides[0].photographs.empty())
    throw InputError("there is no photograph of a ball; name photographs (.exr)");
  for (const ProbeSide& side : request.sides)
    if (side.photographs.size() != request.sides[0].photographs.size())
      throw InputError("one side has " + std::to_string(request.sides[0].photographs.size()) +
                       " photographs, another " + std::to_string(side.photographs.size()) +
                       "; each needs its partner");
  UnwrapOptions unwrap = request.unwrap;
  if (unwrap.width == 0) unwrap.width = 512;
  unwrap.check();
  request.limits.check();
  if (fs::exists(request.folder) && !fs::is_directory(request.folder))
    throw InputError(request.folder.string() + ": is no folder; name another output folder");
  if (fs::exists(request.folder) && !fs::is_empty(request.folder)) {
    if (!fs::exists(request.folder / report_name))
      throw InputError(request.folder.string() +
                       ": contains other files than environment maps of this verb; give a new folder");
    if (!request.replace)
      throw InputError(request.folder.string() + ": already holds light maps; --force replaces them");
  }
}

/// Removes the maps that an earlier run lists.
void clear(const fs::path& folder) {
  if (!fs::exists(folder / report_name)) return;
  const ConfigFile report(folder / report_name, "light probe report", "docs/guide/light-probe.md");
  for (ConfigSection& photograph : report.root().tables("photograph")) {
    std::string name;
    photograph.text("name", name);
    if (!name.empty()) fs::remove(folder / (fs::path(name).filename().string() + ".exr"));
  }
  fs::remove(folder / times_file_name);
}

void write_report(const ProbeSummary& summary, const fs::path& folder) {
  toml::array list;
  for (const ProbedPhotograph& photograph : summary.photographs) {
    const ProbeVerdict& v = photograph.verdict;
    toml::table entry{
        {"name", photograph.photograph.stem().string()},
        {"ball", toml::array{photograph.ball.centre.x(), photograph.ball.centre.y(), photograph.ball.radius}},
        {"mean_radiance", toml::array{v.mean_radiance[0], v.mean_radiance[1], v.mean_radiance[2]}},
        {"sun_fraction", v.sun_fraction},
        {"clipped_fraction", v.clipped_fraction},
        {"unseen_fraction", v.unseen_fraction}};
    if (!v.discarded.empty()) entry.insert("discarded", v.discarded);
    list.push_back(std::move(entry));
  }
  std::ostringstream text;
  text << toml::table{{"format", "refield light probe"},
                      {"version", 1},
                      {"width", summary.width},
                      {"photograph", list}}
       << "\n";
  write_text_atomically(folder / report_name, text.str());
}

}  // namespace

void ProbeLimits::check() const {
  for (double fraction : {max_clipped, max_sun})
    if (!(fraction >= 0.0 && fraction <= 1.0))
      throw InputError("a limit of the light probe is " + std::to_string(fraction) +
                       "; give a fraction, 0 to 1");
}

ProbeVerdict assess(const SeenLight& light, const ProbeLimits& limits) {
  const Image& map = light.radiance;
  std::size_t brightest = 0;
  for (std::size_t t = 0; t < map.pixel_count(); ++t)
    if (luminance(&map.values[3 * t]) > luminance(&map.values[3 * brightest])) brightest = t;
  const auto direction_of = [&](std::size_t t) {
    return lat_long_direction(static_cast<double>(t % map.width) + 0.5,
                              static_cast<double>(t / map.width) + 0.5, map.width, map.height);
  };
  const Eigen::Vector3d sun = direction_of(brightest);
  constexpr double sun_degrees = 3.0;
  const double near = std::cos(radians_from_degrees(sun_degrees));

  ProbeVerdict verdict;
  double all = 0.0, from_sun = 0.0, total = 0.0, clipped = 0.0;
  for (std::size_t t = 0; t < map.pixel_count(); ++t) {
    const double row = static_cast<double>(t / map.width) + 0.5;
    const double solid_angle = std::sin(std::numbers::pi * row / map.height);
    const double flux = solid_angle * luminance(&map.values[3 * t]);
    total += solid_angle;
    all += flux;
    if (direction_of(t).dot(sun) >= near) from_sun += flux;
    if (light.clipped[t]) clipped += solid_angle;
    for (int c = 0; c < 3; ++c) verdict.mean_radiance[c] += solid_angle * map.values[3 * t + c];
  }
  for (double& mean : verdict.mean_radiance) mean /= total;
  verdict.unseen_fraction = unseen_fraction(light.weight);
  verdict.clipped_fraction = clipped / total;
  verdict.sun_fraction = all > 0.0 ? from_sun / all : 0.0;

  if (!(all > 0.0))
    verdict.discarded = "it is black";
  else if (verdict.clipped_fraction > limits.max_clipped)
    verdict.discarded =
        "over-exposed: " + per_cent(verdict.clipped_fraction) +
        " of the sphere clipped in every exposure, so how bright it was (the sun?) is not known; "
        "add a shorter exposure or a denser filter";
  else if (verdict.sun_fraction > limits.max_sun)
    verdict.discarded = "sun only: " + per_cent(verdict.sun_fraction) + " of the light comes from one spot";
  return verdict;
}

void require_usable(const MirrorBall& ball, int width, int height, const std::string& name) {
  double beyond = 0.0;
  for (int i = 0; i < 360; ++i) {
    const Eigen::Vector2d p = ball.outline_point(2.0 * std::numbers::pi * i / 360.0);
    beyond = std::max({beyond, -p.x(), -p.y(), p.x() - width, p.y() - height});
  }
  if (beyond > 0.5)
    throw InputError(name + ": the ball reaches " + std::to_string(static_cast<int>(std::ceil(beyond))) +
                     " pixels beyond the photograph, so part of the environment is missing; photograph the "
                     "whole ball, or check --ball");
  if (ball.radius_px() < least_radius_px)
    throw InputError(name + ": the ball has a radius of " +
                     std::to_string(static_cast<int>(ball.radius_px())) +
                     " pixels, too few for a light map (at least " +
                     std::to_string(static_cast<int>(least_radius_px)) + "); use a longer lens or go nearer");
}

std::size_t ProbeSummary::kept() const {
  return static_cast<std::size_t>(
      std::ranges::count_if(photographs, [](const auto& p) { return p.verdict.discarded.empty(); }));
}

ProbeSummary probe_light(const ProbeRequest& request, const RunContext& run) {
  const ThreadLimit limit(run);
  check(request);
  ProbeSummary summary;
  std::vector<Side> sides;
  for (const ProbeSide& side : request.sides) sides.emplace_back(side, request, summary.notes, run);
  create_folders(request.folder);
  clear(request.folder);
  UnwrapOptions options = request.unwrap;
  std::map<std::string, ClockSeconds> times, inherited;
  const auto& photographs = request.sides[0].photographs;
  if (photographs[0].has_parent_path()) inherited = read_times(photographs[0].parent_path());
  Progress progress(run, "unwrapping the ball", photographs.size());
  for (std::size_t i = 0; i < photographs.size(); ++i) {
    run.throw_if_stopped();
    ProbedPhotograph probed{photographs[i], {}, {}};
    std::vector<SeenLight> views;
    for (std::size_t s = sides.size(); s-- > 0;) {
      views.push_back(sides[s].unwrapped(i, options, probed.ball));
      options.width = views.back().radiance.width;
    }
    SeenLight light = join(views);
    fill_unseen(light);
    probed.verdict = assess(light, request.limits);
    const std::string name = photographs[i].stem().string();
    if (probed.verdict.discarded.empty()) write_exr(request.folder / (name + ".exr"), light.radiance);
    if (const auto known = inherited.find(name); known != inherited.end())
      times[name] = known->second;
    else if (const auto taken = capture_time(photographs[i]))
      times[name] = *taken;
    summary.photographs.push_back(std::move(probed));
    summary.width = options.width;
    write_report(summary, request.folder);
    progress.advance();
  }
  write_times(request.folder, times);
  return summary;
}

}  // namespace refield
