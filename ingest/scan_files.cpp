// SPDX-License-Identifier: BSD-3-Clause
#include "scan_files.hpp"

#include <filesystem>

#include "bags/bag_folder.hpp"
#include "bags/message_source.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/scan_io.hpp"

namespace rangecal::ingest {

std::unique_ptr<ScanSource> open_scan_file(const std::string& path, const BagChoice& choice,
                                           std::size_t beams_kept) {
  if (path != "-" && is_bag(path)) return std::make_unique<BagScans>(path, choice, beams_kept);
  for (const auto& [option, topic] : {std::pair{"--scan", choice.scan}, {"--odom", choice.odometry}})
    if (!topic.empty())
      throw InputError((path == "-" ? "stdin" : path) + ": is no bag, which " + option + " is for");
  return std::make_unique<ScansInMemory>(read_scans(path));
}

std::vector<std::string> files_behind(const std::vector<std::string>& names) {
  std::vector<std::string> files;
  std::error_code ignored;
  for (const std::string& name : names) {
    files.push_back(name == "-" ? "/dev/stdin" : name);
    if (std::filesystem::is_directory(name, ignored))
      for (std::string& file : files_of_bag_folder(name)) files.push_back(std::move(file));
  }
  return files;
}

}  // namespace rangecal::ingest
