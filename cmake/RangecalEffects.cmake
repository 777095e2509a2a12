# SPDX-License-Identifier: BSD-3-Clause
# The registry of effects, generated from the files of problems/effects: NAME.cpp defines
# std::unique_ptr<rangecal::Effect> rangecal::effects::make_NAME(). Static libraries would drop self-registering objects.
function(rangecal_effect_registry target folder)
  file(GLOB files CONFIGURE_DEPENDS "${folder}/*.cpp")
  list(SORT files)
  set(declarations "")
  set(entries "")
  foreach(file ${files})
    get_filename_component(name ${file} NAME_WE)
    string(APPEND declarations "std::unique_ptr<Effect> make_${name}();\n")
    string(APPEND entries "    all.push_back(effects::make_${name}());\n")
  endforeach()
  set(registry "${CMAKE_CURRENT_BINARY_DIR}/effect_registry.cpp")
  file(CONFIGURE OUTPUT "${registry}" CONTENT
"// Generated from the files of problems/effects.
#include \"rangecal/problems/effects/effect.hpp\"

namespace rangecal {
namespace effects {
@declarations@}  // namespace effects

const std::vector<std::unique_ptr<Effect>>& effect_registry() {
  static const std::vector<std::unique_ptr<Effect>> registry = [] {
    std::vector<std::unique_ptr<Effect>> all;
@entries@    return all;
  }();
  return registry;
}

}  // namespace rangecal
" @ONLY)
  # An object of its own, so that a program with effects and a registry of its own does not pull this one from the library.
  set_source_files_properties("${registry}" PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
  target_sources(${target} PRIVATE ${files} "${registry}")
endfunction()
