# SPDX-License-Identifier: BSD-3-Clause
# cmake --install: component `runtime` (the program, the shipped recordings), `dev` (the libraries, their headers, the package
# that find_package(rangecal) finds) and, where there is MPI, `mpi` (the program's part for mpirun). `make package` makes a Debian
# package of each.
include(CMakePackageConfigHelpers)
set(package_dir "${CMAKE_INSTALL_LIBDIR}/cmake/rangecal")

install(TARGETS rangecal_core rangecal_problems rangecal_solvers EXPORT rangecalTargets
        ARCHIVE DESTINATION "${CMAKE_INSTALL_LIBDIR}" COMPONENT dev)
foreach(module core problems solvers)
  install(DIRECTORY ${module}/include/ DESTINATION "${CMAKE_INSTALL_INCLUDEDIR}" COMPONENT dev FILES_MATCHING PATTERN "*.hpp"
          PATTERN "json_fields.hpp" EXCLUDE)  # needs nlohmann-json, which no other header does
endforeach()
install(EXPORT rangecalTargets NAMESPACE rangecal:: DESTINATION "${package_dir}" COMPONENT dev)

configure_package_config_file(cmake/rangecalConfig.cmake.in "${PROJECT_BINARY_DIR}/rangecalConfig.cmake"
                              INSTALL_DESTINATION "${package_dir}" NO_SET_AND_CHECK_MACRO)
# Before 1.0 a new minor version may change the interface.
write_basic_package_version_file("${PROJECT_BINARY_DIR}/rangecalConfigVersion.cmake" COMPATIBILITY SameMinorVersion)
install(FILES "${PROJECT_BINARY_DIR}/rangecalConfig.cmake" "${PROJECT_BINARY_DIR}/rangecalConfigVersion.cmake"
              cmake/RangecalLibraries.cmake cmake/RangecalEffects.cmake cmake/FindNLoptCxx.cmake cmake/Findlibcsv.cmake
        DESTINATION "${package_dir}" COMPONENT dev)

if(TARGET rangecal)
  install(TARGETS rangecal RUNTIME DESTINATION "${CMAKE_INSTALL_BINDIR}" COMPONENT runtime)
endif()
if(TARGET rangecal-mpi)
  install(TARGETS rangecal-mpi RUNTIME DESTINATION "${CMAKE_INSTALL_BINDIR}" COMPONENT mpi)
  install(FILES LICENSE DESTINATION "${CMAKE_INSTALL_DATAROOTDIR}/doc/rangecal-mpi" RENAME copyright COMPONENT mpi)
endif()
# The manual page, packed as Debian asks for it where there is gzip.
find_program(GZIP_EXECUTABLE gzip)
mark_as_advanced(GZIP_EXECUTABLE)
function(rangecal_install_packed source destination name component)
  if(GZIP_EXECUTABLE)
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS "${source}")
    execute_process(COMMAND "${GZIP_EXECUTABLE}" -9nc "${source}" OUTPUT_FILE "${PROJECT_BINARY_DIR}/packed/${name}.gz" COMMAND_ERROR_IS_FATAL ANY)
    install(FILES "${PROJECT_BINARY_DIR}/packed/${name}.gz" DESTINATION "${destination}" COMPONENT ${component})
  else()
    install(FILES "${source}" DESTINATION "${destination}" RENAME "${name}" COMPONENT ${component})
  endif()
endfunction()
file(MAKE_DIRECTORY "${PROJECT_BINARY_DIR}/packed")
if(TARGET rangecal)  # the library alone is built without docs
  rangecal_install_packed("${PROJECT_SOURCE_DIR}/docs/rangecal.1" "${CMAKE_INSTALL_MANDIR}/man1" rangecal.1 runtime)
endif()
if(TARGET rangecal-mpi)
  rangecal_install_packed("${PROJECT_SOURCE_DIR}/docs/rangecal-mpi.1" "${CMAKE_INSTALL_MANDIR}/man1" rangecal-mpi.1 mpi)
endif()

install(DIRECTORY notebooks_data/field-layout notebooks_data/pairs-2016 notebooks_data/scenes
        DESTINATION "${CMAKE_INSTALL_DATADIR}/rangecal/notebooks_data" COMPONENT runtime)
install(FILES README.md CHANGELOG.md CITATION.cff DESTINATION "${CMAKE_INSTALL_DOCDIR}" COMPONENT runtime)
install(DIRECTORY docs DESTINATION "${CMAKE_INSTALL_DOCDIR}" COMPONENT runtime PATTERN "*.mjs" EXCLUDE
        PATTERN "*.1" EXCLUDE)
install(FILES LICENSE DESTINATION "${CMAKE_INSTALL_DOCDIR}" RENAME copyright COMPONENT runtime)
install(FILES "${PROJECT_BINARY_DIR}/NOTICES" DESTINATION "${CMAKE_INSTALL_DOCDIR}" COMPONENT runtime)  # rangecal-mpi depends on it
install(FILES LICENSE DESTINATION "${CMAKE_INSTALL_DATAROOTDIR}/doc/librangecal-dev" RENAME copyright COMPONENT dev)
install(FILES "${PROJECT_BINARY_DIR}/NOTICES" DESTINATION "${CMAKE_INSTALL_DATAROOTDIR}/doc/librangecal-dev" COMPONENT dev)
