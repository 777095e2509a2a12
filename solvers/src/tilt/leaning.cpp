// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/tilt/leaning.hpp"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "diagnosis/calibrated.hpp"
#include "diagnosis/effect_estimates.hpp"
#include "diagnosis/length_interval.hpp"
#include "diagnosis/report.hpp"
#include "rangecal/core/distributions.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/seen_landmarks.hpp"
#include "tilt/leaning_effect.hpp"

namespace rangecal {
namespace {

using namespace diagnosis;

constexpr double degrees = 180.0 / std::numbers::pi, largest_tilt_rad = 10.0 / degrees;

/// The better of refits from a few axes, each of half a turn of 2 b0.
Fit fit_plane(const Rows& rows, const JointState& start) {
  const Effect& plane = *find_effect("tilt");
  Fit best;
  for (const Eigen::VectorXd& p : plane.start_grid(rows.context)) {
    Fit fit = refit(rows, {{&plane, p}}, start, {});
    if (fit.ok && (!best.ok || fit.nll < best.nll)) best = std::move(fit);
  }
  return best;
}

/// True if a tilt of 10 degrees would lie outside of the 95 % region of none about its own plane: by the information of the design,
/// whatever this recording happens to say.
bool sees_a_tilt(const Fit& plane) {
  constexpr double rim = 2.45;  // sqrt(5.99), two dimensions
  if (plane.free.size() != 2 || !plane.covariance.allFinite()) return false;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes(plane.covariance.topLeftCorner<2, 2>());
  return rim * std::sqrt(axes.eigenvalues().maxCoeff()) < largest_tilt_rad * largest_tilt_rad;
}

/// The plane's share of a fit with leans: the covariance of its own two parameters, the leans' uncertainty in
/// it.
Fit plane_of(const Fit& leaning) {
  Fit plane = leaning;
  plane.model = {{find_effect("tilt"), leaning.model[0].parameters.head<2>()}};
  plane.free.clear();
  std::vector<Eigen::Index> own;
  for (std::size_t a = 0; a < leaning.free.size(); ++a) {
    if (leaning.free[a].index >= 2) continue;
    plane.free.push_back(leaning.free[a]);
    own.push_back(static_cast<Eigen::Index>(a));
  }
  plane.covariance = leaning.covariance(own, own);
  return plane;
}

/// The leans of all cylinders, l = w / tan(tau), with what is known of tau in their covariance.
std::vector<LeanEstimate> leans_of(const Fit& fit, std::span<const Recording> recordings, double seen_std) {
  const Eigen::VectorXd& p = fit.model[0].parameters;
  const double tau_sq = std::hypot(p[0], p[1]), tau = std::sqrt(tau_sq), tangent = std::tan(tau);
  // d tan(tau) / d(a, c) = (1 + tan^2 tau) / (2 tau) (a, c) / tau^2
  const Eigen::Vector2d by_plane = (1.0 + tangent * tangent) / (2.0 * tau * tau_sq) * p.head<2>();
  std::vector<Eigen::Index> at(static_cast<std::size_t>(p.size()), -1);
  for (std::size_t a = 0; a < fit.free.size(); ++a)
    at[static_cast<std::size_t>(fit.free[a].index)] = static_cast<Eigen::Index>(a);
  std::vector<LeanEstimate> leans;
  int landmark = 0, index = 0;
  for (const Recording& recording : recordings) {
    for (const Landmark& own : recording.landmarks) {
      const Eigen::Index first = 2 + 2 * static_cast<Eigen::Index>(landmark++);
      LeanEstimate lean;
      lean.landmark = own.label;
      lean.recording = index;
      lean.slope = p.segment<2>(first) / tangent;
      Eigen::Matrix<double, 2, 4> J;
      J << -lean.slope * by_plane.transpose() / tangent, Eigen::Matrix2d::Identity() / tangent;
      const std::vector<Eigen::Index> own_free = {at[0], at[1], at[static_cast<std::size_t>(first)],
                                                  at[static_cast<std::size_t>(first) + 1]};
      if (*std::min_element(own_free.begin(), own_free.end()) >= 0) {
        const Eigen::Matrix4d C = fit.covariance(own_free, own_free);
        lean.covariance = J * C * J.transpose();
        lean.seen = lean.covariance.diagonal().maxCoeff() < seen_std * seen_std;
        const Limits length = length_interval(lean.slope, lean.covariance);
        lean.lean_rad = std::atan(lean.slope.norm());
        lean.low95_rad = std::atan(length.low);
        lean.high95_rad = std::atan(length.high);
      }
      leans.push_back(lean);
    }
    ++index;
  }
  return leans;
}

std::string statement_of(const LeaningFit& fit) {
  if (!fit.tilt_seen)
    return fit.design_sees && fit.tilt.high95 < largest_tilt_rad
               ? fmt::format(
                     "The plane is level to {:.1f} degrees (95 %). A cylinder's lean is seen, and does harm, "
                     "in a tilted plane only.",
                     fit.tilt.high95 * degrees)
               : "This design does not see a tilt of the plane: it passes for a change of the curve. So no "
                 "cylinder's lean is seen either. "
                 "Turn the sensor at each stop (0, 90, 180, 270 degrees).";
  std::string text =
      fmt::format("The plane is tilted by {:.2f} degrees ({:.2f} to {:.2f}). ", fit.tilt.estimate * degrees,
                  fit.tilt.low95 * degrees, fit.tilt.high95 * degrees);
  int unseen = 0;
  for (const LeanEstimate& lean : fit.leans) unseen += !lean.seen;
  const int all = static_cast<int>(fit.leans.size());
  if (unseen == all)
    return text +
           "This design does not see the cylinders' leans: turn the sensor at more stops, or tilt it more.";
  text +=
      fit.leans_seen
          ? fmt::format("Cylinders lean (p = {:.1g}); up or down is known for all of them together only. ",
                        fit.lean_p_value)
          : fmt::format("No cylinder is seen to lean (p = {:.2f}). ", fit.lean_p_value);
  if (unseen > 0) text += fmt::format("Of {} of {} the design does not see it. ", unseen, all);
  text.pop_back();
  return text;
}

}  // namespace

LeaningFit fit_leaning(std::span<const Recording> recordings, const LeaningOptions& options) {
  for (const Recording& recording : recordings)
    if (recording.kind == RecordingKind::pairs)
      throw InputError(recording.path + ": holds pairs; a tilted plane needs readings of landmarks");
  if (!unseen_landmarks(recordings).empty()) return fit_leaning(with_seen_landmarks(recordings), options);
  LeaningFit result;
  CalibrateOptions calibrate_options = options.calibrate;
  calibrate_options.methods = {Method::marginal};
  calibrate_options.noise_shape = NoiseShape::gaussian;  // the effects' likelihood knows no other
  CalibrationReport plain = calibrate_report(recordings, calibrate_options);
  result.calibration = std::move(plain.calibrations[0]);
  result.models = std::move(plain.models);
  if (!is_usable(result.calibration.outcome)) {
    result.outcome = result.calibration.outcome;
    result.reason = result.calibration.reason;
    return result;
  }
  const Calibrated seed = calibrated(recordings, result.calibration);
  const Fit none = refit(seed.rows, {}, seed.state, {});
  const Fit plane = none.ok ? fit_plane(seed.rows, none.state) : none;
  if (!plane.ok) {
    result.reason = "the tilted plane has no optimum";
    return result;
  }
  const auto take_plane = [&](const Fit& fit) {
    for (const EffectEstimate& e : effect_estimates(seed.rows, fit))
      (e.name == "tilt.angle_rad" ? result.tilt : result.axis) = e;
  };
  take_plane(plane);
  result.outcome = Outcome::converged;
  result.tilt_gain = none.nll - plane.nll;
  result.design_sees = sees_a_tilt(plane);
  result.tilt_seen = result.tilt.low95 > 0.0 && result.tilt.high95 < 1.5 * largest_tilt_rad;
  Fit stood_by = result.tilt_seen ? plane : none;
  if (result.tilt_seen) {
    const LeaningEffect effect(seed.rows.problem.landmark_count());
    Eigen::VectorXd p = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(effect.info().parameters.size()));
    p.head<2>() = plane.model[0].parameters;
    const Fit leaning = refit(seed.rows, {{&effect, p}}, plane.state, {});
    if (leaning.ok) {
      result.leans = leans_of(leaning, recordings, options.seen_std);
      result.lean_gain = plane.nll - leaning.nll;
      const double unknowns = 2.0 * seed.rows.problem.landmark_count();
      result.lean_p_value = chi_squared_upper(2.0 * std::max(0.0, result.lean_gain), unknowns);
      result.leans_seen = result.lean_p_value < options.p_value;
      if (result.leans_seen) {
        stood_by = plane_of(leaning);  // correct takes the plane out; a lean is a matter of these cylinders
        take_plane(stood_by);
      }
    }
  }
  result.calibration = calibration_of(seed.rows, recordings, stood_by);
  result.statement = statement_of(result);
  return result;
}

}  // namespace rangecal
