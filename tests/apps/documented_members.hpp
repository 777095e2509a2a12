// SPDX-License-Identifier: BSD-3-Clause
// What docs/formats.md says a JSON file holds, against what programs wrote: a member that only one of them has fails.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "apps/run_binary.hpp"

namespace rangecal::test {

/// Names from the top of a file down to a value; "[]" stands for the entries of a list.
using MemberPath = std::vector<std::string>;

inline std::string joined(const MemberPath& path) {
  std::string text;
  for (const std::string& name : path) text += (text.empty() || name == "[]" ? "" : ".") + name;
  return text;
}

/// The section of docs/formats.md under the heading that begins with `heading`.
inline std::string section_of_formats(const std::string& heading) {
  const std::string page = slurp(std::string(RANGECAL_SOURCE_DIR) + "/docs/formats.md");
  const std::size_t begin = page.find("\n## " + heading);
  EXPECT_NE(begin, std::string::npos) << "docs/formats.md has no section '" << heading << "'";
  if (begin == std::string::npos) return "";
  return page.substr(begin, page.find("\n## ", begin + 1) - begin);
}

/// What stands between backticks.
inline std::vector<std::string> code_in(const std::string& text) {
  std::vector<std::string> codes;
  for (std::size_t open = text.find('`'); open != std::string::npos; open = text.find('`', open)) {
    const std::size_t close = text.find('`', open + 1);
    if (close == std::string::npos) break;
    codes.push_back(text.substr(open + 1, close - open - 1));
    open = close + 1;
  }
  return codes;
}

/// "a.{b,c}" as "a.b" and "a.c".
inline std::vector<std::string> without_braces(const std::string& text) {
  const std::size_t open = text.find('{'), close = text.find('}', open);
  if (open == std::string::npos || close == std::string::npos) return {text};
  std::vector<std::string> all;
  std::istringstream names(text.substr(open + 1, close - open - 1));
  for (std::string name; std::getline(names, name, ',');)
    for (const std::string& rest : without_braces(text.substr(close + 1)))
      all.push_back(text.substr(0, open) + name + rest);
  return all;
}

inline MemberPath path_of(const std::string& text) {
  MemberPath path;
  std::istringstream names(text);
  for (std::string name; std::getline(names, name, '.');) {
    int lists = 0;
    for (; name.ends_with("[]"); ++lists) name.resize(name.size() - 2);
    path.push_back(name);
    path.insert(path.end(), static_cast<std::size_t>(lists), "[]");
  }
  return path;
}

/// The paths in the first columns of the tables of a section that are headed "| member |".
inline std::vector<MemberPath> documented_members(const std::string& heading) {
  std::vector<MemberPath> paths;
  std::istringstream lines(section_of_formats(heading));
  bool inside = false;
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("| member |")) inside = true;
    if (!line.starts_with("|")) inside = false;
    if (!inside) continue;
    for (const std::string& code : code_in(line.substr(0, line.find('|', 1))))
      for (const std::string& one : without_braces(code)) paths.push_back(path_of(one));
  }
  return paths;
}

/// The paths to the values of a file, with whether some value there is more than null or an empty list. A list of plain values
/// is a value; an empty object says nothing.
inline void collect_members(const nlohmann::json& json, const MemberPath& at,
                            std::map<MemberPath, bool>& paths) {
  const auto below = [&](const std::string& name, const nlohmann::json& value) {
    MemberPath path = at;
    path.push_back(name);
    collect_members(value, path, paths);
  };
  if (json.is_object()) {
    for (const auto& [name, value] : json.items()) below(name, value);
  } else if (json.is_array() &&
             std::any_of(json.begin(), json.end(), [](const auto& entry) { return entry.is_object(); })) {
    for (const nlohmann::json& entry : json) below("[]", entry);
  } else {
    paths[at] |= !json.empty();  // null counts as empty
  }
}

/// Does the documented path, whose words in capitals stand for any name, name the written one, or something below it?
inline bool names(const MemberPath& documented, const MemberPath& written, bool below) {
  if (below ? documented.size() <= written.size() : documented.size() != written.size()) return false;
  for (std::size_t i = 0; i < written.size(); ++i) {
    const bool any =
        std::all_of(documented[i].begin(), documented[i].end(), [](char c) { return c >= 'A' && c <= 'Z'; });
    if (!any && documented[i] != written[i]) return false;
  }
  return true;
}

/// Holds the section against files that programs wrote. Between them the files have to show every member.
inline void expect_documented(const std::string& heading, const std::vector<nlohmann::json>& files) {
  const std::vector<MemberPath> documented = documented_members(heading);
  EXPECT_FALSE(documented.empty()) << heading;
  std::map<MemberPath, bool> written;
  for (const nlohmann::json& file : files) collect_members(file, {}, written);
  std::vector<bool> seen(documented.size(), false);
  for (const auto& [path, holds_something] : written) {
    bool known = false;
    for (std::size_t i = 0; i < documented.size(); ++i) {
      const bool named = names(documented[i], path, false);
      if (named) seen[i] = true;
      known = known || named || (!holds_something && names(documented[i], path, true));
    }
    EXPECT_TRUE(known) << "docs/formats.md, '" << heading << "', lacks " << joined(path);
  }
  for (std::size_t i = 0; i < documented.size(); ++i)
    EXPECT_TRUE(seen[i]) << "docs/formats.md, '" << heading << "', names " << joined(documented[i])
                         << ", which no program wrote";
}

}  // namespace rangecal::test
