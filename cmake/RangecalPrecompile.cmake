# SPDX-License-Identifier: BSD-3-Clause
# What most files include is parsed once, not once for each file, which takes 0.65 to 0.9 of its time then.
# Files include what they use all the same; -DRANGECAL_PRECOMPILE=OFF holds them to it.
option(RANGECAL_PRECOMPILE "Parse common headers once, not once for each file" ON)

# rangecal_precompile(TARGET HEADERS...): the standard library's, Eigen's and fmt's, and HEADERS. Where TARGET does not link
# fmt or Eigen itself it has them from what it links.
# rangecal_precompile(TARGET FROM OTHER): those of OTHER, which is compiled with the same options; a target's own would take
# 150 MB and as long as several of its files.
# GCC wants OTHER's definitions there too, so that rangecal_options gives Boost's (for other compilers) to all.
function(rangecal_precompile target)
  cmake_parse_arguments(ARG "" "FROM" "" ${ARGN})
  if(NOT RANGECAL_PRECOMPILE)
    return()
  endif()
  if(ARG_FROM)
    target_precompile_headers(${target} REUSE_FROM ${ARG_FROM})
    get_target_property(type ${target} TYPE)
    get_target_property(other_type ${ARG_FROM} TYPE)
    if(type STREQUAL "EXECUTABLE" AND NOT other_type STREQUAL "EXECUTABLE")
      target_compile_options(${target} PRIVATE -fPIC)  # as the library's, where a program would have -fPIE
    endif()
    return()
  endif()
  target_include_directories(${target} PRIVATE "${CMAKE_CURRENT_FUNCTION_LIST_DIR}")
  target_precompile_headers(${target} PRIVATE
    <algorithm> <array> <cmath> <cstdint> <filesystem> <fstream> <functional> <limits> <map> <memory> <numbers> <numeric>
    <optional> <random> <set> <span> <sstream> <stdexcept> <string> <string_view> <tuple> <utility> <variant> <vector>
    <Eigen/Dense> <eigen_instances.hpp> <fmt/core.h> ${ARGN})
endfunction()
