// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/report.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "calibrate/landmarks_job.hpp"
#include "diagnosis/effect_estimates.hpp"
#include "diagnosis/projector.hpp"
#include "diagnosis/select/rivals.hpp"
#include "diagnosis/settled_by.hpp"
#include "diagnosis/signatures.hpp"
#include "diagnosis/twins.hpp"
#include "diagnosis/working.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "rangecal/solvers/correction/effect_correction.hpp"

namespace rangecal::diagnosis {
namespace {

/// "what: how" as "what (how)".
std::string in_brackets(const std::string& missing) {
  const std::size_t colon = missing.find(": ");
  return colon == std::string::npos ? missing
                                    : missing.substr(0, colon) + " (" + missing.substr(colon + 2) + ")";
}

/// Over the sets that were compared; of effects that were asked for, over these and the seed model.
void fill_probabilities(const SearchResult& found, std::vector<Explanation>& explanations) {
  if (found.best.fit.model.size() <=
      found.known.model.size()) {  // bookkeeping alone: it cannot happen by chance
    explanations.front().probability = 1.0;
    return;
  }
  explanations.front().probability =
      found.best.probability.value_or(1.0 / (1.0 + std::exp(-found.best.evidence)));
  for (std::size_t i = 1; i < explanations.size() && i <= found.rivals.size(); ++i)
    explanations[i].probability = found.rivals[i - 1].probability.value_or(0.0);
}

Explanation explain(const Rows& rows, const SearchResult& found, const Candidate& candidate) {
  Explanation e;
  e.effects = ids_of(candidate.fit.model);
  e.parameters = effect_estimates(rows, candidate.fit);
  e.nll = candidate.fit.nll;
  const std::string family = e.effects.empty() ? std::string() : e.effects.back();
  e.p_value = found.rates.corrected(
      family, log_chi_sq_survival(2.0 * std::max(0.0, candidate.gain), std::max(1, candidate.parameters)));
  for (const ActiveEffect& active : candidate.fit.model) {
    if (!e.physics.empty()) e.physics += " ";
    e.physics += active.effect->info().physics;
    if (e.separated_by.empty()) e.separated_by = settled_by(rows, *active.effect);
  }
  return e;
}

/// The sets that the data do not tell from the best one, at most three, exact twins of every design first.
std::vector<std::vector<std::string>> rivals_of(const SearchResult& found) {
  std::vector<std::vector<std::string>> sets;
  for (const Candidate& c : found.rivals) sets.push_back(ids_of(c.fit.model));
  const std::vector<std::string> names = ids_of(found.best.fit.model);
  for (std::size_t a = 0; a < names.size(); ++a)
    for (const std::string& twin : exact_twins_of(names[a])) {
      std::vector<std::string> swapped = names;
      swapped[a] = twin;
      const auto same_names = [&](std::vector<std::string> set) {
        std::vector<std::string> sorted = swapped;
        std::sort(set.begin(), set.end());
        std::sort(sorted.begin(), sorted.end());
        return set == sorted;
      };
      if (std::any_of(sets.begin(), sets.end(), same_names)) continue;
      sets.insert(sets.begin(), swapped);
      if (sets.size() > most_rivals) sets.pop_back();
    }
  return sets;
}

/// Effects of more than three times their typical size: of linear parameters, or where there is none of all that are sizes, the
/// length in typical sizes.
void note_large(const Model& model, std::vector<std::string>& notes) {
  constexpr double usual = 3.0;
  for (const ActiveEffect& active : model) {
    const std::vector<EffectParameter>& parameters = active.effect->info().parameters;
    const bool any_linear =
        std::any_of(parameters.begin(), parameters.end(), [](const EffectParameter& p) { return p.linear; });
    double squares = 0.0;
    for (std::size_t j = 0; j < parameters.size(); ++j)
      if (parameters[j].linear || (!any_linear && !parameters[j].discrete && parameters[j].low <= 0.0))
        squares += std::pow(active.parameters[static_cast<Eigen::Index>(j)] / parameters[j].typical, 2);
    if (const double size = std::sqrt(squares); size > usual)
      notes.push_back(fmt::format("{} is unusually large: {:.2g} times its typical size",
                                  id_in_words(active.effect->info().id), size));
  }
}

/// Parameters that ended where physics ends: what is there may be larger, or of another kind.
void note_limits(const Rows& rows, const Model& model, std::vector<std::string>& notes) {
  for (const ActiveEffect& active : model) {
    const EffectInfo& info = active.effect->info();
    for (std::size_t j = 0; j < info.parameters.size(); ++j) {
      const EffectParameter& parameter = info.parameters[j];
      const double value = active.parameters[static_cast<Eigen::Index>(j)];
      const auto [low, high] = active.effect->bounds(rows.context, j);
      const double close = 1e-6 * (high - low);
      const bool least = low != 0.0 && value <= low + close;  // a size of 0 is no end of a search
      if (parameter.discrete || !(low < high) || !(least || value >= high - close)) continue;
      notes.push_back(
          fmt::format("{}.{} ends at {:g}, the limit of what is searched: its error is not known, "
                      "and what is there may be larger or of another kind",
                      info.id, parameter.name, value));
    }
  }
}

/// Of the curve and of the parameters theta that move the mean of readings. The curve is fitted at given theta: theta off by
/// delta puts the readings off by x delta, which the curve takes up, alpha = alpha(theta) with d alpha / d theta = -B, B the
/// part of alpha that absorbs x. So cov(alpha) = C + B P B^T and cov(alpha, theta) = -B P, with C the covariance of alpha given
/// theta and P that of theta with the calibration free.
std::optional<EffectsCovariance> effects_covariance_of(const Rows& rows, const Fit& fit) {
  std::vector<Eigen::Index> moving;
  for (std::size_t a = 0; a < fit.free.size(); ++a)
    if (fit.free[a].acts == FreeParameter::Acts::mean) moving.push_back(static_cast<Eigen::Index>(a));
  const Eigen::Index alphas = fit.state.alpha.size(), count = static_cast<Eigen::Index>(moving.size());
  if (count == 0 || fit.alpha_covariance.rows() != alphas || !fit.covariance.allFinite()) return std::nullopt;
  const WorkingProblem working = working_problem(rows, fit.model, fit.state);
  const Projector projector(rows, working, fit.state);
  EffectsCovariance known;
  Eigen::MatrixXd P(count, count), B(alphas, count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const FreeParameter& p = fit.free[static_cast<std::size_t>(moving[i])];
    const ActiveEffect& active = fit.model[static_cast<std::size_t>(p.effect)];
    const EffectInfo& info = active.effect->info();
    known.parameters.push_back(info.id + "." + info.parameters[static_cast<std::size_t>(p.index)].name);
    Eigen::VectorXd phi, stops;
    projector.absorbed(effect_signature(rows, projector, active, p.index), phi, stops);
    B.col(i) = phi.head(alphas);
    for (Eigen::Index j = 0; j < count; ++j) P(i, j) = fit.covariance(moving[i], moving[j]);
  }
  if (!(P.diagonal().array() > 0.0).all() || !B.allFinite()) return std::nullopt;
  known.matrix.resize(alphas + count, alphas + count);
  known.matrix << fit.alpha_covariance + B * P * B.transpose(), -B * P, -P * B.transpose(), P;
  return known;
}

/// Of each column that the effects use, the values in the recordings; labels aside.
void fill_effects_range(const Rows& rows, Calibration& calibration) {
  const std::vector<std::string>& covariates = rows.context.covariates;
  if (const double duration = rows.context.duration_s; duration > 0.0)
    calibration.effects_range["time_s"] = {0.0, duration};  // for effects that count time in it
  const std::vector<EffectCorrector::Need> needs = EffectCorrector(calibration, covariates).needs();
  calibration.effects_range.clear();
  for (const EffectCorrector::Need& need : needs) {
    const bool angle = need.column == "bearing_rad" || need.column == "heading_rad";
    std::vector<double> values;
    if (need.column == "bearing_rad") values = rows.bearing_rad;
    if (need.column == "heading_rad") values = rows.heading_rad;
    if (need.column == "time_s") values = rows.time_s;
    if (need.column == "radius_m") values = rows.radius_m;
    for (std::size_t c = 0; c < covariates.size(); ++c)
      if (covariates[c] == need.column)
        for (std::size_t i = 0; i < rows.size(); ++i)
          values.push_back(rows.covariates[i * covariates.size() + c]);
    std::erase_if(values, [](double value) { return !std::isfinite(value); });
    if (values.empty()) continue;
    const auto [low, high] = std::minmax_element(values.begin(), values.end());
    calibration.effects_range[need.column] = angle ? arc_of(values) : std::pair(*low, *high);
  }
}

}  // namespace

std::vector<std::string> landmark_labels(std::span<const Recording> recordings) {
  std::vector<std::string> labels;
  for (const Recording& recording : recordings)
    for (const Landmark& landmark : recording.landmarks) labels.push_back(landmark.label);
  return labels;
}

Calibration calibration_of(const Rows& rows, std::span<const Recording> recordings, const Fit& fit) {
  Calibration c;
  c.method = Method::marginal;
  c.kind = rows.pairs ? RecordingKind::pairs : RecordingKind::landmarks;
  c.outcome = fit.outcome;
  const std::vector<std::string> labels = landmark_labels(recordings);
  c.reason = with_labels(fit.reason, labels);
  c.covariance_reason = with_labels(fit.covariance_reason, labels);
  c.weakest_direction = in_user_words(fit.weakest_direction, labels, fit.state.noise.law);
  c.scale = rows.curve.scale;
  c.alpha = fit.state.alpha;
  if (fit.alpha_covariance.size() > 0) c.alpha_covariance = fit.alpha_covariance;
  c.noise = fit.state.noise;
  const auto known = [](double std_dev) { return std_dev > 0.0 ? std::optional(std_dev) : std::nullopt; };
  c.noise_estimates = {{fit.state.noise.parameters[0], known(fit.noise_std * fit.state.noise.parameters[0])}};
  if (rows.reads_bearings())
    c.sigma_theta_rad = Estimate{fit.state.sigma_theta_rad, known(fit.sigma_theta_std)};
  const CellGeometry g = cell_geometry(rows, fit.state);
  c.range_min_m = *std::min_element(g.d.begin(), g.d.end());
  c.range_max_m = *std::max_element(g.d.begin(), g.d.end());
  c.marginal_nll = c.joint_nll = fit.nll;
  if (!rows.pairs && !rows.alpha_prior) {
    const WorkingProblem working = working_problem(rows, fit.model, fit.state);
    c.joint_nll = joint_nll(working.problem, fit.state) + working.constant;
  }
  if (!rows.alpha_prior)
    c.aic = 2.0 * (fit.nll + parameter_count(rows.problem, fit.state, rows.pairs) + c.scale.parameters() +
                   static_cast<double>(fit.free.size()));
  int landmark = 0, stop = 0, index = 0;
  for (const Recording& recording : recordings) {
    c.counts.read += recording.counts.read;
    c.counts.used += recording.counts.used;
    c.counts.cells_left_out += recording.counts.cells_left_out;
    for (const auto& [reason, count] : recording.counts.dropped) c.counts.dropped[reason] += count;
    if (!rows.pairs) {
      for (const Landmark& l : recording.landmarks) {
        std::optional<Eigen::Matrix2d> covariance;
        if (fit.landmark_covariance.size() > 0)
          covariance = fit.landmark_covariance.block<2, 2>(2 * landmark, 2 * landmark);
        c.landmarks.push_back({index, l.label, fit.state.landmarks[landmark++], covariance});
      }
      for (const Stop& s : recording.stops) c.stops.push_back({index, s.label, fit.state.stops[stop++]});
    }
    ++index;
  }
  if (rows.pairs && !fit.model.empty()) c.labels = labels;
  for (const ActiveEffect& active : fit.model)
    for (std::size_t j = 0; j < active.effect->info().parameters.size(); ++j)
      c.effects[active.effect->info().id][active.effect->info().parameters[j].name] =
          active.parameters[static_cast<Eigen::Index>(j)];
  if (!fit.model.empty()) c.effects_covariance = effects_covariance_of(rows, fit);
  if (c.effects_covariance)
    c.alpha_covariance = c.effects_covariance->matrix.topLeftCorner(c.alpha.size(), c.alpha.size());
  if (c.alpha_covariance && !fit.free.empty() && !(rows.pairs && c.effects_covariance))
    c.covariance_reason =
        fmt::format("at the effects' parameters: their own errors are not in the covariances of {}",
                    c.effects_covariance ? "the landmarks" : "curve and landmarks");
  return c;
}

Diagnosis assemble_report(const Rows& rows, std::span<const Recording> recordings,
                          const SearchResult& found) {
  Diagnosis result;
  result.verdict = found.verdict;
  result.alarm_p_value = found.alarm_p;
  result.baseline = calibration_of(rows, recordings, found.baseline);
  const auto summary = [&](const Battery& battery, double nll) {
    FitSummary s;
    s.nll = nll;
    s.rms_range_m = std::sqrt(battery.projector().range_residual.squaredNorm() / rows.cell_count);
    s.rms_bearing_rad = std::sqrt(battery.projector().bearing_residual.squaredNorm() / rows.cell_count);
    s.chi_sq_per_dof = battery.cell_chi_sq / std::max(1.0, battery.cell_dof);
    return s;
  };
  result.before = result.after = summary(*found.first, found.baseline.nll);
  result.corrected = result.baseline;

  if (found.verdict == Verdict::explained) {
    result.corrected = calibration_of(rows, recordings, found.best.fit);
    if (found.last) result.after = summary(*found.last, found.best.fit.nll);
    result.explanations.push_back(explain(rows, found, found.best));
    result.explanations[0].indistinguishable_from = rivals_of(found);
    for (const Candidate& rival : found.rivals) result.explanations.push_back(explain(rows, found, rival));
    fill_probabilities(found, result.explanations);
    result.final_effects = result.explanations[0].effects;
  } else if (found.verdict == Verdict::unexplained || found.partly()) {
    Explanation generic;
    if (found.partly()) {
      generic = explain(rows, found, found.best);
      generic.indistinguishable_from = rivals_of(found);
      for (auto& set : generic.indistinguishable_from) set.push_back("generic");
      generic.physics += " What is left has no name in the catalogue; its place and size are given.";
      result.corrected = calibration_of(rows, recordings, found.best.fit);
      result.after = summary(*found.last, found.best.fit.nll);  // until a curve stands for what is left
    } else {
      generic.physics = "Nothing in the catalogue explains this mismatch; its place and size are given.";
    }
    generic.effects.push_back("generic");
    generic.nll = found.partly() ? found.best.fit.nll : found.baseline.nll;
    generic.probability = 1.0;
    generic.p_value = found.alarm_p;
    result.final_effects = generic.effects;
    result.explanations.push_back(generic);
  }
  if (found.named()) {
    result.members = found.members;
    fill_effects_range(rows, result.corrected);
  }
  result.evidence_omitted = found.evidence_omitted;
  result.nearly_as_likely = found.nearly_as_likely;
  result.notes = found.known.notes;
  if (found.named()) {
    note_limits(rows, found.best.fit.model, result.notes);
    note_large(found.best.fit.model, result.notes);
  }
  if (rows.curve.scale.spline && rows.alpha_prior)
    result.notes.push_back(
        "the shape of the simulation's spline is taken for exact: only the line in it has an uncertainty");
  else if (rows.curve.scale.spline)
    result.notes.push_back(fmt::format(
        "the curve is one over a spline of the distance ({:.1f} degrees of freedom): what differs along the distance alone "
        "is in it",
        rows.curve.scale.spline->degrees));
  if (rows.curve.scale.is_reciprocal())
    result.notes.push_back(
        fmt::format("the readings fall with distance as a sensor's voltage does: the curve is one over "
                    "1 / (d + {:.4g} m)",
                    rows.curve.scale.offset_m));
  if (found.verdict == Verdict::no_mismatch && !rows.alpha_prior)
    result.notes.push_back(fmt::format(
        "the seed model is a curve of order {} with noise {}; 'calibrate' may choose others by AIC",
        result.corrected.order(), to_string(result.corrected.noise.law)));
  if (found.first && found.first->questions.empty())
    result.notes.push_back(
        "nothing could be asked: readings at one distance without times or other columns show no mismatch");
  std::map<std::string, std::string> effects_without;
  for (const Effect* effect : effects_of(rows.context)) {
    const std::string missing = effect->lacking(rows.context);
    if (missing.empty()) continue;
    std::string& effects = effects_without[missing];
    effects += (effects.empty() ? "" : ", ") + effect->info().id;
  }
  for (const auto& [missing, effects] : effects_without)
    result.notes.push_back(fmt::format("cannot be judged for lack of {}: {}", in_brackets(missing), effects));
  return result;
}

}  // namespace rangecal::diagnosis
