// SPDX-License-Identifier: Apache-2.0
#pragma once

struct RTCDeviceTy;  // Embree's, whose headers stay in .cpp files

namespace refield {

/// A new Embree device whose errors are thrown as InputError; rtcReleaseDevice() gives it back. Throws
/// InputError where Embree does not start.
RTCDeviceTy* new_embree_device();

}  // namespace refield
