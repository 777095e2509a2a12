# SPDX-License-Identifier: BSD-3-Clause
# Several files are compiled as one, which takes less time from nothing and more after a change: what the presets release and
# ci do; the preset dev compiles file by file. Names in unnamed namespaces are therefore each target's, not each file's.
option(RANGECAL_UNITY "Compile several files of a target as one" OFF)

# rangecal_unity(TARGET): in place of its C++ sources, files that include eight of them each. CMake's own UNITY_BUILD
# includes by absolute paths, by which a copy of the tree (the test of pip) finds nothing in a cache.
function(rangecal_unity target)
  if(RANGECAL_UNITY)
    cmake_language(EVAL CODE "cmake_language(DEFER CALL rangecal_unite ${target})")  # when all of its sources are known
  endif()
endfunction()

function(rangecal_unite target)
  get_target_property(sources ${target} SOURCES)
  set(folder "${CMAKE_CURRENT_BINARY_DIR}/${target}.united")
  set(united "")
  set(others "")
  foreach(source ${sources})
    get_filename_component(path "${source}" ABSOLUTE)
    get_source_file_property(alone "${path}" SKIP_UNITY_BUILD_INCLUSION)
    get_source_file_property(generated "${path}" GENERATED)
    if(alone OR generated OR NOT path MATCHES "\\.cpp$")
      list(APPEND others "${source}")
    else()
      file(RELATIVE_PATH path "${folder}" "${path}")
      list(APPEND united "#include \"${path}\"\n")
    endif()
  endforeach()
  list(LENGTH united count)
  set(batch 0)
  while(batch LESS count)
    list(SUBLIST united ${batch} 8 lines)
    math(EXPR number "${batch} / 8")
    string(JOIN "" text ${lines})
    file(CONFIGURE OUTPUT "${folder}/united_${number}.cpp" CONTENT "${text}" @ONLY)
    list(APPEND others "${folder}/united_${number}.cpp")
    math(EXPR batch "${batch} + 8")
  endwhile()
  set_property(TARGET ${target} PROPERTY SOURCES ${others})
endfunction()
