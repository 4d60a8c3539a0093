// SPDX-License-Identifier: Apache-2.0
#include "relight/relight.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>
#include <unistd.h>

#include <csignal>
#include <numeric>

#include "core/base/files.h"
#include "core/base/number_text.h"
#include "core/image/image_io.h"
#include "core/image/tone_map.h"

namespace refield {

namespace {

/// Length of the part of [left, right) that lies in column [x, x + 1).
double overlap(double left, double right, int x) {
  return std::max(0.0, std::min(right, x + 1.0) - std::max(left, static_cast<double>(x)));
}

}  // namespace

LightMap v0_2::sliding_bar(const LightDomain& domain, double width_fraction, int frame, int frames,
                           float radiance) {
  if (!(width_fraction > 0.0 && width_fraction <= 1.0))
    throw InputError("the bar's width is ", width_fraction,
                     "; give a fraction of the light map's width above 0 and up to 1");
  if (frames < 1 || frame < 0 || frame >= frames)
    throw InputError("a sequence has no frame ", frame, " of ", frames);
  const bool wraps = domain.parameterisation == Parameterisation::lat_long;
  const double bar = width_fraction * domain.width;
  const double left = wraps ? static_cast<double>(domain.width) * frame / frames
                            : (domain.width - bar) * frame / std::max(1, frames - 1);
  LightMap light{Image(domain.width, domain.height, 3), domain.parameterisation};
  for (int x = 0; x < domain.width; ++x) {
    double covered = overlap(left, left + bar, x);
    if (wraps) covered += overlap(left - domain.width, left + bar - domain.width, x);
    if (covered <= 0.0) continue;
    for (int y = 0; y < domain.height; ++y)
      for (int c = 0; c < 3; ++c) light.radiance.at(x, y, c) = static_cast<float>(radiance * covered);
  }
  return light;
}

LightMap v0_2::rotated(const LightMap& light, double turns) {
  if (light.parameterisation != Parameterisation::lat_long)
    throw InputError("only lat-long light maps can be rotated, this one is a ",
                     name_of(light.parameterisation), " map; use a sliding bar instead");
  const Image& source = light.radiance;
  const double shift = (turns - std::floor(turns)) * source.width;
  const int whole = static_cast<int>(shift);
  const auto fraction = static_cast<float>(shift - whole);
  LightMap turned{Image(source.width, source.height, 3), light.parameterisation};
  for (int x = 0; x < source.width; ++x) {
    const int right = (x - whole + 2 * source.width) % source.width;
    const int left = (right + source.width - 1) % source.width;
    for (int y = 0; y < source.height; ++y)
      for (int c = 0; c < 3; ++c)
        turned.radiance.at(x, y, c) =
            (1.0f - fraction) * source.at(right, y, c) + fraction * source.at(left, y, c);
  }
  return turned;
}

LightMap v0_2::mixed(const LightMap& a, const LightMap& b, double share) {
  if (a.domain() != b.domain()) throw InputError("lights of different sizes cannot fade into one another");
  LightMap light = a;
  const auto part = static_cast<float>(share);
  for (std::size_t i = 0; i < light.radiance.values.size(); ++i)
    light.radiance.values[i] = (1.0f - part) * a.radiance.values[i] + part * b.radiance.values[i];
  return light;
}

namespace {

/// The encoder's threads change what it decides, so their number is fixed: equal frames give equal files.
constexpr const char* encoder_threads = "4";

std::vector<std::string> ffmpeg_arguments(const fs::path& file, int width, int height,
                                          double frames_per_second) {
  return {
      "ffmpeg", "-hide_banner", "-loglevel", "error", "-nostdin", "-y",
      // What comes in,
      "-f", "rawvideo", "-pixel_format", "rgb24", "-video_size",
      std::to_string(width) + "x" + std::to_string(height), "-framerate",
      formatted("%.6g", frames_per_second), "-i", "pipe:0",
      // made even-sized, as 4:2:0 wants it,
      "-vf",
      "pad=ceil(iw/2)*2:ceil(ih/2)*2,scale=out_color_matrix=bt709:out_range=tv:flags=accurate_rnd+bitexact",
      "-pix_fmt", "yuv420p", "-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc",
      "iec61966-2-1", "-color_range", "tv",
      // and out, without dates and versions.
      "-c:v", "libx264", "-preset", "medium", "-crf", "17", "-threads", encoder_threads, "-fflags",
      "+bitexact", "-flags:v", "+bitexact", "-map_metadata", "-1", "-movflags", "+faststart", "-f", "mp4",
      file.string()};
}

/// Starts a program that reads `input` and writes what it has to say to `messages`, in a process group of its
/// own, so that Ctrl-C reaches us alone.
pid_t start(std::vector<std::string> arguments, int input, int messages) {
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_adddup2(&files, input, STDIN_FILENO);
  posix_spawn_file_actions_addopen(&files, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_adddup2(&files, messages, STDERR_FILENO);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
  pid_t process = -1;
  const int error = posix_spawnp(&process, argv[0], &files, &attributes, argv.data(), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&files);
  if (error == ENOENT)
    throw DeviceError("ffmpeg", error,
                      "is needed for video and is not installed; install it (Debian: apt-get install "
                      "ffmpeg), or give a folder as output for single images");
  if (error != 0) throw DeviceError("ffmpeg", error, "cannot be started");
  return process;
}

}  // namespace

void VideoOptions::check() const {
  if (!(frames_per_second >= 0.1 && frames_per_second <= 1000.0))
    throw InputError("--fps is ", frames_per_second, "; give 0.1 to 1000 frames per second");
  if (exposure && !(*exposure > 0.0 && std::isfinite(*exposure)))
    throw InputError("--exposure is ", *exposure, "; give a number above zero");
}

VideoWriter::VideoWriter(const fs::path& file, int width, int height, double frames_per_second)
    : file_(file) {
  // A socket pair rather than a pipe: writing to an ffmpeg that has gone away is an error then, no signal.
  int ends[2];
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0)
    throw DeviceError("ffmpeg", errno, "cannot create a pipe");
  pipe_ = ends[0];
  messages_ = ::memfd_create("ffmpeg messages", MFD_CLOEXEC);
  try {
    if (messages_ < 0) throw DeviceError("ffmpeg", errno, "cannot keep its messages");
    process_ = start(ffmpeg_arguments(file, width, height, frames_per_second), ends[1], messages_);
  } catch (...) {
    for (const int descriptor : {ends[0], ends[1], messages_}) ::close(descriptor);
    throw;
  }
  ::close(ends[1]);
}

VideoWriter::~VideoWriter() {
  if (process_ > 0) {
    ::kill(process_, SIGKILL);
    wait();
  }
  if (pipe_ >= 0) ::close(pipe_);
  ::close(messages_);
}

void VideoWriter::add(std::span<const std::uint8_t> frame, const RunContext& run) {
  while (!frame.empty()) {
    const ssize_t sent = ::send(pipe_, frame.data(), frame.size(), MSG_NOSIGNAL);
    if (sent < 0 && errno == EINTR) {
      run.throw_if_stopped();
      continue;
    }
    if (sent < 0) fail();
    frame = frame.subspan(static_cast<std::size_t>(sent));
  }
}

void VideoWriter::finish() {
  ::close(pipe_);  // the end of the film
  pipe_ = -1;
  if (wait() != 0) fail();
}

/// The exit status; not zero for a program that a signal ended.
int VideoWriter::wait() {
  int status = 0;
  while (::waitpid(process_, &status, 0) < 0 && errno == EINTR) {
  }
  process_ = -1;
  return status;
}

void VideoWriter::fail() {
  const int error = errno;
  if (process_ > 0) wait();  // it closed its input: all that it has to say is said
  std::string said(4096, '\0');
  const ssize_t size = ::pread(messages_, said.data(), said.size(), 0);
  said.resize(static_cast<std::size_t>(std::max<ssize_t>(size, 0)));
  while (!said.empty() && said.back() == '\n') said.pop_back();
  throw DeviceError(file_.string(), error != 0 ? error : EIO, "ffmpeg could not write the video",
                    said.empty() ? std::string() : ": " + said);
}

ExposureReport relight_to_video(const FieldPictures& field, const std::vector<LightFunction>& lights,
                                const fs::path& output, const VideoOptions& options, const RunContext& run) {
  const ThreadLimit limit(run);
  options.check();
  MeteredPictures pictures(field, lights, output.string());
  ExposureReport report;
  std::vector<double> clipped(lights.size());
  write_atomically(output, [&](const fs::path& temporary) {
    VideoWriter video(temporary, field.width(), field.height(), options.frames_per_second);
    const double exposure = options.exposure ? *options.exposure : pictures.sequence_exposure(run);
    report.factors = {exposure};
    Progress progress(run, "relight", lights.size());
    // Tokens are numbers and the frames stay here: when a pipeline is stopped, oneTBB forgets to destroy what
    // its larger tokens hold. The frame of a slot is encoded before the next one of that slot is begun.
    std::vector<std::vector<std::uint8_t>> slots(
        static_cast<std::size_t>(tbb::this_task_arena::max_concurrency()) + 1);
    std::size_t next = 0;
    const auto number = [&](tbb::flow_control& control) {
      if (next == lights.size()) control.stop();
      return next++;
    };
    const auto frame = [&](std::size_t i) {
      run.throw_if_stopped();
      MeteredPicture picture = pictures.take(i, run);
      if (options.exposure) clipped[i] = clipped_share(picture.scene, exposure);
      slots[i % slots.size()] = tone_mapped(std::move(picture).whole(), {exposure});
      return i;
    };
    const auto encode = [&](std::size_t i) {
      video.add(slots[i % slots.size()], run);
      progress.advance();
    };
    constexpr auto in_order = tbb::filter_mode::serial_in_order, together = tbb::filter_mode::parallel;
    tbb::parallel_pipeline(slots.size(), tbb::make_filter<void, std::size_t>(in_order, number) &
                                             tbb::make_filter<std::size_t, std::size_t>(together, frame) &
                                             tbb::make_filter<std::size_t, void>(in_order, encode));
    video.finish();
  });
  report.light_shares = pictures.light_shares();
  report.clipped = std::accumulate(clipped.begin(), clipped.end(), 0.0) /
                   static_cast<double>(std::max<std::size_t>(clipped.size(), 1));
  return report;
}

}  // namespace refield
