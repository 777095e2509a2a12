// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/work_queue.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <thread>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"

namespace rangecal {
namespace {

// The file: which work it is (8 bytes), a byte that is locked while a process begins it, one that each holds a shared lock on while it
// uses it, one for the end, then the table.
constexpr std::int64_t kBegin = 8, kUse = 9, kEnd = 10, kTable = 16;

}  // namespace

WorkQueue::WorkQueue(std::string path, std::int64_t units, std::uint64_t work)
    : WorkQueue(path, units, work,
                Descriptor(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0644))) {}

std::optional<WorkQueue> WorkQueue::join(const std::string& path, std::int64_t units, std::uint64_t work) {
  Descriptor file(::open(path.c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW));
  if (!file && errno == ENOENT) return std::nullopt;
  return WorkQueue(path, units, work, std::move(file));
}

WorkQueue::WorkQueue(std::string path, std::int64_t units, std::uint64_t work, Descriptor file)
    : path_(std::move(path)), units_(units), file_(std::move(file)) {
  if (!file_) fail(errno);
  const std::uint64_t print = seed_from("work queue", {work, static_cast<std::uint64_t>(units)});
  lock(kBegin, 1, true);
  std::uint64_t there = 0;
  if (::pread(file_.number(), &there, sizeof there, 0) != sizeof there || there != print) {
    if (!lock(kUse, 1, false))
      throw InputError(path_, 0, "", "belongs to a run with other work that has not ended");
    const bool written = ::ftruncate(file_.number(), 0) == 0 &&
                         ::ftruncate(file_.number(), kTable + units_) == 0 &&
                         ::pwrite(file_.number(), &print, sizeof print, 0) == sizeof print;
    if (!written) fail(errno);
  }
  lock(kUse, 1, true, true);
  unlock(kBegin, 1);
}

void WorkQueue::fail(int reason) const {
  throw InputError(path_, 0, "", std::string("cannot be shared: ") + std::strerror(reason));
}

// Locks of the open file, not of the process: threads with a queue each are strangers, too.
bool WorkQueue::lock(std::int64_t from, std::int64_t length, bool wait, bool shared) {
  struct flock range {};
  range.l_type = shared ? F_RDLCK : F_WRLCK;
  range.l_whence = SEEK_SET;
  range.l_start = from, range.l_len = length;
  while (::fcntl(file_.number(), wait ? F_OFD_SETLKW : F_OFD_SETLK, &range) != 0) {
    if (errno == EINTR) continue;
    if (errno == EAGAIN || errno == EACCES) return false;
    fail(errno);
  }
  return true;
}

void WorkQueue::unlock(std::int64_t from, std::int64_t length) {
  struct flock range {};
  range.l_type = F_UNLCK;
  range.l_whence = SEEK_SET;
  range.l_start = from, range.l_len = length;
  if (::fcntl(file_.number(), F_OFD_SETLK, &range) != 0) fail(errno);
}

bool WorkQueue::is_set(std::int64_t at) const {
  char byte = 0;
  if (::pread(file_.number(), &byte, 1, at) != 1) fail(errno);
  return byte != 0;
}

void WorkQueue::set(std::int64_t at) {
  const char byte = 1;
  if (::pwrite(file_.number(), &byte, 1, at) != 1) fail(errno);
}

std::vector<std::int64_t> WorkQueue::take(std::size_t most) {
  constexpr std::int64_t at_once = 4096;
  std::vector<char> table(at_once);
  std::vector<std::int64_t> taken;
  for (bool held = true; taken.empty() && held;) {  // by others
    held = false;
    const std::int64_t begin = next_;
    for (std::int64_t looked = 0; looked < units_ && taken.size() < most;) {  // once around the table
      const std::int64_t from = (begin + looked) % units_;
      const std::int64_t size = std::min({at_once, units_ - from, units_ - looked});
      if (::pread(file_.number(), table.data(), static_cast<std::size_t>(size), kTable + from) != size)
        fail(errno);
      looked += size;
      for (std::int64_t i = 0; i < size && taken.size() < most; ++i) {
        const std::int64_t place = kTable + from + i;
        if (table[static_cast<std::size_t>(i)] != 0) continue;
        if (!lock(place, 1, false)) {
          held = true;
        } else if (is_set(place)) {  // done since it was looked at
          unlock(place, 1);
        } else {
          taken.push_back(from + i);
          next_ = (from + i + 1) % units_;
        }
      }
    }
    if (taken.empty() && held) std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  return taken;
}

void WorkQueue::done(const std::vector<std::int64_t>& units) {
  for (const std::int64_t unit : units) {
    set(kTable + unit);
    unlock(kTable + unit, 1);
  }
}

bool WorkQueue::finishes() {
  lock(kEnd, 1, true);
  if (!is_set(kEnd)) return true;
  unlock(kEnd, 1);
  return false;
}

void WorkQueue::finished() {
  set(kEnd);
  ::unlink(path_.c_str());
  unlock(kEnd, 1);
}

}  // namespace rangecal
