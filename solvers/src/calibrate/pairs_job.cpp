// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>

#include "calibrate/noise_shapes.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/problems/pairs/pairs_problem.hpp"
#include "rangecal/solvers/closed_form/landmark_calibration.hpp"
#include "rangecal/solvers/pairs_ml/pairs_ml.hpp"

namespace rangecal {
namespace {

/// All recordings as one, for the closed forms.
Recording joined(std::span<const Recording> recordings) {
  Recording all = recordings[0];
  for (const Recording& recording : recordings.subspan(1)) {
    all.pairs.true_m.insert(all.pairs.true_m.end(), recording.pairs.true_m.begin(),
                            recording.pairs.true_m.end());
    all.pairs.reading_m.insert(all.pairs.reading_m.end(), recording.pairs.reading_m.begin(),
                               recording.pairs.reading_m.end());
    add_counts(recording.counts, all.counts);
  }
  return all;
}

PairsOptions pairs_options(const CalibrateOptions& options, std::optional<int> order, NoiseLaw law) {
  PairsOptions wanted;
  wanted.order = order;
  wanted.max_order = options.max_order;
  wanted.law = law;
  wanted.noise_order = order.value_or(1);
  wanted.shape = options.noise_shape;
  return wanted;
}

/// The plain NLL and its AIC, the same functions for every method.
void score_pairs(const PairsProblem& problem, Calibration& calibration) {
  if (calibration.alpha.size() == 0 || !calibration.noise.parameters.allFinite()) return;
  const double nll = pairs_nll(problem, calibration.alpha, calibration.noise);
  if (!std::isfinite(nll)) return;
  calibration.joint_nll = calibration.marginal_nll = nll;
  calibration.aic =
      2.0 * (nll + static_cast<double>(calibration.alpha.size() + calibration.noise.parameters.size()));
}

Calibration with_shape(const PairsFit& fit) {
  Calibration result = fit.calibration;
  if (const auto shape = shape_estimate(fit.shape, fit.shape_std)) result.noise_shapes["range"] = *shape;
  return result;
}

/// What is solved for the recordings, each method and model once: the search for a model, the curve
/// delivered, the band that counts the choice and the check all ask for some of the same.
class PairsRun {
 public:
  PairsRun(std::span<const Recording> recordings, const CalibrateOptions& wanted)
      : all(joined(recordings)), problem(make_pairs_problem(recordings)), options(wanted) {}

  const Calibration& solved(Method method, int order, NoiseLaw law) {
    for (const Solved& one : solved_)
      if (one.method == method && one.order == order && one.law == law) return one.answer;
    return keep(method, order, law, by_method(method, order, law));
  }
  Calibration by_method(Method method, int order, NoiseLaw law) const;
  /// `answer` is that of by_method. References to what was kept before stay.
  const Calibration& keep(Method method, int order, NoiseLaw law, Calibration answer) {
    solved_.push_back({method, order, law, std::move(answer)});
    return solved_.back().answer;
  }

  const Recording all;
  const PairsProblem problem;
  const CalibrateOptions& options;

