// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "rangecal/core/descriptor.hpp"

namespace rangecal {

/// Keeps other runs from writing `path` while it lives: a lock on the file `path`.lock, which is removed at
/// the end. After a kill the file stays and the lock is gone. Of a folder `path` ends in a slash. Throws
/// InputError where another run holds it, or it cannot be made.
class WriteLock {
 public:
  /// `shared`: beside other shared ones, but no other; the file then stays.
  explicit WriteLock(const std::string& path, bool shared = false);
  WriteLock(const WriteLock&) = delete;
  WriteLock& operator=(const WriteLock&) = delete;
  ~WriteLock();

 private:
  std::string file_;
  bool shared_;
  Descriptor descriptor_;
};

}  // namespace rangecal
