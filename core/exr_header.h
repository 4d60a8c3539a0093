// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "core/byte_reader.h"
#include "core/image_header.h"

namespace refield {

/// What the headers of an OpenEXR file promise, a part each. Throws FormatError for headers that are damaged
/// and for deep images, which hold no single colour a pixel. Source: "OpenEXR File Layout", version 2.
std::vector<PromisedImage> read_exr_headers(ByteReader& reader);

}  // namespace refield
