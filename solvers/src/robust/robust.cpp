// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/robust/robust.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <tuple>
#include <utility>

#include "joint_ml/blocks.hpp"
#include "joint_ml/collapse.hpp"
#include "joint_ml/newton_step.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "robust/residual_shape.hpp"
#include "robust/robust_covariance.hpp"
#include "solver_log.hpp"

namespace rangecal {
namespace {

constexpr int max_iterations = 200;

/// When the iterations end: when one gains no more than `settled` [nats], or after so many.
struct IterationLimits {
  double settled = 1e-5;
  int most = max_iterations;
};
/// What models and families are told apart by.
constexpr IterationLimits rough_limits{1e-2, 10};
constexpr double no_fit_nll = std::numeric_limits<double>::infinity();

/// The readings beside the cells of Gaussian readings that stand for them.
class Rows {
 public:
  explicit Rows(const JointProblem& rows) : rows_(rows) {
    for (double count : rows.cells.count)
      if (count != 1.0 && !rows.rows_alike)
        throw InputError("robust noise shapes need every reading as a cell of its own (Grouping::rows)");
    merged_ = merge_rows(rows, {}, &cell_);
  }

  double count() const { return rows_.readings; }
  bool reads_bearings() const { return rows_.reads_bearings; }
  const JointProblem& rows() const { return rows_; }

  /// Errors in spreads, those of bearings empty where there are none; false where a distance or a spread is not positive.
  bool residuals(const JointState& state, ChannelResiduals& range, ChannelResiduals& bearing) const {
    const Cells& r = rows_.cells;
    const std::size_t count = r.size();
    for (ChannelResiduals* one : {&range, &bearing}) {
      const std::size_t read = one == &range || rows_.reads_bearings ? count : 0;
      one->z.resize(read);
      one->s.resize(read);
      if (rows_.rows_alike) one->weight = r.count;
    }
    double f = 0.0, s = 1.0, direction = 0.0, d = 0.0;
    for (std::size_t i = 0; i < count; ++i) {
      if (i == 0 || cell_[i] != cell_[i - 1]) {
        const Sight sight(state.landmarks[r.landmark[i]], state.stops[r.stop[i]], r.radius_m[i]);
        d = sight.d;
        f = evaluate_polynomial(state.alpha, d);
        s = state.noise.spread(d, f);
        direction = sight.bearing;
        if (!(d > 0.0) || !(s > 0.0)) return false;
      }
      range.z[i] = (r.range_mean[i] - f - r.effect_change(i, d)) / s;
      range.s[i] = s;
      if (!rows_.reads_bearings) continue;
      bearing.z[i] = wrap_angle(r.bearing_mean[i] - direction) / state.sigma_theta_rad;
      bearing.s[i] = state.sigma_theta_rad;
    }
    return true;
  }

  /// The problem of the readings under their shapes at given residuals.
  const JointProblem& weighted(const ChannelResiduals& range, const NoiseShapeParameters& range_shape,
                               const ChannelResiduals& bearing, const NoiseShapeParameters& bearing_shape) {
    Cells& c = merged_.cells;
    const Cells& r = rows_.cells;
    take(
        range, range_shape, c.range_weight, c.range_mean, c.range_mean_square,
        [&](std::size_t i, std::size_t) { return r.range_mean[i]; },
        rows_.rows_alike ? &r.range_mean_square : nullptr, work_);
    if (!rows_.reads_bearings) return merged_;
    take(
        bearing, bearing_shape, c.bearing_weight, c.bearing_mean, c.bearing_mean_square,
        [&](std::size_t i,
            std::size_t first) {  // unwrapped about the landmark's direction, not about an outlier
          return r.bearing_mean[first] - bearing.z[first] * bearing.s[first] + bearing.z[i] * bearing.s[i];
        },
        rows_.rows_alike ? &r.bearing_mean_square : nullptr, work_);
    for (double& mean : c.bearing_mean) mean = wrap_angle(mean);
    return merged_;
  }

