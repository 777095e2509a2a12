// SPDX-License-Identifier: BSD-3-Clause
#include "io/input_file.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "rangecal/core/errors.hpp"

namespace rangecal::io {
namespace {

[[noreturn]] void cannot_be_read(const std::string& name) {
  throw InputError(name, 0, "", std::string("cannot be read: ") + std::strerror(errno));
}

}  // namespace

std::string shown_name(const std::string& path) {
  return path == "/dev/stdin" ? "stdin" : path == "/dev/stdout" ? "stdout" : path;
}

// Opened without waiting: a pipe without a writer would keep the program for ever.
InputFile::InputFile(const std::string& path) : name_(shown_name(path)) {
  descriptor_ = Descriptor(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY));
  if (!descriptor_) {
    if (errno == ENOENT || errno == ENOTDIR) throw InputError(name_, 0, "", "no such file");
    cannot_be_read(name_);
  }
  struct stat status {};
  const bool known = ::fstat(descriptor_.number(), &status) == 0;
  pipe_ = known && S_ISFIFO(status.st_mode);
  if (known && (pipe_ || S_ISREG(status.st_mode))) {
    size_ = pipe_ ? 0 : static_cast<std::size_t>(status.st_size);
    return;
  }
  if (!known) cannot_be_read(name_);
  throw InputError(name_, 0, "",
                   S_ISDIR(status.st_mode) ? "is a folder, not a file" : "is a device, not a file");
}

std::size_t InputFile::read(char* bytes, std::size_t size) {
  while (true) {
    const ssize_t count = ::read(descriptor_.number(), bytes, size);
    if (count == 0 && pipe_ && !begun_) throw InputError(name_, 0, "", "is a pipe that nobody writes to");
    if (count >= 0) {
      begun_ = true;
      return static_cast<std::size_t>(count);
    }
    if (errno == EAGAIN) {
      struct pollfd wanted {
        descriptor_.number(), POLLIN, 0
      };
      ::poll(&wanted, 1, -1);
    } else if (errno != EINTR) {
      cannot_be_read(name_);
    }
  }
}

}  // namespace rangecal::io
