// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sys/wait.h>

#include <cstdlib>
#include <fstream>
#include <iterator>
#include <string>

#include "support/temporary_folder.hpp"

namespace rangecal::test {

struct RunResult {
  int code = -1;
  std::string out, err;
};

inline std::string slurp(const std::string& path) {
  std::ifstream stream(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

/// Runs `rangecal ARGUMENTS` through the shell, with `input` on stdin; `before` stands in front of the
/// command.
inline RunResult run(const std::string& arguments, const std::string& input = "",
                     const std::string& before = "") {
  const TemporaryFolder folder;
  folder.write("in", input);
  const std::string command = before + " " + RANGECAL_BINARY + " " + arguments + " < " + folder.file("in") +
                              " > " + folder.file("out") + " 2> " + folder.file("err");
  const int status = std::system(command.c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, slurp(folder.file("out")), slurp(folder.file("err"))};
}

/// A recording that ships with the project.
inline std::string shipped(const std::string& name) {
  return std::string(RANGECAL_SOURCE_DIR) + "/notebooks_data/" + name;
}

inline int count_of(const std::string& text, const std::string& part) {
  int count = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++count;
  return count;
}

}  // namespace rangecal::test
