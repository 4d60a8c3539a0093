// SPDX-License-Identifier: Apache-2.0
#include "cli/acquire/light_list.h"

#include <algorithm>
#include <cstdio>

#include "acquire/journal.h"
#include "core/capture_session.h"
#include "core/files.h"

namespace refield::cli {

namespace fs = std::filesystem;

std::vector<CaptureLight> lights_of_files(const std::string& pattern) {
  std::vector<CaptureLight> lights;
  for (const GlobMatch& match : expand_glob(pattern))
    lights.push_back({match.path.stem().string(), FrameRole::train, "", match.path});
  return lights;
}

std::vector<CaptureLight> lights_of_session(const fs::path& folder) {
  std::vector<CaptureLight> lights;
  for (const CaptureFrame& frame : read_capture_session(folder).frames)
    lights.push_back({frame.name, frame.role, frame.kind, frame.illumination});
  return lights;
}

std::vector<CaptureLight> with_references(const std::vector<CaptureLight>& lights, int every,
                                          fs::path reference) {
  if (every <= 0 || lights.empty()) return lights;
  if (reference.empty()) {
    const auto white = std::ranges::find(lights, "white", &CaptureLight::kind);
    reference = (white != lights.end() ? *white : lights.front()).wanted;
  }
  std::vector<CaptureLight> result;
  int count = 0;
  const auto add_reference = [&] {
    char name[32];
    std::snprintf(name, sizeof name, "reference_%03d", count++);
    result.push_back({name, FrameRole::reference, "reference", reference});
  };
  for (std::size_t i = 0; i < lights.size(); ++i) {
    if (i % static_cast<std::size_t>(every) == 0) add_reference();
    result.push_back(lights[i]);
  }
  add_reference();
  return result;
}

std::string checksum_text(const fs::path& file) {
  return crc32_text(inspect_file(fs::path(), file.string()).crc32);
}

}  // namespace refield::cli
