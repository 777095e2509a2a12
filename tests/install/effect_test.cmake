# SPDX-License-Identifier: BSD-3-Clause
# CONTRIBUTING's "add an effect": one file put into a copy of the sources, reconfigured, built, installed, and listed by the
# installed library. The copy takes over the objects of BUILD; make, which goes by times alone, then compiles what is new.
# Arguments (-D): BUILD, WORK, SOURCE, CXX, CXX_FLAGS, BUILD_TYPE, UNITY.
include("${CMAKE_CURRENT_LIST_DIR}/run.cmake")
file(REMOVE_RECURSE "${WORK}")
set(copy "${WORK}/rangecal")
foreach(part CMakeLists.txt LICENSE cmake core problems solvers)
  file(COPY "${SOURCE}/${part}" DESTINATION "${copy}")
endforeach()
run("${CMAKE_COMMAND}" -G "Unix Makefiles" -S "${copy}" -B "${WORK}/build"
    "-DCMAKE_CXX_COMPILER=${CXX}" "-DCMAKE_CXX_FLAGS=${CXX_FLAGS}" "-DCMAKE_BUILD_TYPE=${BUILD_TYPE}"
    "-DRANGECAL_UNITY=${UNITY}" -DRANGECAL_PRECOMPILE=OFF  # a precompiled header would be newer than the objects
    -DRANGECAL_BUILD_APPS=OFF -DRANGECAL_BUILD_PYTHON=OFF -DRANGECAL_BUILD_TESTS=OFF -DRANGECAL_BUILD_BENCHMARKS=OFF)
foreach(module core problems solvers)
  set(objects "${module}/CMakeFiles/rangecal_${module}.dir")
  file(COPY "${BUILD}/${objects}/" DESTINATION "${WORK}/build/${objects}" FILES_MATCHING PATTERN "*.o")
endforeach()
file(GLOB_RECURSE objects "${WORK}/build/*.o")
file(TOUCH ${objects})

configure_file("${CMAKE_CURRENT_LIST_DIR}/window_frost.cpp.in" "${copy}/problems/effects/window_frost.cpp" COPYONLY)
run("${CMAKE_COMMAND}" --build "${WORK}/build")
run("${CMAKE_COMMAND}" --install "${WORK}/build" --prefix "${WORK}/prefix" --component dev)

run("${CMAKE_COMMAND}" -S "${CMAKE_CURRENT_LIST_DIR}/effect" -B "${WORK}/program" "-DCMAKE_PREFIX_PATH=${WORK}/prefix"
    "-DCMAKE_CXX_COMPILER=${CXX}" "-DCMAKE_CXX_FLAGS=${CXX_FLAGS}")
run("${CMAKE_COMMAND}" --build "${WORK}/program")
run("${WORK}/program/list_effects")
if(NOT output MATCHES "(^|\n)tilt\n" OR NOT output MATCHES "(^|\n)window_frost\n")
  message(FATAL_ERROR "the added effect is not listed beside the others:\n${output}")
endif()
