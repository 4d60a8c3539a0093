#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# installed_test.sh CMAKE BUILD: a project outside the sources finds the library that BUILD installs, includes
# each public header, and relights a field of one pixel.
set -euo pipefail
cmake=$1 build=$2
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"$cmake" --install "$build" --prefix "$folder/prefix" --component library >install.log
cat >CMakeLists.txt <<'END'
cmake_minimum_required(VERSION 3.25)
project(consumer LANGUAGES CXX)
find_package(refield REQUIRED)
add_executable(consumer main.cpp)
target_link_libraries(consumer PRIVATE refield::refield)
END
for header in prefix/include/refield/*.h; do echo "#include \"refield/${header##*/}\""; done >main.cpp
cat >>main.cpp <<'END'
#include <cstdio>

int main() {
  refield::ReflectanceField field;
  field.width = field.height = 1;
  field.basis.domain = {2, 1};
  field.basis.boxes = {{0, 0, 2, 1}};
  field.transfer.append_row(std::vector<std::uint32_t>{0}, std::vector<float>{1, 2, 3});
  const refield::LightMap light{refield::Image(2, 1, 3, 0.5f)};
  const refield::Image image = refield::Relighter(field, refield::RelightPrecision::fine).relight(light);
  std::printf("%.3f %.3f %.3f\n", image.at(0, 0, 0), image.at(0, 0, 1), image.at(0, 0, 2));
}
END
"$cmake" -S . -B build -DCMAKE_PREFIX_PATH="$folder/prefix" >configure.log 2>&1 || { cat configure.log; exit 1; }
"$cmake" --build build >build.log 2>&1 || { tail -40 build.log; exit 1; }
output=$(./build/consumer)
[[ $output == "1.000 2.000 3.000" ]] || { echo "relit to '$output', not 1 2 3"; exit 1; }
