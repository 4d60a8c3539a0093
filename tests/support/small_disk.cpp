// SPDX-License-Identifier: Apache-2.0
#include "tests/support/small_disk.h"

#include <sys/mount.h>

#include <algorithm>
#include <fstream>
#include <string>

namespace refield::test {

namespace fs = std::filesystem;

SmallDisk::SmallDisk(int kilobytes) {
  const std::string options = "size=" + std::to_string(kilobytes) + "k";
  mounted_ = mount("refield-test", folder_.path().c_str(), "tmpfs", 0, options.c_str()) == 0;
}

SmallDisk::~SmallDisk() {
  if (mounted_) umount2(folder_.path().c_str(), MNT_DETACH);
}

void SmallDisk::fill_leaving(int kilobytes) const {
  const auto available = fs::space(folder_.path()).available;
  const auto keep = static_cast<std::uintmax_t>(kilobytes) * 1024;
  std::ofstream(folder_ / "filler") << std::string(available > keep ? available - keep : 0, 'x');
}

int SmallDisk::files() const {
  return static_cast<int>(std::ranges::distance(fs::directory_iterator(folder_.path())));
}

}  // namespace refield::test