 private:
  struct Solved {
    Method method;
    int order;
    NoiseLaw law;
    Calibration answer;
  };
  std::deque<Solved> solved_;
};

Calibration PairsRun::by_method(Method method, int order, NoiseLaw law) const {
  ClosedFormOptions closed;
  closed.order = order;
  closed.noise_law = law;
  switch (method) {
    case Method::closed_form:
      return closed_form_pairs(all, closed);
    case Method::approximate:
      return approximate_pairs(all, closed);
    case Method::full:
      return with_shape(full_pairs(problem, pairs_options(options, order, law)));
    case Method::marginal:
      return with_shape(marginal_pairs(problem, pairs_options(options, order, law)));
  }
  Calibration none;
  none.reason = "it is no method for pairs";
  return none;
}

/// The order whose left-out readings lie nearest to its curve, each weighed by its noise as the model `known` has it; a
/// note says what was compared. None where the readings are too few.
std::optional<int> order_by_left_out(PairsRun& run, std::pair<int, NoiseLaw> known,
                                     CalibrationReport& report) {
  const CalibrateOptions& options = run.options;
  const Calibration& at = run.solved(Method::full, known.first, known.second);
  const std::vector<double>&d = run.problem.row_true_m, &y = run.problem.row_reading_m;
  std::vector<double> weights;
  for (const double distance : d) {
    if (at.outcome != Outcome::converged) break;
    weights.push_back(std::pow(at.noise.spread(distance, evaluate_polynomial(at.alpha, distance)), -2));
  }
  OrderOptions wanted;
  wanted.min_order = 1;
  wanted.max_order = options.max_order;
  wanted.criterion = options.criterion;
  const OrderSelection found = select_order(d, y, wanted, weights);
  const bool thirds = options.criterion == OrderCriterion::thirds;
  const std::string how = thirds ? "a second third of the readings by the fit to a first"
                                 : fmt::format("readings left out in {} folds", wanted.folds);
  if (found.outcome != Outcome::converged) {
    report.notes.push_back("order by AIC: too few to judge " + how);
    return std::nullopt;
  }
  std::string text = fmt::format("order by the RMS error of {}, each weighed by its noise:", how);
  for (std::size_t i = 0; i < found.scores.size(); ++i)
    if (std::isfinite(found.scores[i]))
      text += fmt::format("{} {:.4g} mm at order {}", i ? "," : "", 1e3 * std::sqrt(found.scores[i]),
                          found.min_order + static_cast<int>(i));
  if (thirds && std::isfinite(found.test_mse))
    text += fmt::format("; of the last third at order {}: {:.4g} mm", found.order,
                        1e3 * std::sqrt(found.test_mse));
  report.notes.push_back(text);
  return found.order;
}

/// Order and law by the criterion of the plain NLL. The fit of each law's order of lowest AIC is kept.
std::pair<int, NoiseLaw> choose_pairs_model(PairsRun& run, CalibrationReport& report) {
  std::vector<ModelScore>& models = report.models;
  const CalibrateOptions& options = run.options;
  const std::vector<NoiseLaw> laws =
      options.noise
          ? std::vector<NoiseLaw>{*options.noise}
          : std::vector<NoiseLaw>{NoiseLaw::constant, NoiseLaw::f, NoiseLaw::f_squared, NoiseLaw::f_cubed};
  std::pair<int, NoiseLaw> best{options.order.value_or(1), options.noise.value_or(NoiseLaw::f_squared)};
  if (options.order && options.noise) return best;
  double lowest = std::numeric_limits<double>::infinity();
  for (NoiseLaw law : laws) {
    if (options.on_progress) options.on_progress(fmt::format("trying noise law {}", to_string(law)));
    const PairsOptions wanted = pairs_options(options, options.order, law);
    const PairsFit fit = full_pairs(run.problem, wanted);
    const int order = fit.calibration.order();
    if (fit.calibration.outcome == Outcome::unbounded) return {order, law};  // on the curve
    // A noise polynomial has the order of f where that is given: another model than the search's.
    if (fit.calibration.outcome == Outcome::converged &&
        (law != NoiseLaw::polynomial || order == wanted.noise_order))
      run.keep(Method::full, order, law, with_shape(fit));
    for (const OrderScore& score : fit.orders) {
      const bool usable = score.outcome == Outcome::converged;
      models.push_back(
          {score.order, law, score.nll, usable ? score.aic : std::numeric_limits<double>::infinity()});
      const double value = criterion_of(models.back(), options.criterion, run.problem.readings());
      if (value < lowest) {
        lowest = value;
        best = {score.order, law};
      }
    }
  }
  if (leaves_out(options.criterion)) best.first = order_by_left_out(run, best, report).value_or(best.first);
  return best;
}

/// One method's curves by the models that matter, each with the criterion that the choice went by.
std::vector<TriedCurve> tried_curves(Method method, PairsRun& run, const std::vector<ModelScore>& models) {
  const auto value = [&](const ModelScore& model) {
    return criterion_of(model, run.options.criterion, run.problem.readings());
  };
  double lowest = std::numeric_limits<double>::infinity();
  for (const ModelScore& model : models) lowest = std::min(lowest, value(model));
  std::vector<TriedCurve> curves;
  for (const ModelScore& model : models) {
    if (!std::isfinite(value(model)) || value(model) > lowest + aic_that_matters) continue;
    const Calibration& one = run.solved(method, model.order, model.law);
    if (one.outcome == Outcome::converged) curves.push_back({value(model), one.alpha, one.alpha_covariance});
  }
  return curves;
}

CheckReport check_pairs(const PairsProblem& problem, const Calibration& start, const Calibration& full) {
  CheckReport report;
  if (full.outcome != Outcome::converged || start.alpha.size() != full.alpha.size() ||
      full.noise.law == NoiseLaw::polynomial) {
    report.report = "no check: there is no optimum of a power law to compare with";
    return report;
  }
  const Eigen::Index n = full.alpha.size();
  NloptProblem search;
  search.objective = [&](const Eigen::VectorXd& x, Eigen::VectorXd* gradient) {
    Noise noise = full.noise;
    noise.parameters[0] = std::exp(x[n]);
    if (!gradient) return pairs_nll(problem, x.head(n), noise);
    const PairsDerivatives at = pairs_derivatives(problem, x.head(n), noise);
    *gradient = at.gradient;
    return at.nll;
  };
  search.seed.resize(n + 1);
  const double sigma =
      start.noise.law == full.noise.law ? start.noise.parameters[0] : full.noise.parameters[0];
  search.seed << start.alpha, std::log(std::max(sigma, 1e-9));
  Noise seed_noise = full.noise;
  seed_noise.parameters[0] = std::exp(search.seed[n]);
  if (!std::isfinite(search.objective(search.seed, nullptr))) {
    report.report = "no check: the seed lies outside the model's domain";
    return report;
  }
  search.whitening =
      whitening_from_information(pairs_derivatives(problem, start.alpha, seed_noise).information);
  search.lower = search.upper = search.seed;
  for (Eigen::Index i = 0; i < n; ++i) {
    const double reach = 10.0 * search.whitening.row(i).norm() + std::abs(full.alpha[i] - start.alpha[i]);
    search.lower[i] -= reach;
    search.upper[i] += reach;
    search.global_indices.push_back(static_cast<int>(i));
  }
  NloptOptions options;
  options.reference_nll = full.joint_nll.value_or(std::numeric_limits<double>::quiet_NaN());
  return check_report(nlopt_check(search, options));
}

}  // namespace

void calibrate_pairs(std::span<const Recording> recordings, const CalibrateOptions& options,
                     CalibrationReport& report) {
  PairsRun run(recordings, options);
  report.criterion = options.criterion;
  const auto [order, law] = choose_pairs_model(run, report);
  const bool shaped = options.noise_shape != NoiseShape::gaussian;
  for (Method method : methods_of(options)) {
    if (options.on_progress) options.on_progress(fmt::format("solving {}", to_string(method)));
    if (options.on_method) options.on_method(method, true);
    Calibration result = run.by_method(method, order, law);
    if (options.on_method) options.on_method(method, false);
    run.keep(method, order, law, result);
    if (report.models.size() > 1 && result.alpha_covariance)
      result.covariance_with_choice =
          covariance_with_choice(result, tried_curves(method, run, report.models));
    result.method = method;
    result.kind = RecordingKind::pairs;
    result.counts = run.all.counts;
    if (!shaped) score_pairs(run.problem, result);
    report.calibrations.push_back(std::move(result));
  }
  report_shapes(report);
  if (options.check && !shaped) {
    Calibration full = run.solved(Method::full, order, law);
    score_pairs(run.problem, full);
    report.check = check_pairs(run.problem, run.solved(Method::closed_form, order, law), full);
  }
}

}  // namespace rangecal
