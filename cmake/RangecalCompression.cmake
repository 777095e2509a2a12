# SPDX-License-Identifier: BSD-3-Clause
# Targets lz4::lz4 and zstd::zstd: Debian 12's liblz4-dev has no CMake package, and libzstd-dev's needs a static library or two
# names that differ by release.
foreach(part "lz4;lz4frame.h" "zstd;zstd.h")
  list(GET part 0 name)
  list(GET part 1 header)
  find_path(RANGECAL_${name}_INCLUDE_DIR ${header})
  find_library(RANGECAL_${name}_LIBRARY ${name})
  if(NOT RANGECAL_${name}_INCLUDE_DIR OR NOT RANGECAL_${name}_LIBRARY)
    message(FATAL_ERROR "lib${name}-dev is missing")
  endif()
  if(NOT TARGET ${name}::${name})
    add_library(${name}::${name} UNKNOWN IMPORTED)
    set_target_properties(${name}::${name} PROPERTIES IMPORTED_LOCATION "${RANGECAL_${name}_LIBRARY}"
      INTERFACE_INCLUDE_DIRECTORIES "${RANGECAL_${name}_INCLUDE_DIR}")
  endif()
endforeach()
