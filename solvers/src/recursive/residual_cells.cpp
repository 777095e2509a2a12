// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/recursive/residual_cells.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/solvers/statistics/median.hpp"
#include "recursive/signed_intervals.hpp"

namespace rangecal {
namespace {

using Reference = ResidualCells::Reference;

constexpr std::size_t kept_first = 64;
constexpr SignedIntervals intervals{.width = 0.5, .even_to = 5.0, .ratio = 1.5, .farthest = 1e6};
constexpr double of_normal = 1.0 / median_of_normal_size;  // spread of a normal over its median deviation

/// Number of the interval of v, for z at a place u of the bin.
int interval_of(const Reference& reference, double u, double z) {
  return intervals.index_of((z - reference.offset_at(u)) / reference.spread_at(u));
}

/// The line through a few readings that outliers do not move, and the spread about it.
Reference line_through(const std::vector<ResidualCells::Reading>& readings, const DistanceBins::Bin& bin) {
  const auto at = [&](std::size_t i) {
    return std::pair{bin.place_of(readings[i].d), readings[i].y - readings[i].d};
  };
  std::vector<double> slopes, values;
  constexpr double least_apart = 0.1;  // of the bin's half width
  for (std::size_t i = 0; i < readings.size(); ++i)
    for (std::size_t j = 0; j < i; ++j)
      if (const double apart = at(i).first - at(j).first; std::abs(apart) > least_apart)
        slopes.push_back((at(i).second - at(j).second) / apart);
  Reference reference;
  if (!slopes.empty()) reference.b = upper_median(slopes);
  for (std::size_t i = 0; i < readings.size(); ++i)
    values.push_back(at(i).second - reference.b * at(i).first);
  reference.a = upper_median(values);
  for (double& value : values) value = std::abs(value - reference.a);
  constexpr double least = 1e-6;  // of the distance
  reference.spread = std::max(of_normal * upper_median(values), least * bin.centre_m);
  reference.growth = 2.0 * bin.half_width_m / bin.centre_m;  // as d^2
  return reference;
}

/// Of a fitted curve in a bin; none where there is none, or no spread.
std::optional<Reference> reference_on(const Eigen::VectorXd& alpha, const Noise& noise,
                                      const DistanceBins::Bin& bin) {
  if (alpha.size() == 0) return std::nullopt;
  const auto f = [&](double u) { return evaluate_polynomial(alpha, bin.centre_m + u * bin.half_width_m); };
  const auto s = [&](double u) { return noise.spread(bin.centre_m + u * bin.half_width_m, f(u)); };
  const double above = f(1.0) - f(0.0) - bin.half_width_m, below = f(-1.0) - f(0.0) + bin.half_width_m;
  const Reference on{f(0.0) - bin.centre_m, 0.5 * (above - below), 0.5 * (above + below), s(0.0),
                     std::clamp(0.5 * (s(1.0) - s(-1.0)) / s(0.0), -0.5, 0.5)};
  if (!(on.spread > 0.0) || !std::isfinite(on.a + above + below + on.spread + on.growth)) return std::nullopt;
  return on;
}

void add_to(std::vector<ResidualCells::Cell>& cells, int place, const std::array<double, 7>& sums) {
  auto at = std::lower_bound(cells.begin(), cells.end(), place,
                             [](const ResidualCells::Cell& cell, int wanted) { return cell.place < wanted; });
  if (at == cells.end() || at->place != place) at = cells.insert(at, {place, {}});
  for (std::size_t k = 0; k < sums.size(); ++k) at->sums[k] += sums[k];
}

void file(ResidualCells::Bin& bin, double u, double z, double weight) {
  add_to(bin.cells, interval_of(bin.reference, u, z),
         {weight, weight * weight, weight * u, weight * z, weight * u * u, weight * u * z, weight * z * z});
}

/// Means of u and z, and the lower Cholesky factor of their covariance; what rounding makes is 0.
struct Spread {
  double u, z, uu, uz, zz;
};
Spread spread_of(const ResidualCells::Cell& cell) {
  constexpr double rounding = 1e-13;
  const auto& s = cell.sums;
  Spread spread{s[2] / s[0], s[3] / s[0], 0.0, 0.0, 0.0};
  const double uu = s[4] / s[0] - spread.u * spread.u, uz = s[5] / s[0] - spread.u * spread.z,
               zz = s[6] / s[0] - spread.z * spread.z;
  if (uu > rounding) {
    spread.uu = std::sqrt(uu);
    spread.uz = uz / spread.uu;
  }
  const double rest = zz - spread.uz * spread.uz;
  if (rest > rounding * s[6] / s[0]) spread.zz = std::sqrt(rest);
  return spread;
}

}  // namespace

ResidualCells::ResidualCells(double low_m, double high_m) : places_(low_m, high_m) {
  bins.resize(places_.size());
}

void ResidualCells::add(double d, double y, double weight) {
  const std::size_t index = places_.index_of(d);
  Bin& bin = bins[index];
  if (bin.reference.spread > 0.0) return file(bin, places_[index].place_of(d), y - d, weight);
  bin.first.push_back({d, y, weight});
  if (bin.first.size() < kept_first) return;
  const std::optional<Reference> known = reference_on(alpha, noise, places_[index]);
  bin.reference = known ? *known : line_through(bin.first, places_[index]);
  for (const Reading& one : bin.first) file(bin, places_[index].place_of(one.d), one.y - one.d, one.weight);
  bin.first = {};
}

void ResidualCells::scale(double factor) {
  for (Bin& bin : bins) {
    for (Reading& one : bin.first) one.weight *= factor;
    for (Cell& cell : bin.cells)
      for (std::size_t k = 0; k < cell.sums.size(); ++k) cell.sums[k] *= k == 1 ? factor * factor : factor;
    std::erase_if(bin.cells, [](const Cell& cell) { return !(cell.sums[0] > 1e-200); });
  }
}

void ResidualCells::refer_to(const Eigen::VectorXd& curve, const Noise& spread) {
  alpha = curve;
  noise = spread;
  for (std::size_t b = 0; b < bins.size(); ++b) {
    Bin& bin = bins[b];
    if (!(bin.reference.spread > 0.0)) continue;
    const std::optional<Reference> known = reference_on(alpha, noise, places_[b]);
    if (!known) continue;
    const Reference& wanted = *known;
    double apart = 0.0;
    for (const double u : {-1.0, 0.0, 1.0})
      apart = std::max(apart, std::abs(wanted.offset_at(u) - bin.reference.offset_at(u)));
    constexpr double far = 0.5, wider = 1.5;  // spreads; times
    const double times = wanted.spread / bin.reference.spread;
    if (apart < far * wanted.spread && times < wider && times * wider > 1.0) continue;
    std::vector<Cell> before = std::exchange(bin.cells, {});
    bin.reference = wanted;
    for (const Cell& cell : before) {
      const double u = cell.sums[2] / cell.sums[0], z = cell.sums[3] / cell.sums[0];
      add_to(bin.cells, interval_of(wanted, u, z), cell.sums);
    }
  }
}

PairsProblem ResidualCells::points(double factor, bool weighted) const {
  std::vector<double> d, y, w, w_sq;
  const auto add = [&](double at, double reading, double weight, double weight_sq) {
    d.push_back(at);
    y.push_back(std::max(reading, 1e-6 * at));  // above 0, as every reading is
    w.push_back(factor * weight);
    if (weighted) w_sq.push_back(factor * factor * weight_sq);
  };
  const double root_2 = std::sqrt(2.0);
  for (std::size_t b = 0; b < bins.size(); ++b) {
    for (const Reading& one : bins[b].first) add(one.d, one.y, one.weight, one.weight * one.weight);
    const DistanceBins::Bin& place = places_[b];
    for (const Cell& cell : bins[b].cells) {
      const Spread spread = spread_of(cell);
      const auto point = [&](double u, double z, double share) {
        const double at = place.centre_m + place.half_width_m * (spread.u + u);
        add(at, at + spread.z + z, share * cell.sums[0], share * cell.sums[1]);
      };
      const bool along = spread.uu > 0.0, across = spread.zz > 0.0;
      if (!along && !across) {
        point(0.0, 0.0, 1.0);
      } else {
        const double share = along && across ? 0.25 : 0.5, reach = along && across ? root_2 : 1.0;
        for (const double sign : {-reach, reach}) {
          if (along) point(sign * spread.uu, sign * spread.uz, share);
          if (across) point(0.0, sign * spread.zz, share);
        }
      }
    }
  }
  return make_weighted_pairs(d, y, w, w_sq);
}

}  // namespace rangecal
