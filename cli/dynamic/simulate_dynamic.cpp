// SPDX-License-Identifier: Apache-2.0
#include "cli/dynamic/simulate_dynamic.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "cli/common/options.h"
#include "cli/dynamic/prepared_scene.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/number_text.h"
#include "core/base/output_lock.h"
#include "core/base/rng.h"
#include "core/base/units.h"
#include "core/image/image_io.h"
#include "core/image/tone_map.h"
#include "relight/sequence.h"

namespace refield::cli {

FrameTimes measure_frames(PreparedScene& scene, const dynamic::FrameOptions& options) {
  constexpr int frames = 15;
  const PinholeCamera camera = camera_of(scene.scene());
  std::vector<FrameTimes> all;
  using Clock = std::chrono::steady_clock;
  const auto ms_since = [](Clock::time_point start) {
    return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
  };
  for (int frame = 0; frame < frames; ++frame) {
    const auto start = Clock::now();
    scene.solve(scene.scene().duration() * frame / frames, camera, options);
    scene.light().radiance(0, scene.light().bounces());
    const double solved = ms_since(start);
    const auto before_picture = Clock::now();
    scene.picture(0, scene.light().bounces());
    const dynamic::DynamicLight::Times& times = scene.light().times();
    all.push_back({solved, 1e3 * times.direct, 1e3 * times.place, 1e3 * times.bounces, 1e3 * times.shade,
                   ms_since(before_picture) - 1e3 * times.shade});
  }
  const auto median = [&](double FrameTimes::*part) {
    std::vector<double> values;
    for (const FrameTimes& times : all) values.push_back(times.*part);
    std::ranges::nth_element(values, values.begin() + frames / 2);
    return values[frames / 2];
  };
  return {median(&FrameTimes::frame),   median(&FrameTimes::direct), median(&FrameTimes::place),
          median(&FrameTimes::bounces), median(&FrameTimes::shade),  median(&FrameTimes::picture)};
}

namespace {

constexpr std::size_t max_vertices = 500;

void draw_facing(const dynamic::DynamicScene& scene, FrameReference& drawn) {
  const Eigen::Vector3f eye = drawn.camera.position;
  const std::vector<dynamic::Pose> poses = scene.poses(drawn.time);
  FrameReference facing;
  std::size_t number = 0;
  for (std::uint32_t o = 0; o < scene.objects.size(); ++o) {
    const Mesh& mesh = scene.objects[o].mesh;
    for (std::uint32_t v = 0; v < mesh.positions.size(); ++v, ++number) {
      if ((poses[o].linear() * mesh.normals[v]).dot(eye - poses[o] * mesh.positions[v]) <= 0.0f) continue;
      facing.vertices.push_back(path_start(scene, poses, o, v, eye));
      facing.number.push_back(number);
    }
  }
  Rng rng(7);
  const std::size_t all = facing.vertices.size(), count = std::min(all, max_vertices);
  for (std::size_t i = 0; i < count; ++i) {  // one of each of `count` equal parts
    const std::size_t first = i * all / count, end = (i + 1) * all / count;
    const std::size_t k = first + static_cast<std::size_t>(rng.below(end - first));
    drawn.vertices.push_back(facing.vertices[k]);
    drawn.number.push_back(facing.number[k]);
  }
}

}  // namespace

FrameReference frame_reference(const PreparedScene& scene, double time, int bounces, int paths) {
  FrameReference reference;
  reference.time = time;
  reference.camera = camera_of(scene.scene());
  draw_facing(scene.scene(), reference);
  reference.bounces = scene.reference(time, reference.vertices, {.paths = paths, .bounces = bounces});
  return reference;
}

std::vector<LightError> frame_errors(PreparedScene& scene, const FrameReference& reference,
                                     dynamic::FrameOptions options) {
  const int bounces = static_cast<int>(reference.bounces.size()) - 1;
  options.bounces = bounces;
  scene.solve(reference.time, reference.camera, options);
  const std::size_t count = reference.vertices.size();
  const auto truth_of = [&](int first, int last) {
    std::vector<Eigen::Array3f> truth(count, Eigen::Array3f::Zero());
    for (int b = first; b <= last; ++b)
      for (std::size_t i = 0; i < count; ++i) truth[i] += reference.bounces[static_cast<std::size_t>(b)][i];
    return truth;
  };
  const auto norm = [](const std::vector<Eigen::Array3f>& values) {
    double sum = 0.0;
    for (const auto& value : values) sum += value.matrix().cast<double>().squaredNorm();
    return std::sqrt(sum);
  };
  const double all = norm(truth_of(0, bounces));
  std::vector<LightError> errors;
  const auto add = [&](const std::string& what, int first, int last) {
    const auto radiance = scene.light().radiance(first, last);
    const std::vector<Eigen::Array3f> truth = truth_of(first, last);
    std::vector<Eigen::Array3f> difference(count);
    for (std::size_t i = 0; i < count; ++i) difference[i] = radiance[reference.number[i]] - truth[i];
    errors.push_back({what, norm(difference) / norm(truth), norm(difference) / all, norm(truth) / all});
  };
  add("direct", 0, 0);
  for (int b = 1; b <= bounces; ++b) add("bounce " + std::to_string(b), b, b);
  if (bounces > 0) add("bounced", 1, bounces);
  add("all", 0, bounces);
  return errors;
}

namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

struct DynamicArguments {
  fs::path scene, output;
  dynamic::TransportOptions transport;
  dynamic::FrameOptions frame;
  std::string mode = "refined";
  VideoOptions video;
  std::optional<double> time;
  int reference = 0, traced = 0;
  bool measure = false;
};

void check_output(const fs::path& path) {
  const std::string extension = path.extension();
  if (!path.empty() && !extension.empty() && extension != ".png" && extension != ".exr" &&
      extension != ".mp4")
    throw InputError(path.string() +
                     ": is not a supported file type; images are written as .exr or .png, videos as .mp4");
}

int frame_count(const PreparedScene& scene, const DynamicArguments& arguments) {
  return static_cast<int>(std::floor(scene.scene().duration() * arguments.video.frames_per_second + 1e-6)) +
         1;
}

/// Calls `take` for each frame of the scene's motion in turn, with progress.
template <class Take>
void for_each_frame(PreparedScene& scene, const DynamicArguments& arguments, const Take& take) {
  const int frames = frame_count(scene, arguments);
  const PinholeCamera camera = camera_of(scene.scene());
  Progress progress(run_context(), "frames", static_cast<std::uint64_t>(frames));
  for (int frame = 0; frame < frames; ++frame) {
    run_context().throw_if_stopped();
    scene.solve(frame / arguments.video.frames_per_second, camera, arguments.frame);
    take(frame, scene.picture(0, scene.light().bounces()));
    progress.advance();
  }
}

Image one_picture(PreparedScene& scene, const DynamicArguments& arguments) {
  const double time = arguments.time.value_or(0.0);
  const PinholeCamera camera = camera_of(scene.scene());
  if (arguments.traced > 0)
    return scene.traced_picture(time, camera,
                                {.paths = arguments.traced, .bounces = arguments.frame.bounces});
  scene.solve(time, camera, arguments.frame);
  return scene.picture(0, scene.light().bounces());
}

/// PNG files and films of a scene, and how they are exposed: as --exposure says, else for the light that
/// objects reflect at up to eight times spread over the film, or at the time of the one picture.
class ExposedFrames {
 public:
  ExposedFrames(PreparedScene& scene, const DynamicArguments& arguments) {
    if (arguments.video.exposure) {
      factor_ = *arguments.video.exposure;
      return;
    }
    constexpr int max_metered = 8;
    const bool is_picture = arguments.output.extension() == ".png";
    const int frames = frame_count(scene, arguments), count = is_picture ? 1 : std::min(frames, max_metered);
    const PinholeCamera camera = camera_of(scene.scene());
    ExposureMeter meter;
    for (int k = 0; k < count; ++k) {
      const int frame = (2 * k + 1) * frames / (2 * count);
      const double time =
          is_picture ? arguments.time.value_or(0.0) : frame / arguments.video.frames_per_second;
      run_context().throw_if_stopped();
      scene.solve(time, camera, arguments.frame);
      meter.add(scene.reflected_picture());
    }
    factor_ = meter.exposure();
  }

