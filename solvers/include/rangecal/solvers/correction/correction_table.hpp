// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "rangecal/solvers/correction/effect_correction.hpp"

namespace rangecal {

/// The most likely distance behind each of any number of readings, as `correction_candidates` gives it first, from a table.
///
///   d(y, b) = sum_jk c_jk t^j s^k,   j, k = 0 .. 5,   t, s in (-1, 1) the places of reading y and bearing b in a cell,
///
/// through the exact distances at 6 x 6 Chebyshev nodes of the cell (6 where no effect of the range depends on the bearing). A cell is
/// made when the first reading falls into it. It serves if 4 x 4 (4) further exact distances in it are met within `tolerance_m`, and
/// whether there are several distances, or none, is the same at all of these and the nodes; else its readings get
/// exact answers: beside turning points, jumps, and the ends of the fit. Distances between those that were checked are as smooth as
/// the curve and the effects are: none is narrower than a cell.
///
/// For effects of the range that depend on reading and bearing alone; for others `exact`. The corrector must outlive this.
class CorrectionTable {
 public:
  static constexpr double tolerance_m = 1e-9;
  enum Flag : std::uint8_t { ambiguous = 1, out_of_range = 2, extrapolated = 4, turning_point = 8 };
  struct Answer {
    double distance_m = std::numeric_limits<double>::quiet_NaN();  ///< NaN: no distance explains the reading
    std::uint8_t flags = 0;                                        ///< of CorrectionCandidate, as bits
  };

  /// Cost: some thousand evaluations of the curve.
  CorrectionTable(const EffectCorrector& corrector, bool by_bearing);

  /// Of a reading [m] that is finite and positive. Cost: 10 ns, with bearings 20; of a new cell 10 or 52 corrections.
  Answer operator()(double reading_m, double bearing_rad = 0.0);
  /// Without the table. Cost: one correction.
  Answer exact(double reading_m, const ReadingSetting& setting) const;

  std::size_t cells() const { return cells_; }              ///< made so far
  std::size_t exact_cells() const { return exact_cells_; }  ///< of these, without a polynomial

 private:
  static constexpr int nodes = 6;
  struct Cell;
  Answer at_bearing(double reading_m, double bearing_rad) const;
  double highest_reading() const;
  std::int32_t make_cell(std::size_t row, std::size_t column);

  const EffectCorrector& corrector_;
  bool by_bearing_;
  std::size_t rows_, columns_;  ///< of readings, of bearings
  double highest_m_ = 0.0;      ///< no distance is read as more
  double rows_per_m_ = 0.0, columns_per_rad_ = 0.0;
  std::vector<std::int32_t> place_;  ///< of a cell: where its coefficients begin, or one of the codes below 0
  std::vector<std::uint8_t> flags_;
  std::vector<double> coefficients_;
  std::size_t cells_ = 0, exact_cells_ = 0;
};

}  // namespace rangecal
