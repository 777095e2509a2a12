# SPDX-License-Identifier: BSD-3-Clause
# The build tree installed into an empty prefix; an outside program that finds, links and runs it and has an effect of
# its own. Arguments (-D): BUILD, WORK, SOURCE, GENERATOR, CXX, CXX_FLAGS, VERSION, NEXT_MINOR.
include("${CMAKE_CURRENT_LIST_DIR}/run.cmake")
file(REMOVE_RECURSE "${WORK}")
run("${CMAKE_COMMAND}" --install "${BUILD}" --prefix "${WORK}/prefix")

# The README's program.
file(READ "${SOURCE}/README.md" readme)
if(NOT readme MATCHES "\n```cpp\n(.*)")
  message(FATAL_ERROR "README.md shows no C++")
endif()
string(FIND "${CMAKE_MATCH_1}" "\n```" end)
string(SUBSTRING "${CMAKE_MATCH_1}" 0 ${end} program)
file(WRITE "${WORK}/readme.cpp" "${program}\n")

file(COPY "${SOURCE}/problems/effects" DESTINATION "${WORK}")
file(GLOB shipped RELATIVE "${WORK}/effects" "${WORK}/effects/*.cpp")
list(TRANSFORM shipped REPLACE "\\.cpp$" "")
list(JOIN shipped "|" shipped)
configure_file("${CMAKE_CURRENT_LIST_DIR}/window_frost.cpp.in" "${WORK}/effects/window_frost.cpp" COPYONLY)
run("${CMAKE_COMMAND}" -G "${GENERATOR}" -S "${CMAKE_CURRENT_LIST_DIR}/outside" -B "${WORK}/build"
    "-DCMAKE_PREFIX_PATH=${WORK}/prefix" "-DCMAKE_CXX_COMPILER=${CXX}" "-DCMAKE_CXX_FLAGS=${CXX_FLAGS}"
    "-DRANGECAL_VERSION=${VERSION}" "-DRANGECAL_NEXT_MINOR=${NEXT_MINOR}" "-DEFFECTS=${WORK}/effects" "-DSHIPPED=${shipped}"
    "-DREADME=${WORK}/readme.cpp")
run("${CMAKE_COMMAND}" --build "${WORK}/build")
run("${WORK}/build/outside")
if(NOT output STREQUAL "rangecal ${VERSION}\n")
  message(FATAL_ERROR "another version than ${VERSION}:\n${output}")
endif()
run("${CMAKE_COMMAND}" -E chdir "${WORK}/prefix/share/rangecal" "${WORK}/build/readme")
run("${WORK}/prefix/bin/rangecal" --version)
if(NOT output MATCHES "^rangecal ${VERSION}\nbuilt with Ceres [0-9.]+, .*OpenSSL [0-9.]+.*, [A-Za-z]+ [0-9.]+\n$")
  message(FATAL_ERROR "no version in:\n${output}")
endif()
run("${WORK}/prefix/bin/rangecal" calibrate "${WORK}/prefix/share/rangecal/notebooks_data/field-layout")

# The program's own effect stands beside the library's.
run("${WORK}/build/list_effects")
if(NOT output MATCHES "(^|\n)tilt\n" OR NOT output MATCHES "(^|\n)window_frost\n")
  message(FATAL_ERROR "the program's own effect is not listed beside the library's:\n${output}")
endif()
