// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/correction/correction_table.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <string_view>

#include "correction/search.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/solvers/correction/candidates.hpp"

namespace rangecal {
namespace {

constexpr std::int32_t kNotMade = -1, kExact = -2, kNoDistance = -3;
constexpr std::size_t kRowsAlone = 4096, kRowsByBearing = 192, kColumns = 64;
constexpr int kNodes = 6;
using CellMatrix = Eigen::Matrix<double, kNodes, kNodes>;
using CellVector = Eigen::Matrix<double, kNodes, 1>;

/// Chebyshev nodes in (-1, 1).
const std::array<double, kNodes>& cell_nodes() {
  static const auto nodes = [] {
    std::array<double, kNodes> out{};
    for (std::size_t j = 0; j < out.size(); ++j)
      out[j] = std::cos((2.0 * static_cast<double>(j) + 1.0) * std::numbers::pi / (2.0 * kNodes));
    return out;
  }();
  return nodes;
}

/// Coefficients of the powers of t from the values at the nodes.
const CellMatrix& powers_from_nodes() {
  static const CellMatrix inverse = [] {
    CellMatrix powers;
    for (int i = 0; i < kNodes; ++i)
      for (int j = 0; j < kNodes; ++j) powers(i, j) = std::pow(cell_nodes()[static_cast<std::size_t>(i)], j);
    return CellMatrix(powers.inverse());
  }();
  return inverse;
}

double in_powers(const double* c, double t) {
  return c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * c[5]))));
}

/// Between the nodes and at the ends of a cell.
constexpr std::array<double, 4> kChecks = {-0.995, -0.48, 0.13, 0.86};

std::uint8_t flag_bits(std::string_view flag) {
  std::uint8_t bits = 0;
  const auto has = [&](std::string_view word) { return flag.find(word) != std::string_view::npos; };
  if (has("ambiguous")) bits |= CorrectionTable::ambiguous;
  if (has("out_of_range")) bits |= CorrectionTable::out_of_range;
  if (has("turning_point")) bits |= CorrectionTable::turning_point;
  return bits;
}

}  // namespace

CorrectionTable::CorrectionTable(const EffectCorrector& corrector, bool by_bearing)
    : corrector_(corrector),
      by_bearing_(by_bearing),
      rows_(by_bearing ? kRowsByBearing : kRowsAlone),
      columns_(by_bearing ? kColumns : 1) {
  static_assert(nodes == kNodes);
  highest_m_ = highest_reading();
  rows_per_m_ = static_cast<double>(rows_) / highest_m_;
  columns_per_rad_ = static_cast<double>(columns_) / (2.0 * std::numbers::pi);
  place_.assign(rows_ * columns_, kNotMade);
  flags_.assign(rows_ * columns_, 0);
}

/// A reading that lies above all those that a distance explains, by half of them and ten standard deviations.
double CorrectionTable::highest_reading() const {
  const SearchedRange range = searched_range(corrector_.calibration(), 1.0, {});
  constexpr int distances = 200, bearings = 32;
  double highest = 0.0;
  for (int b = 0; b < (by_bearing_ ? bearings : 1); ++b) {
    ReadingSetting setting;
    setting.bearing_rad = -std::numbers::pi + 2.0 * std::numbers::pi * b / bearings;
    for (int i = 0; i <= distances; ++i) {
      const EffectCorrector::Expected at = corrector_.at(range.low + range.width() * i / distances, setting);
      const double reach = at.mean_m + 10.0 * at.spread_m;
      if (std::isfinite(reach)) highest = std::max(highest, reach);
    }
  }
  return highest > 0.0 ? 1.5 * highest : 1.0;
}

CorrectionTable::Answer CorrectionTable::exact(double reading_m, const ReadingSetting& setting) const {
  const CorrectionCandidate first = correction_candidates(corrector_, reading_m, setting, false).front();
  Answer answer;
  answer.flags = flag_bits(first.flag);
  if (!first.distance_m) {
    answer.flags |= out_of_range;
    return answer;
  }
  answer.distance_m = *first.distance_m;
  if ((answer.flags & out_of_range) == 0 && is_extrapolated(corrector_.calibration(), answer.distance_m))
    answer.flags |= extrapolated;
  return answer;
}

CorrectionTable::Answer CorrectionTable::at_bearing(double reading_m, double bearing_rad) const {
  ReadingSetting setting;
  setting.bearing_rad = bearing_rad;
  return exact(reading_m, setting);
}

