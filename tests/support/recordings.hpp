// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdlib>
#include <string>

namespace rangecal::testing {

/// The folder of real recordings, which are not part of the project.
inline std::string recordings() {
  const char* given = std::getenv("RANGECAL_RECORDINGS");
  return given ? given : std::string(RANGECAL_SOURCE_DIR) + "/../shared/recordings";
}

}  // namespace rangecal::testing
