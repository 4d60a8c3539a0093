# SPDX-License-Identifier: Apache-2.0
# The manual, and Debian packages by CPack: refield, librefield0.2, librefield-dev, and python3-refield where the module is
# built.
# `./dev check packages` makes them.
find_package(Python3 3.9 REQUIRED COMPONENTS Interpreter)

# The newest entry of the change log must be this version; its date is that of the packages.
file(STRINGS CHANGELOG.md releases REGEX "^## ")
list(GET releases 0 release)
if(NOT release MATCHES "^## ${PROJECT_VERSION} \\(([0-9-]+)\\)$")
  message(FATAL_ERROR "CHANGELOG.md begins with '${release}', not with '## ${PROJECT_VERSION} (YYYY-MM-DD)'")
endif()
set(release_date ${CMAKE_MATCH_1})

# Man pages and completion, from what the program prints as help.
set(manual "${PROJECT_BINARY_DIR}/manual")
add_custom_command(OUTPUT "${manual}/refield.bash"
  COMMAND ${Python3_EXECUTABLE} "${PROJECT_SOURCE_DIR}/cli/manual.py" $<TARGET_FILE:refield> "${manual}" --date ${release_date}
  DEPENDS refield cli/manual.py CHANGELOG.md COMMENT "Writing the man pages" VERBATIM)
add_custom_target(manual ALL DEPENDS "${manual}/refield.bash")
install(DIRECTORY "${manual}/man/" DESTINATION share/man/man1 COMPONENT program)
install(FILES "${manual}/refield.bash" DESTINATION share/bash-completion/completions RENAME refield COMPONENT program)
install(FILES "${manual}/_refield" DESTINATION share/zsh/vendor-completions COMPONENT program)

# The viewer and fields on the desktop.
install(FILES cmake/package/refield-view.desktop DESTINATION share/applications COMPONENT program)
install(FILES cmake/package/refield.xml DESTINATION share/mime/packages COMPONENT program)
install(FILES cmake/package/refield.svg DESTINATION share/icons/hicolor/scalable/apps COMPONENT program)

# The documents and scenes that the help and the man pages name.
install(FILES README.md DESTINATION share/doc/refield COMPONENT program)
install(DIRECTORY docs datasets_synthetic DESTINATION share/doc/refield COMPONENT program PATTERN site EXCLUDE)

set(components program shared library)
if(TARGET refield_python)
  list(APPEND components python)
endif()

