# SPDX-License-Identifier: BSD-3-Clause
# Every dependency, looked up in one place. All of them are Debian 12 packages (see .ci/packages).
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
find_package(Ceres 2.1 REQUIRED)
find_package(fmt 9 REQUIRED)
find_package(nlohmann_json 3.11 REQUIRED)
find_package(CLI11 2.1 REQUIRED)
find_package(yaml-cpp 0.7 REQUIRED)
find_package(TBB REQUIRED)
find_package(glog REQUIRED)
find_package(Boost 1.74 REQUIRED)
find_package(Threads REQUIRED)
find_package(OpenSSL 3 REQUIRED COMPONENTS Crypto)  # SHA-256 of sealed keys
# The C++ flavour of NLopt carries the global searches; the C flavour would be found first.
find_package(NLopt REQUIRED PATHS /usr/lib/${CMAKE_LIBRARY_ARCHITECTURE}/cmake/nlopt_cxx NO_DEFAULT_PATH)

find_path(LIBCSV_INCLUDE_DIR csv.h REQUIRED)
find_library(LIBCSV_LIBRARY csv REQUIRED)
if(NOT TARGET rangecal_libcsv)
  add_library(rangecal_libcsv INTERFACE IMPORTED GLOBAL)
  target_include_directories(rangecal_libcsv INTERFACE ${LIBCSV_INCLUDE_DIR})
  target_link_libraries(rangecal_libcsv INTERFACE ${LIBCSV_LIBRARY})
endif()
