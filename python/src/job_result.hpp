// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "archive_fields.hpp"

namespace rangecal::python {

/// The calibrations of one job, each against ground truth where there is any.
struct JobResult {
  CalibrationReport report;
  std::vector<TruthScore> scores;  ///< one per calibration
};

inline void archive_fields(Archive& a, JobResult& s) {
  auto& [report, scores] = s;
  a(report, scores);
}

}  // namespace rangecal::python
