// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/calibrate/batch_check.hpp"

#include <algorithm>
#include <utility>
#include <vector>

#include "rangecal/solvers/statistics/runs_test.hpp"
#include "rangecal/solvers/statistics/shapiro_wilk.hpp"

namespace rangecal {
namespace {

template <typename Result>
void count_test(const Result& result, BatchTest& test) {
  if (result.outcome != Outcome::converged) return;
  ++test.tested;
  test.low += result.p_value < 0.05;
}

}  // namespace

std::optional<BatchCheck> check_batches(std::span<const Recording> recordings) {
  std::vector<std::vector<double>> batches;
  for (const Recording& recording : recordings) {
    if (recording.kind != RecordingKind::pairs) return std::nullopt;
    for (std::vector<double>& batch : batches_of(recording.pairs)) batches.push_back(std::move(batch));
  }
  BatchCheck check;
  for (const std::vector<double>& batch : batches) {
    if (batch.size() < 2) continue;
    ++check.batches;
    count_test(runs_test(batch), check.independence);
    count_test(shapiro_wilk(batch), check.normality);
  }
  if (check.batches == 0) return std::nullopt;
  check.noise = noise_order(batches);
  return check;
}

}  // namespace rangecal
