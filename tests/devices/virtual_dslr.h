/* SPDX-License-Identifier: Apache-2.0 */
/* Included by libgphoto2's virtual camera once virtual_dslr.sh has adapted it. */
#pragma once
#include <dlfcn.h>

/* Asks the program that the camera runs in, by its function of this name and type. `event`: "photograph", the
 * program writes the file; "download"; or "cable", before each message and event. `shutter` in units of 0.1
 * ms, `aperture` in hundredths of the f-number. Returns 0 when all is well, else the PTP response code of a
 * failure. */
typedef unsigned virtual_dslr_answer(const char* event, const char* file, unsigned shutter,
                                     unsigned aperture);

static unsigned virtual_dslr_ask(const char* event, const char* file, unsigned shutter, unsigned aperture) {
  virtual_dslr_answer* answer = (virtual_dslr_answer*)dlsym(RTLD_DEFAULT, "virtual_dslr_event");
  return answer ? answer(event, file, shutter, aperture) : 0;
}