  /// sum w (z - shift)^2 + extra of either channel, the weights and shifts those of the last weighted().
  std::pair<double, double> squares_at(const JointState& state) const {
    const Cells& c = merged_.cells;
    double range = 0.0, bearing = 0.0;
    for (std::size_t i = 0; i < c.size(); ++i) {
      const Sight sight(state.landmarks[c.landmark[i]], state.stops[c.stop[i]], c.radius_m[i]);
      const double f = evaluate_polynomial(state.alpha, sight.d), s = state.noise.spread(sight.d, f),
                   off = c.range_mean[i] - f - c.effect_change(i, sight.d),
                   turn = wrap_angle(c.bearing_mean[i] - sight.bearing);
      range += c.range_weight[i] * (off * off + c.range_mean_square[i]) / (s * s);
      bearing += c.bearing_weight[i] * (turn * turn + c.bearing_mean_square[i]);
    }
    return {range, bearing / (state.sigma_theta_rad * state.sigma_theta_rad)};
  }

 private:
  /// Weight, mean and mean square deviation of every cell.
  template <typename Reading>
  void take(const ChannelResiduals& residuals, const NoiseShapeParameters& shape, std::vector<double>& weight,
            std::vector<double>& mean, std::vector<double>& mean_square, const Reading& reading,
            const std::vector<double>* own_square, std::vector<LogDensity>& of_row) {
    const ShapeDensity density_at(shape);
    const std::size_t count = residuals.z.size();
    of_row.resize(count);
    for (std::size_t begin = 0; begin < count;) {
      std::size_t end = begin;
      const std::size_t cell = static_cast<std::size_t>(cell_[begin]);
      double w = 0.0, sum = 0.0, square = 0.0;
      for (; end < count && cell_[end] == cell_[begin]; ++end) {
        const LogDensity at = density_at(residuals.z[end], residuals.s[end]);
        const double count_of_row = residuals.weight_of(end);
        of_row[end] = at;
        w += count_of_row * at.weight;
        sum += count_of_row * at.weight * (reading(end, begin) - residuals.s[end] * at.shift);
      }
      const double at = sum / w;
      for (std::size_t i = begin; i < end; ++i) {
        const double off = reading(i, begin) - residuals.s[i] * of_row[i].shift - at;
        square += residuals.weight_of(i) *
                  (of_row[i].weight * off * off + of_row[i].extra_square * residuals.s[i] * residuals.s[i]);
        if (own_square) square += residuals.weight_of(i) * of_row[i].weight * (*own_square)[i];
      }
      weight[cell] = w;
      mean[cell] = at;
      mean_square[cell] = square / w;
      begin = end;
    }
  }

