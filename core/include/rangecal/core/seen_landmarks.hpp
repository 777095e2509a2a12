// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <string>
#include <vector>

#include "rangecal/core/recording.hpp"

namespace rangecal {

/// Labels of the landmarks that no reading of their recording sees, in order. Cost: linear in the readings.
std::vector<std::string> unseen_landmarks(std::span<const Recording> recordings);

/// The recordings without the landmarks that no reading sees, of which nothing can be said: the others are numbered
/// anew, and taped distances and true places kept of those alone.
std::vector<Recording> with_seen_landmarks(std::span<const Recording> recordings);

}  // namespace rangecal
