// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/select/curve_places.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <memory>
#include <set>
#include <string>
#include <utility>

#include "diagnosis/generic.hpp"
#include "in_parallel.hpp"
#include "rangecal/solvers/statistics/median.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr std::size_t most_groups = 60;
constexpr std::size_t most_knots_by_landmark = 40;  ///< each is a parameter of every fit that holds the curve
constexpr double gentle = 0.6,
                 rough = 0.15;  ///< lengths over which a smooth curve's values hang together, of its span

/// So many knots at equal shares of each landmark's readings.
CurveBasis basis_by_landmark(const std::vector<double>& sorted, int count) {
  CurveBasis basis;
  for (auto begin = sorted.begin(); begin != sorted.end();) {
    const auto end = std::lower_bound(begin, sorted.end(), std::floor(*begin) + 1.0);
    const std::vector<double> own = knots_at_equal_shares({begin, end}, count);
    basis.knots.insert(basis.knots.end(), own.begin(), own.end());
    begin = end;
  }
  return basis;
}

/// A smooth curve, and for each of several laws of its values at the knots a root L of their covariance L L^T, in units of that at
/// one knot: where they hang together, a curve of many knots has few parameters that matter.
struct SmoothCurve {
  CurveBasis basis;
  std::vector<Eigen::MatrixXd> roots;
};

/// Of values at equal steps from 0 to 1 that hang together over a length: Matern's covariance of order 3/2 (Rasmussen and Williams
/// 2006, eq. 4.17).
Eigen::MatrixXd root_of_values(Eigen::Index knots, double length) {
  Eigen::MatrixXd covariance(knots, knots);
  for (Eigen::Index i = 0; i < knots; ++i)
    for (Eigen::Index j = 0; j < knots; ++j) {
      const double r =
          std::sqrt(3.0) * static_cast<double>(std::abs(i - j)) / (length * static_cast<double>(knots - 1));
      covariance(i, j) = (1.0 + r) * std::exp(-r);
    }
  return covariance.llt().matrixL();
}

SmoothCurve independent(CurveBasis basis) {
  const Eigen::Index knots = basis.size();
  return {std::move(basis), {Eigen::MatrixXd::Identity(knots, knots)}};
}

/// Knots at equal shares of the readings, or one value for each of few; none where there is nothing to vary along.
std::vector<SmoothCurve> smooth_along(const std::string& covariate, const Rows& rows,
                                      const Eigen::VectorXd& x) {
  std::vector<double> sorted;
  for (const double v : x)
    if (std::isfinite(v)) sorted.push_back(v);
  std::sort(sorted.begin(), sorted.end());
  const std::set<double> distinct(sorted.begin(), sorted.end());
  if (distinct.size() < 2) return {};
  const bool grouped = covariate == "landmark" || covariate == "stop";
  if (grouped || distinct.size() <= 4) {
    if (distinct.size() > most_groups) return {};
    CurveBasis basis;
    basis.groups = true;
    basis.knots.assign(distinct.begin(), distinct.end());
    return {independent(std::move(basis))};
  }
  std::vector<SmoothCurve> curves;
  if (covariate == range_by_landmark) {
    for (const int count : {3, 5})
      if (CurveBasis basis = basis_by_landmark(sorted, count); basis.knots.size() <= most_knots_by_landmark)
        curves.push_back(independent(std::move(basis)));
    return curves;
  }
  for (const int most : {12, 8, 4}) {
    CurveBasis basis;
    basis.knots = knots_at_equal_shares(sorted, most);
    const Eigen::Index knots = basis.size();
    if (knots < 3 || !has_cells_for(rows, basis)) continue;
    curves.push_back({std::move(basis), {root_of_values(knots, gentle), root_of_values(knots, rough)}});
    break;
  }
  return curves;
}

/// Value 1 between `from` and `to`, 0 elsewhere, over so short a way that no reading lies on it.
CurveBasis plateau(double from, double to, double way) {
  CurveBasis basis;
  basis.knots = {from - way, from, to, to + way};
  return basis;
}

/// A curve of one shape: basis, and its coefficients for each parameter.
struct OneShape {
  CurveBasis basis;
  Eigen::MatrixXd directions;
};

