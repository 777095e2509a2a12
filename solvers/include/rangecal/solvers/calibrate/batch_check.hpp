// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <span>

#include "rangecal/core/recording.hpp"
#include "rangecal/solvers/closed_form/noise_order.hpp"

namespace rangecal {

/// How many batches a test could judge, and in how many its p-value lies below 0.05: one in twenty by chance.
struct BatchTest {
  int tested = 0, low = 0;
};

/// What the batches of pairs say of the model (Alhashimi 2016, section 4 and eq. 10-16), no curve in between.
struct BatchCheck {
  int batches = 0;         ///< of at least 2 readings
  BatchTest independence;  ///< Wald-Wolfowitz runs of each batch's readings in their order
  BatchTest normality;     ///< Shapiro-Wilk of the same
  NoiseOrder noise;  ///< which power of f the noise grows with; its outcome says where that cannot be told
};

/// Over all recordings; none for landmarks, and where no batch has 2 readings. Cost: sorting the readings.
std::optional<BatchCheck> check_batches(std::span<const Recording> recordings);

}  // namespace rangecal
