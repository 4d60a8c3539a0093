// SPDX-License-Identifier: Apache-2.0
// Any text as a scene recipe and as a capture session's manifest: a value, or an Error.
#include "core/base/errors.h"
#include "core/session/capture_session.h"
#include "simulate/tabletop/recipe.h"
#include "tests/fuzz/memory_file.h"
#include "tests/support/temporary_folder.h"

namespace fs = std::filesystem;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const refield::test::TemporaryFolder folder;
  const refield::fuzz::MemoryFile file(data, size);
  try {
    refield::read_recipe(file.path());
  } catch (const refield::Error&) {
  }
  const fs::path manifest = folder / refield::session_manifest_name;
  fs::remove(manifest);
  fs::create_symlink(file.path(), manifest);
  try {
    refield::read_capture_session(folder.path());
  } catch (const refield::Error&) {
  }
  return 0;
}
