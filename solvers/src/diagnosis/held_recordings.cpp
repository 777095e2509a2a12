// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/held_recordings.hpp"

#include <fmt/core.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <utility>
#include <vector>

#include "calibrate/too_few.hpp"
#include "diagnosis/reselection.hpp"
#include "in_parallel.hpp"
#include "rangecal/core/quantiles.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr int most_folds = 5;
constexpr int fewest_to_compare = 8;  ///< recordings that tell by themselves how predictions scatter
constexpr int parts_in_all = 40;      ///< as many as of blocks of one job
constexpr int steps_of_part = 6;      ///< a part may lack half of the readings
constexpr double not_predicted = std::numeric_limits<double>::quiet_NaN();

/// Indices of the recordings that have cells, ascending.
std::vector<int> recordings_of(const Rows& rows) {
  std::set<int> given;
  for (std::size_t c = 0; c < rows.problem.cells.size(); ++c) given.insert(recording_of(rows, c));
  return {given.begin(), given.end()};
}

int folds_of_recordings(int recordings) { return std::min(most_folds, recordings); }

/// Fold of every recording by its index; -1 for those without readings.
std::vector<int> fold_of_recording(const std::vector<int>& given) {
  std::vector<int> fold(static_cast<std::size_t>(given.back()) + 1, -1);
  for (std::size_t i = 0; i < given.size(); ++i)
    fold[static_cast<std::size_t>(given[i])] =
        static_cast<int>(i) % folds_of_recordings(static_cast<int>(given.size()));
  return fold;
}

/// True if no fit to other recordings can say what the effect does in one.
bool belongs_to_one_recording(const Effect& effect) {
  const EffectInfo& info = effect.info();
  const bool names_one = std::any_of(
      info.parameters.begin(), info.parameters.end(),
      [](const EffectParameter& p) { return p.discrete && (p.name == "landmark" || p.name == "stop"); });
  const bool by_number = info.covariate == "stop" && !effect.acts_on_stops();
  return names_one || by_number || info.kind == EffectKind::label || info.covariate == "landmark" ||
         info.covariate == "time";
}

/// True if all but a tenth of every fold's ranges lie between those of the other folds: a curve says nothing of
/// distances beyond those that it was fitted at.
bool others_cover(const Rows& rows) {
  constexpr double beyond = 0.1;
  const std::vector<int> given = recordings_of(rows), fold = fold_of_recording(given);
  const auto fold_of_row = [&](std::size_t i) {
    return fold[static_cast<std::size_t>(recording_of(rows, static_cast<std::size_t>(rows.cell[i])))];
  };
  for (int f = 0; f < folds_of_recordings(static_cast<int>(given.size())); ++f) {
    double near = std::numeric_limits<double>::infinity(), far = -near, ours = 0.0, outside = 0.0;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      if (fold_of_row(i) == f) continue;
      near = std::min(near, rows.range_m[i]);
      far = std::max(far, rows.range_m[i]);
    }
    for (std::size_t i = 0; i < rows.size(); ++i) {
      if (fold_of_row(i) != f) continue;
      ++ours;
      outside += rows.range_m[i] < near || rows.range_m[i] > far;
    }
    if (outside > beyond * ours) return false;
  }
  return true;
}

/// Predictions of parts of a recording: of pairs given the sensor alone, of landmarks given the rest of it too, by
/// which the landmarks are known.
void add_parts(const Rows& rows, int parts, const Model& model, const JointState& state, double nll,
               HeldOut& held) {
  if (parts == 1) {
    held.parts.push_back(nll);
    return;
  }
  const std::vector<int> part_of_cell = folds_of(rows, blocks_of_cells(rows), parts);
  for (int part = 0; part < parts; ++part) {
    std::vector<char> ours(part_of_cell.size()), others(part_of_cell.size());
    for (std::size_t c = 0; c < ours.size(); ++c) {
      ours[c] = part_of_cell[c] == part;
      others[c] = !ours[c];
    }
    if (std::find(ours.begin(), ours.end(), 1) == ours.end()) continue;
    JointState at = state;
    held.parts.push_back(rows.pairs ? predictive_nll(without_cells(rows, others), model, at)
                                    : nll - predictive_nll(without_cells(rows, ours), model, at));
  }
}

/// Fitted to the recordings of the other folds.
Fit fit_to_others(const Rows& rows, const std::vector<int>& fold, int left_out, const Fit& full,
                  const Rates& rates, const RefitOptions& options, OwnedCurves& curves) {
  constexpr std::size_t fewest_readings = 8;
  std::vector<char> kept(fold.size());
  for (std::size_t r = 0; r < fold.size(); ++r) kept[r] = fold[r] >= 0 && fold[r] != left_out;
  Fit fit = full;
  const Rows rest = of_recordings(rows, kept, fit.state);
  fit.ok = false;
  if (rest.size() < fewest_readings || (!rest.pairs && why_too_few(rest.problem, 1))) return fit;
  fit = fit_part(rest, fit, options, steps_of_part);
  if (fit.ok) fit = reselect(rest, std::move(fit), rates, options, curves);
  fit.ok = fit.ok && fit.outcome != Outcome::unobservable;
  return fit;
}