  double factor() const { return factor_; }
  /// Mean over the pictures that were shown.
  double clipped() const { return pictures_ == 0 ? 0.0 : clipped_ / pictures_; }

  ToneMapping tone(const Image& picture) {
    clipped_ += clipped_share(picture, factor_);
    ++pictures_;
    return {factor_};
  }

 private:
  double factor_ = 1.0, clipped_ = 0.0;
  int pictures_ = 0;
};

/// Returns the exposure of PNG files and films; none for EXR.
std::optional<double> write_frames(PreparedScene& scene, const DynamicArguments& arguments) {
  const fs::path& output = arguments.output;
  create_folders(fs::absolute(output).parent_path());
  if (output.extension() == ".exr") {
    write_exr(output, one_picture(scene, arguments));
    return std::nullopt;
  }
  ExposedFrames frames(scene, arguments);
  if (output.extension() == ".mp4") {
    const PinholeCamera camera = camera_of(scene.scene());
    write_atomically(output, [&](const fs::path& temporary) {
      VideoWriter video(temporary, camera.width, camera.height, arguments.video.frames_per_second);
      for_each_frame(scene, arguments, [&](int, const Image& picture) {
        video.add(tone_mapped(picture, frames.tone(picture)), run_context());
      });
      video.finish();
    });
  } else if (output.extension() == ".png") {
    const Image picture = one_picture(scene, arguments);
    write_png(output, picture, frames.tone(picture));
  } else {
    create_folders(output);
    for_each_frame(scene, arguments, [&](int frame, const Image& picture) {
      write_png(output / formatted("frame_%05d.png", frame), picture, frames.tone(picture));
    });
  }
  if (arguments.video.exposure) warn_of_clipping(frames.clipped());
  return frames.factor();
}

ordered_json measured(PreparedScene& scene, const DynamicArguments& arguments) {
  const FrameTimes times = measure_frames(scene, arguments.frame);
  return {{"frame_ms", times.frame},     {"direct_ms", times.direct}, {"place_ms", times.place},
          {"bounces_ms", times.bounces}, {"shade_ms", times.shade},   {"picture_ms", times.picture}};
}

ordered_json error_rows(PreparedScene& scene, const DynamicArguments& arguments) {
  const FrameReference reference =
      frame_reference(scene, arguments.time.value_or(0.0), arguments.frame.bounces, arguments.reference);
  ordered_json rows = ordered_json::array();
  for (const LightError& error : frame_errors(scene, reference, arguments.frame))
    rows.push_back({{"what", error.what},
                    {"relative", error.relative},
                    {"of_all", error.of_all},
                    {"share", error.share}});
  return rows;
}

void print(const ordered_json& figures) {
  for (const auto& object : figures["objects"])
    std::printf("%-12s %6d vertices, %3d terms (error %.3f)\n", object["name"].get<std::string>().c_str(),
                object["vertices"].get<int>(), object["terms"].get<int>(),
                object["term_error"].get<double>());
  std::printf("%.1f MB, precomputed in %.1f s\n", figures["bytes"].get<double>() / 1e6,
              figures["precompute_seconds"].get<double>());
  if (figures.contains("times")) {
    const auto& times = figures["times"];
    const double frame = times["frame_ms"].get<double>();
    std::printf(
        "%.1f frames/s: %.2f ms = direct %.2f + place %.2f + bounces %.2f + shade %.2f; rasterisation %.2f "
        "ms\n",
        1e3 / frame, frame, times["direct_ms"].get<double>(), times["place_ms"].get<double>(),
        times["bounces_ms"].get<double>(), times["shade_ms"].get<double>(),
        times["picture_ms"].get<double>());
  }
  if (figures.contains("errors"))
    for (const auto& row : figures["errors"])
      std::printf("%-8s relative error %.4f, %.4f of all light; fraction of all light %.4f\n",
                  row["what"].get<std::string>().c_str(), row["relative"].get<double>(),
                  row["of_all"].get<double>(), row["share"].get<double>());
}

void simulate_dynamic(DynamicArguments arguments, const Common& common) {
  if (arguments.mode == "paper") {
    arguments.transport.fields = true;
    arguments.frame.direct_by_fields = true;
  }
  arguments.video.check();
  arguments.frame.check();
  check_output(arguments.output);
  if (arguments.traced > 0 && arguments.output.extension() != ".png" &&
      arguments.output.extension() != ".exr")
    throw InputError("--traced renders a single image; give an output file .exr or .png");
  std::optional<OutputLock> lock;
  if (!arguments.output.empty()) lock.emplace(arguments.output, std::vector<fs::path>{arguments.scene});
  const auto start = std::chrono::steady_clock::now();
  PreparedScene scene(dynamic::read_dynamic_scene(arguments.scene, run_context()), arguments.transport,
                      run_context());
  ordered_json figures{{"objects", ordered_json::array()}};
  for (std::size_t o = 0; o < scene.transport().size(); ++o) {
    const dynamic::ObjectTransport& transport = scene.transport()[o];
    figures["objects"].push_back({{"name", scene.scene().objects[o].name},
                                  {"vertices", scene.scene().objects[o].mesh.positions.size()},
                                  {"terms", transport.terms()},
                                  {"term_error", transport.factors.error()},
                                  {"modes", transport.modes.count()},
                                  {"bytes", transport.bytes()}});
  }
  figures["bytes"] = scene.bytes();
  figures["precompute_seconds"] = seconds_since(start);
  if (!arguments.output.empty())
    if (const auto exposure = write_frames(scene, arguments)) figures["exposure"] = *exposure;
  if (arguments.measure) figures["times"] = measured(scene, arguments);
  if (arguments.reference > 0) figures["errors"] = error_rows(scene, arguments);
  if (common.json)
    print_json(figures);
  else
    print(figures);
  if (!common.json && !arguments.video.exposure && figures.contains("exposure"))
    print_exposures({}, std::array{figures["exposure"].get<double>()});
}

}  // namespace

