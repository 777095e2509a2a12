// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <fstream>
#include <map>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace rangecal {

/// What a study was asked for: parts by name, all of them without any, and `journal=FILE`.
struct StudyParts {
  StudyParts(int argc, char** argv, int first) : names(argv + std::min(argc, first), argv + argc) {
    const std::string prefix = "journal=";
    for (const std::string& name : names)
      if (name.starts_with(prefix)) journal = name.substr(prefix.size());
    std::erase_if(names, [&](const std::string& name) { return name.starts_with(prefix); });
  }

  std::vector<std::string> names;
  std::string journal;  ///< empty: none

  bool wants(const std::string& name) const {
    return names.empty() || std::find(names.begin(), names.end(), name) != names.end();
  }
};

/// What came out of each world, as text by the world's key, in a file if one is given. Worlds may be added by several threads.
class StudyJournal {
 public:
  explicit StudyJournal(std::string path) : path_(std::move(path)) {
    std::ifstream file(path_);
    for (std::string line; std::getline(file, line);) {
      const auto tab = line.find('\t');
      if (tab == std::string::npos || !line.ends_with(end)) continue;  // the last line may be half written
      done_[line.substr(0, tab)] = line.substr(tab + 1, line.size() - tab - 1 - end.size());
    }
  }

  /// Null where the file had no such key.
  const std::string* find(const std::string& key) const {
    const auto found = done_.find(key);
    return found != done_.end() ? &found->second : nullptr;
  }

  void add(const std::string& key, const std::string& text) {
    if (path_.empty()) return;
    const std::lock_guard lock(mutex_);
    std::ofstream(path_, std::ios::app) << '\n' << key << '\t' << text << end << std::flush;
  }

 private:
  const std::string end = "\t.";
  std::string path_;
  std::map<std::string, std::string> done_;
  std::mutex mutex_;
};

}  // namespace rangecal
