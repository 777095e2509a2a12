// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/tails_along_sequence.hpp"

#include <cmath>
#include <memory>
#include <tuple>
#include <utility>

#include "diagnosis/likeliest_sequence.hpp"
#include "diagnosis/tail_slopes.hpp"
#include "diagnosis/wandering_part.hpp"

namespace rangecal::diagnosis {
namespace {

/// ln p of the error of a reading given those before it, then mean and variance that it leaves of the part that wanders.
using Told = Eigen::Array3d;

/// A reading's error and spread [m], and what the readings before it predict.
struct ReadingAlong {
  double error, spread;
  WanderingPart::Prediction before;
  double own() const { return spread * before.spread(); }  ///< spread of the prediction's error [m]
  double gain() const { return before.variance / before.spread(); }

  /// Of z = prediction's error / `own`, where it is larger by `more` of itself: ln p, its slope and its curvature.
  Eigen::Array3d density(const TailLaw& law, double z_more = 0.0, double more = 0.0) const {
    TailLaw::Slopes slopes;
    const LogDensity at =
        law.density(error - spread * before.mean + z_more * own(), own() * std::exp(more), &slopes);
    return {at.value, at.derivative, slopes.curvature};
  }
  Told told(const Eigen::Array3d& density) const {
    const auto [mean, variance] = before.behind(density[1], density[2]);
    return {density[0] - std::log(own()), mean, variance};
  }
  /// Its slope where that of the density alone is known.
  Told told_slope(const Eigen::Array3d& of_density) const {
    return {of_density[0], -gain() * of_density[1], -gain() * gain() * of_density[2]};
  }
};

ReadingAlong reading_along(const Rows& rows, const WorkingProblem& working, const CellGeometry& geometry,
                           const WanderingPart::Prediction& before, int row) {
  const auto cell = static_cast<std::size_t>(rows.cell[static_cast<std::size_t>(row)]);
  return {working.range_with_tail(row) - geometry.f[cell], geometry.spread[cell] * working.spread_factor(row),
          before};
}

constexpr double h = 1e-6;  ///< of differences: of z, logarithms, and q and rho

/// Slopes of what a reading tells: in the error in units of its spread, the predicted variance, q, and ln s with the sizes of the tails
/// as they are, and as they follow the calibration's.
struct ToldSlopes {
  Told in_error, in_variance, in_q, in_spread, in_level;
};

/// `wider`: the law where the calibration's spread is larger by the factor exp(h); null: the same.
ToldSlopes told_slopes(const ReadingAlong& at, const Eigen::Array3d& here, const TailLaw& law,
                       const TailLaw* wider) {
  const double root = at.before.spread(), v = at.before.error_variance, gain = at.gain();
  const Told one{1.0, 0.0, 0.0};
  ToldSlopes out;
  out.in_error = at.told_slope((at.density(law, h) - here) / (h * root));
  const auto in_own_of = [&](const TailLaw& under) -> Told {  // in ln of the spread of the prediction's error
    return at.told_slope((at.density(under, 0.0, h) - here) / h) - one;
  };
  const Told in_own = in_own_of(law);
  const auto by_gain = [&](double in_gain) -> Told {
    return {0.0, -in_gain * here[1], -2.0 * gain * in_gain * here[2]};
  };
  const double less = 0.5 * at.before.variance / (v * root);
  out.in_variance = in_own / (2.0 * v) + by_gain(1.0 / root - less) + Told{0.0, 0.0, 1.0};
  out.in_q = by_gain(less) - in_own / (2.0 * v);
  out.in_spread = in_own - at.before.mean * out.in_error;
  out.in_level = wider ? Told(in_own_of(*wider) - at.before.mean * out.in_error) : out.in_spread;
  return out;
}

/// The laws of the rows with a parameter of a tail a little larger.
struct ProbedLaws {
  ProbedLaws(const Rows& rows, const CellGeometry& geometry, Model with, Eigen::Index of)
      : column(of), model(std::move(with)), laws(rows, geometry, model) {}
  Eigen::Index column;
  Model model;
  TailLaws laws;
};

/// Slopes of q and rho in the logit of a parameter.
std::pair<double, double> sequence_slopes(const Rows& rows, const Model& model, const FreeParameter& p) {
  const auto [low, high] = bounds_of(rows, model, p);
  const double value = value_of(model, p), in_logit = (value - low) * (high - value) / (high - low);
  Model up = model;
  value_of(up, p) += h;
  const Dependence here = dependence_of(model), there = dependence_of(up);
  return {in_logit * (there.range_correlated_share - here.range_correlated_share) / h,
          in_logit * (there.range_correlation - here.range_correlation) / h};
}

}  // namespace

SerialErrors::Columns prediction_slopes(const Rows& rows, const Model& model, const WorkingProblem& working,
                                        const CellGeometry& geometry, const MovedReadings& moved,
                                        const std::vector<FreeParameter>& parameters) {
  using Columns = SerialErrors::Columns;
  const Eigen::Index n = moved.means.rows(), count = moved.means.cols(),
                     first = count - static_cast<Eigen::Index>(parameters.size());
  const Dependence dependence = dependence_of(model);
  const double q = dependence.range_correlated_share, rho = dependence.range_correlation;
  Eigen::ArrayXd in_q = Eigen::ArrayXd::Zero(count), in_rho = in_q;
  std::vector<std::unique_ptr<ProbedLaws>> probes;
  for (std::size_t a = 0; a < parameters.size(); ++a) {
    const Eigen::Index column = first + static_cast<Eigen::Index>(a);
    if (is_of_sequence(rows, model, parameters[a])) {
      std::tie(in_q[column], in_rho[column]) = sequence_slopes(rows, model, parameters[a]);
    } else if (is_of_tail(model, parameters[a])) {
      Model up = model;
      value_of(up, parameters[a]) *= std::exp(h);
      probes.push_back(std::make_unique<ProbedLaws>(rows, geometry, std::move(up), column));
    }
  }
  CellGeometry wide = geometry;
  for (double& s : wide.spread) s *= std::exp(h);
  const bool by_spread = is_measured_by_spread(rows, geometry, model);
  TailLaws laws(rows, geometry, model), wider(rows, wide, model);
  WanderingPart part(rows.sequence, q, rho);
  Columns slopes(n, count), of_mean(n, count), of_variance(n, count);  // of what rows tell
  for (const int row : rows.sequence.order) {
    const auto i = static_cast<std::size_t>(row);
    const ReadingAlong at = reading_along(rows, working, geometry, part.before(row), row);
    const TailLaw& law = laws.of(i);
    const Eigen::Array3d here = at.density(law);
    const Told told = at.told(here);
    part.leave(row, told[1], told[2]);
    const ToldSlopes in = told_slopes(at, here, law, by_spread ? &wider.of(i) : nullptr);
    const int last = rows.sequence.before[i];
    const double phi = at.before.correlation,
                 in_rho_of_phi = last < 0 ? 0.0 : phi * rows.sequence.gap[i] / rho;
    for (Eigen::Index a = 0; a < count; ++a) {
      double mean = 0.0, variance = (1.0 - phi * phi) * in_q[a];  // slopes of what is predicted
      if (last >= 0) {
        const double in_phi = in_rho_of_phi * in_rho[a];
        mean = phi * of_mean(last, a) + part.mean_left(last) * in_phi;
        variance += phi * phi * of_variance(last, a) + 2.0 * phi * (part.variance_left(last) - q) * in_phi;
      }
      const Told all = in.in_error * (-moved.means(row, a) / at.spread - mean) + in.in_variance * variance +
                       in.in_q * in_q[a] + in.in_spread * moved.spreads(row, a) +
                       in.in_level * moved.levels(row, a);
      slopes(row, a) = all[0];
      of_mean(row, a) = mean + all[1];
      of_variance(row, a) = all[2];
    }
    for (const auto& probe : probes) {
      const Told in_parameter = at.told_slope((at.density(probe->laws.of(i)) - here) / h);
      slopes(row, probe->column) += in_parameter[0];
      of_mean(row, probe->column) += in_parameter[1];
      of_variance(row, probe->column) += in_parameter[2];
    }
  }
  return slopes;
}

double nll_along_sequence(const Rows& rows, const Model& model, const WorkingProblem& working,
                          const CellGeometry& geometry) {
  const Dependence dependence = dependence_of(model);
  TailLaws laws(rows, geometry, model);
  WanderingPart part(rows.sequence, dependence.range_correlated_share, dependence.range_correlation);
  double nll = 0.0;
  for (const int row : rows.sequence.order) {
    const ReadingAlong at = reading_along(rows, working, geometry, part.before(row), row);
    const Told told = at.told(at.density(laws.of(static_cast<std::size_t>(row))));
    part.leave(row, told[1], told[2]);
    nll -= told[0];
  }
  return nll;
}

}  // namespace rangecal::diagnosis