void add_render(CLI::App& app, const Common& common, Action& action) {
  auto arguments = std::make_shared<DynamicArguments>();
  CLI::App* verb = app.add_subcommand(
      "render",
      "Render a scene with moving objects and area lights in real time.\n"
      "\n"
      "Includes diffuse and glossy interreflection between the objects. docs/reference/scene-files.md "
      "describes the scene format, docs/method/dynamic.md the method.\n"
      "\n"
      "Examples:\n"
      "  refield render datasets_synthetic/dynamic/rabbit.toml -o rabbit.mp4\n"
      "  refield render scene.toml --time 1.5 -o picture.png\n"
      "  refield render scene.toml --measure --reference 1024");
  verb->add_option("scene", arguments->scene, "Scene (.toml, docs/reference/scene-files.md)")->required();
  verb->add_option("-o,--output", arguments->output,
                   "Video (.mp4), one image (.png, .exr; see --time), or a folder of images");
  verb->add_option("--time", arguments->time,
                   "Time in seconds of the single image and of --reference (default: 0)")
      ->check(non_negative_number());
  add_fps_option(*verb, arguments->video.frames_per_second);
  add_exposure_option(*verb, arguments->video.exposure);
  verb->add_option("--mode", arguments->mode,
                   "Mode: refined: rays from every vertex for shadows and indirect light; paper: precomputed "
                   "fields around objects, direct light by the BRDF terms, shadows from occlusion fields by "
                   "products of spherical harmonics")
      ->check(CLI::IsMember({"refined", "paper"}))
      ->capture_default_str();
  verb->add_option("--bounces", arguments->frame.bounces, "Maximum number of indirect bounces")
      ->check(CLI::Range(0, 64))
      ->capture_default_str();
  verb->add_flag("--measure", arguments->measure, "Also measure computation times");
  verb->add_option("--rays", arguments->frame.rays, "Number of rays from each vertex, for indirect light")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str()
      ->group(further);
  verb->add_option(
          "--traced", arguments->traced,
          "Render the single image by path tracing with this number of paths per vertex, as a reference")
      ->check(CLI::Range(1, 1 << 20))
      ->group(further);
  verb->add_option("--reference", arguments->reference,
                   "Trace this number of paths at each of 500 vertices and print the error by bounce")
      ->check(CLI::Range(1, 1 << 24))
      ->group(further);
  verb->callback([verb, arguments, &common, &action] {
    if (arguments->mode == "paper" && verb->count("--rays") > 0)
      throw InputError("--rays is not an option of --mode paper; give one of the two");
    action = [arguments, &common] { simulate_dynamic(*arguments, common); };
  });
}

}  // namespace refield::cli
