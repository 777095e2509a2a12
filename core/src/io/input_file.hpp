// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>

#include "rangecal/core/descriptor.hpp"

namespace rangecal::io {

/// How messages call a file: "stdin" and "stdout" for these.
std::string shown_name(const std::string& path);

/// A file that is read once from its start to its end: a regular one, or a pipe that somebody writes to.
class InputFile {
 public:
  /// Throws InputError naming the file if it is missing, a folder, a device, or cannot be read.
  explicit InputFile(const std::string& path);

  /// Up to `size` bytes; 0 at the end. Throws InputError, also for a pipe that nobody writes to.
  std::size_t read(char* bytes, std::size_t size);
  std::size_t size() const { return size_; }  ///< in bytes as the file system says; 0 for a pipe

 private:
  std::string name_;
  Descriptor descriptor_;
  bool pipe_ = false, begun_ = false;
  std::size_t size_ = 0;
};

}  // namespace rangecal::io
