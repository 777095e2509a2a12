// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/joint_scoring.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "diagnosis/damped_scoring.hpp"
#include "diagnosis/free_parameters.hpp"
#include "diagnosis/likeliest_sequence.hpp"
#include "diagnosis/tail_slopes.hpp"
#include "diagnosis/tails_along_sequence.hpp"

namespace rangecal::diagnosis {
namespace {

using Columns = SerialErrors::Columns;

/// Where scoring stands, with the readings as the model has them there.
struct Point {
  Model model;
  JointState state;
  WorkingProblem working;
  double nll = std::numeric_limits<double>::infinity();
};

Point point_at(const Rows& rows, Model model, JointState state) {
  Point point{.model = std::move(model), .state = std::move(state), .working = {}};
  if (!point.state.alpha.allFinite() || !(point.state.noise.parameters[0] > 0.0)) return point;
  point.working = working_problem(rows, point.model, point.state);
  const double nll = nll_at(rows, point.working, point.state);
  if (std::isfinite(nll)) point.nll = nll;
  return point;
}

/// What is fitted: alpha, ln sigma, then parameters of effects, those of tails in their logarithms, those of the sequence in
/// their logits.
class Scoring {
 public:
  Scoring(const Rows& rows, const Fit& fit, const RefitOptions& options)
      : rows_(rows), options_(options), alphas_(fit.state.alpha.size()), tails_(has_tails(fit.model)) {
    for (const FreeParameter& p : fit.free)
      if (p.acts != FreeParameter::Acts::numeric || is_of_tail(fit.model, p) ||
          is_of_sequence(rows, fit.model, p))
        own_.push_back(p);
  }

  ScoringSlopes at(const Point& point) const;
  /// Their sum, and the outer product of the rows' slopes.
  ScoringSlopes slopes_of(const Point& point, const Columns& each) const;
  /// What was learned, for fits close by.
  LearnedCurvature learned(const Model& model, const LackOfInformation& lack) const;
  /// What a fit of the same parameters learned; nothing of others.
  LackOfInformation known(const Model& model, const LearnedCurvature* other) const;
  /// The part of a step that stays within the bounds of every parameter, and moves none by too much at a time.
  Eigen::VectorXd within(const Point& from, Eigen::VectorXd step) const;
  Point moved(const Point& from, const Eigen::VectorXd& step) const;

 private:
  Eigen::Index count() const { return alphas_ + 1 + static_cast<Eigen::Index>(own_.size()); }
  Eigen::Index place_of(std::size_t parameter) const {
    return alphas_ + 1 + static_cast<Eigen::Index>(parameter);
  }
  void add_slopes_of_effects(const Point& point, const CellGeometry& geometry, Columns& means,
                             Columns& spreads) const;
  /// Adds the slopes of the log likelihood of every one-step prediction in the sequence's parameters; z: errors / spreads.
  void add_slopes_of_sequence(const Point& point, const Eigen::VectorXd& z, Columns& each) const;
  /// What does not move: what is held, and what its slope leads beyond a bound.
  std::vector<Eigen::Index> held(const Point& point, const Eigen::VectorXd& score) const;

  /// Those of effects.
  std::vector<std::pair<const Effect*, int>> parameters_of(const Model& model) const;

