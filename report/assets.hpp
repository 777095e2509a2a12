// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <string_view>

namespace rangecal::report {

/// The files of page/ and specs/ and, where it was installed, the charting library, by name. Generated at
/// build time.
const std::map<std::string_view, std::string_view>& assets();

}  // namespace rangecal::report
