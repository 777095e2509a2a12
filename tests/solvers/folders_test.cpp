// SPDX-License-Identifier: BSD-3-Clause
// The folders of solvers build on one another without a cycle.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <string>

namespace fs = std::filesystem;

namespace {

constexpr const char* const roots[] = {"solvers/include/rangecal/solvers", "solvers/src"};

/// First folder of a path relative to a root; "" for a file that stands in the root.
std::string folder_of(const std::string& path) {
  const std::size_t slash = path.find('/');
  return slash == std::string::npos ? "" : path.substr(0, slash);
}

/// Folders that each folder's files include, with one file that does so.
std::map<std::string, std::map<std::string, std::string>> included_folders() {
  const std::string begin = "#include \"", module = "rangecal/solvers/";
  std::map<std::string, std::map<std::string, std::string>> folders;
  for (const char* root : roots) {
    const fs::path base = fs::path(RANGECAL_SOURCE_DIR) / root;
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(base)) {
      if (!entry.is_regular_file()) continue;
      const std::string path = entry.path().lexically_relative(base).generic_string();
      std::ifstream file(entry.path());
      for (std::string line; std::getline(file, line);) {
        if (!line.starts_with(begin)) continue;
        std::string header = line.substr(begin.size());
        if (header.starts_with(module))
          header.erase(0, module.size());
        else if (header.starts_with("rangecal/"))
          continue;  // of another module
        const std::string from = folder_of(path), to = folder_of(header);
        if (!from.empty() && !to.empty() && from != to) folders[from].try_emplace(to, path);
      }
    }
  }
  return folders;
}

}  // namespace

TEST(Folders, OfSolversHaveNoCycle) {
  auto folders = included_folders();
  ASSERT_GT(folders.size(), 10u);
  // Kahn's algorithm: folders that include none of those left are taken out until none is left.
  for (bool any = true; any;) {
    any = false;
    for (auto it = folders.begin(); it != folders.end();) {
      bool free = true;
      for (const auto& [to, file] : it->second) free = free && !folders.contains(to);
      any = any || free;
      it = free ? folders.erase(it) : std::next(it);
    }
  }
  for (const auto& [from, included] : folders)
    for (const auto& [to, file] : included)
      if (folders.contains(to)) ADD_FAILURE() << from << " -> " << to << " by " << file;
}
