// SPDX-License-Identifier: BSD-3-Clause
#include "track/line_source.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"

namespace rangecal::app {
namespace {

constexpr std::size_t longest_line = std::size_t{4} << 20;

}  // namespace

LineSource::LineSource(const std::string& path) : path_(path) {
  if (path == "-") {
    file_ = STDIN_FILENO;
    path_ = "stdin";
    return;
  }
  opened_ = Descriptor(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  file_ = opened_.number();
  struct stat status {};
  if (file_ < 0 || ::fstat(file_, &status) != 0)
    throw InputError(path, 0, "", std::string("cannot be read: ") + std::strerror(errno));
  if (S_ISDIR(status.st_mode)) throw InputError(path, 0, "", "is a folder, not a file");
  file_is_regular_ = S_ISREG(status.st_mode);
}

LineSource::Status LineSource::next(std::string& line) {
  std::size_t searched = begin_;
  while (true) {
    const std::size_t end = buffer_.find('\n', searched);
    if (end != std::string::npos) {
      line.assign(buffer_, begin_, end - begin_);
      taken_ = seed_from(line, {taken_});
      if (!line.empty() && line.back() == '\r') line.pop_back();
      offset_ += static_cast<std::int64_t>(end + 1 - begin_);
      begin_ = end + 1;
      return Status::line;
    }
    buffer_.erase(0, begin_);
    begin_ = 0;
    if (buffer_.size() > longest_line) throw InputError(path_, 0, "", "holds a line longer than 4 MB");
    searched = buffer_.size();
    std::array<char, 65536> chunk;
    const ssize_t count = ::read(file_, chunk.data(), chunk.size());
    if (count < 0 && errno == EINTR) return Status::interrupted;
    if (count < 0) throw InputError(path_, 0, "", std::string("cannot be read: ") + std::strerror(errno));
    if (count == 0) return Status::end;
    buffer_.append(chunk.data(), static_cast<std::size_t>(count));
  }
}

std::string LineSource::rest() {
  std::string line = buffer_.substr(begin_);
  taken_ = seed_from(line, {taken_});
  offset_ += static_cast<std::int64_t>(line.size());
  begin_ = buffer_.size();
  return line;
}

std::string LineSource::fingerprint() const { return fmt::format("{:016x}", taken_); }

std::string LineSource::lost() const {
  struct stat open {
  }, named{};
  if (!file_is_regular_ || ::fstat(file_, &open) != 0) return "";
  const std::int64_t read = offset_ + static_cast<std::int64_t>(buffer_.size() - begin_);
  if (open.st_size < read)
    return fmt::format("was cut back to {} bytes after {} had been read", open.st_size, read);
  // One that is only gone may still be written to.
  if (::stat(path_.c_str(), &named) != 0 || (named.st_ino == open.st_ino && named.st_dev == open.st_dev))
    return "";
  return "was replaced by another file";
}

std::optional<std::vector<std::string>> csv_fields(std::string_view line) {
  std::vector<std::string> fields(1);
  bool quoted = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    if (quoted && c == '"' && i + 1 < line.size() && line[i + 1] == '"') {
      fields.back() += '"';
      ++i;
    } else if (c == '"') {
      quoted = !quoted;
    } else if (c == ',' && !quoted) {
      fields.emplace_back();
    } else {
      fields.back() += c;
    }
  }
  if (quoted) return std::nullopt;
  return fields;
}

std::optional<double> number_of(std::string_view text) {
  const auto is_space = [](char c) { return c == ' ' || c == '\t' || c == '\r'; };
  while (!text.empty() && is_space(text.front())) text.remove_prefix(1);
  while (!text.empty() && is_space(text.back())) text.remove_suffix(1);
  if (!text.empty() && text.front() == '+') text.remove_prefix(1);
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty() || error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

}  // namespace rangecal::app