  const Rows& rows_;
  const RefitOptions& options_;
  Eigen::Index alphas_;
  std::vector<FreeParameter> own_;
  bool tails_;
};

std::vector<std::pair<const Effect*, int>> Scoring::parameters_of(const Model& model) const {
  std::vector<std::pair<const Effect*, int>> parameters;
  for (const FreeParameter& p : own_)
    parameters.emplace_back(model[static_cast<std::size_t>(p.effect)].effect, p.index);
  return parameters;
}

LearnedCurvature Scoring::learned(const Model& model, const LackOfInformation& lack) const {
  return {alphas_, parameters_of(model), lack.matrix()};
}

LackOfInformation Scoring::known(const Model& model, const LearnedCurvature* other) const {
  const bool same = other && other->alphas == alphas_ && other->parameters == parameters_of(model);
  return same ? LackOfInformation(other->lack) : LackOfInformation(count());
}

void Scoring::add_slopes_of_effects(const Point& point, const CellGeometry& geometry, Columns& means,
                                    Columns& spreads) const {
  struct Probe {  // a parameter, and its effect with a little more and less of it
    Eigen::Index place;
    int index;
    double step;
    ActiveEffect at, up, down;
  };
  std::vector<Probe> probes;
  for (std::size_t a = 0; a < own_.size(); ++a) {
    const FreeParameter& p = own_[a];
    if (p.acts == FreeParameter::Acts::numeric) continue;
    const ActiveEffect& active = point.model[static_cast<std::size_t>(p.effect)];
    const double step = difference_step(info_of(point.model, p), active.parameters[p.index]);
    probes.push_back({place_of(a), p.index, step, active, active, active});
    probes.back().up.parameters[p.index] += step;
    probes.back().down.parameters[p.index] -= step;
  }
  for (Eigen::Index i = 0; i < means.rows() && !probes.empty(); ++i) {
    const ReadingView<double> view = view_of(rows_, geometry, static_cast<std::size_t>(i));
    for (const Probe& probe : probes) {
      const Effect& effect = *probe.at.effect;
      ReadingChange<double> slope;
      if (const auto own = effect.slope(view, probe.at.parameters.data(), probe.index)) {
        slope = *own;
      } else {
        const auto high = effect.reading(view, probe.up.parameters.data()),
                   low = effect.reading(view, probe.down.parameters.data());
        slope.range = (high.range - low.range) / (2.0 * probe.step);
        slope.range_log_variance = (high.range_log_variance - low.range_log_variance) / (2.0 * probe.step);
      }
      means(i, probe.place) =
          geometry.stages.gain(effect.info().stage, rows_.cell[static_cast<std::size_t>(i)]) * slope.range;
      spreads(i, probe.place) = 0.5 * slope.range_log_variance;
    }
  }
}

ScoringSlopes Scoring::at(const Point& point) const {
  const auto n = static_cast<Eigen::Index>(rows_.size());
  const WorkingProblem& working = point.working;
  CellGeometry geometry = cell_geometry(rows_, point.state);
  geometry.stages = working.stages;
  Columns means = Columns::Zero(n, count()), spreads = means,
          levels = means;  // slopes of f, of ln s by effects, by the calibration
  const double power = geometry.spread_power;
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto cell = static_cast<std::size_t>(rows_.cell[static_cast<std::size_t>(i)]);
    double u = 1.0;
    for (Eigen::Index a = 0; a < alphas_; ++a, u *= geometry.u[cell]) {
      means(i, a) = u;
      levels(i, a) = power * u / geometry.f[cell];
    }
    levels(i, alphas_) = 1.0;
  }
  add_slopes_of_effects(point, geometry, means, spreads);
  if (working.rounding_share.size() > 0)  // stays as it is
    spreads -= working.rounding_share.asDiagonal() * (spreads + levels);
  const bool along = !working.serial.independent();
  if (tails_ && along)
    return slopes_of(point,
                     prediction_slopes(rows_, point.model, working, geometry,
                                       {std::move(means), std::move(spreads), std::move(levels)}, own_));
  Eigen::VectorXd root(n), z(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto cell = static_cast<std::size_t>(rows_.cell[static_cast<std::size_t>(i)]);
    root[i] = working.range_whitening.scale_of(i) / geometry.spread[cell];
    z[i] = root[i] * (working.range[i] - geometry.f[cell]);
  }
  Columns each;  // slopes of what every row adds to the log likelihood
  Columns of_means = z.cwiseProduct(root).asDiagonal() * means;
  if (!tails_) {
    spreads += levels;
    each = (z.array().square() - 1.0).matrix().asDiagonal() * spreads;
    each += of_means;
    if (along) {
      Columns of_z = -(z.asDiagonal() * spreads);
      of_z -= root.asDiagonal() * means;
      each += z.asDiagonal() * of_z;
      each -= working.serial.whitened(z).asDiagonal() * working.serial.whitened_columns(of_z);
      add_slopes_of_sequence(point, z, each);
    }
    return slopes_of(point, each);
  }
  const LawSlopes law = law_slopes(rows_, point.model, working, geometry, own_);
  each = Columns::Zero(n, count());
  each.rightCols(static_cast<Eigen::Index>(own_.size())) = law.in_parameters;
  each += law.in_spread.asDiagonal() * spreads;
  each += law.in_level.asDiagonal() * levels;
  each += of_means;
  return slopes_of(point, each);
}

ScoringSlopes Scoring::slopes_of(const Point& point, const Columns& each) const {
  ScoringSlopes out{each.colwise().sum().transpose(), each.transpose() * each, {}};
  for (std::size_t a = 0; a < own_.size(); ++a) {
    const double scale =
        own_[a].acts == FreeParameter::Acts::numeric ? 1.0 : size_of(info_of(point.model, own_[a]));
    out.information(place_of(a), place_of(a)) += 1e-6 / (scale * scale);
  }
  out.held = held(point, out.score);
  return out;
}

void Scoring::add_slopes_of_sequence(const Point& point, const Eigen::VectorXd& z, Columns& each) const {
  constexpr double h = 1e-4;  // of a logit
  for (std::size_t a = 0; a < own_.size(); ++a) {
    if (!is_of_sequence(rows_, point.model, own_[a])) continue;
    const auto bounds = bounds_of(rows_, point.model, own_[a]);
    const double logit = logit_between(bounds, value_of(point.model, own_[a]));
    const auto log_density = [&](double at) {  // of every prediction
      Model model = point.model;
      value_of(model, own_[a]) = at_logit(bounds, at);
      const SerialErrors errors = serial_errors_of(rows_, model);
      Eigen::VectorXd value = -0.5 * errors.whitened(z).array().square();
      for (Eigen::Index i = 0; i < value.size() && !errors.independent(); ++i)
        value[i] -= errors.log_spread(i);
      return value;
    };
    each.col(place_of(a)) += (log_density(logit + h) - log_density(logit - h)) / (2.0 * h);
  }
}

std::vector<Eigen::Index> Scoring::held(const Point& point, const Eigen::VectorXd& score) const {
  std::vector<Eigen::Index> stay;
  for (Eigen::Index a = 0; options_.held.alpha && a < alphas_; ++a) stay.push_back(a);
  if (options_.held.sigmas) stay.push_back(alphas_);
  for (std::size_t a = 0; a < own_.size(); ++a)
    if (is_stuck(rows_, point.model, own_[a], score[place_of(a)])) stay.push_back(place_of(a));
  return stay;
}

Eigen::VectorXd Scoring::within(const Point& from, Eigen::VectorXd step) const {
  constexpr double longest = 1.5;  // of a logarithm: a factor of 4.5
  const auto cut = [](double by, double limit) { return std::clamp(by, -limit, limit); };
  step[alphas_] = cut(step[alphas_], longest);
  for (std::size_t a = 0; a < own_.size(); ++a) {
    const FreeParameter& p = own_[a];
    const auto [low, high] = bounds_of(rows_, from.model, p);
    const double value = value_of(from.model, p);
    double& by = step[place_of(a)];
    if (is_of_sequence(rows_, from.model, p)) {
      const double logit = logit_between({low, high}, value);
      by = std::clamp(logit + cut(by, longest), -largest_logit, largest_logit) - logit;
    } else if (p.acts == FreeParameter::Acts::numeric) {
      by = value > 0.0 ? std::clamp(cut(by, longest), std::log(low / value), std::log(high / value)) : 0.0;
    } else {
      // A non-linear parameter moves by at most a third of its bounds at a time.
      const double limit =
          info_of(from.model, p).linear ? std::numeric_limits<double>::infinity() : 0.33 * (high - low);
      by = std::clamp(cut(by, limit), low - value, high - value);
    }
  }
  return step;
}

Point Scoring::moved(const Point& from, const Eigen::VectorXd& step) const {
  JointState state = from.state;
  Model model = from.model;
  state.alpha += step.head(alphas_);
  state.noise.parameters[0] *= std::exp(step[alphas_]);
  for (std::size_t a = 0; a < own_.size(); ++a) {
    const FreeParameter& p = own_[a];
    const auto [low, high] = bounds_of(rows_, model, p);
    double& value = value_of(model, p);
    const double by = step[place_of(a)];
    if (is_of_sequence(rows_, model, p)) {
      value = at_logit({low, high}, logit_between({low, high}, value) + by);
    } else {
      const double to = p.acts == FreeParameter::Acts::numeric ? value * std::exp(by) : value + by;
      value = std::clamp(to, low, high);
    }
  }
  return point_at(rows_, std::move(model), std::move(state));
}

}  // namespace