set(CPACK_COMPONENTS_ALL ${components})
set(CPACK_DEBIAN_PROGRAM_PACKAGE_NAME refield)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SECTION graphics)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_RECOMMENDS "ffmpeg, fonts-dejavu-core")
set(CPACK_COMPONENT_PROGRAM_DESCRIPTION "measure and relight reflectance fields
refield photographs a scene under many light patterns, or reads such
photographs, estimates how the scene transforms light into pixel values,
and renders it under new illumination: images, video, an interactive
viewer and web pages. It also precomputes the light transport of meshes.")

# As the SONAME says; its users depend on it by name and version.
set(shared_package librefield${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR})
set(CPACK_DEBIAN_SHARED_PACKAGE_NAME ${shared_package})
set(CPACK_DEBIAN_SHARED_PACKAGE_SECTION libs)
# CPack would call ldconfig in scripts; Debian has a trigger for it.
set(control "${PROJECT_BINARY_DIR}/package-control")
file(WRITE "${control}/triggers" "activate-noawait ldconfig\n")
file(WRITE "${control}/shlibs"
     "librefield ${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR} ${shared_package} (= ${PROJECT_VERSION}-1)\n")
file(CHMOD "${control}/triggers" "${control}/shlibs" PERMISSIONS OWNER_READ OWNER_WRITE GROUP_READ WORLD_READ)
set(CPACK_DEBIAN_SHARED_PACKAGE_CONTROL_EXTRA "${control}/triggers;${control}/shlibs")
set(CPACK_COMPONENT_SHARED_DESCRIPTION "estimate and relight reflectance fields (shared library)
Library for programs that estimate reflectance fields from images in
memory, read and write field files, relight fields and precompute the
light transport of meshes.")

set(CPACK_DEBIAN_LIBRARY_PACKAGE_NAME librefield-dev)
set(CPACK_DEBIAN_LIBRARY_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_LIBRARY_PACKAGE_DEPENDS "${shared_package} (= ${PROJECT_VERSION}-1)")
set(CPACK_DEBIAN_LIBRARY_PACKAGE_SUGGESTS "refield")
set(CPACK_COMPONENT_LIBRARY_DESCRIPTION "estimate and relight reflectance fields (C++ library)
Headers for C++ programs that estimate reflectance fields from images in
memory, read and write field files, relight fields and precompute the
light transport of meshes. CMake finds the library by
find_package(refield).")

set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-refield)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS "python3 (>= ${Python3_VERSION_MAJOR}.${Python3_VERSION_MINOR}~), python3 (<< ${Python3_VERSION_MAJOR}.${Python3_VERSION_MINOR}.99), python3-numpy, ${shared_package} (= ${PROJECT_VERSION}-1)")
set(CPACK_DEBIAN_PYTHON_PACKAGE_SUGGESTS "refield, python3-scipy, python3-sklearn")
set(CPACK_DEBIAN_PYTHON_PACKAGE_CONTROL_EXTRA "${PROJECT_SOURCE_DIR}/cmake/package/postinst;${PROJECT_SOURCE_DIR}/cmake/package/prerm")
set(CPACK_COMPONENT_PYTHON_DESCRIPTION "estimate and relight reflectance fields (Python module)
The module refield estimates reflectance fields from NumPy arrays, files
or capture sessions, relights them, and precomputes the light transport
of meshes. Long calls report progress and release the interpreter lock.")

# What every package of Debian has: copyright and the two change logs.
set(stamp "${PROJECT_BINARY_DIR}/package-doc")
execute_process(COMMAND date -u -R -d "${release_date}" OUTPUT_VARIABLE date_in_words OUTPUT_STRIP_TRAILING_WHITESPACE)
set(CPACK_PACKAGE_CONTACT "refield maintainers <maintainers@refield.example>")
foreach(component IN LISTS components)
  string(TOUPPER ${component} upper)
  set(package ${CPACK_DEBIAN_${upper}_PACKAGE_NAME})
  file(WRITE "${stamp}/${package}/changelog.Debian" "refield (${PROJECT_VERSION}-1) bookworm; urgency=medium

  * Version ${PROJECT_VERSION}; changelog.gz lists the changes.

 -- ${CPACK_PACKAGE_CONTACT}  ${date_in_words}
")
  configure_file(CHANGELOG.md "${stamp}/${package}/changelog" COPYONLY)
  execute_process(COMMAND gzip -9nf changelog changelog.Debian WORKING_DIRECTORY "${stamp}/${package}")
  install(FILES cmake/package/copyright "${stamp}/${package}/changelog.gz" "${stamp}/${package}/changelog.Debian.gz"
          DESTINATION share/doc/${package} COMPONENT ${component})
endforeach()

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "")  # it would stand before those of the packages
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS
    OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS "${PROJECT_BINARY_DIR}/library")
# Not the tests and benchmarks of target `all`; ./dev check packages builds what is installed.
set(CPACK_CMAKE_GENERATOR Ninja)
set(CPACK_INSTALL_CMAKE_PROJECTS "${PROJECT_BINARY_DIR};refield;ALL;/")
set(CMAKE_SKIP_INSTALL_ALL_DEPENDENCY ON)
add_custom_target(packaged DEPENDS manual refield_image_formats_module refield-reader refield_shared)
if(TARGET refield_python)
  add_dependencies(packaged refield_python)
endif()
include(CPack)
