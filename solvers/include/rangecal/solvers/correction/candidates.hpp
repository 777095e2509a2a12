// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/csv_table.hpp"
#include "rangecal/solvers/correction/effect_correction.hpp"

namespace rangecal {

/// One distance that a reading may stand for, as `rangecal correct` lists it.
struct CorrectionCandidate {
  std::optional<double> distance_m;  ///< none where the reading cannot be used or no distance explains it
  std::optional<double>
      std_dev_m;      ///< noise of the reading and uncertainty of f together, where there is one
  int candidate = 0;  ///< 1 is the most likely; 0 where there is no distance
  /// "ok"; "ambiguous" or "out_of_range" (f(d) = reading has no root: the nearest distance, or none where that is more than
  /// 4 standard deviations off), "extrapolated" (not beside it), "turning_point", "extrapolated_column" (of the setting), joined by
  /// "+" in this order; "missing", "not_finite", "zero", "negative"
  std::string flag;
};

/// Every distance that explains the reading, most likely first; always at least one line. `maximum_likelihood`: minima
/// of the reading's NLL instead of roots of f(d) = y. Cost: one correction.
std::vector<CorrectionCandidate> correction_candidates(const EffectCorrector& corrector, double reading_m,
                                                       const ReadingSetting& setting,
                                                       bool maximum_likelihood);

/// A column whose values lie outside those over which the effects that use it were fitted; of landmarks or devices, one that the
/// calibration does not know.
struct ColumnBeyond {
  std::string column;
  double from = 0.0, to = 0.0;  ///< as in Calibration::effects_range
  std::size_t readings = 0;
  int first_row = 0;       ///< of the table's file
  std::string label = {};  ///< of landmarks: the first one that is not known
};

/// The effects of a calibration, which must outlive this, and what they need to know about each reading.
struct ReadingSettings {
  EffectCorrector corrector;
  std::vector<ReadingSetting> of_reading;
  std::vector<ColumnBeyond> beyond = {};
};

/// Settings of `count` readings from the rows of a table; `table` may be null where the readings come alone. Times
/// count from the table's first; a stop that the calibration knows stands for its heading. A row that lacks what an effect
/// needs is not complete. Throws InputError naming the column that an effect of the calibration needs and `name` lacks,
/// and the place of a field that is no number where one is needed, or a repeat that is no whole one. Cost: linear in the
/// table, and in the landmarks.
ReadingSettings reading_settings(const Calibration& calibration, const CsvTable* table,
                                 const std::string& name, std::size_t count);
ReadingSettings reading_settings(const Calibration&&, const CsvTable*, const std::string&,
                                 std::size_t) = delete;  ///< would be gone

/// Throws InputError, naming `name`, where the calibration's outcome leaves no curve to correct by.
void require_curve(const Calibration& calibration, const std::string& name);

}  // namespace rangecal
