// SPDX-License-Identifier: Apache-2.0
// refield-reader: reads one file with a library that a hostile file can crash, for refield, which starts it
// and reads its answer. Needs few shared libraries, so that it starts in milliseconds.
#include "core/base/isolated.h"
#include "core/field_io/hdf5_reader.h"
#include "simulate/geometry/mesh_formats.h"

int main(int argc, char** argv) {
  refield::run_reader_process(
      argc, argv, {{"hdf5", refield::describe_hdf5}, {"mesh", refield::prt::read_with_mesh_library}});
}
