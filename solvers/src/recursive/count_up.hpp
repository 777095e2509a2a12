// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>

namespace rangecal {

/// A stream may last longer than an int counts: the count then stays, used() goes on.
inline void count_up(int& count, int by = 1) {
  count = count > std::numeric_limits<int>::max() - by ? std::numeric_limits<int>::max() : count + by;
}

}  // namespace rangecal
