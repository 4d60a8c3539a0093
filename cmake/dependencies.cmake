# SPDX-License-Identifier: Apache-2.0
# What the libraries link.
enable_language(C)  # what FindHDF5 tries its headers with
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
find_package(HDF5 REQUIRED COMPONENTS C)
find_package(OpenImageIO REQUIRED)
find_package(OpenEXR 3 REQUIRED)
find_package(PNG REQUIRED)
find_package(ZLIB REQUIRED)
find_package(TBB REQUIRED)
find_package(tomlplusplus REQUIRED)
find_package(nlohmann_json REQUIRED)
find_package(embree 3 REQUIRED)
find_package(HWY REQUIRED)
find_package(PkgConfig REQUIRED)
pkg_check_modules(libraw REQUIRED IMPORTED_TARGET libraw_r)  # RAW files

# Debian ships OpenCV's CMake package with all of OpenCV, graphical toolkits included: a gigabyte for two modules. The two
# are found by hand instead.
find_path(REFIELD_OPENCV_INCLUDE opencv2/core.hpp PATH_SUFFIXES opencv4 REQUIRED)
foreach(module core imgproc)
  find_library(REFIELD_OPENCV_${module} opencv_${module} REQUIRED)
  add_library(opencv_${module} UNKNOWN IMPORTED)
  set_target_properties(opencv_${module} PROPERTIES IMPORTED_LOCATION "${REFIELD_OPENCV_${module}}"
                        INTERFACE_INCLUDE_DIRECTORIES "${REFIELD_OPENCV_INCLUDE}")
endforeach()

# Debian's CMake package of assimp names libraries whose own packages it does not bring along.
find_path(REFIELD_ASSIMP_INCLUDE assimp/Importer.hpp REQUIRED)
find_library(REFIELD_ASSIMP assimp REQUIRED)
add_library(assimp UNKNOWN IMPORTED)
set_target_properties(assimp PROPERTIES IMPORTED_LOCATION "${REFIELD_ASSIMP}"
                      INTERFACE_INCLUDE_DIRECTORIES "${REFIELD_ASSIMP_INCLUDE}")

# CMake 3.25 gives HDF5 as variables; as a target it reaches only who asks for it.
add_library(refield_hdf5 INTERFACE IMPORTED)
target_include_directories(refield_hdf5 SYSTEM INTERFACE ${HDF5_INCLUDE_DIRS})
target_link_libraries(refield_hdf5 INTERFACE ${HDF5_LIBRARIES})
