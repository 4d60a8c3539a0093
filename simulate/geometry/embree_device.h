// SPDX-License-Identifier: Apache-2.0
#pragma once

struct RTCDeviceTy;  // Embree's, whose headers stay in .cpp files

namespace refield {

/// The program's Embree device, whose errors are thrown as InputError. Scenes of one device can hold one
/// another. Throws InputError where Embree does not start.
RTCDeviceTy* embree_device();

}  // namespace refield
