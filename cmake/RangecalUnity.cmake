# SPDX-License-Identifier: BSD-3-Clause
# Several files are compiled as one, which takes half the time from nothing and more after a change: what the presets release
# and ci do; the preset dev compiles file by file. Names in unnamed namespaces are therefore each target's, not each file's.
option(RANGECAL_UNITY "Compile several files of a target as one" OFF)

# rangecal_unity(TARGET)
function(rangecal_unity target)
  if(RANGECAL_UNITY)
    set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 8)
  endif()
endfunction()
