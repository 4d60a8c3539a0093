// SPDX-License-Identifier: Apache-2.0
// The laboratory of a guided capture: what a camera sees of a scene under the screen of an X server without a
// monitor, read from its frame buffer. usage: guided_lab SHARE SCREEN genicam|dslr    SHARE holds truth/ and
// recipe.toml and gets camera.log; SCREEN is the file that Xvfb -fbdir keeps. The GenICam camera is Aravis'
// fake one at 127.0.0.1; a DSLR's photographs are asked for at the socket SHARE/camera (guided_dslr.cpp).
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <thread>

#include "core/base/files.h"
#include "tests/devices/lab_scene.h"
#include "tests/support/dng_file.h"
#include "tests/support/fake_genicam.h"

namespace refield::test {
namespace {

namespace fs = std::filesystem;

TimePoint now() {
  return TimePoint(std::chrono::steady_clock::now().time_since_epoch());
}

/// An XWD file in memory that the X server draws in (X11/XWDFile.h): its header has 32-bit words, most
/// significant byte first.
class FrameBuffer {
 public:
  explicit FrameBuffer(const char* file) {
    const int descriptor = open(file, O_RDONLY);
    struct stat status {};
    if (descriptor < 0 || fstat(descriptor, &status) != 0) throw std::runtime_error("no frame buffer");
    void* memory =
        mmap(nullptr, static_cast<std::size_t>(status.st_size), PROT_READ, MAP_SHARED, descriptor, 0);
    close(descriptor);
    if (memory == MAP_FAILED) throw std::runtime_error("no frame buffer");
    bytes_ = static_cast<const std::uint8_t*>(memory);
    if (word(11) != 32) throw std::runtime_error("the frame buffer must have 32 bits per pixel");
  }

  /// One pixel of each texel, not at its border; texels are squares, the largest that fit, in the middle of
  /// the screen.
  DriveImage drive(int width, int height) const {
    const int columns = static_cast<int>(word(4)), rows = static_cast<int>(word(5));
    const int scale = std::min(columns / width, rows / height);
    const int left = (columns - width * scale) / 2, top = (rows - height * scale) / 2;
    const std::uint8_t* pixels = bytes_ + word(0) + std::size_t{12} * word(19);
    DriveImage drive{width, height, {}};
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        const std::uint8_t* pixel = pixels + std::size_t{word(12)} * (top + y * scale + scale / 2) +
                                    std::size_t{4} * (left + x * scale + scale / 2);
        for (const int c : {2, 1, 0}) drive.levels.push_back(pixel[c]);
      }
    return drive;
  }

 private:
  std::uint32_t word(std::size_t place) const {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < 4; ++i) value = value << 8 | bytes_[4 * place + i];
    return value;
  }
  const std::uint8_t* bytes_;
};

struct Laboratory {
  LabScene scene;
  FrameBuffer screen;

  std::vector<std::uint16_t> expose(Seconds length, double gain) {
    const auto [width, height, parameterisation] = scene.domain();
    const TimePoint start = now();
    const DriveImage first = screen.drive(width, height);
    std::this_thread::sleep_for(length);
    return scene.expose(first, screen.drive(width, height), start, length, gain);
  }
};

[[noreturn]] void be_genicam(Laboratory& lab) {
  FakeGenicam camera("127.0.0.1", "LAB", [&](const FakeExposure& exposure) {
    const auto samples =
        lab.expose(Seconds(exposure.microseconds * 1e-6), std::pow(10.0, exposure.gain_db / 20.0));
    if (exposure.format == "BayerRG12" && exposure.bytes.size() == 2 * samples.size())
      std::memcpy(exposure.bytes.data(), samples.data(), exposure.bytes.size());
  });
  std::printf("ready\n");
  std::fflush(stdout);
  while (true) pause();
}

[[noreturn]] void be_dslr(Laboratory& lab, const fs::path& socket_file) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, socket_file.c_str(), sizeof address.sun_path - 1);
  const int listener = socket(AF_UNIX, SOCK_STREAM, 0);
  if (bind(listener, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0 || listen(listener, 4) != 0)
    throw std::runtime_error("no socket");
  std::printf("ready\n");
  std::fflush(stdout);
  while (true) {
    const int client = accept(listener, nullptr, nullptr);
    char request[4096] = "", file[4096] = "";
    unsigned shutter = 0, aperture = 0;
    if (read(client, request, sizeof request - 1) > 0 &&
        std::sscanf(request, "%u %u %4095[^\n]", &shutter, &aperture, file) == 3) {
      const Seconds length(shutter * 1e-4);
      const auto samples = lab.expose(length, 1.0);
      const auto width = static_cast<std::uint32_t>(lab.scene.columns());
      write_text_atomically(file, dng(width, static_cast<std::uint32_t>(samples.size()) / width, samples,
                                      {0, 1, 1, 2}, length.count(), aperture * 0.01));
    }
    close(client);
  }
}

}  // namespace
}  // namespace refield::test

int main(int argc, char** argv) {
  if (argc != 4) return 2;
  try {
    const std::filesystem::path share = argv[1];
    refield::test::Laboratory lab{
        {share / "truth", share / "recipe.toml", (share / "camera.log").c_str(), false},
        refield::test::FrameBuffer(argv[2])};
    if (argv[3] == std::string("genicam")) refield::test::be_genicam(lab);
    refield::test::be_dslr(lab, share / "camera");
  } catch (const std::exception& error) {
    std::fprintf(stderr, "guided_lab: %s\n", error.what());
    return 1;
  }
}
