// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/image/image.h"
#include "core/light/light_map.h"
#include "refield/relight.h"
#include "relight/field_pictures.h"

namespace refield {

/// A light, read or computed when its turn comes; lights may be asked for from several threads at a time.
using LightFunction = std::function<SceneLight()>;

/// One image to be made: a light and the file that the relit scene goes to. The file's extension chooses the
/// format: .exr (scene-linear, float), .png (sRGB, 8 bits) or, of a mesh, .glb (light as vertex colours).
struct RelightJob {
  LightFunction light;
  fs::path output;
};

/// The factor on the radiance of PNG files, baked meshes and videos.
struct ExposureOptions {
  std::optional<double> factor{};  ///< none: chosen by ExposureMeter
  /// Whether the pictures are frames of one sequence and share an automatic exposure. It is chosen from up to
  /// eight frames spread over the sequence.
  bool is_sequence = false;
};

/// How PNG files and videos were exposed, and whether the field knows the light.
struct ExposureReport {
  std::vector<double> factors{};  ///< one for all, or one per picture; empty: EXR alone
  /// Share of the pixels that show light and are clipped in some channel, mean over the pictures; 0 for
  /// automatic exposures, which clip fewer than 1 %.
  double clipped = 0.0;
  LightShares light_shares;  ///< FieldOutline::light_shares(), each of the picture where it is largest
};

/// Relights `field` for each job and writes the images, several at a time, with progress. A file appears when
/// it is complete. Throws InputError for an output of no such format (before any work), for a light
/// that does not fit the field or makes pixels that are not finite, Interrupted between images.
ExposureReport relight_to_files(const FieldPictures& field, const std::vector<RelightJob>& jobs,
                                const ExposureOptions& exposure = {}, const RunContext& run = {});

struct VideoOptions {
  double frames_per_second = 30.0;
  std::optional<double> exposure{};  ///< factor on the radiance, as for PNG files; none: automatic

  /// Throws InputError naming the option and its range.
  void check() const;
};

/// Frames on their way into the program `ffmpeg`, which encodes them as they come (H.264, 4:2:0, BT.709).
/// Equal frames give equal files with equal versions of ffmpeg, on any number of cores.
class VideoWriter {
 public:
  /// Frames of width × height pixels go to `file`, whose name ends in .mp4. Throws DeviceError where ffmpeg
  /// is not installed or cannot be started.
  VideoWriter(const fs::path& file, int width, int height, double frames_per_second);
  /// Ends ffmpeg; what was written is of no use unless finish() was called.
  ~VideoWriter();
  VideoWriter(const VideoWriter&) = delete;
  VideoWriter& operator=(const VideoWriter&) = delete;

  /// One frame, [height × width × 3] bytes, sRGB. Throws DeviceError with ffmpeg's words when it gave up.
  void add(std::span<const std::uint8_t> frame, const RunContext& run = {});

  /// Waits until the file is complete. Throws DeviceError with ffmpeg's words when it failed.
  void finish();

 private:
  [[noreturn]] void fail();
  int wait();

  fs::path file_;
  int pipe_ = -1;      // our end of a socket pair: ffmpeg's standard input
  int messages_ = -1;  // ffmpeg's standard error, in memory
  int process_ = -1;
};

/// Relights `field` for each light in turn and writes the images as a video, with progress. Several images
/// are made at a time; none is kept once it is encoded. The file appears when it is complete. Throws
/// Interrupted between frames, DeviceError where ffmpeg is missing or fails, and what the lights throw.
ExposureReport relight_to_video(const FieldPictures& field, const std::vector<LightFunction>& lights,
                                const fs::path& output, const VideoOptions& options,
                                const RunContext& run = {});

/// The scene in a picture, and what FieldPictures::background() adds to it; or what its vertices reflect.
struct MeteredPicture {
  Image scene, background;
  Image vertices;  ///< FieldPictures::vertices(), of meshes to be written

  /// The scene before its background.
  Image whole() &&;
};

/// The pictures of `lights`, one at a time and from several threads: those that were made to choose a
/// sequence's exposure are not made again, where they fit into memory.
class MeteredPictures {
 public:
  /// `name` is what errors call the pictures; `are_meshes` [lights] says which are meshes, none if it is
  /// empty.
  MeteredPictures(const FieldPictures& field, std::vector<LightFunction> lights, std::string name,
                  std::vector<char> are_meshes = {});

  /// The exposure of a sequence of these pictures: for what light does to the scene, not for the background.
  double sequence_exposure(const RunContext& run);
  /// Picture i. Throws InputError where a pixel is not finite.
  MeteredPicture take(std::size_t i, const RunContext& run);
  /// FieldOutline::light_shares() so far, each of the light where it is largest.
  LightShares light_shares() const { return {interpolated_, unobserved_}; }

 private:
  bool is_mesh(std::size_t i) const { return !are_meshes_.empty() && are_meshes_[i] != 0; }
  /// `is_metered`: the picture is needed of a mesh, too.
  MeteredPicture make(std::size_t i, bool is_metered, const RunContext& run) const;
  void require_finite(const Image& image, std::size_t i, const SceneLight& light) const;

  const FieldPictures& field_;
  std::vector<LightFunction> lights_;
  std::string name_;
  std::vector<char> are_meshes_;
  std::map<std::size_t, MeteredPicture> kept_;
  mutable std::atomic<double> interpolated_ = 0.0, unobserved_ = 0.0;
};

}  // namespace refield
