// SPDX-License-Identifier: BSD-3-Clause
#include "closed_form/landmark_map.hpp"

#include <algorithm>
#include <cmath>
#include <set>

#include "closed_form/moments.hpp"

namespace rangecal {

using Eigen::Matrix2d;
using Eigen::Vector2d;

namespace {

int places_with_cells(const JointProblem& problem) {
  std::set<int> places;
  for (const int stop : problem.cells.stop) places.insert(problem.stops[stop].place);
  return static_cast<int>(places.size());
}

}  // namespace

Vector2d commanded_position(const JointProblem& problem, int stop) {
  return {problem.stops[stop].commanded.x_m, problem.stops[stop].commanded.y_m};
}

std::vector<RangeSample> samples_at(const JointProblem& problem, const LandmarkMap& map,
                                    const std::vector<StopVariance>& stops) {
  const Cells& cells = problem.cells;
  std::vector<RangeSample> samples;
  for (std::size_t c = 0; c < cells.size(); ++c) {
    const int l = cells.landmark[c];
    if (!map.used[l]) continue;
    const Vector2d v = map.position[l] - commanded_position(problem, cells.stop[c]);
    const double d = v.norm() - cells.radius_m[c];
    if (!(d > 0.0)) continue;  // a stop inside the landmark: the position is not that good
    samples.push_back({d, cells.range_mean[c], cells.count[c], cells.range_mean_square[c],
                       stops[cells.stop[c]].along(v.normalized()), l, static_cast<int>(c), cells.stop[c],
                       v.normalized()});
  }
  return samples;
}

void append_reason(std::string& text, const std::string& more) {
  if (more.empty()) return;
  if (!text.empty()) text += "; ";
  text += more;
}

std::optional<Estimate> sigma_theta_at(const JointProblem& problem, const LandmarkMap& map,
                                       const std::vector<StopVariance>& stops) {
  const Cells& cells = problem.cells;
  std::vector<MomentTerm> terms;
  std::vector<int> stop_of;
  double within = 0.0, dof = 0.0, dof_within = 0.0;
  for (std::size_t c = 0; c < cells.size(); ++c) {
    const int l = cells.landmark[c], k = cells.stop[c];
    within += cells.count[c] * cells.bearing_mean_square[c];
    dof += cells.count[c] - 1.0;
    dof_within += cells.count[c] - 1.0;
    if (!map.used[l]) continue;
    const Vector2d v = map.position[l] - commanded_position(problem, k);
    const double phi = problem.stops[k].commanded.heading_rad + cells.bearing_mean[c];
    const double angle = std::atan2(std::cos(phi) * v.y() - std::sin(phi) * v.x(),
                                    std::cos(phi) * v.x() + std::sin(phi) * v.y());
    terms.push_back({angle * angle, 1.0 / cells.count[c],
                     stops[k].off_line({std::sin(phi), -std::cos(phi)}, v.norm()) / v.squaredNorm()});
    stop_of.push_back(k);
    dof += 1.0;
  }
  for (const char used : map.used) dof -= used ? 2.0 : 0.0;
  const double variance = variance_from_moments(terms, within, dof);
  if (!(variance > 0.0)) return std::nullopt;
  // Cells of a stop see one error of it from all sides: half of their squared correlation, on average.
  double shared = 0.0;
  for (std::size_t i = 0; i < terms.size(); ++i)
    for (std::size_t j = i + 1; j < terms.size() && stop_of[j] == stop_of[i]; ++j)
      shared += 0.5 * terms[i].other / (variance * terms[i].scale + terms[i].other) * terms[j].other /
                (variance * terms[j].scale + terms[j].other);
  return Estimate{std::sqrt(variance), std_dev_from_moments(terms, shared, dof_within, dof, variance) /
                                           (2.0 * std::sqrt(variance))};
}

LandmarkMap map_from(const JointProblem& problem, const LandmarksFromBearings& found) {
  const auto raw = landmarks_from_positions(problem);
  LandmarkMap map;
  for (std::size_t l = 0; l < found.landmarks.size(); ++l) {
    const bool used = found.landmarks[l].outcome == Outcome::converged;
    map.used.push_back(used);
    map.position.push_back(used ? found.landmarks[l].position_m : raw[l].value_or(Vector2d::Zero()));
    map.covariance.push_back(used ? found.landmarks[l].covariance : Matrix2d::Zero());
  }
  return map;
}

LandmarkMap map_from(const LandmarksFromRanges& found) {
  LandmarkMap map;
  for (const LandmarkFromRanges& landmark : found.landmarks) {
    map.used.push_back(landmark.outcome == Outcome::converged);
    map.position.push_back(landmark.position_m);
    map.covariance.push_back(landmark.covariance);
  }
  return map;
}

Calibration begun_calibration(const JointProblem& problem, Method method) {
  Calibration result;
  result.method = method;
  result.covariance_reason =
      "first order, at the commanded stops; the bend that errors in the distances put into f is not in it";
  if (!problem.reads_bearings && method == Method::closed_form)
    result.covariance_reason += ", nor what taking raw ranges for true does to the landmarks";
  if (const int places = places_with_cells(problem); places < 3) {
    result.outcome = Outcome::too_few_data;
    result.reason = std::to_string(places) +
                    " place(s) to stand: lines of sight and ranges have no redundancy with fewer than 3";
  }
  return result;
}

void fill_calibration(const JointProblem& problem, const LandmarkMap& map, const RangeModel& model,
                      const std::vector<RangeSample>& samples, Calibration& result) {
  append_reason(result.reason, model.reason);
  for (int l = 0; l < problem.landmark_count(); ++l) {
    LandmarkEstimate estimate;
    estimate.recording = problem.landmark_recording[l];
    estimate.position_m = map.position[l];
    if (map.used[l]) estimate.covariance = map.covariance[l];
    result.landmarks.push_back(estimate);
  }
  if (!is_usable(model.outcome)) {
    result.outcome = model.outcome;
    return;
  }
  append_reason(result.reason, model.note);
  result.alpha = model.alpha;
  if (model.alpha_covariance.size() > 0 && model.alpha_covariance.allFinite())
    result.alpha_covariance = model.alpha_covariance;
  result.noise = model.noise;
  result.noise_estimates = model.noise_estimates;
  const auto by_distance = [](const RangeSample& a, const RangeSample& b) { return a.d < b.d; };
  result.range_min_m = std::min_element(samples.begin(), samples.end(), by_distance)->d;
  result.range_max_m = std::max_element(samples.begin(), samples.end(), by_distance)->d;
}

void fill_sigma_theta(const JointProblem& problem, const LandmarkMap& map,
                      const std::vector<StopVariance>& stops, const ClosedFormOptions& options,
                      Calibration& result) {
  if (!problem.reads_bearings) return;
  if (options.bearings.sigma_theta_rad) {
    result.sigma_theta_rad = Estimate{*options.bearings.sigma_theta_rad, std::nullopt};
    return;
  }
  result.sigma_theta_rad = sigma_theta_at(problem, map, stops);
  if (!result.sigma_theta_rad)
    append_reason(result.reason, "sigma_theta cannot be told from the errors of the stops: none is given");
}

}  // namespace rangecal
