// SPDX-License-Identifier: Apache-2.0
// Loaded into the program before its libraries (LD_PRELOAD): answers the driver of the virtual DSLR, see
// virtual_dslr.h, with photographs that guided_lab writes; VIRTUAL_DSLR_LAB names its socket.
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>

extern "C" [[gnu::visibility("default")]] unsigned virtual_dslr_event(const char* event, const char* file,
                                                                      unsigned shutter, unsigned aperture) {
  constexpr unsigned general_error = 0x2002;  // of PTP
  const char* lab = std::getenv("VIRTUAL_DSLR_LAB");
  if (std::strcmp(event, "photograph") != 0 || !lab) return 0;
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, lab, sizeof address.sun_path - 1);
  const int connection = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (connection < 0) return general_error;
  char text[4096];
  const int length = std::snprintf(text, sizeof text, "%u %u %s\n", shutter, aperture, file);
  const bool asked = connect(connection, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0 &&
                     write(connection, text, static_cast<std::size_t>(length)) == length;
  // The laboratory hangs up once the file is there.
  const bool done = asked && read(connection, text, sizeof text) == 0;
  close(connection);
  return done ? 0 : general_error;
}