std::int32_t CorrectionTable::make_cell(std::size_t row, std::size_t column) {
  ++cells_;
  const auto reading = [&](double t) { return (static_cast<double>(row) + 0.5 * (t + 1.0)) / rows_per_m_; };
  const auto bearing = [&](double s) {
    return by_bearing_ ? (static_cast<double>(column) + 0.5 * (s + 1.0)) / columns_per_rad_ - std::numbers::pi
                       : 0.0;
  };
  std::optional<std::uint8_t> flags;
  bool none = true, all = true, same = true;
  const auto distance = [&](double t, double s) {
    const Answer at = at_bearing(reading(t), bearing(s));
    const auto own = static_cast<std::uint8_t>(at.flags & ~extrapolated);
    same = same && (!flags || *flags == own);
    flags = own;
    const bool there = std::isfinite(at.distance_m);
    none = none && !there, all = all && there;
    return at.distance_m;
  };
  const auto fails = [&] {
    ++exact_cells_;
    return kExact;
  };
  const auto& at = cell_nodes();
  CellMatrix values = CellMatrix::Zero();
  const int bearings = by_bearing_ ? kNodes : 1;
  for (int k = 0; k < bearings; ++k)
    for (int j = 0; j < kNodes; ++j) {
      values(j, k) = distance(at[static_cast<std::size_t>(j)], at[static_cast<std::size_t>(k)]);
      if (!same || !(none || all)) return fails();
    }
  const CellMatrix& V = powers_from_nodes();
  CellMatrix c;
  if (by_bearing_)
    c = V * values * V.transpose();
  else
    c.col(0) = V * values.col(0);
  for (const double s : kChecks) {
    for (const double t : kChecks) {
      const double exact_m = distance(t, s);
      if (!same || !(none || all)) return fails();
      if (none) continue;
      CellVector along = c.col(0);
      if (by_bearing_)
        for (int j = 0; j < kNodes; ++j) {
          const CellVector of_bearing = c.row(j).transpose();
          along[j] = in_powers(of_bearing.data(), s);
        }
      if (!(std::abs(in_powers(along.data(), t) - exact_m) <= tolerance_m)) return fails();
    }
    if (!by_bearing_) break;
  }
  flags_[row * columns_ + column] = *flags;
  if (none) return kNoDistance;
  const auto begin = static_cast<std::int32_t>(coefficients_.size());
  for (int j = 0; j < kNodes; ++j)  // by powers of t, each a polynomial in s
    for (int k = 0; k < bearings; ++k) coefficients_.push_back(c(j, k));
  return begin;
}

CorrectionTable::Answer CorrectionTable::operator()(double reading_m, double bearing_rad) {
  if (reading_m >= highest_m_) return {std::numeric_limits<double>::quiet_NaN(), out_of_range};
  const double y = reading_m * rows_per_m_;
  const std::size_t row = std::min(static_cast<std::size_t>(y), rows_ - 1);
  std::size_t column = 0;
  double b = 0.0;
  if (by_bearing_) {
    b = (wrap_angle(bearing_rad) + std::numbers::pi) * columns_per_rad_;
    column = std::min(static_cast<std::size_t>(std::max(b, 0.0)), columns_ - 1);
  }
  const std::size_t cell = row * columns_ + column;
  if (place_[cell] == kNotMade) place_[cell] = make_cell(row, column);
  const std::int32_t place = place_[cell];
  if (place == kNoDistance) return {std::numeric_limits<double>::quiet_NaN(), out_of_range};
  if (place == kExact) return at_bearing(reading_m, by_bearing_ ? wrap_angle(bearing_rad) : 0.0);
  const double t = 2.0 * (y - static_cast<double>(row)) - 1.0;
  const double* c = coefficients_.data() + place;
  Answer answer;
  answer.flags = flags_[cell];
  if (by_bearing_) {
    const double s = 2.0 * (b - static_cast<double>(column)) - 1.0;
    std::array<double, kNodes> along;
    for (std::size_t j = 0; j < along.size(); ++j) along[j] = in_powers(c + kNodes * j, s);
    answer.distance_m = in_powers(along.data(), t);
  } else {
    answer.distance_m = in_powers(c, t);
  }
  if ((answer.flags & out_of_range) == 0 && is_extrapolated(corrector_.calibration(), answer.distance_m))
    answer.flags |= extrapolated;
  return answer;
}

}  // namespace rangecal
