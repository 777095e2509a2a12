// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/pairs_ml/pairs_ml.hpp"

#include <fmt/ranges.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "least_absolute.hpp"
#include "pairs_newton.hpp"
#include "pairs_reml.hpp"
#include "pairs_report.hpp"
#include "pairs_shape.hpp"
#include "rangecal/core/errors.hpp"
#include "solver_log.hpp"

namespace rangecal {
namespace {

using pairs_ml::NewtonResult;
using pairs_ml::ScaledPairs;

int noise_count(const PairsOptions& options) { return parameter_count(options.law, options.noise_order); }

PairsFit empty_fit(const PairsProblem& problem, Method method) {
  PairsFit fit;
  fit.calibration.method = method;
  fit.calibration.kind = RecordingKind::pairs;
  fit.calibration.counts = problem.counts;
  if (problem.size() > 0) {
    fit.calibration.range_min_m = problem.true_m.front();
    fit.calibration.range_max_m = problem.true_m.back();
  }
  fit.nll = std::numeric_limits<double>::quiet_NaN();
  return fit;
}

/// The smallest, in vectors as std::min_element is not: a twentieth of a fit of 1000 readings (pairs_speed).
double lowest(const std::vector<double>& values) {
  return Eigen::Map<const Eigen::ArrayXd>(values.data(), static_cast<Eigen::Index>(values.size())).minCoeff();
}

/// True, with the outcome and its reason set, where the model's domain excludes the readings.
bool outside_domain(const PairsProblem& problem, const PairsOptions& options, Calibration& calibration) {
  const NoiseForm form = form_of(options.law);
  if (form.power_of_d > 0 && !(problem.true_m.front() > 0.0)) {
    calibration.reason = fmt::format("noise law {} needs distances above 0, got {} m", to_string(options.law),
                                     problem.true_m.front());
  } else if (form.power_of_f > 0 && lowest(problem.mean_m) <= 0.0) {
    calibration.reason = fmt::format("noise law {} needs readings above 0", to_string(options.law));
  } else {
    return false;
  }
  calibration.outcome = Outcome::failed;
  return true;
}

std::string caution(const Calibration& calibration, const char* kind) {
  return fmt::format(
      "from the {} information at the estimate{}", kind,
      calibration.method == Method::full ? "; the noise is not corrected for the coefficients fitted" : "");
}

void set_nll(PairsFit& fit, double nll, int parameters) {
  fit.nll = nll;
  fit.calibration.joint_nll = fit.calibration.marginal_nll = nll;
  fit.calibration.aic = 2.0 * (nll + parameters);
}

/// Delivers where a fit of another shape than the Gaussian came to; `marginal` corrects its noise.
void take_other_shape(const PairsProblem& problem, const ScaledPairs& scaled,
                      const pairs_ml::ShapeResult& shaped, int order, const PairsOptions& options,
                      Method method, PairsFit& fit) {
  Calibration& calibration = fit.calibration;
  fit.shape = shaped.shape;
  fit.shape_std = shaped.shape_std;
  calibration.iterations = shaped.iterations;
  calibration.outcome = shaped.outcome;
  if (!is_usable(shaped.outcome)) {
    calibration.reason = fmt::format("the {} likelihood did not reach an optimum", to_string(options.shape));
    if (shaped.x.size() == 0) return;
  }
  pairs_ml::Vector x = shaped.x.head(scaled.unknowns());
  fit.gradient_norm = shaped.gradient_norm;
  double nll = shaped.nll;
  if (method == Method::marginal) {
    const PairsProblem rows = pairs_as_rows(problem, shaped.weights);
    const ScaledPairs weighted(rows, order, options.law, options.noise_order, options.parallel_from);
    NewtonResult start = pairs_ml::minimise(weighted, x, weighted.unknowns(), options.max_iterations, 1e-8);
    const NewtonResult corrected = pairs_ml::restricted(weighted, start, options.max_iterations);
    if (corrected.outcome == Outcome::converged) {
      x = corrected.x;
      const pairs_ml::ShapePairs likelihood(problem, scaled, options.law, options.shape,
                                            shaped.shape.outlier_mean < 0.0);
      nll = likelihood.evaluate(likelihood.internal(x, shaped.shape), nullptr);
    }
  }
  calibration.alpha = scaled.alpha(x);
  calibration.noise = scaled.noise(x);
  set_nll(fit, nll, scaled.unknowns() + shape_parameter_count(options.shape));
  calibration.covariance_reason =
      shaped.covariance.size() > 0
          ? caution(calibration, "observed") +
                (shaped.at_limit ? "; a shape parameter is held at its limit" : "")
          : fmt::format("the {} likelihood has no regular second derivatives at the estimate",
                        to_string(options.shape));
  pairs_ml::Matrix covariance;
  if (shaped.covariance.size() > 0) {
    const pairs_ml::Matrix J = scaled.jacobian(x);
    covariance = J * shaped.covariance * J.transpose();
  }
  pairs_ml::set_covariance(calibration, covariance, calibration.range_max_m);
}

/// Every reading lies on the curve.
void set_unbounded(Calibration& calibration) {
  calibration.outcome = Outcome::unbounded;
  calibration.reason = fmt::format(
      "a curve of order {} passes through every reading (alpha = {:.6g}): there is no noise, "
      "sigma goes to 0 and the likelihood has no maximum",
      calibration.order(), fmt::join(calibration.alpha, ", "));
  calibration.covariance_reason = "the likelihood has no maximum";
}

PairsFit fit_order(const PairsProblem& problem, int order, const PairsOptions& options, Method method,
                   const pairs_ml::NestedFit* nested = nullptr);

/// One order, one shape. `method` full or marginal.
PairsFit fit_one_order(const PairsProblem& problem, int order, const PairsOptions& options, Method method,
                       const pairs_ml::NestedFit* nested) {
  PairsFit fit = empty_fit(problem, method);
  Calibration& calibration = fit.calibration;
  const int unknowns = order + 1 + noise_count(options) + shape_parameter_count(options.shape);
  if (problem.readings() < unknowns) {
    calibration.outcome = Outcome::too_few_data;
    calibration.reason = fmt::format("{} readings for {} unknowns", problem.row_true_m.size(), unknowns);
    return fit;
  }
  if (outside_domain(problem, options, calibration)) return fit;

  const int distinct = static_cast<int>(problem.size());
  const int noise_unknowns = noise_count(options);
  if (distinct < order + 1 || distinct < noise_unknowns) {
    const Eigen::VectorXd unseen = pairs_ml::unseen_polynomial(problem.true_m);
    PairsOptions reduced = options;
    reduced.noise_order = std::min(options.noise_order, distinct - 1);
    const int determined = std::min(order, distinct - 1);
    fit = fit_order(problem, determined, reduced, method);
    if (fit.calibration.outcome == Outcome::converged) fit.calibration.outcome = Outcome::unobservable;
    const std::string where = distinct == 1 ? fmt::format("the one distance {:.6g} m", problem.true_m.front())
                                            : fmt::format("{} distinct distances", distinct);
    fit.calibration.reason =
        fmt::format("{} cannot determine order {}: {} can be added to f unseen; order {} is given{}{}", where,
                    order, pairs_ml::name_direction(unseen), determined,
                    fit.calibration.reason.empty() ? "" : "; ", fit.calibration.reason);
    fit.calibration.weakest_direction = pairs_ml::name_direction(unseen);
    fit.calibration.alpha_covariance.reset();
    for (Estimate& estimate : fit.calibration.noise_estimates) estimate.std_dev.reset();
    fit.calibration.covariance_reason = "a direction of the parameters is not determined by the data";
    return fit;
  }

  const ScaledPairs scaled(problem, order, options.law, options.noise_order, options.parallel_from);
  pairs_ml::Vector seed;
  NewtonResult best;
  if (scaled.quick_seed(seed)) {
    best = pairs_ml::minimise(scaled, seed, scaled.unknowns(), options.max_iterations,
                              options.gradient_tolerance);
  }
  if (best.outcome != Outcome::converged) seed = scaled.seed();
  if (best.outcome != Outcome::converged && scaled.perfect(seed)) {
    calibration.alpha = scaled.alpha(seed);
    calibration.noise = scaled.noise(seed);
    calibration.noise.parameters.setZero();
    set_unbounded(calibration);
    return fit;
  }
  if (best.outcome != Outcome::converged) {
    best = pairs_ml::minimise(scaled, seed, scaled.unknowns(), options.max_iterations,
                              options.gradient_tolerance);
  }
  fit.gradient_norm = best.gradient_norm;
  if (best.outcome == Outcome::converged && options.shape != NoiseShape::gaussian) {
    take_other_shape(
        problem, scaled,
        pairs_ml::fit_shape(problem, scaled, best.x, options.law, options.noise_order, options.shape, nested),
        order, options, method, fit);
    return fit;
  }
  if (best.outcome == Outcome::converged && method == Method::marginal) {
    best = pairs_ml::restricted(scaled, best, options.max_iterations);
  }
  calibration.outcome = best.outcome;
  calibration.iterations = best.iterations;
  if (!best.at.valid || best.at.information.size() == 0) {
    calibration.outcome = Outcome::failed;
    calibration.reason = "no start inside the model's domain (f and s above 0 at every distance) was found";
    return fit;
  }
  const bool perfect = scaled.perfect(best.x);
  if (!perfect && best.outcome != Outcome::converged) {
    calibration.reason = fmt::format("stopped after {} iterations at a scaled gradient norm of {:.3g}",
                                     best.iterations, best.gradient_norm);
  }
  calibration.alpha = scaled.alpha(best.x);
  calibration.noise = scaled.noise(best.x);
  set_nll(fit, best.at.nll, scaled.unknowns());
  calibration.covariance_reason = caution(calibration, "expected");
  if (perfect) set_unbounded(calibration);
  pairs_ml::Matrix covariance;
  const Eigen::LLT<pairs_ml::Matrix> factor(best.at.information);
  if (factor.info() == Eigen::Success && calibration.outcome == Outcome::converged) {
    const pairs_ml::Matrix root = factor.matrixL().solve(scaled.jacobian(best.x).transpose());
    covariance = root.transpose() * root;
  }
  pairs_ml::set_covariance(calibration, covariance, calibration.range_max_m);
  return fit;
}

PairsFit fit_order(const PairsProblem& problem, int order, const PairsOptions& options, Method method,
                   const pairs_ml::NestedFit* nested) {
  SolverLog log(method == Method::marginal ? "pairs marginal" : "pairs full");
  if (log.on()) log.of(curve_in_words(order + 1, options.law) + ", " + to_string(options.shape));
  PairsFit fit = fit_one_order(problem, order, options, method, nested);
  log.end(fit.calibration.iterations, fit.nll, fit.gradient_norm, fit.calibration.outcome,
          fit.calibration.reason);
  return fit;
}

/// The orders asked for, of one shape; the lowest AIC of `full` decides.
PairsFit fit_shape_orders(const PairsProblem& problem, const PairsOptions& options, Method method) {
  const int low = options.order.value_or(1), high = options.order.value_or(options.max_order);
  std::vector<OrderScore> scores;
  PairsFit best;
  double best_aic = std::numeric_limits<double>::infinity();
  int best_order = low;
  // Shapes other than the Gaussian have several basins: each order starts from the one below, too.
  const bool chained = options.shape != NoiseShape::gaussian;
  pairs_ml::NestedFit nested, best_start;
  for (int order = chained ? std::min(low, 1) : low; order <= high; ++order) {
    PairsFit fit = fit_order(problem, order, options, Method::full, chained ? &nested : nullptr);
    if (is_usable(fit.calibration.outcome))
      nested = {fit.calibration.alpha, fit.calibration.noise, fit.shape};
    if (order < low) continue;
    const int parameters = order + 1 + noise_count(options) + shape_parameter_count(options.shape);
    scores.push_back(
        pairs_ml::score_order(order, fit.nll, parameters, problem.readings(), fit.calibration.outcome));
    // What no noise would leave to chance: no other model can be better, and no higher order is needed.
    const bool exact = fit.calibration.outcome == Outcome::unbounded &&
                       problem.size() >= static_cast<std::size_t>(order) + 3;
    const bool better =
        exact || (fit.calibration.outcome == Outcome::converged && scores.back().aic < best_aic);
    if (better) best_aic = exact ? -std::numeric_limits<double>::infinity() : scores.back().aic;
    if (better || order == low) {
      best = std::move(fit);
      best_order = order;
      best_start = nested;
    }
    if (exact) break;
  }
  if (method == Method::marginal) {
    const double gradient_norm = best.gradient_norm;
    best = fit_order(problem, best_order, options, Method::marginal, chained ? &best_start : nullptr);
    best.gradient_norm = gradient_norm;
  }
  best.orders = std::move(scores);
  best.shape.shape = options.shape;
  best.shapes = {{options.shape, best_aic}};
  return best;
}

PairsFit fit_pairs(const PairsProblem& problem, const PairsOptions& options, Method method) {
  options.check();
  if (problem.size() == 0) {
    PairsFit fit = empty_fit(problem, method);
    fit.calibration.outcome = Outcome::too_few_data;
    const std::string dropped = dropped_in_words(problem.counts);
    fit.calibration.reason =
        dropped.empty() ? "no readings"
                        : fmt::format("none of {} readings can be used: {}", problem.counts.read, dropped);
    return fit;
  }
  if (options.shape != NoiseShape::automatic) return fit_shape_orders(problem, options, method);
  PairsOptions one = options;
  std::vector<std::pair<NoiseShape, double>> shapes;
  NoiseShape chosen = NoiseShape::gaussian;
  double best_aic = std::numeric_limits<double>::infinity();
  for (const NoiseShape shape : range_shapes()) {
    one.shape = shape;
    const PairsFit fit = fit_shape_orders(problem, one, Method::full);
    shapes.push_back(fit.shapes.front());
    if (shapes.back().second < best_aic) {
      best_aic = shapes.back().second;
      chosen = shape;
    }
  }
  one.shape = chosen;
  PairsFit best = fit_shape_orders(problem, one, method);
  best.shapes = std::move(shapes);
  return best;
}

}  // namespace

void PairsOptions::check() const {
  const auto refuse = [](const std::string& what) { throw InputError("PairsOptions: " + what); };
  const auto between = [&](const char* field, int value, int low, int high) {
    if (value < low || value > high)
      refuse(fmt::format("{} = {} is outside of {} .. {}", field, value, low, high));
  };
  if (order) between("order", *order, 0, 8);
  between("max_order", max_order, 1, 8);
  between("noise_order", noise_order, 0, 4);
  between("max_iterations", max_iterations, 1, 100000);
  between("parallel_from", parallel_from, 1, std::numeric_limits<int>::max());
  if (!(gradient_tolerance > 0.0 && gradient_tolerance < 1.0)) {
    refuse(fmt::format("gradient_tolerance = {} is outside of (0, 1)", gradient_tolerance));
  }
}

PairsFit full_pairs(const PairsProblem& problem, const PairsOptions& options) {
  return fit_pairs(problem, options, Method::full);
}

PairsFit full_pairs_from(const PairsProblem& problem, const PairsFit& start, const PairsOptions& options) {
  const Calibration& from = start.calibration;
  if (problem.size() == 0 || from.alpha.size() == 0)
    throw InputError("full_pairs_from: no reading, or a start without a curve");
  PairsOptions own = options;
  own.order = from.order();
  own.law = from.noise.law;
  own.shape = start.shape.shape;
  own.check();
  PairsFit fit = empty_fit(problem, Method::full);
  if (outside_domain(problem, own, fit.calibration)) return fit;
  const ScaledPairs scaled(problem, *own.order, own.law, own.noise_order, own.parallel_from);
  take_other_shape(problem, scaled,
                   pairs_ml::fit_shape_from(problem, scaled, own.law, own.noise_order,
                                            {from.alpha, from.noise, start.shape}),
                   *own.order, own, Method::full, fit);
  return fit;
}

NoiseShape shape_of_pairs(const PairsProblem& problem, const PairsOptions& options, double margin) {
  const int order = options.order.value_or(options.max_order);
  if (problem.size() <= static_cast<std::size_t>(order) + 1 || !(problem.true_m.front() > 0.0))
    return NoiseShape::gaussian;
  const ScaledPairs scaled(problem, order, options.law, options.noise_order, options.parallel_from);
  const pairs_ml::Vector x =
      pairs_ml::least_absolute(problem, scaled, options.law, NoiseLaw::d_squared, scaled.seed());
  if (x.size() == 0 || !x.allFinite()) return NoiseShape::gaussian;
  const pairs_ml::ShapePairs gaussian(problem, scaled, options.law, NoiseShape::gaussian);
  const ChannelResiduals residuals = gaussian.residuals(x);
  if (!may_have_outliers(residuals)) return NoiseShape::gaussian;
  const auto [best, aic] = rank_shapes(residuals, range_shapes()).front();
  return aic < -margin ? best.shape.shape : NoiseShape::gaussian;
}

PairsFit marginal_pairs(const PairsProblem& problem, const PairsOptions& options) {
  return fit_pairs(problem, options, Method::marginal);
}

}  // namespace rangecal
