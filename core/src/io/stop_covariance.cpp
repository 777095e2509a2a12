// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/stops_io.hpp"

namespace rangecal {
namespace {

/// What correlations a covariance may have: an eigenvalue of the correlations of 1e-12 is rounding, not
/// knowledge.
constexpr double least_determinant = 1e-12;

}  // namespace

StopCovariance stop_covariance(const CovarianceEntries& entries, double sigma_heading_rad) {
  const auto fault = [](std::size_t at, const char* what) { return StopCovariance{std::nullopt, what, at}; };
  if (std::none_of(entries.begin(), entries.end(), [](const auto& entry) { return entry.has_value(); }))
    return {};
  for (std::size_t i = 0; i < 3; ++i)
    if (!entries[i]) return fault(i, "is missing beside other entries of the covariance");
  for (std::size_t i = 4; i < 6; ++i)
    if (entries[i] && !entries[3]) return fault(3, "is missing beside a covariance with the heading");
  const double xx = *entries[0], xy = *entries[1], yy = *entries[2];
  const double hh = entries[3].value_or(sigma_heading_rad * sigma_heading_rad);
  const double xh = entries[4].value_or(0.0), yh = entries[5].value_or(0.0);
  for (std::size_t i : {0, 2})
    if (!(*entries[i] > 0.0)) return fault(i, "is not positive");
  if (!(hh >= 0.0)) return fault(3, "is negative");
  const double plane = 1.0 - xy * xy / (xx * yy);
  if (!(plane > least_determinant)) return fault(1, "makes a covariance that is not positive definite");
  if (xh != 0.0 || yh != 0.0) {
    const double whole = plane - (xh * xh / xx + yh * yh / yy - 2.0 * xy * xh * yh / (xx * yy)) / hh;
    if (!(hh > 0.0 && whole > least_determinant))
      return fault(xh != 0.0 ? 4 : 5, "makes a covariance that is not positive definite");
  }
  StopCovariance result;
  result.matrix.emplace();
  *result.matrix << xx, xy, xh, xy, yy, yh, xh, yh, hh;
  return result;
}

const Eigen::Matrix3d& checked_covariance(const Stop& stop, const std::string& where) {
  const StopCovariance checked = stop_covariance(covariance_entries(*stop.covariance), 0.0);
  if (!checked.fault.empty())
    throw InputError(where + ": " + covariance_columns[checked.at] + " " + checked.fault);
  return *stop.covariance;
}

void require_turn_alone(const Stop& stop, const std::string& where) {
  if (stop.covariance && !stop.covariance->topRightCorner<2, 1>().isZero(0.0))
    throw InputError(where + " was turned where it stood, at place '" + stop.place +
                     "': its heading cannot vary with a step; leave cov_xh_m_rad and cov_yh_m_rad empty");
}

CovarianceEntries covariance_entries(const Eigen::Matrix3d& c) {
  return {c(0, 0), c(0, 1), c(1, 1), c(2, 2), c(0, 2), c(1, 2)};
}

}  // namespace rangecal
