// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/tail_slopes.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "diagnosis/damped_scoring.hpp"

namespace rangecal::diagnosis {
namespace {

/// Error and spread of a row to which the law of a tail applies, the spread times exp(log_level).
std::pair<double, double> error_and_spread(const Rows& rows, const WorkingProblem& working,
                                           const CellGeometry& geometry, Eigen::Index row, double log_level) {
  const auto cell = static_cast<std::size_t>(rows.cell[static_cast<std::size_t>(row)]);
  const double change = working.range_log_variance.size() > 0 ? 0.5 * working.range_log_variance[row] : 0.0;
  return {working.range_of_tail(row) - geometry.f[cell],
          geometry.spread[cell] * std::exp(change + log_level)};
}

/// A parameter of a tail, and the tail with that parameter a little larger and smaller.
struct Probe {
  Eigen::Index column;
  int effect;
  ActiveEffect up, down;
};

}  // namespace

bool is_of_tail(const Model& model, const FreeParameter& p) {
  return p.acts == FreeParameter::Acts::numeric && is_tail(model[static_cast<std::size_t>(p.effect)]);
}

SerialErrors::Columns tail_slopes(const Rows& rows, const Model& model, const WorkingProblem& working,
                                  const CellGeometry& geometry, const std::vector<FreeParameter>& parameters,
                                  double log_level, Eigen::VectorXd* of_log_spread) {
  constexpr double h = 1e-6;  // of the logarithm; share and size are nearly linear in a parameter
  SerialErrors::Columns slopes = SerialErrors::Columns::Zero(static_cast<Eigen::Index>(rows.size()),
                                                             static_cast<Eigen::Index>(parameters.size()));
  std::vector<Probe> probes;
  for (std::size_t a = 0; a < parameters.size(); ++a) {
    const FreeParameter& p = parameters[a];
    if (!is_of_tail(model, p)) continue;
    const ActiveEffect& active = model[static_cast<std::size_t>(p.effect)];
    probes.push_back({static_cast<Eigen::Index>(a), p.effect, active, active});
    probes.back().up.parameters[p.index] *= std::exp(h);
    probes.back().down.parameters[p.index] *= std::exp(-h);
  }
  if (of_log_spread) of_log_spread->setZero(slopes.rows());
  if (probes.empty()) return slopes;
  TailLaws laws(rows, geometry, model);
  for (Eigen::Index i = 0; i < slopes.rows(); ++i) {
    const auto row = static_cast<std::size_t>(i);
    const TailLaw& law = laws.of(row);
    if (law.empty()) continue;
    TailLaw::Slopes in;
    const auto [error, spread] = error_and_spread(rows, working, geometry, i, log_level);
    const LogDensity at = law.density(error, spread, &in);
    if (of_log_spread) {
      const double off = error / spread - at.shift;
      (*of_log_spread)[i] = at.weight * off * off + at.extra_square - 1.0;
    }
    const ReadingView<double> view = view_of(rows, geometry, row);
    for (const Probe& probe : probes)
      for (std::size_t k = 0; k < laws.effects().size(); ++k) {
        if (laws.effects()[k] != probe.effect) continue;
        const Contamination high = probe.up.effect->contamination(view, probe.up.parameters.data()),
                            low = probe.down.effect->contamination(view, probe.down.parameters.data());
        slopes(i, probe.column) =
            (in.in_share[k] * (high.share - low.share) +
             in.in_size[k] * (high.extra_sigma_m + high.mean_m - low.extra_sigma_m - low.mean_m)) /
            (2.0 * h);
      }
  }
  return slopes;
}

namespace {

/// Tails, and the level of the spreads, with the errors held fixed.
struct TailPoint {
  Model model;
  double log_level = 0.0;
  double nll = std::numeric_limits<double>::infinity();
};

/// Fits the tails with the errors held at those of a fit.
class TailsAtErrors {
 public:
  TailsAtErrors(const Rows& rows, const Fit& fit, const std::vector<FreeParameter>& tails)
      : rows_(rows),
        tails_(tails),
        working_(working_problem(rows, fit.model, fit.state)),
        geometry_(cell_geometry(rows, fit.state)) {
    Eigen::VectorXd of_level;
    tail_slopes(rows, fit.model, working_, geometry_, tails, 0.0, &of_level);
    score_of_level_ = of_level.sum();
  }

  TailPoint point_at(Model model, double log_level) const {
    TailPoint point{std::move(model), log_level, score_of_level_ * log_level};
    TailLaws laws(rows_, geometry_, point.model);
    for (Eigen::Index i = 0; i < static_cast<Eigen::Index>(rows_.size()); ++i) {
      const TailLaw& law = laws.of(static_cast<std::size_t>(i));
      const auto [error, spread] = error_and_spread(rows_, working_, geometry_, i, log_level);
      point.nll += std::log(spread) -
                   (law.empty() ? -0.5 * std::pow(error / spread, 2) : law.density(error, spread).value);
    }
    return point;
  }

  ScoringSlopes slopes(const TailPoint& point) const {
    const auto n = static_cast<Eigen::Index>(tails_.size());
    Eigen::VectorXd of_level;
    SerialErrors::Columns each(static_cast<Eigen::Index>(rows_.size()), n + 1);
    each.leftCols(n) =
        tail_slopes(rows_, point.model, working_, geometry_, tails_, point.log_level, &of_level);
    each.col(n) = of_level;
    ScoringSlopes out{each.colwise().sum().transpose(), each.transpose() * each};
    out.score[n] -= score_of_level_;
    for (Eigen::Index a = 0; a < n; ++a) {
      if (!is_stuck(rows_, point.model, tails_[static_cast<std::size_t>(a)], out.score[a])) continue;
      hold(a, out.score, out.information);
    }
    out.information.diagonal().array() += 1e-6 * (1.0 + out.information.diagonal().array());
    return out;
  }

  TailPoint moved(const TailPoint& from, const Eigen::VectorXd& step) const {
    constexpr double longest = 1.5;  // of a logarithm: a factor of 4.5
    Model model = from.model;
    for (std::size_t a = 0; a < tails_.size(); ++a) {
      const auto [low, high] = bounds_of(rows_, model, tails_[a]);
      double& value = value_of(model, tails_[a]);
      const double by = std::clamp(step[static_cast<Eigen::Index>(a)], -longest, longest);
      value = std::clamp(value * std::exp(by), low, high);
    }
    return point_at(std::move(model), from.log_level + std::clamp(step[step.size() - 1], -longest, longest));
  }

 private:
  const Rows& rows_;
  const std::vector<FreeParameter>& tails_;
  WorkingProblem working_;
  CellGeometry geometry_;
  double score_of_level_ = 0.0;
};

}  // namespace

Model likeliest_tails(const Rows& rows, const Fit& fit, const std::vector<FreeParameter>& tails) {
  const TailsAtErrors at(rows, fit, tails);
  return scored(
             "tails", at.point_at(fit.model, 0.0), [&](const TailPoint& point) { return at.slopes(point); },
             [&](const TailPoint& point, const Eigen::VectorXd& step) { return at.moved(point, step); })
      .model;
}

}  // namespace rangecal::diagnosis
