// SPDX-License-Identifier: BSD-3-Clause
// Where the estimate of a stream of landmark readings starts: at `marginal` of its first stops, and where stops that are held would
// lie.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "calibrate/landmarks_job.hpp"
#include "marginal/laplace.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "rangecal/solvers/closed_form/consensus.hpp"
#include "rangecal/solvers/closed_form/landmark_calibration.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"
#include "rangecal/solvers/statistics/median.hpp"
#include "recursive/landmark_answer.hpp"
#include "recursive/predicted_reading.hpp"

namespace rangecal {
namespace {

using Eigen::VectorXd;

/// The better of the starts, by the joint NLL.
std::optional<JointState> start_of(const JointProblem& problem, int order, NoiseLaw law) {
  ClosedFormOptions closed;
  closed.order = order;
  closed.noise_law = law;
  std::optional<JointState> best;
  double lowest = std::numeric_limits<double>::infinity();
  const auto consider = [&](auto&& make) {
    try {
      const JointState state = make();
      const double nll = joint_nll(problem, state);
      if (!(nll < lowest)) return;
      lowest = nll;
      best = state;
    } catch (const InputError&) {  // this start does not exist for this problem; the other may
    }
  };
  consider([&] { return closed_form_state(problem, closed); });
  consider([&] { return position_seed(problem, order, law); });
  return best;
}

void append_cell(const Cells& from, std::size_t i, Cells& to) {
  to.stop.push_back(0);
  to.landmark.push_back(from.landmark[i]);
  for (const auto column :
       {&Cells::count, &Cells::range_weight, &Cells::bearing_weight, &Cells::range_mean,
        &Cells::range_mean_square, &Cells::bearing_mean, &Cells::bearing_mean_square, &Cells::radius_m})
    (to.*column).push_back((from.*column)[i]);
}

/// d with f(d) = y for the start of a landmark; y itself where the curve has none near, which is near enough for a start.
double inverted(const VectorXd& alpha, double y) {
  const std::optional<double> d = invert_near(alpha, y);
  return d && *d > 0.2 * y && *d < 5.0 * y ? *d : y;
}

/// Rows that lie within six spreads of what `state` foretells of them, and those of landmarks that it does not know.
std::vector<char> agreeing(const JointProblem& rows, const JointState& state) {
  constexpr double far = 6.0;
  const Cells& c = rows.cells;
  const std::vector<StopVariance> variances = stop_variances(rows, std::nullopt);
  std::vector<char> kept(c.size(), 1);
  for (std::size_t i = 0; i < c.size(); ++i) {
    const auto k = static_cast<std::size_t>(c.stop[i]), l = static_cast<std::size_t>(c.landmark[i]);
    if (l >= state.landmarks.size()) continue;
    const auto predicted = predicted_reading(state, state.stops[k], variances[k], state.landmarks[l],
                                             c.radius_m[i], c.range_mean[i], c.bearing_mean[i]);
    kept[i] = predicted && std::abs(predicted->range.z()) < far && std::abs(predicted->bearing.z()) < far;
  }
  return kept;
}

/// Stop after stop of a random walk from where the one before was found, by what it sees of the landmarks of
/// `state`: the commanded path alone drifts away from them within a block.
void find_stops(const JointProblem& walk, JointState& state) {
  const bool looks_for_outliers = walk.rows_alike;
  const Cells& c = walk.cells;
  const auto known = static_cast<int>(state.landmarks.size());
  for (std::size_t k = 1; k < walk.stops.size(); ++k) {
    Pose2& pose = state.stops[k];
    pose = commanded_step(walk, state.stops[k - 1], k);
    const bool turned = !walk.stops[k].opens_place;  // where it stood: its heading alone is open
    if (turned && !looks_for_outliers) continue;
    JointProblem one;
    one.stops = {walk.stops[k]};
    one.stops[0].opens_place = true;
    if (turned) one.stops[0].sigma_xy_m = 0.0;
    one.rows_alike = looks_for_outliers;
    one.stops[0].commanded = pose;
    one.stops[0].place = 0;
    one.stops[0].chained = false;
    one.stops[0].shape.reset();
    one.place_count = 1;
    one.sigma_s_shared = {0};
    one.landmark_radius_m.assign(walk.landmark_radius_m.begin(), walk.landmark_radius_m.begin() + known);
    one.landmark_recording.assign(one.landmark_radius_m.size(), 0);
    for (int i = c.stop_begin[k]; i < c.stop_begin[k + 1]; ++i)
      if (c.landmark[static_cast<std::size_t>(i)] < known)
        append_cell(c, static_cast<std::size_t>(i), one.cells);
    one.cells.stop_begin = {0, static_cast<int>(one.cells.size())};
    JointState at = state;
    at.stops = {pose};
    if (one.rows_alike) one = merge_rows(one, agreeing(one, at));
    JointSystem system(one, static_cast<int>(at.alpha.size()), 1);
    int evaluations = 0;
    if (std::isfinite(settle_stops(system, at, evaluations))) pose = at.stops[0];
  }
}

/// Why the stops are too few for a curve of this order; none where they are enough.
std::optional<std::string> too_few_stops(const JointProblem& problem, int order) {
  const int places = problem.place_count;
  if (places < 3)
    return fmt::format("{} place(s) to stand: lines of sight have no redundancy with fewer than 3", places);
  const double cells = static_cast<double>(problem.cells.size()),
               unknowns = order + 1 + 2.0 * problem.landmark_count();
  if (2.0 * cells < unknowns + 2.0)
    return fmt::format("{} cells of range and bearing for {} unknowns of curve and landmarks", cells,
                       unknowns);
  if (cells < order + 2) return fmt::format("{} distances for a curve of order {}", cells, order);
  return std::nullopt;
}

}  // namespace

RecursiveLandmarks::Answer RecursiveLandmarks::first_answer(const JointProblem& stops, int order) const {
  Answer answer;
  answer.order = order;
  if (const auto why = too_few_stops(stops, order)) {
    answer.outcome = Outcome::too_few_data;
    answer.reason = *why;
    return answer;
  }
  // Outliers do not move the consensus.
  const bool looks = looks_for_outliers();
  const JointProblem cells = looks ? find_consensus(stops).problem : JointProblem();
  const JointProblem& gaussian = looks ? cells : stops;
  const auto start = start_of(gaussian, order, options_.law);
  if (!start) {
    answer.reason = "no start inside the model's domain was found";
    return answer;
  }
  JointOptions with_sigmas_held;
  with_sigmas_held.held.sigmas = true;
  MarginalFit fit;
  for (const JointOptions& joint_options : {JointOptions{}, with_sigmas_held}) {
    const JointFit joint = solve_joint_block(gaussian, *start, joint_options);
    if (joint.outcome != Outcome::converged) {
      if (fit.reason.empty()) fit.reason = joint.reason;
      continue;
    }
    fit = solve_marginal(gaussian, joint.state, {});
    if (fit.outcome == Outcome::converged) break;
  }
  if (looks) {
    RobustMarginalFit shaped =
        solve_marginal_robust(stops, is_usable(fit.outcome) ? fit.state : *start, options_.noise_shape);
    fit = std::move(shaped.fit);
    if (!ChannelShapes(shaped.shapes.range.shape, shaped.shapes.bearing.shape).gaussian()) {
      fit.marginal_nll = shaped.shapes.nll;
      answer.shapes = std::move(shaped.shapes);
    }
  }
  answer.outcome = fit.outcome;
  answer.reason = fit.reason;
  answer.weakest_direction = fit.weakest_direction;
  answer.covariance_reason = fit.covariance_reason;
  answer.iterations = fit.iterations;
  if (!is_usable(fit.outcome)) return answer;
  answer.state = fit.state;
  answer.nll = fit.marginal_nll;
  answer.covariance = fit.covariance;
  answer.log_sigmas = log_sigmas_of(fit.state);
  if (answer.shapes) answer.outliers = outliers_among(stops, answer.state, *answer.shapes);
  return answer;
}

/// Stops to where the readings that agree with the map of `state` put them; those of a random walk are there already.
void RecursiveLandmarks::settle_held(JointState& state) const {
  if (options_.random_walk) return;
  JointState known = state;
  known.landmarks.resize(last_->landmarks.size());
  const JointProblem cells = merge_rows(held_, agreeing(held_, known));
  JointState settled = state;
  JointSystem system(cells, static_cast<int>(state.alpha.size()), 1);
  int evaluations = 0;
  if (std::isfinite(settle_stops(system, settled, evaluations))) state = std::move(settled);
}

JointState RecursiveLandmarks::start_of_held() const {
  JointState state = *last_;
  Pose2 first = held_.stops.empty() ? Pose2{} : held_.stops[0].commanded;
  if (anchored_) {
    const LastPose law = sums_->last_pose->at(sums_->grid.weights(log_sigmas_of(state)))
                             .moved(phi_of(state) - sums_->reference);
    first = law.pose(law.mean[0]);
  }
  state.stops = commanded_from(held_, first);
  if (anchored_) find_stops(held_, state);
  const Cells& c = held_.cells;
  for (std::size_t l = state.landmarks.size(); l < labels_.size(); ++l) {
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();
    std::vector<double> x, y, count;
    for (std::size_t i = 0; i < c.size(); ++i) {
      if (c.landmark[i] != static_cast<int>(l)) continue;
      const Pose2& stop = state.stops[static_cast<std::size_t>(c.stop[i])];
      const double phi = stop.heading_rad + c.bearing_mean[i],
                   r = inverted(state.alpha, c.range_mean[i]) + c.radius_m[i];
      x.push_back(stop.x_m + r * std::cos(phi));
      y.push_back(stop.y_m + r * std::sin(phi));
      count.push_back(c.count[i]);
      sum += count.back() * Eigen::Vector2d(x.back(), y.back());
    }
    if (x.empty())
      state.landmarks.push_back(Eigen::Vector2d::Zero());
    else if (looks_for_outliers())
      state.landmarks.emplace_back(upper_median(x, count), upper_median(y, count));
    else
      state.landmarks.push_back(sum / std::accumulate(count.begin(), count.end(), 0.0));
  }
  return state;
}

}  // namespace rangecal
