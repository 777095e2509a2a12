// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/descriptor.hpp"

namespace rangecal {

/// Units of work that several processes share, any of which may die at any time. They share a file: byte i of its table is 1 once unit i
/// is done, and who works at unit i holds a lock on that byte. The system takes a lock back when its holder dies, so that the unit is
/// free again, without messages, clocks or a process that hands out. Which units are done stays in the file: a run that was
/// stopped goes on. Processes on several machines need a file system with locks of ranges (NFS 4 has them).
///
/// A result has to be kept before done() is called; a unit whose process died between the two is done twice.
class WorkQueue {
 public:
  /// The queue in `path`, which is made where there is none. `work` is a number of its own for each work; a file of another is begun
  /// anew if no process uses it. Throws InputError where one does, or the file cannot be written or locked.
  WorkQueue(std::string path, std::int64_t units, std::uint64_t work);
  /// The queue that another process made; none where its file is gone because all is done.
  static std::optional<WorkQueue> join(const std::string& path, std::int64_t units, std::uint64_t work);

  /// Up to `most` units that are neither done nor held, from now on held by this; waits while there is none, but others hold some, for
  /// these may die. Empty once all are done.
  std::vector<std::int64_t> take(std::size_t most);
  void done(const std::vector<std::int64_t>& units);

  /// Of what follows when all units are done, and is for one process: true for it; the others wait until it is through, take its place where it
  /// died, else get false.
  bool finishes();
  /// It is through. The file is not needed any more and gone: who comes now finds that all is done.
  void finished();

 private:
  WorkQueue(std::string path, std::int64_t units, std::uint64_t work, Descriptor file);
  bool lock(std::int64_t from, std::int64_t length, bool wait, bool shared = false);
  void unlock(std::int64_t from, std::int64_t length);
  bool is_set(std::int64_t at) const;
  void set(std::int64_t at);
  [[noreturn]] void fail(int reason) const;

  std::string path_;
  std::int64_t units_;
  Descriptor file_;
  std::int64_t next_ = 0;  ///< where the search for a free unit begins
};

}  // namespace rangecal
