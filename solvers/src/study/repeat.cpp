// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <optional>

#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/study/bound.hpp"
#include "rangecal/solvers/study/sums.hpp"
#include "study/repeat_estimates.hpp"

namespace rangecal {
namespace {

/// True distances beside raw readings, to score a curve on.
struct TestReadings {
  std::vector<double> d, y, exact;  ///< exact: f(d)
};

TestReadings test_readings(const Study& study, const StudyPoint& point, int repeat) {
  const Scene& scene = point.scene;
  const Recording recording = simulate(scene, study_seed(study, point, repeat, "test"));
  TestReadings test;
  if (scene.kind == RecordingKind::pairs) {
    test.d = recording.pairs.true_m;
    test.y = recording.pairs.reading_m;
  } else {
    const Readings& readings = recording.readings;
    for (std::size_t i = 0; i < readings.size(); ++i) {
      const Pose2& stop = *recording.truth.stops[readings.stop[i]];
      const Eigen::Vector2d& landmark = *recording.truth.landmarks[readings.landmark[i]];
      test.d.push_back((landmark - Eigen::Vector2d(stop.x_m, stop.y_m)).norm() -
                       recording.landmarks[readings.landmark[i]].radius_m);
      test.y.push_back(readings.range_m[i]);
    }
  }
  for (const double d : test.d) test.exact.push_back(evaluate_polynomial(scene.alpha, d));
  return test;
}

void add_mse(const TestReadings& test, const Eigen::VectorXd& alpha, bool relative, double* sums) {
  if (test.d.empty()) return;
  double raw = 0.0, corrected = 0.0, exact_raw = 0.0, exact_corrected = 0.0;
  const double share = 1.0 / static_cast<double>(test.d.size());
  for (std::size_t i = 0; i < test.d.size(); ++i) {
    const double d = test.d[i], w = relative ? share / (d * d) : share;
    const auto square = [&](double other) { return w * (other - d) * (other - d); };
    raw += square(test.y[i]);
    corrected += square(least_squares_distance(alpha, test.y[i]));
    exact_raw += square(test.exact[i]);
    exact_corrected += square(least_squares_distance(alpha, test.exact[i]));
  }
  const double ratio = raw / corrected, log = std::log10(ratio);
  const double values[mse_slots] = {
      1.0,           raw, raw * raw, corrected, corrected * corrected, raw * corrected, ratio,
      ratio * ratio, log, log * log, exact_raw, exact_corrected};
  for (int i = 0; i < mse_slots; ++i) sums[i] += values[i];
}

void add_ratio(const std::optional<double>& estimate, double truth, double* sums) {
  if (!estimate || !(truth > 0.0)) return;
  const double ratio = *estimate / truth;
  sums[0] += 1.0;
  sums[1] += ratio;
  sums[2] += ratio * ratio;
}

/// The curve's error at the study's distances, and whether the 95 % intervals hold it.
void add_curve(const Study& study, const StudyPoint& point, const RepeatEstimate& found,
               const StudyLayout& layout, double* sums) {
  double total = 0.0;
  for (int i = 0; i < layout.curve; ++i) {
    const double d = study.curve_m[i];
    const double error = evaluate_polynomial(found.alpha, d) - evaluate_polynomial(point.scene.alpha, d);
    sums[layout.curve_error + i] += error;
    sums[layout.curve_square + i] += error * error;
    total += error * error;
    if (!found.alpha_covariance) continue;
    const Eigen::VectorXd powers = powers_of(d, found.alpha.size());
    const double variance = powers.dot(*found.alpha_covariance * powers);
    if (!(variance > 0.0)) continue;
    sums[layout.cover + 2] += 1.0;
    sums[layout.cover + 3] += std::abs(error) <= z95 * std::sqrt(variance);
  }
  sums[layout.curve_total] += total;
  sums[layout.curve_total_square] += total * total;
}

void add_landmarks(const Recording& recording, const std::vector<int>& seen, const RepeatEstimate& found,
                   const StudyLayout& layout, double* sums) {
  double total = 0.0;
  for (std::size_t l = 0; l < found.landmarks.size(); ++l) {
    const Eigen::Vector2d error = found.landmarks[l] - *recording.truth.landmarks[seen[l]];
    total += error.squaredNorm();
    for (int axis = 0; axis < 2; ++axis) {
      const int slot = 2 * seen[l] + axis;
      sums[layout.landmark_error + slot] += error[axis];
      sums[layout.landmark_square + slot] += error[axis] * error[axis];
      if (found.landmark_variance.size() == 0) continue;
      const double variance = found.landmark_variance[2 * static_cast<Eigen::Index>(l) + axis];
      if (!(variance > 0.0)) continue;
      sums[layout.cover] += 1.0;
      sums[layout.cover + 1] += std::abs(error[axis]) <= z95 * std::sqrt(variance);
    }
  }
  sums[layout.landmark_total] += total;
  sums[layout.landmark_total_square] += total * total;
}

void add_estimate(const Study& study, const StudyPoint& point, const RepeatEstimate& found,
                  const std::optional<TestReadings>& test, const StudyLayout& layout, double* sums) {
  sums[layout.outcome + static_cast<int>(found.outcome)] += 1.0;
  const std::vector<double>& scores = found.aic_by_order;
  const auto finite = [](double score) { return std::isfinite(score); };
  if (!scores.empty() &&
      std::all_of(scores.begin(), scores.end(), finite)) {  // only then are they comparable
    sums[layout.aic] += 1.0;
    for (std::size_t i = 0; i < scores.size(); ++i) sums[layout.aic + 2 + i] += scores[i];
  }
  if (!found.answered()) return;
  sums[layout.answers] += 1.0;
  const auto order = static_cast<int>(found.alpha.size()) - 1;
  if (order <= study_highest_order) sums[layout.order + order] += 1.0;
  add_curve(study, point, found, layout, sums);
  add_ratio(found.sigma_e, point.scene.noise.parameters[0], sums + layout.sigma_e);
  add_ratio(found.sigma_theta, point.scene.sigma_theta_rad, sums + layout.sigma_theta);
  if (test)
    add_mse(*test, found.alpha, study.measures_any({StudyMeasure::normalised_mse}), sums + layout.mse);
}

void add_noise_order(const Recording& recording, const StudyEstimator& estimator, const StudyLayout& layout,
                     double* sums) {
  const NoiseOrder found = noise_order(recording.pairs, estimator.divisor);
  sums[layout.outcome + static_cast<int>(found.outcome)] += 1.0;
  if (found.outcome != Outcome::converged) return;
  sums[layout.answers] += 1.0;
  sums[layout.power + found.best_power] += 1.0;
  for (int s = 0; s < 4; ++s) sums[layout.power + 4 + s] += found.hypotheses[s].log_likelihood;
}

/// The bound of this repeat's own placement, where landmarks are drawn anew.
void add_bound(const Study& study, const StudyPoint& point, const Recording& recording,
               const JointProblem& problem, const std::vector<int>& seen, double* sums) {
  const auto bound = placement_bound(study, point, recording, problem, seen);
  if (!bound) return;
  sums[0] += 1.0;
  sums[1] += bound->landmarks_sq;
  sums[2] += bound->curve_sq;
}

}  // namespace

void run_study_repeat(const Study& study, const StudyPoint& point, const StudyLayout& layout, int repeat,
                      StudySums& sums) {
  const double begin = thread_seconds();
  const Scene& scene = point.scene;
  const bool pairs = scene.kind == RecordingKind::pairs;
  const Recording recording = simulate(scene, study_seed(study, point, repeat, "readings"));
  std::optional<TestReadings> test;
  if (study.measures_any({StudyMeasure::mse_ratio, StudyMeasure::normalised_mse}))
    test = test_readings(study, point, repeat);
  std::optional<LandmarkEstimates> landmarks;
  std::optional<PairsProblem> known;
  if (pairs)
    known = make_pairs_problem({&recording, 1});
  else
    landmarks.emplace(recording);
  ++sums.repeats;
  sums.seconds[0] += thread_seconds() - begin;

  for (int e = 0; e < layout.estimators; ++e) {
    const StudyEstimator& estimator = study.estimators[e];
    double* row = sums.numbers.data() + layout.of(e);
    const double start = thread_seconds();
    if (estimator.noise_order) {
      add_noise_order(recording, estimator, layout, row);
      sums.seconds[e + 1] += thread_seconds() - start;
      continue;
    }
    const RepeatModel model{point.order ? point.order : estimator.order, study.max_order,
                            study.noise.value_or(scene.noise.law)};
    const RepeatEstimate found =
        pairs ? estimate_pairs(recording, *known, estimator, model) : landmarks->estimate(estimator, model);
    sums.seconds[e + 1] += thread_seconds() - start + found.shared_seconds;
    add_estimate(study, point, found, test, layout, row);
    if (!pairs && found.answered()) add_landmarks(recording, landmarks->seen(), found, layout, row);
  }
  if (scene.random_landmarks && study.measures_any({StudyMeasure::rmse_over_bound}))
    add_bound(study, point, recording, landmarks->problem(), landmarks->seen(),
              sums.numbers.data() + layout.bound);
}

}  // namespace rangecal