/// The shapes that physics outside the catalogue most often has along a covariate.
std::vector<OneShape> shapes_along(const std::string& covariate, const Rows& rows, const Eigen::VectorXd& x) {
  std::vector<OneShape> shapes;
  const double low = x.minCoeff(), span = x.maxCoeff() - low;
  if (!(span > 0.0)) return shapes;
  const double way = 1e-6 * span;
  const Eigen::MatrixXd inside = (Eigen::MatrixXd(4, 1) << 0.0, 1.0, 1.0, 0.0).finished();
  if (covariate == "sensor_bearing")
    for (const int k : {1, 2, 3, 4, 5, 6, 8}) {
      CurveBasis basis;
      basis.wavenumber = k;
      shapes.push_back({basis, Eigen::MatrixXd::Identity(2, 2)});
    }
  if (covariate == "sensor_bearing" || covariate == "range")
    for (const double share : {0.06, 0.12, 0.25})
      for (double from = low; from < low + span; from += 0.5 * share * span)
        shapes.push_back({plateau(from, from + share * span, way), inside});
  if (covariate == "time" && rows.context.stop_time_s.size() <= 40) {
    std::vector<double> at = rows.context.stop_time_s;
    std::sort(at.begin(), at.end());
    at.erase(std::unique(at.begin(), at.end()), at.end());
    for (std::size_t i = 1; i < at.size(); ++i) {
      CurveBasis basis;
      basis.knots = {at[i] - way, at[i]};
      shapes.push_back({basis, Eigen::MatrixXd::Identity(2, 2).rightCols(1)});
    }
  }
  return shapes;
}

}  // namespace

std::vector<CurvePlace> curve_places(const Rows& rows, const Projector& projector, double sigma_theta_rad) {
  std::vector<std::string> covariates{"range",  "sensor_bearing", "heading", "time",
                                      "repeat", "landmark",       "stop",    "radius"};
  if (!rows.pairs && rows.context.landmark_count > 1) covariates.push_back(range_by_landmark);
  const auto& columns = rows.context.covariates;
  covariates.insert(covariates.end(), columns.begin(), columns.end());
  const double spread = upper_median(projector.geometry().spread);
  struct Wanted {
    std::string channel, covariate;
    CurveBasis basis;
    std::vector<Eigen::MatrixXd> directions;  ///< of each curve; of smooth ones, the roots
    bool smooth = false;
    std::size_t among = 1;  ///< curves of the same kind
    const Eigen::VectorXd* x = nullptr;
  };
  std::vector<Eigen::VectorXd> values;
  values.reserve(covariates.size());
  std::vector<Wanted> wanted;
  for (const std::string& covariate : covariates) {
    const CovariateOf value = covariate_of(rows, covariate);
    if (!value) continue;
    const Eigen::VectorXd& x = values.emplace_back(values_along(rows, projector.geometry(), value));
    std::vector<SmoothCurve> curves = smooth_along(covariate, rows, x);
    std::erase_if(curves, [&](const SmoothCurve& curve) { return !has_cells_for(rows, curve.basis); });
    if (curves.empty()) continue;
    std::size_t smooth = 0;
    for (const SmoothCurve& curve : curves) smooth += curve.roots.size();
    const std::vector<OneShape> shapes = shapes_along(covariate, rows, x);
    for (const char* channel : {"range", "bearing"}) {
      if ((rows.pairs || covariate == range_by_landmark) && channel != std::string("range")) continue;
      for (const SmoothCurve& curve : curves)
        wanted.push_back({channel, covariate, curve.basis, curve.roots, true, smooth, &x});
      for (const OneShape& shape : shapes)
        wanted.push_back({channel, covariate, shape.basis, {shape.directions}, false, shapes.size(), &x});
    }
  }
  std::vector<std::vector<CurvePlace>> made(wanted.size());
  in_parallel(wanted.size(), [&](std::size_t i) {
    const Wanted& w = wanted[i];
    const CurveChannel channel = curve_channel_of(w.channel);
    const double unit = channel == CurveChannel::range ? spread : sigma_theta_rad;
    std::vector<Eigen::MatrixXd> each = w.directions;
    if (w.smooth) each = directions_left(rows, projector, channel, *w.x, w.basis, w.directions);
    for (Eigen::MatrixXd& directions : each) {
      if (directions.cols() == 0) continue;
      CurvePlace& place = made[i].emplace_back();
      place.effect =
          std::make_shared<GenericEffect>(channel, w.channel, w.covariate, covariate_of(rows, w.covariate),
                                          w.basis, std::move(directions), unit);
      place.sizes = {0.5 * unit, 2.0 * unit, 8.0 * unit};
      place.effect->smooth = w.smooth;
      place.effect->choices = 2.0 * static_cast<double>(w.among * place.sizes.size());
    }
  });
  std::vector<CurvePlace> places;
  for (std::vector<CurvePlace>& some : made)
    places.insert(places.end(), std::make_move_iterator(some.begin()), std::make_move_iterator(some.end()));
  return places;
}

}  // namespace rangecal::diagnosis