  const JointProblem& rows_;
  JointProblem merged_;
  std::vector<int> cell_;
  std::vector<LogDensity> work_;
};

double nll_of(const ChannelResiduals& residuals, const NoiseShapeParameters& shape) {
  const ShapeDensity density_at(shape);
  double sum = 0.0;
  for (std::size_t i = 0; i < residuals.z.size(); ++i)
    sum += residuals.weight_of(i) *
           (std::log(residuals.s[i]) - density_at(residuals.z[i], residuals.s[i]).value);
  return sum;
}

/// Squared extrapolation (Varadhan and Roland 2008, SQUAREM, scheme S3) of states that iterations of expectation and
/// maximisation pass through, x = x0 - 2 a r + a^2 v with r = x1 - x0, v = x2 - 2 x1 + x0, a = -|r| / |v|, the lengths
/// taken in the readings' errors, which have one unit. None before three states are there.
class Squarem {
 public:
  std::optional<JointState> after(const JointState& state, const ChannelResiduals& range,
                                  const ChannelResiduals& bearing) {
    Point point{state, range.z};
    point.z.insert(point.z.end(), bearing.z.begin(), bearing.z.end());
    points_.push_back(std::move(point));
    if (points_.size() < 3) return std::nullopt;
    double r_sq = 0.0, v_sq = 0.0;
    for (std::size_t i = 0; i < points_[0].z.size(); ++i) {
      // An outlier's error is of no account, and large.
      const double r = points_[1].z[i] - points_[0].z[i], v = points_[2].z[i] - points_[1].z[i] - r;
      const double weight = 1.0 / (1.0 + points_[0].z[i] * points_[0].z[i]);
      r_sq += weight * r * r;
      v_sq += weight * v * v;
    }
    const double a = v_sq > 0.0 ? -std::clamp(std::sqrt(r_sq / v_sq), 1.0, 20.0) : -1.0;
    const double c0 = (1.0 + a) * (1.0 + a), c1 = -2.0 * a * (1.0 + a),
                 c2 = a * a;  // of x0, x1, x2; they sum to 1
    const JointState &x0 = points_[0].state, &x1 = points_[1].state, &x2 = points_[2].state;
    const auto mix = [&](double p0, double p1, double p2) { return c0 * p0 + c1 * p1 + c2 * p2; };
    const auto mix_logs = [&](double p0, double p1, double p2) {
      return std::exp(mix(std::log(p0), std::log(p1), std::log(p2)));
    };
    JointState x = x2;
    x.alpha = c0 * x0.alpha + c1 * x1.alpha + c2 * x2.alpha;
    if (!has_sigma(x.noise.law))
      x.noise.parameters = c0 * x0.noise.parameters + c1 * x1.noise.parameters + c2 * x2.noise.parameters;
    else
      x.noise.parameters[0] =
          mix_logs(x0.noise.parameters[0], x1.noise.parameters[0], x2.noise.parameters[0]);
    x.sigma_theta_rad = mix_logs(x0.sigma_theta_rad, x1.sigma_theta_rad, x2.sigma_theta_rad);
    for (std::size_t l = 0; l < x.landmarks.size(); ++l)
      x.landmarks[l] = c0 * x0.landmarks[l] + c1 * x1.landmarks[l] + c2 * x2.landmarks[l];
    for (std::size_t k = 0; k < x.stops.size(); ++k) {
      x.stops[k].x_m = mix(x0.stops[k].x_m, x1.stops[k].x_m, x2.stops[k].x_m);
      x.stops[k].y_m = mix(x0.stops[k].y_m, x1.stops[k].y_m, x2.stops[k].y_m);
      x.stops[k].heading_rad = mix(x0.stops[k].heading_rad, x1.stops[k].heading_rad, x2.stops[k].heading_rad);
    }
    points_.clear();
    return x;
  }
  void restart() { points_.clear(); }

 private:
  struct Point {
    JointState state;
    std::vector<double> z;
  };
  std::vector<Point> points_;
};

double laplace_part(const JointFit&) { return 0.0; }
double laplace_part(const MarginalFit& fit) { return fit.marginal_nll - fit.joint_nll; }
/// Its sigmas and nu are not those of the lowest likelihood but REML's.
constexpr bool is_restricted(const JointFit&) { return false; }
constexpr bool is_restricted(const MarginalFit&) { return true; }
/// What a solve of nearly the same problem begins with, if it need not be exact: how phi-hat turns with sigma would stay what it was
/// at the first weights.
void begin_with(const JointFit&, bool, JointOptions&) {}
void begin_with(const MarginalFit& fit, bool rough, MarginalOptions& options) {
  options.begin = rough ? fit.reml : std::nullopt;
}

int free_count(const JointProblem& problem, const JointState& state, const Held& held, bool sigma_s) {
  const JointLayout layout(problem, static_cast<int>(state.alpha.size()),
                           static_cast<int>(state.noise.parameters.size()), sigma_s);
  const int silent = problem.reads_bearings || held.sigmas ? 0 : 1;
  return static_cast<int>(free_globals(layout, held).size()) - silent;
}

/// Where a fit of given families starts.
struct ShapeStart {
  ResidualShape range, bearing;
  bool held = false;  ///< the shapes' parameters stay

