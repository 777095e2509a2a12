// SPDX-License-Identifier: BSD-3-Clause
#include "track/output.hpp"

#include <fmt/core.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <string>

#include "rangecal/core/errors.hpp"

namespace rangecal::app {

void TrackOutput::open(std::int64_t bytes, bool tells_outliers) {
  const bool resumed = bytes > 0;
  if (!path_.empty()) {
    if (resumed) {
      std::error_code error;
      const auto size = std::filesystem::file_size(path_, error);
      if (error || static_cast<std::int64_t>(size) < bytes) fail("is missing or shorter than the state says");
      std::filesystem::resize_file(path_, static_cast<std::uintmax_t>(bytes));
    }
    out_ = std::fopen(path_.c_str(), resumed ? "ab" : "wb");
    if (!out_) fail_to_write();
    closer_.reset(out_);
  }
  bytes_ = bytes;
  if (!resumed || path_.empty())
    print(tells_outliers ? "reading_m,distance_m,std_m,flag,outlier\n" : "reading_m,distance_m,std_m,flag\n");
}

void TrackOutput::print(const std::string& text) {
  if (std::fwrite(text.data(), 1, text.size(), out_) != text.size()) fail_to_write();
  bytes_ += static_cast<std::int64_t>(text.size());
}

void TrackOutput::flush() {
  if (std::fflush(out_) != 0) fail_to_write();
}

void TrackOutput::fail_to_write() const { fail("cannot be written: " + std::string(std::strerror(errno))); }

void TrackOutput::fail(const std::string& what) const {
  throw InputError(path_.empty() ? "stdout" : path_, 0, "", what);
}

std::string table_of(const std::vector<ChangeAlarm>& changes, bool of_landmarks) {
  std::string text = of_landmarks
                         ? "reading,since_reading,kind,probability,size,std,phase_rad,phase_std_rad\n"
                         : "pair,since_pair,kind,probability,size,std,phase_rad,phase_std_rad\n";
  for (const ChangeAlarm& c : changes) {
    std::string phase = ",";
    if (const auto& told = c.phase_rad)
      phase =
          fmt::format("{:.6g},{}", told->value, told->std_dev ? fmt::format("{:.2g}", *told->std_dev) : "");
    text += c.named ? fmt::format("{},{},{},{:.4f},{:.6g},{:.2g},{}\n", c.reading, c.since, to_string(c.kind),
                                  c.probability, c.size, c.std_dev, phase)
                    : fmt::format("{},{},,,,,{}\n", c.reading, c.since, phase);
  }
  return text;
}

}  // namespace rangecal::app
