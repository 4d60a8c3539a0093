# SPDX-License-Identifier: Apache-2.0
# find_package(refield) defines refield::refield, the library that include/refield/ declares.
include("${CMAKE_CURRENT_LIST_DIR}/dependencies.cmake")
include("${CMAKE_CURRENT_LIST_DIR}/refield-targets.cmake")