bool is_scored_jointly(const Rows& rows, const Model& model, const JointState& state,
                       const RefitOptions& options) {
  const Dependence dependence = dependence_of(model);
  const bool along = !rows.sequence.empty();
  const bool alone = static_cast<std::size_t>(rows.cell_count) == rows.size();  // every reading in its cell
  const bool exact = std::all_of(rows.problem.stops.begin(), rows.problem.stops.end(),
                                 [](const StopPrior& stop) { return stop.sigma_xy_m == 0.0; });
  const bool dependent = dependence.range_correlation != 0.0;
  return (has_tails(model) || (along && dependent)) && rows.pairs && exact && !rows.alpha_prior &&
         has_sigma(state.noise.law) && (alone || !has_grid(model)) && dependence.range_cell_sigma_m == 0.0 &&
         (along || !dependent) && !(options.held.alpha && options.held.sigmas);
}

namespace {

constexpr double far_off = 2.0;  ///< of the level of errors, in units of what is expected

/// The point with the level of the noise that its errors have, where they are far larger than it expects.
Point with_level_of_errors(const Rows& rows, Point point) {
  Eigen::VectorXd z = sequence_residuals(point.working, cell_geometry(rows, point.state));
  double squares = point.working.serial.whitened(std::move(z)).squaredNorm();
  if (point.working.tail_square.size() > 0) squares += point.working.tail_square.sum();
  const double level = std::sqrt(squares / static_cast<double>(rows.size()));
  if (!(level > far_off) || !std::isfinite(level)) return point;
  JointState state = point.state;
  state.noise.parameters[0] *= level;
  Point wider = point_at(rows, point.model, std::move(state));
  return wider.nll < point.nll ? wider : point;
}

/// Where scoring starts: at the state of `fit`, or, where most readings are outliers there (a member was taken out that had moved
/// them all), where the calibration is without tails, if that is likelier.
Point start_of(const Rows& rows, const RefitOptions& options, const Fit& fit) {
  Point start = with_level_of_errors(rows, point_at(rows, fit.model, fit.state));
  if (std::isfinite(start.nll) && level_of_errors(rows, start.working, start.state) < far_off) return start;
  Model others = fit.model;
  std::erase_if(others, is_tail);
  JointState state = fit.state;
  if (!std::isfinite(calibrate_under(rows, others, state, options))) return start;
  Point calibrated = point_at(rows, fit.model, with_robust_noise(rows, others, state));
  return calibrated.nll < start.nll ? calibrated : start;
}

}  // namespace

