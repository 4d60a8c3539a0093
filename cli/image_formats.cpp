// SPDX-License-Identifier: Apache-2.0
// What refield reads formats other than OpenEXR with is loaded with the first such file: OpenImageIO brings
// 250 shared libraries along, whose start takes 0.2 s of processor time.
#include "core/image/image_file.h"

#include <dlfcn.h>
#include <sys/mman.h>

#include <cstddef>
#include <new>

namespace refield {

namespace {

/// Beside this program, or where it is installed.
fs::path module_file() {
  constexpr const char* name = "refield_image_formats.so";
  const auto folder = fs::read_symlink("/proc/self/exe").parent_path();
  const auto beside = folder / name;
  return fs::exists(beside) ? beside : folder / "../lib/refield" / name;
}

/// The libraries take 50 MiB, and not all look whether they get it.
void require_memory_for_libraries() {
  constexpr std::size_t min_bytes = std::size_t{64} << 20;
  void* room = ::mmap(nullptr, min_bytes, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (room == MAP_FAILED) throw std::bad_alloc();
  ::munmap(room, min_bytes);
}

const ImageFormats* load_image_formats() {
  require_memory_for_libraries();
  void* module = ::dlopen(module_file().c_str(), RTLD_NOW | RTLD_LOCAL);
  void* symbol = module ? ::dlsym(module, "refield_image_formats") : nullptr;
  if (!symbol)
    throw std::runtime_error("its decoder cannot be loaded, " + std::string(::dlerror()) +
                             "; install refield again");
  return reinterpret_cast<const ImageFormats* (*)()>(symbol)();
}

}  // namespace

const ImageFormats& image_formats() {
  static const ImageFormats* const formats = load_image_formats();
  return *formats;
}

}  // namespace refield
