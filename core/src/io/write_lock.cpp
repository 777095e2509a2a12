// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/write_lock.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "rangecal/core/errors.hpp"

namespace rangecal {

// The run that ends removes the file: who opened it before that holds the lock of a file that is gone, and
// tries again.
WriteLock::WriteLock(const std::string& path, bool shared) : file_(path + ".lock"), shared_(shared) {
  while (true) {
    descriptor_ = Descriptor(::open(file_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0644));
    if (!descriptor_)
      throw InputError(path, 0, "", std::string("cannot be written: ") + std::strerror(errno));
    if (::flock(descriptor_.number(), (shared ? LOCK_SH : LOCK_EX) | LOCK_NB) != 0) {
      const int reason = errno;
      throw InputError(path, 0, "",
                       reason == EWOULDBLOCK ? "another run is writing it"
                                             : std::string("cannot be locked: ") + std::strerror(reason));
    }
    struct stat mine {
    }, there{};
    const bool same = ::fstat(descriptor_.number(), &mine) == 0 && ::stat(file_.c_str(), &there) == 0 &&
                      mine.st_ino == there.st_ino && mine.st_dev == there.st_dev;
    if (same) return;
  }
}

WriteLock::~WriteLock() {
  if (!shared_) ::unlink(file_.c_str());
}

}  // namespace rangecal
