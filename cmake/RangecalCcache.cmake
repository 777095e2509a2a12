# SPDX-License-Identifier: BSD-3-Clause
# What is compiled once more from the same text (the test of pip builds a copy of the tree) comes from a cache of the build's
# own. It leaves ccache's settings of the user alone, and a launcher that the user chose in its place.
set(RANGECAL_CCACHE "" CACHE PATH "Folder in which ccache, where there is one, keeps what it compiled; empty: none")
find_program(RANGECAL_CCACHE_PROGRAM ccache)
mark_as_advanced(RANGECAL_CCACHE_PROGRAM)
set(rangecal_ccache_used OFF)
if(RANGECAL_CCACHE AND RANGECAL_CCACHE_PROGRAM AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  # CMake writes what is precompiled a moment before it is compiled, too new for ccache unless it is told not to mind.
  # Names under the source folder are taken relative to the build folder, so a copy that is built as deep finds them.
  set(CMAKE_CXX_COMPILER_LAUNCHER ${CMAKE_COMMAND} -E env "CCACHE_DIR=${RANGECAL_CCACHE}" "CCACHE_BASEDIR=${PROJECT_SOURCE_DIR}"
      CCACHE_NOHASHDIR=1 CCACHE_DEPEND=1 CCACHE_SLOPPINESS=pch_defines,time_macros,include_file_mtime,include_file_ctime
      CCACHE_MAXSIZE=2G CCACHE_PCH_EXTSUM=1 sh ${CMAKE_CURRENT_LIST_DIR}/ccache.sh ${RANGECAL_CCACHE_PROGRAM})
  set(rangecal_ccache_used ON)
endif()
