// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "rangecal/solvers/study/run.hpp"

namespace rangecal {

/// Columns of the table of results: point, the grid's parameters, estimator, repeats, then those of each measure in
/// the study's order (docs/study.md states each). A value that does not exist is an empty field.
std::vector<std::string> study_columns(const Study& study);

/// The values of one (point, estimator) under study_columns, from the column after `estimator` on.
std::vector<std::optional<double>> study_values(const Study& study, const StudyPointResult& result,
                                                int estimator);

/// Header, and the rows of one point, as CSV lines. Numbers in the shortest text that reads back to the same bits.
std::string study_csv_header(const Study& study);
std::string study_csv_rows(const Study& study, const StudyPointResult& result);

/// Processor times of one point: milliseconds per repeat of `simulate` and of every estimator, a table of their own since
/// no two runs agree in them.
std::string timing_csv_header(const Study& study);
std::string timing_csv_rows(const Study& study, const StudyPointResult& result);

}  // namespace rangecal
