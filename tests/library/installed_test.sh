#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# installed_test.sh CMAKE BUILD: a project outside the sources finds the library that BUILD installs, includes
# each public header alone, relights a light map, and cannot include what is internal.
set -euo pipefail
cmake=$1 build=$2
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
for component in shared library; do "$cmake" --install "$build" --prefix "$folder/prefix" --component $component; done >install.log
cat >CMakeLists.txt <<'END'
cmake_minimum_required(VERSION 3.25)
project(consumer LANGUAGES CXX)
find_package(refield REQUIRED)
file(GLOB headers header_*.cpp)
add_executable(consumer main.cpp ${headers})
target_link_libraries(consumer PRIVATE refield::refield)
END
for header in prefix/include/refield/*.h; do
  echo "#include \"refield/${header##*/}\"" | tee -a all.cpp >"header_$(basename "$header" .h).cpp"
done
cat >main.cpp <<'END'
#include <cstdio>
#include "refield/relight.h"

int main() {
  const refield::LightDomain window{2, 1};
  const refield::LightMap seen = refield::Environment(refield::Image(8, 4, 3, 0.5f))
                                     .project(window, refield::placements_from_texts({"520x320@600"}));
  std::printf("%.3f\n", seen.radiance.at(1, 0, 2));
  try {
    refield::Field field("none.rfield");
  } catch (const refield::DeviceError& error) {
    std::printf("%s\n", error.what());
  }
}
END
"$cmake" -S . -B build -DCMAKE_PREFIX_PATH="$folder/prefix" >configure.log 2>&1 || { cat configure.log; exit 1; }
"$cmake" --build build >build.log 2>&1 || { tail -40 build.log; exit 1; }
output=$(./build/consumer)
[[ $output == $'0.500\n'none.rfield* ]] || { echo "printed '$output'"; exit 1; }
# No header of the stages or of their libraries is installed or included.
[[ $(ls prefix/include/refield) == "$(cd prefix/include/refield && ls ./*.h | sed 's|^\./||')" ]] || { ls prefix/include/refield; exit 1; }
used=$(c++ -std=c++20 -M -I prefix/include all.cpp)
! grep -E 'Eigen|tbb|hdf5|nlohmann|/(core|acquire|estimate|relight|simulate)/' <<<"$used" || { echo "a public header includes these"; exit 1; }
for internal in core/image/image.h relight/relighter.h refield/internal/core/image/image.h; do
  ! echo "#include \"$internal\"" | c++ -std=c++20 -fsyntax-only -I prefix/include -x c++ - 2>/dev/null ||
    { echo "$internal can be included"; exit 1; }
done
