// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <tbb/global_control.h>

namespace rangecal {

/// Holds oneTBB to so many threads while it lives; 0: as many as there are.
inline tbb::global_control at_most(int threads) {
  constexpr auto most = tbb::global_control::max_allowed_parallelism;
  return {most, threads > 0 ? static_cast<std::size_t>(threads) : tbb::global_control::active_value(most)};
}

}  // namespace rangecal
