// SPDX-License-Identifier: BSD-3-Clause
#include "bags/bag_folder.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <utility>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/yaml_reader.hpp"

namespace rangecal::ingest {
namespace {

constexpr const char* kMetadata = "metadata.yaml";

/// Names in the order of the numbers in them: run_2 before run_10.
bool numbers_before(const std::string& a, const std::string& b) {
  const auto digit = [](char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; };
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (!digit(a[i]) || !digit(b[j])) {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i, ++j;
      continue;
    }
    std::size_t end_a = i, end_b = j;
    while (end_a < a.size() && digit(a[end_a])) ++end_a;
    while (end_b < b.size() && digit(b[end_b])) ++end_b;
    const auto value = [](std::string text) {
      return text.erase(0, std::min(text.find_first_not_of('0'), text.size()));
    };
    const std::string x = value(a.substr(i, end_a - i)), y = value(b.substr(j, end_b - j));
    if (x != y) return x.size() != y.size() ? x.size() < y.size() : x < y;
    i = end_a, j = end_b;
  }
  return a.size() - i < b.size() - j;
}

std::vector<std::string> names_by_metadata(const std::string& folder) {
  const std::string path = (std::filesystem::path(folder) / kMetadata).string();
  const YamlReader information = YamlReader::open(path).at("rosbag2_bagfile_information");
  std::vector<std::string> names;
  for (const YamlReader& item : information.at("relative_file_paths").items()) {
    // early releases wrote the folder's name before the file's
    const std::filesystem::path given(item.text());
    const std::string name = given.filename().string();
    if (given.is_absolute() || name.empty() || name == "." || name == ".." ||
        name.find('\0') != std::string::npos)
      item.fail("'" + item.text() + "' is no file of this folder");
    if (std::find(names.begin(), names.end(), name) != names.end())
      item.fail("'" + name + "' is listed twice: its readings would count twice");
    names.push_back(name);
  }
  return names;
}

class BagFolder : public MessageSource {
 public:
  explicit BagFolder(const std::string& folder) {
    const std::vector<std::string> files = files_of_bag_folder(folder);
    for (const std::string& file : files) {
      const std::string name = std::filesystem::path(file).filename().string();
      if (files.size() == 1) {
        parts_.push_back({name, open_bag(file)});
        continue;
      }
      try {
        parts_.push_back({name, open_bag(file)});
      } catch (const InputError& error) {
        if (missing_.empty()) first_ = error.what();
        missing_.push_back(name);
      }
    }
    if (parts_.empty()) throw InputError(first_);
  }

  std::vector<BagTopic> topics() override {
    std::vector<BagTopic> all;
    for (const Part& part : parts_)
      for (BagTopic& topic : part.source->topics()) all.push_back(std::move(topic));
    return merged(std::move(all));
  }

  void read(const std::vector<std::string>& names, const Take& take, const Progress& progress) override {
    const auto count = static_cast<double>(parts_.size());
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      Progress inner;
      if (progress) inner = [&](double share) { progress((static_cast<double>(i) + share) / count); };
      parts_[i].source->read(names, take, inner);
    }
  }

  std::string losses() const override {
    std::string out;
    if (!missing_.empty())
      out = missing_.size() == 1
                ? fmt::format("{} cannot be opened", missing_.front())
                : fmt::format("{} and {} more files cannot be opened", missing_.front(), missing_.size() - 1);
    for (const Part& part : parts_)
      if (const std::string lost = part.source->losses(); !lost.empty())
        out += (out.empty() ? "" : "; ") + part.name + ": " + lost;
    return out;
  }
  std::string format() const override { return "rosbag2 folder, " + parts_.front().source->format(); }

 private:
  struct Part {
    std::string name;
    std::unique_ptr<MessageSource> source;
  };
  std::vector<Part> parts_;
  std::vector<std::string> missing_;
  std::string first_;
};

}  // namespace

std::vector<std::string> files_of_bag_folder(const std::string& folder) {
  namespace fs = std::filesystem;
  std::vector<std::string> names;
  std::error_code ignored;
  if (fs::exists(fs::path(folder) / kMetadata, ignored)) {
    names = names_by_metadata(folder);
  } else {
    for (fs::directory_iterator at(folder, ignored), end; at != end; at.increment(ignored)) {
      const std::string extension = at->path().extension().string();
      if (extension == ".mcap" || extension == ".db3") names.push_back(at->path().filename().string());
    }
    std::sort(names.begin(), names.end(), numbers_before);
  }
  if (names.empty())
    throw InputError(folder, 0, "",
                     "is a folder without metadata.yaml and without files of a bag (*.mcap, *.db3)");
  for (std::string& name : names) name = (fs::path(folder) / name).string();
  return names;
}

std::unique_ptr<MessageSource> open_bag_folder(const std::string& folder) {
  return std::make_unique<BagFolder>(folder);
}

}  // namespace rangecal::ingest
