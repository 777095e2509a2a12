# SPDX-License-Identifier: BSD-3-Clause
# Run as a script: cmake -DOUTPUT=FILE.cpp "-DFILES=name=path|name=path" -P RangecalEmbed.cmake
# Writes a C++ file that holds the files as text. References to source maps are dropped: they would be fetched.
string(REPLACE "|" ";" entries "${FILES}")
set(delimiter "rangecal_text")
file(WRITE "${OUTPUT}.new" "// Generated: the files of the report as text.\n"
     "#include \"assets.hpp\"\n\nnamespace rangecal::report {\n\n"
     "const std::map<std::string_view, std::string_view>& assets() {\n"
     "  static const std::map<std::string_view, std::string_view> files{\n")
foreach(entry IN LISTS entries)
  string(REGEX MATCH "^([^=]+)=(.+)$" matched "${entry}")
  set(name "${CMAKE_MATCH_1}")
  set(path "${CMAKE_MATCH_2}")
  file(READ "${path}" text)
  string(REGEX REPLACE "\n?//# sourceMappingURL=[^\n]*" "" text "${text}")
  string(FIND "${text}" ")${delimiter}\"" clash)
  if(NOT clash EQUAL -1)
    message(FATAL_ERROR "${path} holds the delimiter of its own literal")
  endif()
  file(APPEND "${OUTPUT}.new" "      {\"${name}\", R\"${delimiter}(")
  file(APPEND "${OUTPUT}.new" "${text}")
  file(APPEND "${OUTPUT}.new" ")${delimiter}\"},\n")
endforeach()
file(APPEND "${OUTPUT}.new" "  };\n  return files;\n}\n\n}  // namespace rangecal::report\n")
file(RENAME "${OUTPUT}.new" "${OUTPUT}")
