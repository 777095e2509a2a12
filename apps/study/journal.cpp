// SPDX-License-Identifier: BSD-3-Clause
#include "study/journal.hpp"

#include <fcntl.h>
#include <fmt/core.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string_view>
#include <tuple>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/random.hpp"

namespace rangecal::app {
namespace {

constexpr std::size_t checksum_digits = 16;

std::string header_of(const Study& study) {
  return fmt::format("rangecal-study-journal/1 {:016x} {}", study.fingerprint, study.name);
}

bool whole(std::string_view line) {
  if (line.size() < checksum_digits + 3 || line.substr(0, 2) != "u ") return false;
  const std::string_view body = line.substr(0, line.size() - checksum_digits - 1);
  return line.substr(body.size() + 1) == fmt::format("{:016x}", seed_from(body));
}

/// Fields parted by one space.
class Fields {
 public:
  explicit Fields(std::string_view text) : at_(text.data()), end_(text.data() + text.size()) {}
  template <typename Number>
  bool next(Number& number) {
    if (at_ < end_ && *at_ == ' ') ++at_;
    const auto [stop, error] = std::from_chars(at_, end_, number);
    at_ = stop;
    return error == std::errc();
  }

 private:
  const char *at_, *end_;
};

auto key(const StudyUnit& unit) { return std::pair(unit.point, unit.piece); }

}  // namespace

std::string journal_line(const StudyUnit& unit, const StudySums& sums) {
  fmt::memory_buffer text;
  fmt::format_to(std::back_inserter(text), "u {} {} {} {} {}", unit.point, unit.piece, sums.repeats,
                 sums.numbers.size(), sums.seconds.size());
  for (const auto* row : {&sums.numbers, &sums.seconds})
    for (const double number : *row) fmt::format_to(std::back_inserter(text), " {}", number);
  const std::string body = fmt::to_string(text);
  return fmt::format("{} {:016x}\n", body, seed_from(body));
}

std::optional<std::pair<StudyUnit, StudySums>> from_journal_line(const std::string& line) {
  std::string_view text = line;
  if (!text.empty() && text.back() == '\n') text.remove_suffix(1);
  if (!whole(text)) return std::nullopt;
  StudyUnit unit;
  StudySums sums;
  std::size_t numbers = 0, seconds = 0;
  Fields fields(text.substr(1));
  if (!fields.next(unit.point) || !fields.next(unit.piece) || !fields.next(sums.repeats) ||
      !fields.next(numbers) || !fields.next(seconds) || numbers > text.size() || seconds > text.size())
    return std::nullopt;
  sums.numbers.resize(numbers);
  sums.seconds.resize(seconds);
  for (auto* row : {&sums.numbers, &sums.seconds})
    for (double& number : *row)
      if (!fields.next(number)) return std::nullopt;
  return std::pair(unit, std::move(sums));
}

bool names_journal(const std::string& file) { return file.starts_with("journal") && file.ends_with(".txt"); }

std::vector<std::string> journals_in(const std::string& folder) {
  std::vector<std::string> paths;
  std::error_code none;
  for (const auto& entry : std::filesystem::directory_iterator(folder, none)) {
    if (names_journal(entry.path().filename().string())) paths.push_back(entry.path().string());
  }
  std::sort(paths.begin(), paths.end());
  return paths;
}

JournalReader::JournalReader(const Study& study, const std::vector<std::string>& folders) {
  for (const std::string& folder : folders)
    for (const std::string& path : journals_in(folder)) scan(study, path);
  const auto less = [](const Entry& a, const Entry& b) { return key(a.unit) < key(b.unit); };
  std::stable_sort(entries_.begin(), entries_.end(), less);
  const auto same = [](const Entry& a, const Entry& b) { return a.unit == b.unit; };
  entries_.erase(std::unique(entries_.begin(), entries_.end(), same), entries_.end());
}

void JournalReader::scan(const Study& study, const std::string& path) {
  std::ifstream stream(path, std::ios::binary);
  std::string line;
  if (!stream) throw InputError(path, 0, "", std::string("cannot be read: ") + std::strerror(errno));
  if (!std::getline(stream, line)) return;  // killed before its header was written
  if (line != header_of(study)) {
    if (stream.eof()) return;  // killed while its header was written
    throw InputError(path, 1, "", "is of another study, or of this one before it was changed");
  }
  Descriptor descriptor(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!descriptor) throw InputError(path, 0, "", std::string("cannot be read: ") + std::strerror(errno));
  descriptors_.push_back(std::move(descriptor));
  const int pieces = study_pieces(study);
  for (std::int64_t at = stream.tellg(); std::getline(stream, line); at = stream.tellg()) {
    if (!whole(line)) continue;
    Entry entry;
    int repeats = 0;
    Fields fields(std::string_view(line).substr(1));
    if (!fields.next(entry.unit.point) || !fields.next(entry.unit.piece) || !fields.next(repeats)) continue;
    const bool asked = entry.unit.point >= 0 && entry.unit.point < static_cast<int>(study.points.size()) &&
                       entry.unit.piece >= 0 && entry.unit.piece < pieces &&
                       repeats == study_unit_repeats(study, entry.unit);
    if (!asked) continue;  // of a run with more repeats, or its shorter last piece
    entry.file = static_cast<int>(descriptors_.size()) - 1;
    entry.offset = at;
    entry.length = static_cast<int>(line.size());
    entries_.push_back(entry);
  }
}

const JournalReader::Entry* JournalReader::find(const StudyUnit& unit) const {
  const auto at = std::lower_bound(
      entries_.begin(), entries_.end(), unit,
      [](const Entry& entry, const StudyUnit& wanted) { return key(entry.unit) < key(wanted); });
  return at != entries_.end() && at->unit == unit ? &*at : nullptr;
}

std::optional<StudySums> JournalReader::recall(const StudyUnit& unit) const {
  const Entry* entry = find(unit);
  if (!entry) return std::nullopt;
  std::string line(entry->length, '\0');
  if (::pread(descriptors_[entry->file].number(), line.data(), line.size(), entry->offset) != entry->length)
    return std::nullopt;
  auto parsed = from_journal_line(line);
  if (!parsed) return std::nullopt;
  return std::move(parsed->second);
}

JournalWriter::JournalWriter(const Study& study, const std::string& path)
    : path_(path), descriptor_(::open(path.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0644)) {
  if (!descriptor_) throw InputError(path, 0, "", std::string("cannot be written: ") + std::strerror(errno));
  if (::flock(descriptor_.number(), LOCK_EX | LOCK_NB) != 0)
    throw InputError(path, 0, "", "another run of this study is writing it");
  const off_t size = ::lseek(descriptor_.number(), 0, SEEK_END);
  std::string first(size > 0 ? std::min<off_t>(size, 4096) : 0, '\0');
  const bool read =
      ::pread(descriptor_.number(), first.data(), first.size(), 0) == static_cast<ssize_t>(first.size());
  const std::string header = header_of(study) + "\n";
  if (!read || !first.starts_with(header)) {  // new, or killed in its first line: nothing is lost
    if (::ftruncate(descriptor_.number(), 0) != 0) throw InputError(path, 0, "", "cannot be written");
    write_all(header);
  } else {
    write_all("\n");  // ends a torn last line; an empty one is skipped
  }
}

void JournalWriter::write_all(const std::string& text) {
  if (const int error = rangecal::write_all(descriptor_.number(), text))
    throw InputError(path_, 0, "", std::string("cannot be written: ") + std::strerror(error));
}

void JournalWriter::append(const StudyUnit& unit, const StudySums& sums) {
  write_all(journal_line(unit, sums));
}

}  // namespace rangecal::app
