// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/files.hpp"

#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "rangecal/core/errors.hpp"

namespace rangecal {

bool file_exists(const std::string& path) {
  std::error_code ignored;
  return std::filesystem::exists(path, ignored);
}

std::string read_file(const std::string& path) {
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (!std::filesystem::exists(status)) throw InputError(path, 0, "", "no such file");
  if (std::filesystem::is_directory(status)) throw InputError(path, 0, "", "is a folder, not a file");
  std::ifstream stream(path, std::ios::binary);
  if (!stream) throw InputError(path, 0, "", std::string("cannot be read: ") + std::strerror(errno));
  std::string text{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
  if (stream.bad()) throw InputError(path, 0, "", "cannot be read to its end");
  return text;
}

void write_file(const std::string& path, const std::string& text) {
  const std::string temporary = path + ".partial" + std::to_string(::getpid());
  std::error_code error;
  std::string reason;
  {
    std::ofstream stream(temporary, std::ios::binary | std::ios::trunc);
    if (!stream) throw InputError(path, 0, "", std::string("cannot be written: ") + std::strerror(errno));
    stream.write(text.data(), static_cast<std::streamsize>(text.size()));
    stream.close();
    if (!stream) reason = std::strerror(errno);
  }
  if (reason.empty()) {
    std::filesystem::rename(temporary, path, error);
    if (!error) return;
    reason = error.message();
  }
  std::filesystem::remove(temporary, error);
  throw InputError(path, 0, "", "cannot be written: " + reason);
}

void make_folder(const std::string& path) {
  std::error_code error;
  std::filesystem::create_directories(path, error);
  if (error) throw InputError(path, 0, "", "the folder cannot be made: " + error.message());
  if (!std::filesystem::is_directory(path, error)) throw InputError(path, 0, "", "is not a folder");
}

}  // namespace rangecal
