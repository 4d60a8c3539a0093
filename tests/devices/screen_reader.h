// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace refield::test {

/// What a screen shows, XRGB words, top row first.
struct Screen {
  int width = 0;
  int height = 0;
  std::vector<std::uint32_t> pixels;
};

/// Reads back what vkms shows, through its writeback connector. Only the program that holds the display may
/// ask for that, so the reader borrows that program's descriptor (pidfd_getfd) for as long as it lives.
class ScreenReader {
 public:
  /// `program` is the name of the process that holds `card`; its picture counts once the mode has that size,
  /// before which a text console may show.
  ScreenReader(std::string program, std::string card, int width, int height);
  ~ScreenReader();

  /// The picture at the next vertical blanking; nullopt while no such process shows one.
  std::optional<Screen> read();

 private:
  struct Borrowed;
  bool borrow();
  void let_go();
  std::string program_, card_;
  int width_, height_;
  Borrowed* borrowed_ = nullptr;
};

}  // namespace refield::test
