# SPDX-License-Identifier: BSD-3-Clause
# NLopt::nlopt_cxx, the flavour of NLopt with the global searches. Debian installs both flavours under one package name and
# find_package(NLopt) takes the other; a program that uses rangecal may want that one, so its NLopt_DIR is left alone.
find_file(NLoptCxx_CONFIG NLoptConfig.cmake
          PATHS "/usr/lib/${CMAKE_LIBRARY_ARCHITECTURE}/cmake/nlopt_cxx" NO_DEFAULT_PATH)
mark_as_advanced(NLoptCxx_CONFIG)
function(rangecal_read_nlopt_config)
  include("${NLoptCxx_CONFIG}")
  set(NLoptCxx_VERSION "${NLOPT_VERSION}" PARENT_SCOPE)
endfunction()
if(NLoptCxx_CONFIG)
  rangecal_read_nlopt_config()
endif()
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(NLoptCxx REQUIRED_VARS NLoptCxx_CONFIG VERSION_VAR NLoptCxx_VERSION)
