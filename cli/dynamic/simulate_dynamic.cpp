// SPDX-License-Identifier: Apache-2.0

#include "cli/common/options.h"
#include "cli/dynamic/prepared_scene.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/files.h"
#include "core/base/json.h"
#include "core/base/number_text.h"
#include "core/base/output_lock.h"
#include "core/base/units.h"
#include "core/image/image_io.h"
#include "core/image/tone_map.h"
#include "relight/relight.h"

namespace refield::cli {

namespace {

struct DynamicArguments {
  fs::path scene, output;
  dynamic::TransportOptions transport;
  dynamic::FrameOptions frame;
  std::string mode = "refined";
  VideoOptions video;
  std::optional<double> time;
};

void check_output(const fs::path& path) {
  const std::string extension = path.extension();
  if (!path.empty() && !extension.empty() && extension != ".png" && extension != ".exr" &&
      extension != ".mp4")
    throw InputError(path,
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
  scene.solve(time, camera_of(scene.scene()), arguments.frame);
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

void print(const Json& figures) {
  for (const auto& object : figures["objects"])
    std::printf("%-12s %6d vertices, %3d terms (error %.3f)\n", object["name"].get<std::string>().c_str(),
                object["vertices"].get<int>(), object["terms"].get<int>(),
                object["term_error"].get<double>());
  std::printf("%.1f MB, precomputed in %.1f s\n", figures["bytes"].get<double>() / 1e6,
              figures["precompute_seconds"].get<double>());
}

void simulate_dynamic(DynamicArguments arguments, const Common& common) {
  if (arguments.mode == "paper") {
    arguments.transport.fields = true;
    arguments.frame.direct_by_fields = true;
  }
  arguments.video.check();
  arguments.frame.check();
  check_output(arguments.output);
  std::optional<OutputLock> lock;
  if (!arguments.output.empty()) lock.emplace(arguments.output, std::vector<fs::path>{arguments.scene});
  const auto start = std::chrono::steady_clock::now();
  PreparedScene scene(dynamic::read_dynamic_scene(arguments.scene, run_context()), arguments.transport,
                      run_context());
  Json figures{{"objects", Json::array()}};
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
      "  refield render scene.toml --time 1.5 -o picture.png");
  verb->add_option("scene", arguments->scene, "Scene (.toml, docs/reference/scene-files.md)")->required();
  verb->add_option("-o,--output", arguments->output,
                   "Video (.mp4), one image (.png, .exr; see --time), or a folder of images");
  verb->add_option("--time", arguments->time, "Time in seconds of the single image (default: 0)")
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
  verb->add_option("--rays", arguments->frame.rays, "Number of rays from each vertex, for indirect light")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str()
      ->group(further);
  verb->callback([verb, arguments, &common, &action] {
    if (arguments->mode == "paper" && verb->count("--rays") > 0)
      throw InputError("--rays is not an option of --mode paper; give one of the two");
    action = [arguments, &common] { simulate_dynamic(*arguments, common); };
  });
}

}  // namespace refield::cli
