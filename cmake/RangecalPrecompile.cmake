# SPDX-License-Identifier: BSD-3-Clause
# What most files include is parsed once for each target, not once for each file, which takes 0.65 to 0.9 of its time then.
# Files include what they use all the same; -DRANGECAL_PRECOMPILE=OFF holds them to it.
option(RANGECAL_PRECOMPILE "Parse common headers once for each target" ON)

# rangecal_precompile(TARGET HEADERS...): the standard library's, Eigen's and fmt's, and HEADERS. Where TARGET does not link
# fmt or Eigen itself it has them from what it links.
function(rangecal_precompile target)
  if(NOT RANGECAL_PRECOMPILE)
    return()
  endif()
  target_precompile_headers(${target} PRIVATE
    <algorithm> <array> <cmath> <cstdint> <filesystem> <fstream> <functional> <limits> <map> <memory> <numbers> <numeric>
    <optional> <random> <set> <span> <sstream> <stdexcept> <string> <string_view> <tuple> <utility> <variant> <vector>
    <Eigen/Dense> <fmt/core.h> ${ARGN})
endfunction()