HeldOut predict_recording(const Rows& rows, int recording, std::size_t recordings, int parts, const Fit& full,
                          const Fit& trained) {
  HeldOut held;
  std::vector<char> kept(recordings);
  kept[static_cast<std::size_t>(recording)] = 1;
  JointState state = full.state;
  Rows ours = of_recordings(rows, kept, state);
  ours.alpha_prior.reset();  // alpha is the training fit's, which knows the prior
  state.alpha = trained.state.alpha;
  state.noise = trained.state.noise;
  state.sigma_theta_rad = trained.state.sigma_theta_rad;
  state.sigma_s_m = trained.state.sigma_s_m;
  held.nll = predictive_nll(ours, trained.model, state);
  held.ok = std::isfinite(held.nll);
  add_squares(ours, std::vector<char>(static_cast<std::size_t>(ours.cell_count), 1), trained.model, state,
              held);
  if (held.ok) add_parts(ours, parts, trained.model, state, held.nll, held);
  return held;
}

}  // namespace

int recordings_with_readings(const Rows& rows) { return static_cast<int>(recordings_of(rows).size()); }

double predictive_nll(const Rows& rows, const Model& model, JointState& state) {
  if (rows.pairs) return laplace_value(rows, model, state);
  RefitOptions of_sensor;
  of_sensor.held.alpha = of_sensor.held.sigmas = true;
  MarginalFit detail;
  const double value = calibrate_under(rows, model, state, of_sensor, &detail);
  if (!std::isfinite(value) || !detail.covariance) return not_predicted;
  const Eigen::Index first = state.alpha.size(), coordinates = 2 * rows.problem.landmark_count();
  const Eigen::LLT<Eigen::MatrixXd> root(detail.covariance->block(first, first, coordinates, coordinates));
  if (root.info() != Eigen::Success) return not_predicted;
  // The root's diagonal: 1/2 log det A = -sum log of it.
  return value - root.matrixLLT().diagonal().array().log().sum() -
         static_cast<double>(coordinates) * half_log_two_pi;
}

std::string why_not_whole_recordings(const Rows& rows, const Model& model) {
  for (const ActiveEffect& active : model)
    if (belongs_to_one_recording(*active.effect))
      return fmt::format("other recordings say nothing of {} in one", active.effect->info().id);
  return others_cover(rows) ? "" : "the recordings do not cover one another's distances";
}

HeldOut predict_recordings(const Rows& rows, const Fit& full, const Rates& rates,
                           const RefitOptions& options) {
  const std::vector<int> given = recordings_of(rows), fold = fold_of_recording(given);
  const int count = static_cast<int>(given.size());
  const int parts = count < fewest_to_compare ? parts_in_all / count : 1;
  std::vector<HeldOut> of_recording(given.size());
  in_parallel(
      static_cast<std::size_t>(folds_of_recordings(count)),
      [&](std::size_t left_out) {
        const int f = static_cast<int>(left_out);
        OwnedCurves curves;
        const Fit trained = fit_to_others(rows, fold, f, full, rates, options, curves);
        for (std::size_t i = 0; i < given.size(); ++i) {
          if (fold[static_cast<std::size_t>(given[i])] != f) continue;
          if (trained.ok)
            of_recording[i] = predict_recording(rows, given[i], fold.size(), parts, full, trained);
          else
            of_recording[i].ok = false;
        }
      },
      jobs_at_once(rows.size()));
  HeldOut all = sum_of(of_recording);
  const bool known =
      std::all_of(all.parts.begin(), all.parts.end(), [](double v) { return std::isfinite(v); });
  if (!known) all.parts.clear();  // then no standard error
  return all;
}

std::string whole_recordings_in_words(const Rows& rows) {
  const int count = recordings_with_readings(rows);
  const std::string turns = count > most_folds ? fmt::format("{} groups of {}", most_folds, count)
                                               : fmt::format("each of {}", count);
  const std::string nuisances = rows.pairs ? "" : ", its stops and landmarks integrated";
  if (count >= fewest_to_compare)
    return fmt::format("held out: whole recordings, {} in turn{}; standard errors are over the recordings",
                       turns, nuisances);
  return fmt::format(
      "held out: whole recordings, {} in turn{}; standard errors are of {} within them, since {} recordings are "
      "too few to tell how recordings differ",
      turns, nuisances, rows.blocks, count);
}

}  // namespace rangecal::diagnosis
