// SPDX-License-Identifier: Apache-2.0
// usage: check_pairs SESSION LIGHTS LOG [LOG ...]
// Looks every raw frame of a session up in the virtual laboratory's logs: was the pattern on the monitor that
// of its light alone, and the exposure that of its place? Prints the counts; exit status 1 when one frame was
// mispaired.
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <sstream>

#include "acquire/calibrate/calibration.h"
#include "acquire/capture/capture.h"
#include "acquire/hdr/bracket_files.h"
#include "core/base/files.h"
#include "core/image/image_io.h"
#include "core/session/capture_session.h"
#include "core/session/journal.h"

namespace refield::test {
namespace {

namespace fs = std::filesystem;

struct Truth {
  std::string pattern;
  double microseconds = 0.0;
};

template <class T>
std::string checksum(const std::vector<T>& values) {
  char text[9];
  std::snprintf(text, sizeof text, "%08x",
                crc32_of({reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)}));
  return text;
}

int check(const fs::path& folder, const fs::path& lights, int logs, char** names) {
  std::map<std::string, Truth> truth;
  for (int i = 0; i < logs; ++i) {
    std::ifstream log(names[i]);
    std::string frame;
    Truth line;
    long long stamp = 0;
    while (log >> frame >> line.pattern >> line.microseconds >> stamp) truth[frame] = line;
  }
  const CaptureSession session = read_capture_session(folder);
  const MonitorCalibration monitor = read_monitor_calibration(folder / "calibration.toml");
  const auto exposures = exposures_of_plan(folder / "plan.toml");
  std::size_t frames = 0, mispaired = 0, mixed = 0;
  for (const CaptureFrame& frame : session.frames) {
    const Image wanted = read_image(lights / (frame.name + ".exr"));
    const std::string pattern = checksum(drive_levels(wanted, monitor).levels);
    for (std::size_t i = 0; i < exposures.size(); ++i) {
      const auto raw = read_bracket_file(folder / "raw" / (frame.name + "_e" + std::to_string(i) + ".png"));
      const auto found = truth.find(checksum(raw.frame.samples));
      const bool good = found != truth.end() && found->second.pattern == pattern &&
                        std::abs(found->second.microseconds - 1e6 * exposures[i].count()) < 1.0;
      ++frames;
      if (good) continue;
      ++mispaired;
      const std::string seen = found == truth.end() ? "unknown" : found->second.pattern;
      mixed += seen == "mixed";
      std::printf("## mispaired: %s exposure %zu shows pattern %s, not %s\n", frame.name.c_str(), i,
                  seen.c_str(), pattern.c_str());
    }
  }
  std::size_t made = truth.size(), made_mixed = 0;
  for (const auto& [name, line] : truth) made_mixed += line.pattern == "mixed";
  std::printf(
      "## %zu patterns, %zu frames taken, %zu mispaired; the sensor made %zu frames, %zu of them during a "
      "flip\n",
      session.frames.size(), frames, mispaired, made, made_mixed);
  return mispaired == 0 ? 0 : 1;
}

}  // namespace
}  // namespace refield::test

int main(int argc, char** argv) {
  return argc < 4 ? 2 : refield::test::check(argv[1], argv[2], argc - 3, argv + 3);
}
