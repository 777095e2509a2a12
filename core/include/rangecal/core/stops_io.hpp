// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/recording.hpp"

namespace rangecal {

/// The stops of a table like stops.csv (docs/formats.md), in its order: `stop, x_m, y_m, heading_rad`, optionally `sigma_xy_m`,
/// `sigma_heading_rad`, `place`, and the columns of a covariance; `sigma_heading_rad` is that of a heading whose variance
/// neither says. Throws InputError with file, row and column, for a stop listed twice and for no stop.
std::vector<Stop> stops_of(const CsvTable& table, double sigma_heading_rad = 0.0);

/// The columns of a stop's covariance over (x, y, heading).
inline constexpr std::array<const char*, 6> covariance_columns = {
    "cov_xx_m2", "cov_xy_m2", "cov_yy_m2", "cov_hh_rad2", "cov_xh_m_rad", "cov_yh_m_rad"};
using CovarianceEntries = std::array<std::optional<double>, 6>;

/// A covariance made of entries in the order of `covariance_columns`, or what is wrong with which of them.
struct StopCovariance {
  std::optional<Eigen::Matrix3d> matrix;  ///< none where no entry is given, or with a fault
  std::string fault;                      ///< in words; empty: none
  std::size_t at = 0;                     ///< the entry with the fault
};

/// The first three entries go together; without the fourth the heading has `sigma_heading_rad` and no correlation.
StopCovariance stop_covariance(const CovarianceEntries& entries, double sigma_heading_rad);

/// The covariance that `stop` has. Throws InputError, which begins with `where`, if no error can have it.
const Eigen::Matrix3d& checked_covariance(const Stop& stop, const std::string& where);

/// Throws InputError, which begins with `where`, if the covariance of a stop that was turned where it stands ties its heading
/// to a step: it has none.
void require_turn_alone(const Stop& stop, const std::string& where);

/// The entries of a covariance, as the columns have them.
CovarianceEntries covariance_entries(const Eigen::Matrix3d& covariance);

}  // namespace rangecal
