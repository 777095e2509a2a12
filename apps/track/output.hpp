// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "rangecal/solvers/change/change_detector.hpp"

namespace rangecal::app {

/// Where the corrected rows go: a file, or stdout where `path` is empty. Throws InputError where it cannot be written.
class TrackOutput {
 public:
  explicit TrackOutput(std::string path) : path_(std::move(path)) {}
  /// With its header; or, where an earlier run wrote `bytes` that count, behind these: what follows them is cut off.
  void open(std::int64_t bytes, bool tells_outliers);
  void print(const std::string& text);
  void flush();
  std::int64_t bytes() const { return bytes_; }

 private:
  [[noreturn]] void fail_to_write() const;
  [[noreturn]] void fail(const std::string& what) const;
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::string path_;
  std::FILE* out_ = stdout;
  std::unique_ptr<std::FILE, Close> closer_;
  std::int64_t bytes_ = 0;
};

/// The table of --changes.
std::string table_of(const std::vector<ChangeAlarm>& changes, bool of_landmarks);

}  // namespace rangecal::app
