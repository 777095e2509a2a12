// SPDX-License-Identifier: BSD-3-Clause
// Runs what the README shows: every line "$ rangecal ..." of a fenced `console` block, in order, in one
// folder that has the shipped data beside it. A block opened with "```console slow" is left out.
#include <gtest/gtest.h>

#include <filesystem>
#include <sstream>
#include <string>
#include <vector>

#include "apps/run_binary.hpp"

namespace rangecal::test {
namespace {

struct Shown {
  int line = 0;
  std::string command;  ///< without the prompt; a trailing backslash continues on the next line
};

std::vector<Shown> commands_of(const std::string& text) {
  std::istringstream stream(text);
  std::vector<Shown> shown;
  std::string line;
  bool in_block = false, continued = false;
  for (int number = 1; std::getline(stream, line); ++number) {
    if (line.starts_with("```")) {
      in_block = !in_block && line == "```console";
      continued = false;
      continue;
    }
    if (!in_block) continue;
    if (continued)
      shown.back().command += " " + line;
    else if (line.starts_with("$ rangecal "))
      shown.push_back({number, line.substr(2)});
    else
      continue;
    continued = shown.back().command.ends_with('\\');
    if (continued) shown.back().command.pop_back();
  }
  return shown;
}

TEST(Readme, FindsCommandsOfConsoleBlocksOnly) {
  const std::vector<Shown> shown = commands_of(
      "```console\n$ rangecal a \\\n  b\noutput\n```\n$ rangecal outside\n```console slow\n$ rangecal "
      "c\n```\n"
      "```\n$ rangecal d\n```\n```console\n$ rangecal e | head -n 3\n$ make\n```\n");
  ASSERT_EQ(shown.size(), 2u);
  EXPECT_EQ(shown[0].command, "rangecal a    b");
  EXPECT_EQ(shown[0].line, 2);
  EXPECT_EQ(shown[1].command, "rangecal e | head -n 3");
}

TEST(Readme, CommandsRun) {
  const TemporaryFolder folder;
  const std::filesystem::path root = RANGECAL_SOURCE_DIR;
  std::filesystem::create_directory_symlink(root / "notebooks_data", folder.file("notebooks_data"));
  const std::vector<Shown> shown = commands_of(slurp((root / "README.md").string()));
  EXPECT_GE(shown.size(), 8u) << "README.md shows hardly a command";
  const std::string directory = std::filesystem::path(RANGECAL_BINARY).parent_path().string();
  for (const Shown& example : shown) {
    // the exit code of a pipeline is that of rangecal; a reader that stops early (head) ends it by SIGPIPE,
    // 141
    folder.write("script", "set -o pipefail\ncd '" + folder.path() + "' || exit 99\nPATH='" + directory +
                               "':$PATH\n" + example.command + "\n");
    const int status = std::system(("bash " + folder.file("script") + " > " + folder.file("shown.out") +
                                    " 2> " + folder.file("shown.err"))
                                       .c_str());
    const int code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    EXPECT_TRUE(code == 0 || (code == 141 && example.command.find("head") != std::string::npos))
        << "README.md:" << example.line << ": " << example.command << "\nexit code " << code << "\n"
        << slurp(folder.file("shown.err"));
    EXPECT_FALSE(slurp(folder.file("shown.out")).empty() && example.command.find('>') == std::string::npos)
        << "README.md:" << example.line << ": " << example.command << " prints nothing";
  }
}

}  // namespace
}  // namespace rangecal::test
