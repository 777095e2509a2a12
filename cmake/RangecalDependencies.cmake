# SPDX-License-Identifier: BSD-3-Clause
# Every dependency. All of them are Debian 12 packages (see .ci/packages).
macro(rangecal_find)
  find_package(${ARGN} REQUIRED)
endmacro()
include(RangecalLibraries)

# Only the build needs these: headers alone, or the program.
find_package(nlohmann_json 3.11 REQUIRED)
find_package(CLI11 2.1 REQUIRED)
find_package(glog REQUIRED)
find_package(Boost 1.74 REQUIRED)
find_package(Threads REQUIRED)
find_package(MPI COMPONENTS C QUIET)  # optional: studies and fleets under mpirun
find_package(OpenSSL 3 REQUIRED COMPONENTS Crypto)  # SHA-256 of sealed keys
find_package(SQLite3 REQUIRED)  # results of a fleet; bags of rosbag2
include(RangecalCompression)  # lz4 and zstd: chunks of MCAP
