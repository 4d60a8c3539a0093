# SPDX-License-Identifier: Apache-2.0
# Finds what the Python module is built with; turns REFIELD_PYTHON off where something is missing. Debian's own
# interpreter comes first, since its packages are those that ./dev installs; -DPython3_EXECUTABLE=... names another.
if(NOT Python3_EXECUTABLE AND EXISTS /usr/bin/python3)
  set(Python3_EXECUTABLE /usr/bin/python3)
endif()
find_package(Python3 3.9 COMPONENTS Interpreter Development.Module NumPy)
if(Python3_FOUND)
  find_package(pybind11 2.10 QUIET)
endif()
if(NOT Python3_FOUND OR NOT pybind11_FOUND)
  message(STATUS "python3-dev, python3-numpy or pybind11-dev is not there: the Python module will not be built")
  set(REFIELD_PYTHON OFF)
endif()
