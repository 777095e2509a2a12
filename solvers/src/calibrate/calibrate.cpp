// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/calibrate.hpp"

#include <fmt/core.h>

#include <cmath>
#include <limits>
#include <utility>

#include "calibrate/landmarks_job.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/names.hpp"
#include "rangecal/solvers/calibrate/plausibility.hpp"
#include "rangecal/solvers/statistics/information_criteria.hpp"

namespace rangecal {

namespace {

constexpr auto solver_names =
    names_of<JointSolver>("solver", {{JointSolver::block, "block"}, {JointSolver::ceres, "ceres"}});

}  // namespace

const char* to_string(JointSolver solver) { return solver_names.name_of(solver); }

JointSolver joint_solver_from_string(const std::string& text) { return solver_names.value_of(text); }

void CalibrateOptions::check_values() const {
  if (order && (*order < 0 || *order > 8)) throw InputError(fmt::format("order is {}, not 0 to 8", *order));
  if (max_order < 1 || max_order > 8) throw InputError(fmt::format("max_order is {}, not 1 to 8", max_order));
  if (curve && *curve != CurveFamily::polynomial) {
    const std::string name = std::string("curve ") + to_string(*curve);
    if (noise && !is_power_of_f(*noise))
      throw InputError(
          fmt::format("noise {} is a law of the distance, and {} knows f alone: take constant, f, f2 or f3",
                      to_string(*noise), name));
    if (leaves_out(criterion))
      throw InputError(
          fmt::format("criterion {} leaves readings out, and the scale of {} is chosen by aic, aicc or bic",
                      to_string(criterion), name));
    if (*curve == CurveFamily::spline && order)
      throw InputError("curve spline has no order: its smoothness is estimated");
  }
  if (order && leaves_out(criterion))
    throw InputError(
        fmt::format("criterion {} chooses the order, and order {} is given", to_string(criterion), *order));
  if (from) require_polynomial(*from, "the calibration to start from");
  if (from && (from->alpha.size() == 0 || !from->alpha.allFinite()))
    throw InputError("the calibration to start from has no curve f (its outcome is " +
                     std::string(to_string(from->outcome)) + ")");
}

double criterion_of(const ModelScore& model, OrderCriterion criterion, double readings) {
  if (!std::isfinite(model.aic)) return std::numeric_limits<double>::infinity();
  const double k = 0.5 * model.aic - model.nll;
  if (criterion == OrderCriterion::aicc) return aicc(model.nll, k, readings);
  return criterion == OrderCriterion::bic ? bic(model.nll, k, readings) : model.aic;
}

std::vector<Method> methods_of(const CalibrateOptions& options) {
  if (!options.methods.empty()) return options.methods;
  return {all_methods().begin(), all_methods().end()};
}

void add_counts(const Counts& from, Counts& to) {
  to.read += from.read;
  to.used += from.used;
  to.cells_left_out += from.cells_left_out;
  for (const auto& [reason, count] : from.dropped) to.dropped[reason] += count;
}

CheckReport check_report(const NloptCheck& check) {
  return {check.agrees, check.better_basin, check.nll, check.report};
}

CalibrationReport calibrate_report(std::span<const Recording> recordings, const CalibrateOptions& options) {
  options.check_values();
  if (recordings.empty()) throw InputError("no recording to calibrate");
  for (const Recording& recording : recordings)
    if (recording.kind != recordings[0].kind)
      throw InputError(recording.path + ": kinds landmarks and pairs cannot be mixed in one job (" +
                       recordings[0].path + " is of the other kind)");
  if (recordings[0].kind == RecordingKind::landmarks && options.curve &&
      *options.curve != CurveFamily::polynomial)
    throw InputError(
        recordings[0].path + ": curve " + to_string(*options.curve) +
        " is for known distances (kind pairs): where landmarks are unknown, readings are distances");
  CalibrationReport report;
  if (recordings[0].kind == RecordingKind::pairs)
    calibrate_pairs(recordings, options, report);
  else
    calibrate_landmarks(recordings, options, report);
  for (Calibration& calibration : report.calibrations)
    if (const std::string warning = noise_shape_warning(calibration);
        !warning.empty() && calibration.alpha_covariance)
      calibration.covariance_reason += (calibration.covariance_reason.empty() ? "" : "; ") + warning;
  for (std::string& warning : plausibility_warnings(recordings, report.calibrations.back()))
    report.notes.push_back(std::move(warning));
  return report;
}

std::vector<Calibration> calibrate(std::span<const Recording> recordings, const CalibrateOptions& options) {
  return calibrate_report(recordings, options).calibrations;
}

}  // namespace rangecal