bool score_jointly(const Rows& rows, const RefitOptions& options, Fit& fit, MarginalFit& detail) {
  RefitOptions staying = options;
  staying.places_stay = true;
  const Scoring scoring(rows, fit, options);
  Point here = start_of(rows, staying, fit);
  if (!std::isfinite(here.nll)) return false;
  if (auto likeliest = likeliest_sequence(rows, fit.free, here.model, here.working, here.state)) {
    Point next = point_at(rows, std::move(likeliest->first), std::move(likeliest->second));
    if (next.nll < here.nll) here = std::move(next);
  }
  // A step costs one pass over the readings, an iteration of Gauss-Newton a calibration for each length that it tries.
  constexpr int steps_of_iteration = 4;
  LackOfInformation lack = scoring.known(here.model, options.learned.get());
  here = scored(
      "scoring", std::move(here), [&](const Point& point) { return scoring.at(point); },
      [&](const Point& point, const Eigen::VectorXd& step) { return scoring.within(point, step); },
      [&](const Point& point, const Eigen::VectorXd& step) { return scoring.moved(point, step); }, lack,
      std::min(many_steps, steps_of_iteration * options.max_iterations));
  fit.learned = std::make_shared<LearnedCurvature>(scoring.learned(here.model, lack));
  const double value = calibrate_under(rows, here.model, here.state, staying, &detail);
  if (!std::isfinite(value)) return false;
  fit.nll = value;
  fit.model = std::move(here.model);
  fit.state = std::move(here.state);
  return true;
}

}  // namespace rangecal::diagnosis
