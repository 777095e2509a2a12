// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/tail_slopes.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "diagnosis/damped_scoring.hpp"

namespace rangecal::diagnosis {
namespace {

/// Error and spread of a row to which the law of a tail applies.
std::pair<double, double> error_and_spread(const Rows& rows, const WorkingProblem& working,
                                           const CellGeometry& geometry, Eigen::Index row) {
  const auto cell = static_cast<std::size_t>(rows.cell[static_cast<std::size_t>(row)]);
  return {working.range_of_tail(row) - geometry.f[cell],
          geometry.spread[cell] * working.tail_spread_factor(row)};
}

}  // namespace

bool is_of_tail(const Model& model, const FreeParameter& p) {
  return p.acts == FreeParameter::Acts::numeric && is_tail(model[static_cast<std::size_t>(p.effect)]);
}

namespace {

/// A parameter of a tail, and the tail with that parameter a little larger and smaller.
struct Probe {
  Eigen::Index column;
  int effect;
  ActiveEffect up, down;
};

/// d ln p(e_i) / d ln p_k [rows x parameters]: slopes of the log density of every reading's error e_i under the laws of the
/// model's tails, and in `of_log_spread` those in ln s.
SerialErrors::Columns tail_slopes(const Rows& rows, const Model& model, const WorkingProblem& working,
                                  const CellGeometry& geometry, const std::vector<FreeParameter>& parameters,
                                  Eigen::VectorXd& of_log_spread) {
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
  of_log_spread.setZero(slopes.rows());
  if (probes.empty()) return slopes;
  TailLaws laws(rows, geometry, model);
  for (Eigen::Index i = 0; i < slopes.rows(); ++i) {
    const auto row = static_cast<std::size_t>(i);
    const TailLaw& law = laws.of(row);
    if (law.empty()) continue;
    TailLaw::Slopes in;
    const auto [error, spread] = error_and_spread(rows, working, geometry, i);
    const LogDensity at = law.density(error, spread, &in);
    const double off = error / spread - at.shift;
    of_log_spread[i] = at.weight * off * off + at.extra_square - 1.0;
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

}  // namespace

bool is_measured_by_spread(const Rows& rows, const CellGeometry& geometry, const Model& model) {
  ReadingView<double> view = view_of(rows, geometry, 0), wider = view;
  wider.spread *= 2.0;
  return std::any_of(model.begin(), model.end(), [&](const ActiveEffect& active) {
    if (!is_tail(active)) return false;
    const Contamination at = active.effect->contamination(view, active.parameters.data()),
                        of_wider = active.effect->contamination(wider, active.parameters.data());
    return at.extra_sigma_m != of_wider.extra_sigma_m || at.mean_m != of_wider.mean_m ||
           at.share != of_wider.share;
  });
}

LawSlopes law_slopes(const Rows& rows, const Model& model, const WorkingProblem& working,
                     const CellGeometry& geometry, const std::vector<FreeParameter>& parameters) {
  constexpr double h = 1e-6;  // of ln s
  const auto n = static_cast<Eigen::Index>(rows.size());
  const auto density = [](const TailLaw& law, double error, double spread) {
    const double z = error / spread;
    return (law.empty() ? -0.5 * z * z - half_log_two_pi : law.density(error, spread).value) -
           std::log(spread);
  };
  LawSlopes out{Eigen::VectorXd(n), {}, {}};
  Eigen::VectorXd with_sizes;  // in ln s, as if every even tail were measured by it
  out.in_parameters = tail_slopes(rows, model, working, geometry, parameters, with_sizes);
  const double more = std::exp(h);
  Eigen::VectorXd here(n);
  TailLaws laws(rows, geometry, model);
  for (Eigen::Index i = 0; i < n; ++i) {
    const TailLaw& law = laws.of(static_cast<std::size_t>(i));
    const auto [error, spread] = error_and_spread(rows, working, geometry, i);
    here[i] = density(law, error, spread);
    out.in_spread[i] = (density(law, error, more * spread) - here[i]) / h;
  }
  out.in_level = out.in_spread;
  if (is_measured_by_spread(rows, geometry, model)) {
    CellGeometry wide = geometry;
    for (double& s : wide.spread) s *= more;
    TailLaws wider(rows, wide, model);
    for (Eigen::Index i = 0; i < n; ++i) {
      const auto [error, spread] = error_and_spread(rows, working, geometry, i);
      out.in_level[i] = (density(wider.of(static_cast<std::size_t>(i)), error, more * spread) - here[i]) / h;
    }
  }
  return out;
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
    tail_slopes(rows, fit.model, working_, geometry_, tails, of_level);
    score_of_level_ = of_level.sum();
  }

  TailPoint point_at(Model model, double log_level) const {
    TailPoint point{.model = std::move(model), .log_level = log_level, .nll = score_of_level_ * log_level};
    const CellGeometry geometry = at_level(log_level);
    TailLaws laws(rows_, geometry, point.model);
    for (Eigen::Index i = 0; i < static_cast<Eigen::Index>(rows_.size()); ++i) {
      const TailLaw& law = laws.of(static_cast<std::size_t>(i));
      const auto [error, spread] = error_and_spread(rows_, working_, geometry, i);
      point.nll += std::log(spread) -
                   (law.empty() ? -0.5 * std::pow(error / spread, 2) : law.density(error, spread).value);
    }
    return point;
  }

  ScoringSlopes slopes(const TailPoint& point) const {
    const auto n = static_cast<Eigen::Index>(tails_.size());
    Eigen::VectorXd of_level;
    SerialErrors::Columns each(static_cast<Eigen::Index>(rows_.size()), n + 1);
    each.leftCols(n) = tail_slopes(rows_, point.model, working_, at_level(point.log_level), tails_, of_level);
    each.col(n) = of_level;
    ScoringSlopes out{each.colwise().sum().transpose(), each.transpose() * each, {}};
    out.score[n] -= score_of_level_;
    for (Eigen::Index a = 0; a < n; ++a)
      if (is_stuck(rows_, point.model, tails_[static_cast<std::size_t>(a)], out.score[a]))
        out.held.push_back(a);
    out.information.diagonal().array() += 1e-6 * (1.0 + out.information.diagonal().array());
    return out;
  }

  Eigen::VectorXd within(const TailPoint& from, const Eigen::VectorXd& step) const {
    constexpr double longest = 1.5;  // of a logarithm: a factor of 4.5
    Eigen::VectorXd part = step.cwiseMin(longest).cwiseMax(-longest);
    for (std::size_t a = 0; a < tails_.size(); ++a) {
      const auto [low, high] = bounds_of(rows_, from.model, tails_[a]);
      const double value = value_of(from.model, tails_[a]);
      double& by = part[static_cast<Eigen::Index>(a)];
      by = value > 0.0 ? std::clamp(by, std::log(low / value), std::log(high / value)) : 0.0;
    }
    return part;
  }

  TailPoint moved(const TailPoint& from, const Eigen::VectorXd& step) const {
    Model model = from.model;
    for (std::size_t a = 0; a < tails_.size(); ++a) {
      const auto [low, high] = bounds_of(rows_, model, tails_[a]);
      double& value = value_of(model, tails_[a]);
      value = std::clamp(value * std::exp(step[static_cast<Eigen::Index>(a)]), low, high);
    }
    return point_at(std::move(model), from.log_level + step[step.size() - 1]);
  }

 private:
  CellGeometry at_level(double log_level) const {
    CellGeometry geometry = geometry_;
    for (double& s : geometry.spread) s *= std::exp(log_level);
    return geometry;
  }

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
             [&](const TailPoint& point, const Eigen::VectorXd& step) { return at.within(point, step); },
             [&](const TailPoint& point, const Eigen::VectorXd& step) { return at.moved(point, step); },
             1 + static_cast<Eigen::Index>(tails.size()))
      .model;
}

}  // namespace rangecal::diagnosis
