// SPDX-License-Identifier: Apache-2.0
#include "core/base/aligned_memory.h"

#include <sys/mman.h>
#include <unistd.h>

namespace refield {

namespace {
constexpr std::size_t huge_page = std::size_t{2} << 20;
constexpr std::size_t large = 2 * huge_page;  // from here on huge pages pay

std::align_val_t alignment_of(std::size_t bytes) {
  return std::align_val_t{bytes < large ? 64 : huge_page};
}
}  // namespace

void* allocate_aligned(std::size_t bytes) {
  // Whole huge pages, or the last part would lie on small ones.
  if (bytes >= large) bytes = (bytes + huge_page - 1) / huge_page * huge_page;
  void* memory = ::operator new(bytes, alignment_of(bytes));
  // Advice only: a kernel without huge pages gives small ones.
  if (bytes >= large) madvise(memory, bytes, MADV_HUGEPAGE);
  return memory;
}

void free_aligned(void* memory, std::size_t bytes) {
  ::operator delete(memory, alignment_of(bytes));
}

void release_pages(void* memory, std::size_t bytes) {
  static const auto page = static_cast<std::uintptr_t>(sysconf(_SC_PAGESIZE));
  const auto first = reinterpret_cast<std::uintptr_t>(memory);
  const std::uintptr_t begin = (first + page - 1) / page * page;
  const std::uintptr_t end = (first + bytes) / page * page;
  if (begin < end) madvise(static_cast<std::byte*>(memory) + (begin - first), end - begin, MADV_DONTNEED);
}

}  // namespace refield
