// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>

#include "calibrate/left_out_check.hpp"
#include "calibrate/noise_shapes.hpp"
#include "calibrate/reference_error.hpp"
#include "calibrate/scale_choice.hpp"
#include "rangecal/core/blocks.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/problems/pairs/pairs_problem.hpp"
#include "rangecal/solvers/closed_form/consensus.hpp"
#include "rangecal/solvers/closed_form/landmark_calibration.hpp"
#include "rangecal/solvers/pairs_ml/pairs_ml.hpp"
#include "robust/residual_shape.hpp"
#include "solver_log.hpp"

namespace rangecal {
namespace {

/// The readings that agree with most others (agreeing_pairs), true distance and reading alone.
Recording agreeing_of(const Recording& all) {
  const std::vector<char> kept = agreeing_pairs(all.pairs.true_m, all.pairs.reading_m);
  Recording agreeing = all;
  agreeing.pairs.true_m.clear();
  agreeing.pairs.reading_m.clear();
  for (std::size_t i = 0; i < kept.size(); ++i) {
    if (!kept[i]) continue;
    agreeing.pairs.true_m.push_back(all.pairs.true_m[i]);
    agreeing.pairs.reading_m.push_back(all.pairs.reading_m[i]);
  }
  return agreeing;
}

/// These, unless Gaussian noise was asked for.
Recording counting_readings(const Recording& all, const CalibrateOptions& options) {
  return options.noise_shape == NoiseShape::gaussian ? all : agreeing_of(all);
}

PairsOptions pairs_options(const CalibrateOptions& options, NoiseShape shape, std::optional<int> order,
                           NoiseLaw law) {
  PairsOptions wanted;
  wanted.order = order;
  wanted.max_order = options.max_order;
  wanted.law = law;
  wanted.noise_order = order.value_or(1);
  wanted.shape = shape;
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
  /// `closed`: what the closed forms see; `readings`: what the likelihoods do, with noise of that shape.
  PairsRun(const Recording& closed, const Recording& readings, NoiseShape of_noise,
           const CalibrateOptions& wanted)
      : closed_forms_see(closed),
        problem(make_pairs_problem({&readings, 1})),
        shape(of_noise),
        options(wanted) {}

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

  const Recording& closed_forms_see;
  const PairsProblem problem;
  const NoiseShape shape;
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
  const auto in_closed_form = [&](const char* solver, Calibration answer) {
    SolverLog log(solver);
    if (log.on()) log.of(curve_in_words(order + 1, law));
    log.end(-1, not_known, not_known, answer.outcome, answer.reason);
    return answer;
  };
  switch (method) {
    case Method::closed_form:
      return in_closed_form("closed-form", closed_form_pairs(closed_forms_see, closed));
    case Method::approximate:
      return in_closed_form("approximate", approximate_pairs(closed_forms_see, closed));
    case Method::full:
      return with_shape(full_pairs(problem, pairs_options(options, shape, order, law)));
    case Method::marginal:
      return with_shape(marginal_pairs(problem, pairs_options(options, shape, order, law)));
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

/// The value of the criterion of one model, fitted where it was not; infinity where it did not converge.
double criterion_at(PairsRun& run, int order, NoiseLaw law, std::vector<ModelScore>& models) {
  const auto value = [&](const ModelScore& model) {
    return criterion_of(model, run.options.criterion, run.problem.readings());
  };
  for (const ModelScore& model : models)
    if (model.order == order && model.law == law) return value(model);
  if (run.options.on_progress)
    run.options.on_progress(fmt::format("trying order {} with noise law {}", order, to_string(law)));
  const Calibration& fit = run.solved(Method::full, order, law);
  const bool usable = fit.outcome == Outcome::converged && fit.aic && fit.marginal_nll;
  models.push_back({order, law, fit.marginal_nll.value_or(std::numeric_limits<double>::quiet_NaN()),
                    usable ? *fit.aic : std::numeric_limits<double>::infinity()});
  return value(models.back());
}

/// Order and law by the criterion of the plain NLL. The fit of each law's order of lowest AIC is kept.
OrderAndLaw choose_pairs_model(PairsRun& run, OrderAndLaw start, CalibrationReport& report) {
  std::vector<ModelScore>& models = report.models;
  const CalibrateOptions& options = run.options;
  OrderAndLaw best{options.order.value_or(1), options.noise.value_or(NoiseLaw::f_squared)};
  if (options.order && options.noise) return best;
  if (run.shape != NoiseShape::gaussian) {  // each fit costs many times the Gaussian's: not all of them
    std::map<OrderAndLaw, double> known;
    best =
        search_model(options, options.max_order, start, known, [&](const std::vector<OrderAndLaw>& wanted) {
          std::vector<double> values;
          for (const auto& [order, law] : wanted) values.push_back(criterion_at(run, order, law, models));
          return values;
        });
    if (leaves_out(options.criterion)) best.first = order_by_left_out(run, best, report).value_or(best.first);
    return best;
  }
  double lowest = std::numeric_limits<double>::infinity();
  for (NoiseLaw law : laws_to_try(options)) {
    if (options.on_progress) options.on_progress(fmt::format("trying noise law {}", to_string(law)));
    const PairsOptions wanted = pairs_options(options, run.shape, options.order, law);
    const PairsFit fit = full_pairs(run.problem, wanted);
    const int order = fit.calibration.order();
    if (fit.calibration.outcome == Outcome::unbounded) return {order, law};  // on the curve
    // A noise polynomial has the order of f where that is given: another model than the search's.
    if (fit.calibration.outcome == Outcome::converged && (has_sigma(law) || order == wanted.noise_order))
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
      !has_sigma(full.noise.law)) {
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

/// The noise shape of lowest AIC at the residuals about a curve; a note says by how much.
NoiseShape shape_about(const Calibration& curve, const PairsProblem& readings, bool all_agree,
                       std::vector<std::pair<NoiseShape, double>>& tried) {
  if (curve.outcome != Outcome::converged) return NoiseShape::gaussian;
  const ChannelResiduals residuals = residuals_about(curve, readings.row_true_m, readings.row_reading_m);
  for (std::size_t i = 0; i < residuals.z.size(); ++i)
    if (!std::isfinite(residuals.z[i]) || !(residuals.s[i] > 0.0)) return NoiseShape::gaussian;
  if (all_agree && !may_have_outliers(residuals)) return NoiseShape::gaussian;
  const RankedShapes ranked = rank_shapes(residuals, range_shapes());
  tried.clear();
  for (const auto& [fit, aic] : ranked) tried.emplace_back(fit.shape.shape, aic - ranked.front().second);
  return ranked.front().second < -shape_margin_aic ? ranked.front().first.shape.shape : NoiseShape::gaussian;
}

/// Where each reading of the recordings stands, in the order of joined().
std::vector<PlacedReading> places_of(std::span<const Recording> recordings) {
  std::vector<PlacedReading> places;
  for (std::size_t index = 0; index < recordings.size(); ++index) {
    const Pairs& pairs = recordings[index].pairs;
    for (std::size_t i = 0; i < pairs.size(); ++i)
      places.push_back(
          {static_cast<int>(index), i < pairs.row.size() ? pairs.row[i] : static_cast<int>(i) + 1});
  }
  return places;
}

/// Every reading beside a curve: its error in spreads, what the noise shape takes it for, and its robust weight.
struct WeighedReadings {
  std::vector<double> z, outlier, weight;
  std::vector<char> judged;
};

WeighedReadings readings_about(const Recording& all, const Calibration& calibration) {
  const ShapeDensity density_at(noise_shape_of(calibration, "range"));
  WeighedReadings about;
  ChannelResiduals residuals = residuals_about(calibration, all.pairs.true_m, all.pairs.reading_m);
  for (std::size_t i = 0; i < residuals.z.size(); ++i) {
    const LogDensity at = density_at(residuals.z[i], residuals.s[i]);
    about.outlier.push_back(at.outlier);
    about.weight.push_back(1.0 - at.outlier);
    about.judged.push_back(about.weight.back() > 0.5);
  }
  about.z = std::move(residuals.z);
  return about;
}

/// Outliers, and whether the curve is better than none.
void judge(const Recording& all, std::span<const Recording> recordings, Calibration& calibration) {
  if (calibration.outcome != Outcome::converged) return;
  const WeighedReadings about = readings_about(all, calibration);
  list_outliers(about.z, about.outlier, places_of(recordings), calibration);
  StopInfluence halves;
  const BlocksOfAll blocks = blocks_of_all(recordings);
  const LeftOutErrors errors =
      left_out_errors({all.pairs.true_m, all.pairs.reading_m, about.weight, about.judged, blocks.of},
                      calibration, calibration, halves);
  calibration.left_out = left_out_check(errors, &halves, blocks.words);
}

/// The lowest order that is nearly as likely as AIC's choice and predicts blocks left out no worse than within its
/// standard error (the one-standard-error rule: Breiman et al. 1984): AIC alone takes an order too many in one of five.
int order_by_blocks_left_out(const Recording& all, const BlocksOfAll& blocks, PairsRun& run,
                             std::pair<int, NoiseLaw> model, CalibrationReport& report) {
  constexpr double nearly = 4.0;  // of AIC
  const Calibration& highest = run.solved(Method::full, model.first, model.second);
  if (highest.outcome != Outcome::converged || model.first < 2) return model.first;
  const WeighedReadings about = readings_about(all, highest);
  StopInfluence unused;
  const LeftOutErrors of_highest =
      left_out_errors({all.pairs.true_m, all.pairs.reading_m, about.weight, about.judged, blocks.of}, highest,
                      highest, unused);
  const double value = criterion_at(run, model.first, model.second, report.models);
  int best = model.first;
  for (int order = model.first - 1; order >= 1; --order) {
    if (!(criterion_at(run, order, model.second, report.models) < value + nearly)) break;
    const Calibration& lower = run.solved(Method::full, order, model.second);
    if (lower.outcome != Outcome::converged) break;
    const std::vector<double> weight = readings_about(all, lower).weight;
    const LeftOutErrors errors = left_out_errors(
        {all.pairs.true_m, all.pairs.reading_m, weight, about.judged, blocks.of}, lower, highest, unused);
    const std::optional<Gain> gain = gain_of(errors, of_highest);
    if (!gain || gain->mean < -gain->std_dev) break;
    best = order;
  }
  if (best != model.first)
    report.notes.push_back(
        fmt::format("order {} rather than {}, which has the lowest AIC: it predicts {} left out no worse",
                    best, model.first, blocks.words));
  return best;
}

/// All four methods at polynomials in what the recordings have for true distances.
void calibrate_polynomials(const Recording& all, std::span<const Recording> recordings,
                           const CalibrateOptions& options, CalibrationReport& report) {
  const bool looks = options.noise_shape != NoiseShape::gaussian;
  const Recording agreeing = counting_readings(all, options);
  const bool all_agree = agreeing.pairs.size() == all.pairs.size();
  std::optional<PairsRun> run;
  run.emplace(agreeing, agreeing, NoiseShape::gaussian, options);
  std::pair<int, NoiseLaw> model{options.order.value_or(std::min(2, options.max_order)),
                                 options.noise.value_or(NoiseLaw::f_squared)};
  model = choose_pairs_model(*run, model, report);
  NoiseShape shape = options.noise_shape;
  std::vector<std::pair<NoiseShape, double>> tried;
  if (looks) {
    const Recording& closed = agreeing;
    const PairsProblem readings = make_pairs_problem({&all, 1});
    if (shape == NoiseShape::automatic)
      shape = shape_about(run->solved(Method::full, model.first, model.second), readings, all_agree, tried);
    for (int round = 0; round < 2 && (shape != NoiseShape::gaussian || !all_agree); ++round) {
      const std::pair<int, NoiseLaw> before = model;
      report.models.clear();
      run.emplace(shape == NoiseShape::gaussian ? all : closed, all, shape, options);
      model = choose_pairs_model(*run, before, report);
      if (options.noise_shape != NoiseShape::automatic || shape == NoiseShape::gaussian || model == before)
        break;
      const NoiseShape again =
          shape_about(run->solved(Method::full, model.first, model.second), readings, false, tried);
      if (again == shape) break;  // the family holds under the law chosen with it
      shape = again;
    }
    const bool chosen = options.noise_shape == NoiseShape::automatic && run->shape != NoiseShape::gaussian;
    if (chosen && run->solved(Method::full, model.first, model.second).outcome != Outcome::converged) {
      // A shape without an optimum is none: Gaussian noise holds all readings.
      shape = NoiseShape::gaussian;
      report.models.clear();
      run.emplace(all, all, shape, options);
      model = choose_pairs_model(*run, model, report);
    }
    if (!tried.empty() && shape != NoiseShape::gaussian)
      report.notes.push_back("noise shape by AIC: " + tried_in_words(shape, tried));
  }
  if (!options.order && options.criterion == OrderCriterion::aic && looks)
    model.first = order_by_blocks_left_out(all, blocks_of_all(recordings), *run, model, report);
  const auto [order, law] = model;
  const bool shaped = run->shape != NoiseShape::gaussian;
  for (Method method : methods_of(options)) {
    if (options.on_progress) options.on_progress(fmt::format("solving {}", to_string(method)));
    if (options.on_method) options.on_method(method, true);
    Calibration result = run->by_method(method, order, law);
    if (options.on_method) options.on_method(method, false);
    run->keep(method, order, law, result);
    if (report.models.size() > 1 && result.alpha_covariance)
      result.covariance_with_choice =
          covariance_with_choice(result, tried_curves(method, *run, report.models));
    result.method = method;
    result.kind = RecordingKind::pairs;
    result.counts = all.counts;
    if (!shaped) score_pairs(run->problem, result);
    if (method == Method::marginal) judge(all, recordings, result);
    report.calibrations.push_back(std::move(result));
  }
  report_shapes(report);
  if (options.check && !shaped) {
    Calibration full = run->solved(Method::full, order, law);
    score_pairs(run->problem, full);
    report.check = check_pairs(run->problem, run->solved(Method::closed_form, order, law), full);
  }
}

/// The approximate model takes the reading for the distance in its noise.
Calibration no_approximate(CurveFamily family) {
  Calibration none;
  none.method = Method::approximate;
  none.reason = fmt::format(
      "the approximate model has s = sigma d^2 for s = sigma f^2 (2016, eq. 21): it is one of polynomials in d, not of a {}",
      to_string(family));
  return none;
}

/// How far readings of stretches of distance that were left out lie from the curve and from polynomials.
std::string left_out_beside_polynomials(const Recording& agreeing, const ScaleChoice& chosen, int max_order) {
  const Pairs& pairs = agreeing.pairs;
  const auto rms = [&](const CurveScale& scale, int order) {
    const auto errors = stretches_left_out(pairs.true_m, pairs.reading_m, {}, scale, order);
    return errors ? std::optional(errors->rms()) : std::nullopt;
  };
  const std::optional<double> own = rms(chosen.scale, chosen.order);
  std::optional<double> least;
  int of_order = 0;
  for (int order = 1; order <= max_order; ++order) {
    const std::optional<double> other = rms({}, order);
    if (!other || (least && *least <= *other)) continue;
    least = other;
    of_order = order;
  }
  if (!own || !least) return {};
  const std::string& unit = agreeing.sensor.unit;
  const bool is_spline = chosen.scale.family == CurveFamily::spline;
  return fmt::format(
      "readings of stretches of distance inside the range, left out in turn, lie {:.3g} {} RMS from the {}, "
      "{:.3g} {} from the best polynomial (order {})",
      *own, unit.empty() ? "m" : unit,
      is_spline ? "spline" : fmt::format("{} of order {}", to_string(chosen.scale.family), chosen.order),
      *least, unit.empty() ? "m" : unit, of_order);
}

void calibrate_on_scale(const Recording& all, std::span<const Recording> recordings,
                        const CalibrateOptions& options, const ScaleChoice& chosen,
                        CalibrationReport& report) {
  CalibrateOptions at = options;
  at.order = chosen.order;
  at.noise = chosen.law;
  at.methods.clear();
  for (const Method method : methods_of(options))
    if (method != Method::approximate) at.methods.push_back(method);
  CalibrationReport inner;
  if (!at.methods.empty()) calibrate_polynomials(on_scale(all, chosen.scale), recordings, at, inner);
  report.models = chosen.models;
  report.notes = std::move(inner.notes);
  report.check = std::move(inner.check);
  report.noise_shape = std::move(inner.noise_shape);
  if (std::string left_out =
          left_out_beside_polynomials(counting_readings(all, options), chosen, options.max_order);
      !left_out.empty())
    report.notes.insert(report.notes.begin(), std::move(left_out));
  if (chosen.order_of_lowest != chosen.order)
    report.notes.insert(
        report.notes.begin(),
        fmt::format("order {} rather than {}, which has the lowest criterion, but by less than 4",
                    chosen.order, chosen.order_of_lowest));
  if (!chosen.note.empty()) report.notes.insert(report.notes.begin(), chosen.note);
  auto next = inner.calibrations.begin();
  for (const Method method : methods_of(options)) {
    Calibration result =
        method == Method::approximate ? no_approximate(chosen.scale.family) : std::move(*next++);
    result.kind = RecordingKind::pairs;
    result.counts = all.counts;
    // A reading that falls with the distance is none: no curve is no rival. Over a spline's scale readings left out are in its shape.
    result.left_out.reset();
    std::vector<double> weight;
    if (!result.noise_shapes.empty()) weight = readings_about(on_scale(all, chosen.scale), result).weight;
    if (method != Method::approximate) take_scale(chosen.scale, all, weight, result);
    if (result.aic) *result.aic += 2.0 * chosen.scale.parameters();
    report.calibrations.push_back(std::move(result));
  }
}

}  // namespace

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

namespace {

/// True if a law of the distance, or left-out readings, are to choose the model: neither knows another scale.
bool is_of_distance(const CalibrateOptions& options) {
  return (options.noise && !is_power_of_f(*options.noise)) || leaves_out(options.criterion);
}

/// True of an order of 2 at most that is below the highest tried.
bool is_low(int order, const CalibrateOptions& options) { return order <= 2 && order < options.max_order; }

/// The polynomial of lowest criterion among all that were tried, with Gaussian noise.
struct BestPolynomial {
  int order = 1;
  double value = 0.0;
  std::vector<ModelScore> models;
};

BestPolynomial best_polynomial(const Recording& agreeing, const CalibrateOptions& options, NoiseLaw law) {
  PairsRun polynomials(agreeing, agreeing, NoiseShape::gaussian, options);
  CalibrationReport tried;
  const OrderAndLaw best =
      choose_pairs_model(polynomials, {options.order.value_or(2), options.noise.value_or(law)}, tried);
  const double value = criterion_at(polynomials, best.first, best.second, tried.models);
  return {best.first, value, std::move(tried.models)};
}

}  // namespace

std::optional<ScaleChoice> reciprocal_due(const Recording& all, const CalibrateOptions& options) {
  if (options.curve && *options.curve != CurveFamily::reciprocal) return std::nullopt;
  const Pairs& pairs = all.pairs;
  const bool asked = options.curve.has_value();
  if (!asked && (is_of_distance(options) || !readings_fall(pairs.true_m, pairs.reading_m)))
    return std::nullopt;
  if (options.on_progress) options.on_progress("trying reciprocal curves");
  const Recording agreeing = counting_readings(all, options);
  std::optional<ScaleChoice> found =
      choose_reciprocal(agreeing.pairs.true_m, agreeing.pairs.reading_m, options);
  if (!found || asked) return found;
  const BestPolynomial best = best_polynomial(agreeing, options, NoiseLaw::constant);
  if (best.value <= found->value) return std::nullopt;
  found->models.insert(found->models.begin(), best.models.begin(), best.models.end());
  return found;
}

ScaleChoice asked_spline(const Recording& all, const CalibrateOptions& options) {
  if (options.on_progress) options.on_progress("trying a spline");
  const Recording counting = counting_readings(all, options);
  std::optional<ScaleChoice> found = choose_spline(counting.pairs.true_m, counting.pairs.reading_m, options);
  if (!found)
    throw InputError(
        all.path +
        ": no curve spline: it needs 6 readings or more at 5 different distances or more, with noise, that rise or fall with them");
  return std::move(*found);
}

namespace {

/// A spline where low orders do not suffice: of polynomials, or of reciprocals where one is due, one of order 3 or more has the lowest
/// criterion, a spline's is lower by more than 4, and it predicts better.
std::optional<ScaleChoice> better_spline(const Recording& all, const CalibrateOptions& options,
                                         const std::optional<ScaleChoice>& reciprocal) {
  constexpr double clearly = 4.0;
  const std::vector<Method> methods = methods_of(options);
  const bool approximate_alone =
      std::all_of(methods.begin(), methods.end(), [](Method m) { return m == Method::approximate; });
  if (options.curve || options.order || is_of_distance(options) || approximate_alone) return std::nullopt;
  if (options.on_progress) options.on_progress("trying a spline");
  const Recording counting = counting_readings(all, options);
  std::optional<ScaleChoice> found = choose_spline(counting.pairs.true_m, counting.pairs.reading_m, options);
  if (!found) return std::nullopt;
  const BestPolynomial best = reciprocal
                                  ? BestPolynomial{reciprocal->order, reciprocal->value, reciprocal->models}
                                  : best_polynomial(counting, options, NoiseLaw::f_squared);
  if (is_low(best.order, options) || !(found->value < best.value - clearly) ||
      !spline_predicts_better(counting.pairs, *found, reciprocal ? reciprocal->scale : CurveScale{},
                              best.order))
    return std::nullopt;
  found->models.insert(found->models.begin(), best.models.begin(), best.models.end());
  return found;
}

/// On the scale that is asked for, or else on that of lowest criterion; a spline is looked for where low orders did not suffice.
void calibrate_on_best_scale(const Recording& all, std::span<const Recording> recordings,
                             const CalibrateOptions& options, CalibrationReport& report) {
  if (options.curve == CurveFamily::spline) {
    calibrate_on_scale(all, recordings, options, asked_spline(all, options), report);
    return;
  }
  const std::optional<ScaleChoice> reciprocal = reciprocal_due(all, options);
  if (reciprocal)
    calibrate_on_scale(all, recordings, options, *reciprocal, report);
  else
    calibrate_polynomials(all, recordings, options, report);
  int order = 0;
  for (const Calibration& one : report.calibrations) order = std::max(order, one.order());
  if (is_low(order, options)) return;
  if (const std::optional<ScaleChoice> spline = better_spline(all, options, reciprocal)) {
    report = {};
    report.criterion = options.criterion;
    calibrate_on_scale(all, recordings, options, *spline, report);
  }
}

}  // namespace

void calibrate_pairs(std::span<const Recording> recordings, const CalibrateOptions& options,
                     CalibrationReport& report) {
  report.criterion = options.criterion;
  calibrate_on_best_scale(joined(recordings), recordings, options, report);
  std::optional<std::string> note;
  for (Calibration& calibration : report.calibrations)
    if (std::optional<std::string> added = add_reference_error(recordings, calibration))
      note = std::move(added);
  if (note) report.notes.push_back(std::move(*note));
}

}  // namespace rangecal
