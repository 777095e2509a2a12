// SPDX-License-Identifier: BSD-3-Clause
// Runs what the README and docs/first-steps.md show: every line "$ COMMAND" of a fenced `console` block, in order, in one folder that has the
// shipped data beside it. What stands below a command is what it prints; every block ends in a command that holds something
// against what was printed or written.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

#include "apps/run_binary.hpp"

namespace rangecal::test {
namespace {

struct Shown {
  int line = 0;
  std::string command;  ///< without the prompt; a trailing backslash continues on the next line
  std::string output;   ///< what the README shows below it; empty where it shows nothing
};

/// The same words, and numbers that differ by one unit of their last digit at most: machines round differently.
bool same_output(const std::string& a, const std::string& b) {
  static const std::regex number(R"(\d+(\.\d+)?)");
  if (std::regex_replace(a, number, "#") != std::regex_replace(b, number, "#")) return false;
  using Numbers = std::sregex_iterator;
  for (Numbers i(a.begin(), a.end(), number), j(b.begin(), b.end(), number); i != Numbers(); ++i, ++j) {
    const double decimals = i->length(1) > 0 ? static_cast<double>(i->length(1)) - 1.0 : 0.0;
    if (std::abs(std::stod(i->str()) - std::stod(j->str())) > 1.01 * std::pow(10.0, -decimals)) return false;
  }
  return true;
}

std::vector<std::vector<Shown>> blocks_of(const std::string& text) {
  std::istringstream stream(text);
  std::vector<std::vector<Shown>> blocks;
  std::string line;
  bool in_block = false, continued = false;
  for (int number = 1; std::getline(stream, line); ++number) {
    if (line.starts_with("```")) {
      in_block = !in_block && line == "```console";
      if (in_block) blocks.emplace_back();
      continued = false;
      continue;
    }
    if (!in_block) continue;
    std::vector<Shown>& shown = blocks.back();
    if (continued)
      shown.back().command += " " + line;
    else if (line.starts_with("$ "))
      shown.push_back({number, line.substr(2), ""});
    else {
      if (!shown.empty()) shown.back().output += line + "\n";
      continue;
    }
    continued = shown.back().command.ends_with('\\');
    if (continued) shown.back().command.pop_back();
  }
  return blocks;
}

bool asserts(const std::string& command) {
  return command.starts_with("test ") || command.starts_with("grep -q ") ||
         command.find("| grep -q ") != std::string::npos;
}

TEST(Readme, FindsCommandsOfConsoleBlocksOnly) {
  const auto blocks = blocks_of(
      "```console\n$ rangecal a \\\n  b\noutput\n```\n$ rangecal outside\n```cpp\n$ rangecal c\n```\n"
      "```\n$ rangecal d\n```\n```console\n$ rangecal e | head -n 3\n$ test -s f\n```\n");
  ASSERT_EQ(blocks.size(), 2u);
  ASSERT_EQ(blocks[0].size(), 1u);
  EXPECT_EQ(blocks[0][0].command, "rangecal a    b");
  EXPECT_EQ(blocks[0][0].line, 2);
  EXPECT_EQ(blocks[0][0].output, "output\n");
  ASSERT_EQ(blocks[1].size(), 2u);
  EXPECT_EQ(blocks[1][0].command, "rangecal e | head -n 3");
  EXPECT_FALSE(asserts(blocks[1][0].command));
  EXPECT_TRUE(asserts(blocks[1][1].command));
  EXPECT_TRUE(asserts("rangecal compare sim | grep -q marginal"));
  EXPECT_TRUE(same_output("0.41 to 4.72 m\n", "0.41 to 4.71 m\n"));
  EXPECT_FALSE(same_output("0.41 to 4.72 m\n", "0.41 to 4.70 m\n"));
  EXPECT_FALSE(same_output("500 read\n", "500 used\n"));
}

/// Runs what a page shows, in one folder.
void run_what_is_shown(const std::string& page, std::size_t least) {
  const TemporaryFolder folder;
  const std::filesystem::path root = RANGECAL_SOURCE_DIR;
  std::filesystem::create_directory_symlink(root / "notebooks_data", folder.file("notebooks_data"));
  const auto blocks = blocks_of(slurp((root / page).string()));
  EXPECT_GE(blocks.size(), least) << page << " shows hardly a command";
  const std::string directory = std::filesystem::path(RANGECAL_BINARY).parent_path().string();
  for (const std::vector<Shown>& block : blocks) {
    ASSERT_FALSE(block.empty());
    EXPECT_TRUE(asserts(block.back().command))
        << page << ":" << block.back().line << ": the block asserts nothing";
    for (const Shown& example : block) {
      // the exit code of a pipeline is that of rangecal; a reader that stops early ends it by SIGPIPE, 141
      folder.write("script", "set -o pipefail\ncd '" + folder.path() + "' || exit 99\nPATH='" + directory +
                                 "':$PATH\n" + example.command + "\n");
      const int status = std::system(("bash " + folder.file("script") + " > " + folder.file("shown.out") +
                                      " 2> " + folder.file("shown.err"))
                                         .c_str());
      const int code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
      EXPECT_TRUE(code == 0 || (code == 141 && example.command.find(" | ") != std::string::npos))
          << page << ":" << example.line << ": " << example.command << "\nexit code " << code << "\n"
          << slurp(folder.file("shown.err"));
      const bool silent = asserts(example.command) || example.command.find(" > ") != std::string::npos;
      EXPECT_FALSE(!silent && slurp(folder.file("shown.out")).empty())
          << page << ":" << example.line << ": " << example.command << " prints nothing";
      const std::string out = slurp(folder.file("shown.out"));
      EXPECT_TRUE(example.output.empty() || same_output(out, example.output))
          << page << ":" << example.line << ": " << example.command << " prints\n"
          << out;
    }
  }
}

TEST(Readme, CommandsRun) { run_what_is_shown("README.md", 2); }

TEST(Readme, CommandsOfTheFirstStepsRun) { run_what_is_shown("docs/first-steps.md", 4); }

}  // namespace
}  // namespace rangecal::test
