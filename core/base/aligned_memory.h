// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>
#include <new>
#include <type_traits>
#include <utility>

#include "core/base/files.h"

namespace refield {

/// Memory that starts at a cache line; where there is much of it, on huge pages if the kernel has them. Sums
/// over rectangles are fetched from anywhere in a gigabyte: with small pages, finding each is as slow as
/// reading it. Throws std::bad_alloc.
void* allocate_aligned(std::size_t bytes);
void free_aligned(void* memory, std::size_t bytes);

/// Gives the whole pages of a part of memory back to the system, contents and all: it holds zeros, or what it
/// held, when it is looked at again. For large arrays that are used up from front to back.
void release_pages(void* memory, std::size_t bytes);

template <class T>
struct AlignedAllocator {
  using value_type = T;
  AlignedAllocator() = default;
  template <class U>
  AlignedAllocator(const AlignedAllocator<U>&) {}
  T* allocate(std::size_t count) { return static_cast<T*>(allocate_aligned(count * sizeof(T))); }
  void deallocate(T* memory, std::size_t count) { free_aligned(memory, count * sizeof(T)); }
  template <class U>
  bool operator==(const AlignedAllocator<U>&) const {
    return true;
  }
};
using AlignedFloats = std::vector<float, AlignedAllocator<float>>;
using AlignedDoubles = std::vector<double, AlignedAllocator<double>>;

/// Gives a vector its first values where they lie in a mapped file, all other memory from the heap.
template <class T>
class FileAllocator {
 public:
  using value_type = T;
  using is_always_equal = std::false_type;
  using propagate_on_container_move_assignment = std::true_type;
  using propagate_on_container_swap = std::true_type;

  FileAllocator() = default;
  /// `values`: in `file`, and aligned for T.
  FileAllocator(std::shared_ptr<const MappedFile> file, std::span<const std::byte> values)
      : file_(std::move(file)), values_(values) {}
  /// An allocator for other types takes memory from the heap alone.
  template <class U>
  FileAllocator(const FileAllocator<U>&) {}  // NOLINT(google-explicit-constructor): as allocators do
  FileAllocator select_on_container_copy_construction() const { return {}; }

  bool is_mapped() const { return file_ != nullptr; }

  T* allocate(std::size_t count) {
    if (file_ && count * sizeof(T) == values_.size()) return mapped();
    return static_cast<T*>(allocate_aligned(count * sizeof(T)));
  }
  void deallocate(T* memory, std::size_t count) {
    if (!file_ || memory != mapped()) free_aligned(memory, count * sizeof(T));
  }
  /// Values in the file are there already; those that a vector has grown by are not.
  void construct(T* value) {
    if (!is_in_file(value)) ::new (static_cast<void*>(value)) T();
  }
  template <class... Arguments>
  void construct(T* value, Arguments&&... arguments) {
    ::new (static_cast<void*>(value)) T(std::forward<Arguments>(arguments)...);
  }
  bool operator==(const FileAllocator& other) const { return file_ == other.file_; }

 private:
  bool is_in_file(const T* value) const {
    const std::less<const T*> before;
    return file_ && !before(value, mapped()) && before(value, mapped() + values_.size() / sizeof(T));
  }
  T* mapped() const { return const_cast<T*>(reinterpret_cast<const T*>(values_.data())); }

  std::shared_ptr<const MappedFile> file_;
  std::span<const std::byte> values_;
};

/// A vector whose values may lie in a file, which the system then reads when they are looked at and whose
/// memory it takes back when it needs it. Such values must not be written to: copy the vector to change it.
template <class T>
using FileVector = std::vector<T, FileAllocator<T>>;

/// Says that a pass is done with the values [first, last): where they lie in a file, they take no memory of
/// the program's own until they are looked at again.
template <class T>
void pass_by(const FileVector<T>& values, std::size_t first, std::size_t last) {
  if (values.get_allocator().is_mapped())
    release_pages(const_cast<T*>(values.data()) + first, (last - first) * sizeof(T));
}

}  // namespace refield
