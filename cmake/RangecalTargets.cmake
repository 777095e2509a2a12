# SPDX-License-Identifier: BSD-3-Clause
include(GNUInstallDirs)

if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
  message(STATUS "No build type given: use a preset (cmake --preset release) for measured speed")
endif()

add_library(rangecal_options INTERFACE)
target_compile_features(rangecal_options INTERFACE cxx_std_20)
target_compile_definitions(rangecal_options INTERFACE BOOST_ALL_NO_LIB)
target_compile_options(rangecal_options INTERFACE -Wall -Wextra -Wnon-virtual-dtor)
if(NOT RANGECAL_UNITY)  # a local name may be that of another file's constant
  target_compile_options(rangecal_options INTERFACE -Wshadow)
endif()
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
  target_compile_options(rangecal_options INTERFACE -Wno-restrict)  # false in GCC 12 on std::string (bug 105651)
  if(RANGECAL_PRECOMPILE)  # and so are these where it was precompiled and no longer counts as a system header
    target_compile_options(rangecal_options INTERFACE -Wno-array-bounds -Wno-stringop-overflow -Wno-stringop-overread)
  endif()
endif()
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")  # that collects its own garbage only beyond 1 GB compiles 10 to 20 % faster, in a sixth more memory
  target_compile_options(rangecal_options INTERFACE --param=ggc-min-heapsize=1000000)
endif()
if(RANGECAL_WARNINGS_AS_ERRORS)
  target_compile_options(rangecal_options INTERFACE -Werror)
endif()
if(RANGECAL_SANITIZE)
  target_compile_options(rangecal_options INTERFACE -fsanitize=address,undefined -fno-omit-frame-pointer)
  target_link_options(rangecal_options INTERFACE -fsanitize=address,undefined)
endif()
if(RANGECAL_COVERAGE)
  target_compile_options(rangecal_options INTERFACE --coverage -fprofile-update=atomic)
  target_link_options(rangecal_options INTERFACE --coverage)
endif()

# rangecal_compile_lightly(TARGET): what computes nothing itself (tests, bindings) is not worth -O3, which takes a third longer.
function(rangecal_compile_lightly target)
  target_compile_options(${target} PRIVATE $<$<CONFIG:Release>:-O1>)
endfunction()

# rangecal_module(NAME DEPENDS targets... PRIVATE_DEPENDS targets... HEADERS_ONLY targets...)
# A static library from NAME/src/**.cpp whose headers live in NAME/include/rangecal/NAME. Who links it needs DEPENDS and
# PRIVATE_DEPENDS, not HEADERS_ONLY.
function(rangecal_module name)
  cmake_parse_arguments(ARG "" "" "DEPENDS;PRIVATE_DEPENDS;HEADERS_ONLY" ${ARGN})
  file(GLOB_RECURSE sources CONFIGURE_DEPENDS "${CMAKE_CURRENT_SOURCE_DIR}/src/*.cpp")
  add_library(rangecal_${name} STATIC ${sources})
  add_library(rangecal::${name} ALIAS rangecal_${name})
  set_target_properties(rangecal_${name} PROPERTIES EXPORT_NAME ${name} POSITION_INDEPENDENT_CODE ON)
  target_include_directories(rangecal_${name}
    PUBLIC $<BUILD_INTERFACE:${CMAKE_CURRENT_SOURCE_DIR}/include> $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>
    PRIVATE ${CMAKE_CURRENT_SOURCE_DIR}/src)
  target_compile_features(rangecal_${name} PUBLIC cxx_std_20)
  target_link_libraries(rangecal_${name}
    PUBLIC ${ARG_DEPENDS} PRIVATE ${ARG_PRIVATE_DEPENDS} "$<BUILD_INTERFACE:${ARG_HEADERS_ONLY};rangecal_options>")
  rangecal_unity(rangecal_${name})
  if(name STREQUAL "core")
    rangecal_precompile(rangecal_core)
    set(instances "${CMAKE_CURRENT_FUNCTION_LIST_DIR}/eigen_instances.cpp")  # which the precompiled headers say are compiled elsewhere
    target_sources(rangecal_core PRIVATE "${instances}")
    set_source_files_properties("${instances}" PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
  else()
    rangecal_precompile(rangecal_${name} FROM rangecal_core)
  endif()
endfunction()
