# SPDX-License-Identifier: BSD-3-Clause
# cmake -DRANGECAL_SOURCE_DIR= -DWORK= -DGENERATOR= -DCXX= -DCXX_FLAGS= -DPROBLEMS_LIBRARY= -DCORE_LIBRARY= -P run.cmake
function(run)
  execute_process(COMMAND ${ARGV} OUTPUT_VARIABLE output ERROR_VARIABLE error RESULT_VARIABLE code)
  if(code)
    message(FATAL_ERROR "${ARGV}\n${output}\n${error}")
  endif()
  set(output "${output}" PARENT_SCOPE)
endfunction()

file(REMOVE_RECURSE "${WORK}")
file(COPY "${RANGECAL_SOURCE_DIR}/problems/effects" DESTINATION "${WORK}")
run("${CMAKE_COMMAND}" -G "${GENERATOR}" -S "${CMAKE_CURRENT_LIST_DIR}" -B "${WORK}/build" "-DCMAKE_CXX_COMPILER=${CXX}"
  "-DCMAKE_CXX_FLAGS=${CXX_FLAGS}" "-DRANGECAL_SOURCE_DIR=${RANGECAL_SOURCE_DIR}" "-DEFFECTS=${WORK}/effects"
  "-DPROBLEMS_LIBRARY=${PROBLEMS_LIBRARY}" "-DCORE_LIBRARY=${CORE_LIBRARY}")
run("${CMAKE_COMMAND}" --build "${WORK}/build")
run("${WORK}/build/list_effects")
set(before "${output}")
if(NOT before MATCHES "(^|\n)tilt\n" OR before MATCHES "window_frost")
  message(FATAL_ERROR "unexpected effects before the file was added:\n${before}")
endif()

# The build notices the new file by itself.
configure_file("${CMAKE_CURRENT_LIST_DIR}/window_frost.cpp.in" "${WORK}/effects/window_frost.cpp" COPYONLY)
run("${CMAKE_COMMAND}" --build "${WORK}/build")
run("${WORK}/build/list_effects")
string(REPLACE "window_frost\n" "" without "${output}")
if(NOT output MATCHES "(^|\n)window_frost\n" OR NOT without STREQUAL before)
  message(FATAL_ERROR "the added effect is not listed beside the others:\n${output}")
endif()
