# SPDX-License-Identifier: BSD-3-Clause
# Debian packages by CPack: `rangecal` (the program), `librangecal-dev` (static libraries, headers, package file) and
# `rangecal-mpi` (studies under mpirun).
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME rangecal)
set(CPACK_PACKAGE_VENDOR "the rangecal authors")
set(CPACK_PACKAGE_CONTACT "the rangecal authors <maintainers@rangecal.invalid>")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL runtime dev)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)

set(CPACK_DEBIAN_RUNTIME_PACKAGE_NAME rangecal)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SECTION science)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SHLIBDEPS ON)  # by dpkg-shlibdeps: needs dpkg-dev and file
set(CPACK_COMPONENT_RUNTIME_DESCRIPTION
    "The command rangecal calibrates triangulation lidars, sonars and range cameras
from readings of landmarks in unknown places, and diagnoses what the
calibration leaves out.")

if(TARGET rangecal-mpi)
  list(APPEND CPACK_COMPONENTS_ALL mpi)
  set(CPACK_DEBIAN_MPI_PACKAGE_NAME rangecal-mpi)
  set(CPACK_DEBIAN_MPI_PACKAGE_SECTION science)
  set(CPACK_DEBIAN_MPI_PACKAGE_SHLIBDEPS ON)
  set(CPACK_DEBIAN_MPI_PACKAGE_DEPENDS "rangecal (= ${PROJECT_VERSION})")
  set(CPACK_COMPONENT_MPI_DESCRIPTION
      "Studies and fleets over the ranks of an MPI job: mpirun rangecal study,
mpirun rangecal fleet.")
endif()

# What the static libraries need to be linked (RangecalLibraries.cmake); no tool derives these.
set(CPACK_DEBIAN_DEV_PACKAGE_NAME librangecal-dev)
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEV_PACKAGE_DEPENDS
    "libceres-dev (>= 2.1), libcsv-dev, libeigen3-dev (>= 3.4), libfmt-dev (>= 9), libmuparser-dev, libnlopt-cxx-dev, libtbb-dev, libyaml-cpp-dev (>= 0.7)")
set(CPACK_COMPONENT_DEV_DESCRIPTION
    "Development files: static libraries and headers, and the CMake package that
find_package(rangecal) finds.")

# Debian's changelog, which names the version and points to CHANGELOG.md, in each package.
string(TIMESTAMP rangecal_date "%a, %d %b %Y %H:%M:%S +0000" UTC)  # SOURCE_DATE_EPOCH, where it is set
configure_file(cmake/debian/changelog.in "${PROJECT_BINARY_DIR}/packed/changelog" @ONLY)
foreach(component ${CPACK_COMPONENTS_ALL})
  string(TOUPPER ${component} upper)
  rangecal_install_packed("${PROJECT_BINARY_DIR}/packed/changelog"
                          "${CMAKE_INSTALL_DATAROOTDIR}/doc/${CPACK_DEBIAN_${upper}_PACKAGE_NAME}" changelog ${component})
endforeach()
include(CPack)
