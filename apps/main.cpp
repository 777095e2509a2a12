// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

int main() {
  fmt::print("rangecal {}\n", RANGECAL_VERSION);
  return 0;
}