  int parameters() const {
    return held ? 0 : shape_parameter_count(range.shape.shape) + shape_parameter_count(bearing.shape.shape);
  }
};

ShapeStart start_of(const RobustShapes& shapes, bool held) {
  ShapeStart start;
  start.range.shape = shapes.range;
  start.bearing.shape = shapes.bearing;
  start.held = held;
  return start;
}

template <typename Robust, typename Options, typename Solve>
class RobustSolver {
 public:
  RobustSolver(const JointProblem& problem, Options options, int parameters, Solve solve)
      : rows_(problem), options_(std::move(options)), parameters_(parameters), solve_(std::move(solve)) {}

  Robust gaussian(const JointState& start) {
    Robust best;
    if (!rows_.residuals(start, range_, bearing_)) return outside_domain(best);
    best.fit =
        solve_(rows_.weighted(range_, best.shapes.range, bearing_, best.shapes.bearing), start, options_);
    best.shapes.nll = value(best);
    best.shapes.iterations = 1;
    finish(start, 0, best);
    return best;
  }

  /// Shapes of the residuals at `start`, the families given.
  ShapeStart first(const JointState& start, ChannelShapes families) {
    ShapeStart first;
    if (!rows_.residuals(start, range_, bearing_)) return first;
    first.range = fit_residual_shape(range_, first_residual_shape(range_, families.range));
    if (rows_.reads_bearings())
      first.bearing = fit_residual_shape(bearing_, first_residual_shape(bearing_, families.bearing));
    return first;
  }

  Robust shaped(const JointState& start, const ShapeStart& from, const IterationLimits& until = {});
  /// `until`: of the families chosen in the end.
  Robust automatic(const JointState& start, ChannelShapes asked, const IterationLimits& until);

 private:
  static Robust& outside_domain(Robust& fit) {
    fit.fit.reason = "the start lies outside the model's domain: a distance or a spread is not positive";
    fit.shapes.nll = fit.shapes.aic = no_fit_nll;
    return fit;
  }
  /// True where the readings are likelier at state a than at b, shapes of these families fitted to its residuals.
  bool likelier(const JointState& a, const JointState& b, ChannelShapes families) {
    const auto nll = [&](const JointState& at) {
      if (!rows_.residuals(at, range_, bearing_)) return no_fit_nll;
      double sum = joint_nll_parts(rows_.rows(), at).stops;
      for (std::size_t i = 0; i < range_.s.size(); ++i) sum += range_.weight_of(i) * std::log(range_.s[i]);
      sum += fit_residual_shape(range_, first_residual_shape(range_, families.range)).nll;
      if (!rows_.reads_bearings()) return sum;
      sum += bearing_.count() * std::log(at.sigma_theta_rad);
      return sum + fit_residual_shape(bearing_, first_residual_shape(bearing_, families.bearing)).nll;
    };
    return nll(a) < nll(b);
  }
  /// The objective of the shapes at the end of a fit; leaves the residuals there.
  double value(const Robust& at) {
    if (!std::isfinite(at.fit.joint_nll) || at.fit.outcome == Outcome::failed) return no_fit_nll;
    if (!rows_.residuals(at.fit.state, range_, bearing_)) return no_fit_nll;
    const JointNllParts parts = joint_nll_parts(rows_.rows(), at.fit.state);
    return nll_of(range_, at.shapes.range) + nll_of(bearing_, at.shapes.bearing) + parts.stops + parts.taped +
           laplace_part(at.fit);
  }
  void finish(const JointState& start, int shape_parameters, Robust& best) const {
    if (const std::string collapsed = collapsed_sigma(start, best.fit.state); !collapsed.empty()) {
      best.fit.outcome = Outcome::unbounded;
      best.fit.reason = "with this noise shape the likelihood has no maximum: " + collapsed;
    }
    best.shapes.aic = 2.0 * (best.shapes.nll + parameters_ + shape_parameters);
  }
  /// Covariance and standard deviations of the shapes delivered.
  void fill_deviations(Robust& best) {
    if (!rows_.residuals(best.fit.state, range_, bearing_)) return;
    RobustShapes& shapes = best.shapes;
    const JointProblem& weighted = rows_.weighted(range_, shapes.range, bearing_, shapes.bearing);
    const auto [of_range, of_bearing] = rows_.squares_at(best.fit.state);
    ShapeAtEstimate range{shapes.range, of_range, {}, range_.typical_spread()};
    ShapeAtEstimate bearing{shapes.bearing, of_bearing, {}, best.fit.state.sigma_theta_rad};
    set_robust_covariance(weighted, is_restricted(best.fit), range, bearing, best.fit);
    shapes.range_std = range.shape_std;
    shapes.bearing_std = bearing.shape_std;
  }
  ResidualShape renewed(const ChannelResiduals& residuals, const NoiseShapeParameters& shape, double squares,
                        double tolerance) const {
    if (residuals.z.empty()) return {};
    ResidualShapeOptions options;
    if (is_restricted(decltype(Robust::fit)())) options.fitted = std::max(0.0, rows_.count() - squares);
    options.tolerance = tolerance;
    ResidualShape start;
    start.shape = shape;
    return fit_residual_shape(residuals, start, options);
  }

