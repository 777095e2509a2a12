// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <pybind11/pybind11.h>

#include <utility>

#include "archive.hpp"
#include "rangecal/core/calibration.hpp"
#include "rangecal/core/recording.hpp"
#include "rangecal/core/version.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/calibrate/curve.hpp"
#include "rangecal/solvers/calibrate/truth_score.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"
#include "rangecal/solvers/diagnosis/model_residuals.hpp"

// The members of every structure in their order. A member that is added and not listed does not compile.
namespace rangecal {

inline void archive_fields(python::Archive& a, Sensor& s) {
  auto& [name, principle, lowest, highest, unit] = s;
  a(name, principle, lowest, highest, unit);
}
inline void archive_fields(python::Archive& a, Pose2& s) {
  auto& [x, y, heading] = s;
  a(x, y, heading);
}
inline void archive_fields(python::Archive& a, Stop& s) {
  auto& [label, commanded, sigma_xy, sigma_heading, place, covariance] = s;
  a(label, commanded, sigma_xy, sigma_heading, place, covariance);
}
inline void archive_fields(python::Archive& a, Landmark& s) {
  auto& [label, radius, reflectance] = s;
  a(label, radius, reflectance);
}
inline void archive_fields(python::Archive& a, KnownDistance& s) {
  auto& [from, to, distance, sigma] = s;
  a(from, to, distance, sigma);
}
inline void archive_fields(python::Archive& a, Readings& s) {
  auto& [stop, landmark, repeat, time, range, bearing, row, covariates] = s;
  a(stop, landmark, repeat, time, range, bearing, row, covariates);
}
inline void archive_fields(python::Archive& a, Pairs& s) {
  auto& [distance, reading, batch, labels, landmark, time, bearing, row, covariates] = s;
  a(distance, reading, batch, labels, landmark, time, bearing, row, covariates);
}
inline void archive_fields(python::Archive& a, Groups& s) {
  auto& [by, of, labels] = s;
  a(by, of, labels);
}
inline void archive_fields(python::Archive& a, Reference& s) {
  auto& [sigma] = s;
  a(sigma);
}
inline void archive_fields(python::Archive& a, Counts& s) {
  auto& [read, used, dropped, cells] = s;
  a(read, used, dropped, cells);
}
inline void archive_fields(python::Archive& a, Truth& s) {
  auto& [stops, landmarks] = s;
  a(stops, landmarks);
}
inline void archive_fields(python::Archive& a, Column& s) {
  auto& [role, unit] = s;
  a(role, unit);
}
inline void archive_fields(python::Archive& a, Recording& s) {
  auto& [path, kind, sensor, sigma_xy, estimate, sigma_heading, error, stops, landmarks, known, readings,
         pairs, groups, reference, counts, truth, columns, extraction, notes] = s;
  a(path, kind, sensor, sigma_xy, estimate, sigma_heading, error, stops, landmarks, known, readings, pairs,
    groups, reference, counts, truth, columns, extraction, notes);
}

inline void archive_fields(python::Archive& a, Noise& s) {
  auto& [law, parameters] = s;
  a(law, parameters);
}
inline void archive_fields(python::Archive& a, Estimate& s) {
  auto& [value, std_dev] = s;
  a(value, std_dev);
}
inline void archive_fields(python::Archive& a, ShapeEstimate& s) {
  auto& [family, parameters, std_dev] = s;
  a(family, parameters, std_dev);
}
inline void archive_fields(python::Archive& a, LandmarkEstimate& s) {
  auto& [recording, label, position, covariance, by_stops] = s;
  a(recording, label, position, covariance, by_stops);
}
inline void archive_fields(python::Archive& a, LeftOutCheck& s) {
  auto& [groups, what, raw, raw_std, corrected, corrected_std, halves, usable, reason] = s;
  a(groups, what, raw, raw_std, corrected, corrected_std, halves, usable, reason);
}
inline void archive_fields(python::Archive& a, MisfitOfDeviations& s) {
  auto& [factor, threshold, clusters, where] = s;
  a(factor, threshold, clusters, where);
}
inline void archive_fields(python::Archive& a, OutlierReading& s) {
  auto& [recording, row, channel, sigmas, reason] = s;
  a(recording, row, channel, sigmas, reason);
}
inline void archive_fields(python::Archive& a, StopEstimate& s) {
  auto& [recording, label, pose] = s;
  a(recording, label, pose);
}
inline void archive_fields(python::Archive& a, EffectsCovariance& s) {
  auto& [parameters, matrix] = s;
  a(parameters, matrix);
}
inline void archive_fields(python::Archive& a, NaturalSpline& s) {
  Eigen::VectorXd knots = s.knots(), values = s.values();
  a(knots, values);
  if (knots.size() > 0) s = NaturalSpline(std::move(knots), std::move(values));
}
inline void archive_fields(python::Archive& a, SplineScale& s) {
  auto& [u, covariance, degrees] = s;
  a(u, covariance, degrees);
}
inline void archive_fields(python::Archive& a, CurveScale& s) {
  auto& [family, offset, offset_std, spline] = s;
  a(family, offset, offset_std, spline);
}
inline void archive_fields(python::Archive& a, Calibration& s) {
  auto& [method, kind, outcome, reason, scale, alpha, covariance, by_stops, by_landmarks, misfit, left_out,
         with_choice, bound, why, noise, noise_estimates, shapes, outlier_count, outliers, sigma_theta,
         sigma_s, upper, lowest, highest, effects, known, ranges, labels, landmarks, stops, counts, joint,
         marginal, aic, weakest, iterations, seconds] = s;
  a(method, kind, outcome, reason, scale, alpha, covariance, by_stops, by_landmarks, misfit, left_out,
    with_choice, bound, why, noise, noise_estimates, shapes, outlier_count, outliers, sigma_theta, sigma_s,
    upper, lowest, highest, effects, known, ranges, labels, landmarks, stops, counts, joint, marginal, aic,
    weakest, iterations, seconds);
}
inline void archive_fields(python::Archive& a, ModelScore& s) {
  auto& [order, law, nll, aic, family] = s;
  a(order, law, nll, aic, family);
}
inline void archive_fields(python::Archive& a, CheckReport& s) {
  auto& [agrees, better, nll, report] = s;
  a(agrees, better, nll, report);
}
inline void archive_fields(python::Archive& a, CalibrationReport& s) {
  auto& [calibrations, models, notes, check, shape, criterion] = s;
  a(calibrations, models, notes, check, shape, criterion);
}
inline void archive_fields(python::Archive& a, TruthScore& s) {
  auto& [rmse, landmarks, strain, ratio, raw, corrected, readings, estimated] = s;
  a(rmse, landmarks, strain, ratio, raw, corrected, readings, estimated);
}

inline void archive_fields(python::Archive& a, BinnedResidual& s) {
  auto& [at, before, after, std_dev, readings] = s;
  a(at, before, after, std_dev, readings);
}
inline void archive_fields(python::Archive& a, Finding& s) {
  auto& [channel, covariate, shape, effects, from, to, group, everywhere, size, unit, p_value, log_p, share,
         residuals] = s;
  a(channel, covariate, shape, effects, from, to, group, everywhere, size, unit, p_value, log_p, share,
    residuals);
}
inline void archive_fields(python::Archive& a, EffectEstimate& s) {
  auto& [name, estimate, std_dev, low, high, note] = s;
  a(name, estimate, std_dev, low, high, note);
}
inline void archive_fields(python::Archive& a, Explanation& s) {
  auto& [effects, probability, parameters, nll, heldout, heldout_std, p_value, alike, separated, physics] = s;
  a(effects, probability, parameters, nll, heldout, heldout_std, p_value, alike, separated, physics);
}
inline void archive_fields(python::Archive& a, Unseen& s) {
  auto& [effect, typical, detectable, harm, settled] = s;
  a(effect, typical, detectable, harm, settled);
}
inline void archive_fields(python::Archive& a, NextExperiment& s) {
  auto& [code, change, settles, power] = s;
  a(code, change, settles, power);
}
inline void archive_fields(python::Archive& a, FitSummary& s) {
  auto& [nll, heldout, std_dev, heldout_rms, range, bearing, chi_sq] = s;
  a(nll, heldout, std_dev, heldout_rms, range, bearing, chi_sq);
}
inline void archive_fields(python::Archive& a, AddedChange& s) {
  auto& [range, bearing, range_variance, bearing_variance] = s;
  a(range, bearing, range_variance, bearing_variance);
}
inline void archive_fields(python::Archive& a, SimulationModel& s) {
  auto& [recordings, read, calibration, added] = s;
  a(recordings, read, calibration, added);
}
inline void archive_fields(python::Archive& a, Member& s) {
  auto& [effect, probability, evidence, held_out] = s;
  a(effect, probability, evidence, held_out);
}
inline void archive_fields(python::Archive& a, Law& s) {
  auto& [id, channel, formula, variables, parameters, evidence, over_curve, agrees, text] = s;
  a(id, channel, formula, variables, parameters, evidence, over_curve, agrees, text);
}
inline void archive_fields(python::Archive& a, Diagnosis& s) {
  auto& [verdict, sentence, baseline, corrected, before, after, alarm, location, explanations, effects,
         members, omitted, nearly, twins, unseen, next, notes, blocks, effective, laws, simulation] = s;
  a(verdict, sentence, baseline, corrected, before, after, alarm, location, explanations, effects, members,
    omitted, nearly, twins, unseen, next, notes, blocks, effective, laws, simulation);
}
inline void archive_fields(python::Archive& a, ReadingResidual& s) {
  auto& [recording, reading, stop, landmark, repeat, row, range, bearing, distance, residual, std_dev,
         bearing_residual, bearing_std_dev, corrected] = s;
  a(recording, reading, stop, landmark, repeat, row, range, bearing, distance, residual, std_dev,
    bearing_residual, bearing_std_dev, corrected);
}
inline void archive_fields(python::Archive& a, ModelResiduals& s) {
  auto& [readings, along] = s;
  a(readings, along);
}
inline void archive_fields(python::Archive& a, CurveChange::At& s) {
  auto& [distance, change, std_dev] = s;
  a(distance, change, std_dev);
}
inline void archive_fields(python::Archive& a, CurveChange& s) {
  auto& [largest, rms, at, chi_sq, p_value, degrees, exact, noise_degrees, given, reason] = s;
  a(largest, rms, at, chi_sq, p_value, degrees, exact, noise_degrees, given, reason);
}

namespace python {

/// pickle, copy and multiprocessing for a bound class, attributes given in Python included.
template <typename T>
auto picklable() {
  namespace py = pybind11;
  return py::pickle(
      [](const py::object& self) {
        Archive archive;
        T copy = self.cast<const T&>();
        archive(copy);
        return py::make_tuple(std::string(version()), py::bytes(archive.bytes()),
                              py::getattr(self, "__dict__", py::dict()));
      },
      [](const py::tuple& state) {
        if (state.size() != 3 || state[0].cast<std::string>() != version())
          throw InputError("pickled by another version of rangecal than " + std::string(version()));
        Archive archive(state[1].cast<std::string>());
        T value;
        archive(value);
        if (!archive.at_end()) throw InputError("the pickled bytes are damaged");
        return std::pair(std::move(value), state[2].cast<py::dict>());
      });
}

}  // namespace python
}  // namespace rangecal
