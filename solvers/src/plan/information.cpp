// SPDX-License-Identifier: BSD-3-Clause
#include "plan/information.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"

namespace rangecal::plan {

using diagnosis::Rows;

Rows expected_rows(const PlanRequest& request, const PlanDesign& design, bool every_repeat,
                   JointState& state) {
  const Scene& sketch = request.sketch;
  Recording recording = unread_recording(sketch);
  recording.stops = design.stops;
  for (std::size_t l = 0; l < design.landmarks.size(); ++l)
    recording.landmarks.push_back({"L" + std::to_string(l), design.radius_m[l], std::nullopt});
  Readings& r = recording.readings;
  for (std::size_t k = 0; k < design.stops.size(); ++k) {
    const Pose2& pose = design.stops[k].commanded;
    for (std::size_t l = 0; l < design.landmarks.size(); ++l) {
      const Eigen::Vector2d v = design.landmarks[l] - Eigen::Vector2d(pose.x_m, pose.y_m);
      const double d = v.norm() - design.radius_m[l];
      if (!(d > std::max(0.05, sketch.visible_min_m) && d < sketch.visible_max_m)) continue;
      const double y = evaluate_polynomial(sketch.alpha, d);
      if (!(y > sketch.sensor.range_min_m && y < sketch.sensor.range_max_m)) continue;
      const auto headings = static_cast<std::size_t>(design.headings), places = k / headings;
      const auto turns = places * (headings - 1) + k % headings;
      const double time_s = static_cast<double>(places) * request.costs.place_s +
                            static_cast<double>(turns) * request.costs.turn_s;
      for (int repeat = 0; repeat < (every_repeat ? design.repeats : 1); ++repeat) {
        r.stop.push_back(static_cast<int>(k));
        r.landmark.push_back(static_cast<int>(l));
        r.repeat.push_back(repeat);
        r.time_s.push_back(time_s + repeat * request.costs.scan_s);
        r.range_m.push_back(y);
        if (sketch.reads_bearings)
          r.bearing_rad.push_back(wrap_angle(std::atan2(v.y(), v.x()) - pose.heading_rad));
        r.row.push_back(0);
      }
    }
  }
  Rows rows = diagnosis::make_rows({&recording, 1});
  if (!every_repeat) {
    Cells& cells = rows.problem.cells;
    const auto stand_for_repeats = [&](std::vector<double>& weights) {
      std::fill(weights.begin(), weights.end(), static_cast<double>(design.repeats));
    };
    stand_for_repeats(cells.count);
    stand_for_repeats(cells.range_weight);
    if (sketch.reads_bearings) stand_for_repeats(cells.bearing_weight);
  }
  state = {};
  state.alpha = sketch.alpha;
  state.noise = sketch.noise;
  state.sigma_theta_rad = sketch.reads_bearings ? sketch.sigma_theta_rad : SilentBearing::sigma_theta_rad;
  for (const Stop& stop : design.stops) state.stops.push_back(stop.commanded);
  state.landmarks = design.landmarks;
  return rows;
}

std::vector<Nuisance> nuisances_of(const PlanRequest& request, const Rows& rows) {
  std::vector<Nuisance> nuisances;
  for (const std::string& id : request.effects) {
    const Effect* effect = find_effect(id);
    if (!effect)
      throw InputError("plan: '" + id + "' is no effect of the catalogue; 'rangecal effects' lists them");
    if (effect->info().channel == "bearing" && !request.sketch.reads_bearings)
      throw InputError("plan: the effect '" + id +
                       "' changes bearings, which the sketch's sensor does not read");
    const std::vector<Eigen::VectorXd> grid = effect->start_grid(rows.context);
    if (grid.empty())
      throw InputError("plan: the effect '" + id + "' needs columns that a plan does not have");
    Nuisance nuisance{{effect, grid[grid.size() / 2]}, {}};
    const auto& parameters = effect->info().parameters;
    for (std::size_t j = 0; j < parameters.size(); ++j) {
      if (parameters[j].discrete || parameters[j].typical == 0.0) continue;
      if (parameters[j].linear)
        nuisance.active.parameters[static_cast<Eigen::Index>(j)] = parameters[j].typical;
      nuisance.indices.push_back(static_cast<int>(j));
    }
    if (nuisance.indices.empty()) throw InputError("plan: the effect '" + id + "' is not a matter of size");
    nuisances.push_back(std::move(nuisance));
  }
  return nuisances;
}

double criterion(const PlanRequest& request, const PlanDesign& design,
                 const std::vector<Nuisance>& nuisances) {
  constexpr double none = std::numeric_limits<double>::infinity();
  JointState state;
  const Rows rows = expected_rows(request, design, false, state);
  std::vector<int> seen(design.landmarks.size(), 0);
  for (const int l : rows.landmark) ++seen[static_cast<std::size_t>(l)];
  if (std::any_of(seen.begin(), seen.end(), [](int count) { return count < 3; })) return none;
  const auto [low, high] = std::minmax_element(rows.range_m.begin(), rows.range_m.end());
  const double width = *high - *low;  // no extrapolation beyond a tenth of what is read
  if (evaluate_polynomial(state.alpha, request.low_m) < *low - 0.1 * width ||
      evaluate_polynomial(state.alpha, request.high_m) > *high + 0.1 * width)
    return none;
  const diagnosis::Projector projector(rows, diagnosis::working_problem(rows, {}, state), state);
  const Eigen::Index n = state.alpha.size();
  Eigen::MatrixXd C = projector.phi_covariance().topLeftCorner(n, n);
  if (!C.allFinite() || (C.diagonal().array() <= 0.0).any()) return none;
  std::vector<diagnosis::Signature> signatures;
  std::vector<double> typical;
  for (const Nuisance& nuisance : nuisances)
    for (const int j : nuisance.indices) {
      signatures.push_back(diagnosis::effect_signature(rows, projector, nuisance.active, j));
      typical.push_back(nuisance.active.effect->info().parameters[static_cast<std::size_t>(j)].typical);
    }
  if (!signatures.empty()) {
    const auto count = static_cast<Eigen::Index>(signatures.size());
    Eigen::MatrixXd M = Eigen::MatrixXd::Zero(count, count), A(n, count);
    for (Eigen::Index a = 0; a < count; ++a) {  // per typical size
      const double scale = typical[static_cast<std::size_t>(a)];
      Eigen::VectorXd phi, stops;
      projector.absorbed(signatures[static_cast<std::size_t>(a)], phi, stops);
      A.col(a) = scale * phi.head(n);
      const Eigen::VectorXd projected = projector.project(signatures[static_cast<std::size_t>(a)]);
      for (Eigen::Index b = 0; b <= a; ++b)
        M(a, b) = M(b, a) = scale * typical[static_cast<std::size_t>(b)] *
                            projector.inner(signatures[static_cast<std::size_t>(b)], projected,
                                            signatures[static_cast<std::size_t>(a)]);
    }
    M.diagonal().array() += 1.0;
    C += A * M.ldlt().solve(A.transpose());
  }
  double largest = 0.0;
  for (int i = 0; i <= 8; ++i) {
    const double d = request.low_m + (request.high_m - request.low_m) * i / 8.0;
    const Eigen::VectorXd phi = powers_of(d, n);
    const double slope = std::abs(evaluate_derivative(state.alpha, d));
    largest = std::max(largest, std::sqrt(phi.dot(C * phi)) / slope);
  }
  return std::isfinite(largest) ? largest : none;
}

}  // namespace rangecal::plan
