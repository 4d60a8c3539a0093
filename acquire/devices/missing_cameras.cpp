// SPDX-License-Identifier: Apache-2.0
// Cameras whose library was not there when the program was built.
#include "acquire/devices/tethered_camera.h"

namespace refield {

#if REFIELD_LACKS_GENICAM

namespace {

[[noreturn]] void refuse_genicam() {
  throw InputError(
      "this refield was built without support for GenICam cameras; install Aravis 0.8 (Debian: "
      "libaravis-dev) "
      "and build again");
}

}  // namespace

bool has_genicam() {
  return false;
}
std::vector<GenicamIdentity> find_genicam_cameras() {
  return {};
}
GenicamAbilities abilities_of(const GenicamIdentity& /*camera*/) {
  refuse_genicam();
}
std::unique_ptr<TetheredCamera> open_camera(GenicamCameraOptions /*options*/, RunContext /*run*/) {
  refuse_genicam();
}

#endif
#if REFIELD_LACKS_GPHOTO

namespace {

[[noreturn]] void refuse_gphoto() {
  throw InputError(
      "this refield was built without support for DSLRs; install libgphoto2-dev and build again");
}

}  // namespace

bool has_gphoto() {
  return false;
}
std::vector<GphotoIdentity> find_gphoto_cameras() {
  return {};
}
GphotoAbilities abilities_of(const GphotoIdentity& /*camera*/) {
  refuse_gphoto();
}
std::unique_ptr<TetheredCamera> open_camera(GphotoCameraOptions /*options*/, RunContext /*run*/) {
  refuse_gphoto();
}

#endif

}  // namespace refield
