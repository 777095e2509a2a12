// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>

namespace rangecal::app {

/// What a recording's files were when it was fitted. `stamp` is of their sizes and times: five stats; `contents` of their bytes,
/// asked where the stamp differs, so that a copy or a touch costs no fit. A change that keeps size and time is not seen.
struct Fingerprint {
  std::int64_t stamp = 0, contents = 0;
};

std::int64_t stamp_of(const std::string& folder);
std::int64_t contents_of(const std::string& folder);

/// The folder without links, `.` and `..`: the same however it is spelt. Empty where there is none.
std::string identity_of(const std::string& folder);

/// Where the unit `name` is read: there, if that is the folder of its identity; else at its identity, if that is there
/// (another working folder); else at its name (another computer).
std::string place_of(const std::string& name, const std::string& identity);

}  // namespace rangecal::app