  Rows rows_;
  Options options_;
  int parameters_;
  Solve solve_;
  ChannelResiduals range_, bearing_;
};

template <typename Robust, typename Options, typename Solve>
Robust RobustSolver<Robust, Options, Solve>::shaped(const JointState& start, const ShapeStart& from,
                                                    const IterationLimits& until) {
  SolverLog log("robust");
  if (log.on())
    log.of(fmt::format("{}, {} ranges, {} bearings", curve_in_words(start.alpha.size(), start.noise.law),
                       to_string(from.range.shape.shape), to_string(from.bearing.shape.shape)));
  Robust best, at;
  at.fit.state = start;
  at.shapes.range = from.range.shape;
  at.shapes.bearing = from.bearing.shape;
  if (!options_.held.sigmas) {
    at.fit.state.noise.parameters *= from.range.scale;
    at.fit.state.sigma_theta_rad *= from.bearing.scale;
  }
  const bool restricted = is_restricted(at.fit), renews = !from.held && !options_.held.sigmas;
  double last = no_fit_nll, change = no_fit_nll;
  Squarem squarem;
  bool extrapolated = false;
  int iterations = 0;
  for (; iterations < until.most; ++iterations) {
    JointState state = at.fit.state;
    if (!rows_.residuals(state, range_, bearing_)) break;
    if (iterations > 0) {
      const auto [of_range, of_bearing] = rows_.squares_at(state);
      extrapolated = false;
      if (const auto further = squarem.after(state, range_, bearing_)) {
        ChannelResiduals range, bearing;
        if (rows_.residuals(*further, range, bearing) &&
            nll_of(range, at.shapes.range) + nll_of(bearing, at.shapes.bearing) <
                nll_of(range_, at.shapes.range) + nll_of(bearing_, at.shapes.bearing) + 5.0) {
          extrapolated = true;
          state = *further;
          range_ = std::move(range);
          bearing_ = std::move(bearing);
        }
      }
      if (renews) {
        const double tolerance = std::clamp(1e-3 * change, 1e-9, 1e-3);
        const ResidualShape range = renewed(range_, at.shapes.range, of_range, tolerance),
                            bearing = renewed(bearing_, at.shapes.bearing, of_bearing, tolerance);
        at.shapes.range = range.shape;
        at.shapes.bearing = bearing.shape;
        state.noise.parameters *= range.scale;
        state.sigma_theta_rad *= bearing.scale;
        rows_.residuals(state, range_, bearing_);
      }
    }
    const JointProblem& weighted = rows_.weighted(range_, at.shapes.range, bearing_, at.shapes.bearing);
    Options options = options_;
    const bool rough = change > 1e-2;
    if (rough) options.gradient_tolerance = std::max(options.gradient_tolerance, 1e-3);
    begin_with(at.fit, rough, options);
    at.fit = solve_(weighted, state, options);
    const double now = value(at);
    log.iteration(iterations + 1, now, not_known, at.fit.gradient_norm);
    if (extrapolated && !(now < last + 1e-3)) {  // too far: back to where the iterations stood
      at = best;
      squarem.restart();
      rows_.residuals(at.fit.state, range_, bearing_);
      rows_.weighted(range_, at.shapes.range, bearing_, at.shapes.bearing);
      continue;
    }
    // REML's fixed point lies a little above the lowest likelihood: there the iterations end where it stands still.
    if (iterations == 0 || (std::isfinite(now) && (now < last || restricted))) {
      best = at;
      best.shapes.nll = now;
    }
    change = restricted ? std::abs(last - now) : last - now;
    if (!std::isfinite(now) || !(change > until.settled)) break;
    last = now;
  }
  best.shapes.iterations = std::min(iterations + 1, until.most);
  if (best.fit.state.alpha.size() == 0) {
    log.end(best.shapes.iterations, not_known, "the start lies outside the model's domain");
    return outside_domain(best);
  }
  fill_deviations(best);
  finish(start, from.parameters(), best);
  if (iterations == max_iterations && best.fit.outcome == Outcome::converged) {
    best.fit.outcome = Outcome::not_converged;
    best.fit.reason = "the weights of the noise shape did not settle";
  }
  log.end(best.shapes.iterations, best.shapes.nll, best.fit.gradient_norm, best.fit.outcome, best.fit.reason);
  return best;
}

std::vector<std::pair<NoiseShape, double>> above_best(const RankedShapes& ranked) {
  std::vector<std::pair<NoiseShape, double>> tried;
  for (const auto& [fit, aic] : ranked) tried.emplace_back(fit.shape.shape, aic - ranked.front().second);
  return tried;
}

template <typename Robust, typename Options, typename Solve>
Robust RobustSolver<Robust, Options, Solve>::automatic(const JointState& start, ChannelShapes asked,
                                                       const IterationLimits& until) {
  Robust best = gaussian(start);
  const bool usable = is_usable(best.fit.outcome);
  const JointState& gaussian_end = usable ? best.fit.state : start;
  if (!rows_.residuals(gaussian_end, range_, bearing_)) return best;
  if (usable && !may_have_outliers(range_) && (!rows_.reads_bearings() || !may_have_outliers(bearing_)))
    return best;
  const auto any_of = [](NoiseShape asked_for, std::span<const NoiseShape> all, const NoiseShape& own) {
    return asked_for == NoiseShape::automatic ? all : std::span<const NoiseShape>(&own, 1);
  };
  const auto rank = [&] {
    return std::pair(rank_shapes(range_, any_of(asked.range, range_shapes(), asked.range)),
                     !rows_.reads_bearings()
                         ? RankedShapes(1)
                         : rank_shapes(bearing_, any_of(asked.bearing, bearing_shapes(), asked.bearing)));
  };
  // The Gaussian's end may be where outliers drew it: the start is kept where Student's t, which no outlier breaks, likes
  // it better.
  const auto without_outliers = [](NoiseShape asked_for) {
    return asked_for == NoiseShape::automatic ? NoiseShape::student_t : asked_for;
  };
  const ChannelShapes safe_shapes(without_outliers(asked.range), without_outliers(asked.bearing));
  JointState from = usable && likelier(gaussian_end, start, safe_shapes) ? gaussian_end : start;
  rows_.residuals(from, range_, bearing_);
  auto [of_range, of_bearing] = rank();
  // A channel whose families gain too little stays Gaussian.
  const auto best_of = [](const RankedShapes& ranked) -> const ResidualShape& {
    if (ranked.front().second < -shape_margin_aic) return ranked.front().first;
    for (const auto& [fit, aic] : ranked)
      if (fit.shape.shape == NoiseShape::gaussian) return fit;
    return ranked.front().first;
  };
  constexpr int most_tries = 3;
  std::vector<std::pair<NoiseShape, NoiseShape>> tried;
  for (int attempt = 0; attempt < most_tries; ++attempt) {
    const ShapeStart chosen{best_of(of_range), best_of(of_bearing)};
    const std::pair families(chosen.range.shape.shape, chosen.bearing.shape.shape);
    if (ChannelShapes(families.first, families.second).gaussian()) break;
    if (std::find(tried.begin(), tried.end(), families) != tried.end()) break;
    tried.push_back(families);
    Robust fit = shaped(from, chosen, rough_limits);
    if (is_usable(fit.fit.outcome)) from = fit.fit.state;
    const bool first_shape = ChannelShapes(best.shapes.range.shape, best.shapes.bearing.shape).gaussian();
    const double margin = first_shape ? shape_margin_aic : 0.0;
    if (is_usable(fit.fit.outcome) &&
        (!is_usable(best.fit.outcome) || fit.shapes.aic < best.shapes.aic - margin))
      best = std::move(fit);
    if (!rows_.residuals(from, range_, bearing_)) break;
    std::tie(of_range, of_bearing) = rank();
  }
  if (!ChannelShapes(best.shapes.range.shape, best.shapes.bearing.shape).gaussian())
    best = shaped(JointState(best.fit.state), start_of(best.shapes, false), until);
  best.shapes.range_tried = above_best(of_range);
  best.shapes.bearing_tried = above_best(of_bearing);
  return best;
}

template <typename Robust, typename Options, typename Solve>
Robust robust(RobustSolver<Robust, Options, Solve> solver, const JointState& start, ChannelShapes shapes,
              const IterationLimits& until = {}) {
  if (shapes.gaussian()) return solver.gaussian(start);
  if (shapes.automatic()) return solver.automatic(start, shapes, until);
  return solver.shaped(start, solver.first(start, shapes), until);
}

auto joint_solver(const JointProblem& rows, const JointState& start, const JointOptions& options) {
  const auto solve = [](const JointProblem& weighted, const JointState& at, const JointOptions& with) {
    return solve_joint_block(weighted, at, with);
  };
  return RobustSolver<RobustJointFit, JointOptions, decltype(solve)>(
      rows, options, free_count(rows, start, options.held, false), solve);
}

auto marginal_solver(const JointProblem& rows, const JointState& start, const MarginalOptions& options) {
  const auto solve = [](const JointProblem& weighted, const JointState& at, const MarginalOptions& with) {
    return solve_marginal(weighted, at, with);
  };
  return RobustSolver<RobustMarginalFit, MarginalOptions, decltype(solve)>(
      rows, options, free_count(rows, start, options.held, options.estimate_sigma_s), solve);
}

}  // namespace

RobustJointFit solve_joint_robust(const JointProblem& rows, const JointState& start, ChannelShapes shapes,
                                  const JointOptions& options) {
  return robust(joint_solver(rows, start, options), start, shapes);
}

RobustMarginalFit solve_marginal_robust(const JointProblem& rows, const JointState& start,
                                        ChannelShapes shapes, const MarginalOptions& options, bool rough) {
  return robust(marginal_solver(rows, start, options), start, shapes,
                rough ? rough_limits : IterationLimits());
}

RobustMarginalFit solve_marginal_robust(const JointProblem& rows, const JointState& start,
                                        const RobustShapes& shapes, const MarginalOptions& options,
                                        bool rough) {
  return marginal_solver(rows, start, options)
      .shaped(start, start_of(shapes, false), rough ? rough_limits : IterationLimits());
}

std::optional<RobustShapes> better_shapes(const JointProblem& rows, const JointState& state,
                                          const RobustShapes& shapes) {
  constexpr double matters = 4.0;
  const Rows of(rows);
  ChannelResiduals range, bearing;
  if (!of.residuals(state, range, bearing)) return std::nullopt;
  RobustShapes better = shapes;
  bool any = false;
  const auto look = [&](const ChannelResiduals& residuals, std::span<const NoiseShape> families,
                        NoiseShapeParameters& own) {
    const RankedShapes ranked = rank_shapes(residuals, families);
    for (const auto& [fit, aic] : ranked)
      if (fit.shape.shape == own.shape && aic - ranked.front().second > matters) {
        own = ranked.front().first.shape;
        any = true;
        break;
      }
  };
  look(range, range_shapes(), better.range);
  if (rows.reads_bearings) look(bearing, bearing_shapes(), better.bearing);
  return any ? std::optional(better) : std::nullopt;
}

RobustJointFit solve_joint_with_shapes(const JointProblem& rows, const JointState& start,
                                       const RobustShapes& held, const JointOptions& options) {
  return joint_solver(rows, start, options).shaped(start, start_of(held, true));
}

RobustNll robust_nll(const JointProblem& rows, const JointState& state, const NoiseShapeParameters& range,
                     const NoiseShapeParameters& bearing) {
  Rows of(rows);
  RobustNll out;
  const JointNllParts parts = joint_nll_parts(rows, state);
  ChannelResiduals range_residuals, bearing_residuals;
  if (!std::isfinite(parts.total()) || !of.residuals(state, range_residuals, bearing_residuals)) return out;
  const LaplaceValue laplace =
      laplace_marginal(of.weighted(range_residuals, range, bearing_residuals, bearing), state);
  out.ok = laplace.ok;
  out.joint = nll_of(range_residuals, range) + nll_of(bearing_residuals, bearing) + parts.stops + parts.taped;
  out.marginal = out.joint + laplace.marginal_nll - laplace.joint_nll;
  return out;
}

JointProblem weighted_problem(const JointProblem& rows, const JointState& state,
                              const NoiseShapeParameters& range, const NoiseShapeParameters& bearing) {
  Rows of(rows);
  ChannelResiduals range_residuals, bearing_residuals;
  if (!of.residuals(state, range_residuals, bearing_residuals))
    throw InputError("weights of a noise shape: a distance or a spread is not positive at the state given");
  return of.weighted(range_residuals, range, bearing_residuals, bearing);
}

ReadingErrors reading_errors(const JointProblem& rows, const JointState& state,
                             const NoiseShapeParameters& range, const NoiseShapeParameters& bearing) {
  const Rows of(rows);
  ReadingErrors errors;
  ChannelResiduals range_residuals, bearing_residuals;
  if (!of.residuals(state, range_residuals, bearing_residuals)) return errors;
  const auto outliers = [](const ChannelResiduals& residuals, const NoiseShapeParameters& shape) {
    const ShapeDensity density_at(shape);
    std::vector<double> result;
    for (std::size_t i = 0; i < residuals.z.size(); ++i)
      result.push_back(density_at(residuals.z[i], residuals.s[i]).outlier);
    return result;
  };
  errors.range_outlier = outliers(range_residuals, range);
  errors.bearing_outlier = outliers(bearing_residuals, bearing);
  errors.range_z = std::move(range_residuals.z);
  errors.range_s = std::move(range_residuals.s);
  errors.bearing_z = std::move(bearing_residuals.z);
  errors.bearing_z.resize(errors.range_z.size(), 0.0);
  errors.bearing_outlier.resize(errors.range_z.size(), 0.0);
  return errors;
}

}  // namespace rangecal
