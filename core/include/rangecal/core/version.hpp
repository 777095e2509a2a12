// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string_view>
#include <vector>

namespace rangecal {

/// The version of rangecal, "major.minor.patch" (semver.org), as CMakeLists.txt states it.
std::string_view version();

struct BuiltWith {
  std::string_view name, version;
};

/// The compiler and the libraries that rangecal was built with.
const std::vector<BuiltWith>& built_with();

}  // namespace rangecal
