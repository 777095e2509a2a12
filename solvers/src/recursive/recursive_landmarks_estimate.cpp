// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <span>
#include <tuple>

#include "calibrate/landmarks_job.hpp"
#include "joint_ml/newton_step.hpp"
#include "marginal/laplace.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/scaled_inverse.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"
#include "recursive/landmark_answer.hpp"
#include "recursive/pose_leverage.hpp"
#include "recursive/residual_sketch.hpp"
#include "robust/robust_covariance.hpp"
#include "solver_log.hpp"

namespace rangecal {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

void put(JointState& state, const VectorXd& phi, const Eigen::Vector2d& log_sigmas) {
  const Eigen::Index alphas = state.alpha.size();
  state.alpha = phi.head(alphas);
  for (std::size_t l = 0; l < state.landmarks.size(); ++l)
    state.landmarks[l] = phi.segment<2>(alphas + 2 * static_cast<Eigen::Index>(l));
  state.noise.parameters[0] = std::exp(log_sigmas.x());
  state.sigma_theta_rad = std::exp(log_sigmas.y());
}

/// The entries of (alpha, landmarks, log sigmas) that are free.
std::vector<int> free_entries(Eigen::Index size, int alphas, int order) {
  std::vector<int> free;
  for (int i = 0; i < static_cast<int>(size); ++i)
    if (i <= order || i >= alphas) free.push_back(i);
  return free;
}

/// Inverse over the entries that are free, zero elsewhere; none where it is not positive definite.
std::optional<MatrixXd> covariance_from(const MatrixXd& hessian, int alphas, int order) {
  const std::vector<int> free = free_entries(hessian.rows(), alphas, order);
  const std::optional<UnitDiagonalInverse> own = unit_diagonal_inverse(hessian(free, free));
  if (!own || !(own->inverse.diagonal().maxCoeff() < 1e11)) return std::nullopt;
  MatrixXd covariance = MatrixXd::Zero(hessian.rows(), hessian.rows());
  covariance(free, free) = own->scale.asDiagonal() * own->inverse * own->scale.asDiagonal();
  return covariance;
}

/// What a Hessian of (alpha, landmarks, then what else) says least of, in words.
std::string least_seen(const JointProblem& problem, const MatrixXd& hessian, int alphas, int order) {
  JointFit fit;
  describe_covariance(hessian, JointLayout(problem, alphas, 1, false),
                      free_entries(hessian.rows(), alphas, order), fit);
  return fit.weakest_direction;
}

/// With the landmarks' labels, and the names of the noise.
std::string with_names(std::string direction, const std::vector<std::string>& labels) {
  const std::string noise = "noise parameter 0";
  if (const std::size_t at = direction.find(noise); at != std::string::npos)
    direction.replace(at, noise.size(), "log sigma_e");
  return with_labels(direction, labels);
}

/// What the likelihood of the shapes is above that of the Gaussian readings that stand for the rows at `state` [nats].
double excess_nll(const JointProblem& rows, const JointProblem& cells, const JointState& state,
                  const RobustShapes& shapes) {
  const RobustNll nll = robust_nll(rows, state, shapes.range, shapes.bearing);
  return nll.joint - joint_nll(cells, state);
}

}  // namespace

std::pair<ChannelResiduals, ChannelResiduals> residuals_of(const JointProblem& rows,
                                                           const JointState& state) {
  constexpr double least_left = 0.05;
  ReadingErrors errors = reading_errors(rows, state, {}, {});
  std::pair<ChannelResiduals, ChannelResiduals> residuals;
  if (errors.range_z.empty()) return residuals;
  const PoseLeverage leverage = pose_leverage(rows, state);
  for (std::size_t i = 0; i < errors.range_z.size(); ++i) {
    errors.range_z[i] /= std::sqrt(std::max(least_left, 1.0 - leverage.range[i]));
    errors.bearing_z[i] /= std::sqrt(std::max(least_left, 1.0 - leverage.bearing[i]));
  }
  residuals.second = {std::move(errors.bearing_z),
                      std::vector<double>(errors.range_s.size(), state.sigma_theta_rad), rows.cells.count};
  residuals.first = {std::move(errors.range_z), std::move(errors.range_s), rows.cells.count};
  return residuals;
}

int outliers_among(const JointProblem& rows, const JointState& state, const RobustShapes& shapes) {
  const ReadingErrors errors = reading_errors(rows, state, shapes.range, shapes.bearing);
  double count = 0.0;
  for (std::size_t i = 0; i < errors.range_z.size(); ++i)
    if (std::max(errors.range_outlier[i], errors.bearing_outlier[i]) > 0.5) count += rows.cells.count[i];
  return static_cast<int>(std::min(count, 2e9));
}

VectorXd reference_with(const LandmarkSums& sums, const JointState& state) {
  VectorXd reference = phi_of(state);
  reference.head(sums.reference.size()) = sums.reference;
  return reference;
}

std::pair<double, double> distances_of(const JointProblem& problem, const JointState& state, double low,
                                       double high) {
  const Cells& c = problem.cells;
  for (std::size_t i = 0; i < c.size(); ++i) {
    const Pose2& pose = state.stops[static_cast<std::size_t>(c.stop[i])];
    const double d =
        (state.landmarks[static_cast<std::size_t>(c.landmark[i])] - Eigen::Vector2d(pose.x_m, pose.y_m))
            .norm() -
        c.radius_m[i];
    low = std::max(0.0, std::min(low, d));
    high = std::max(high, d);
  }
  return {low, high};
}

/// What the first stop leaves open of a random walk, which its sums take as exact: `third`, T of the sums,
/// tells how A, and with it the log-determinant, changes with phi.
void RecursiveLandmarks::add_first_pose(Answer& answer, const MatrixXd& hessian,
                                        const std::vector<MatrixXd>& third) const {
  const Eigen::Index alphas = answer.state.alpha.size(), phis = hessian.rows() - 2;
  MatrixXd Q = MatrixXd::Zero(hessian.rows(), 3);
  for (std::size_t l = 0; l < answer.state.landmarks.size(); ++l) {
    const Eigen::Vector2d away = answer.state.landmarks[l] - first_position_m_;
    Q.block<2, 3>(alphas + 2 * static_cast<Eigen::Index>(l), 0) << 1.0, 0.0, -away.y(), 0.0, 1.0, away.x();
  }
  const Eigen::Matrix3d open =
      Eigen::Matrix3d::Identity() + first_covariance_ * (Q.transpose() * hessian * Q);
  answer.nll += 0.5 * std::log(open.determinant());
  const MatrixXd M = open.inverse() * first_covariance_, AQM = hessian * Q * M;
  VectorXd slope = VectorXd::Zero(hessian.rows());
  for (Eigen::Index i = 0; i < phis; ++i) {
    if (!third.empty())
      slope[i] =
          0.5 *
          (third[static_cast<std::size_t>(i)] * Q.topRows(phis) * M * Q.topRows(phis).transpose()).trace();
    const bool x = (i - alphas) % 2 == 0;  // the arm of Q's turn moves with the landmark
    if (i >= alphas) slope[i] += x ? AQM(i + 1, 2) : -AQM(i - 1, 2);
  }
  put(answer.state, phi_of(answer.state) - (*answer.covariance * slope).head(phis), answer.log_sigmas);
  *answer.covariance += Q * first_covariance_ * Q.transpose();
}

RecursiveLandmarks::Answer RecursiveLandmarks::from_sums(int order) const {
  constexpr int most_gaussian = 15,
                most_shaped = 60;  // expectation and maximisation goes slower than Newton's steps
  // standard deviations; the step is of third order, so that what is left is far smaller
  constexpr double still = 3e-3;
  SolverLog log("recursive landmarks");
  if (log.on()) log.of(fmt::format("order {}", order));
  Answer answer;
  const auto end = [&] { log.end(answer.iterations, answer.nll, not_known, answer.outcome, answer.reason); };
  answer.order = order;
  answer.state = start_of_held();
  const int alphas = options_.columns();
  const VectorXd reference = reference_with(*sums_, answer.state);
  LandmarkSums before = *sums_;
  before.grow(reference);
  answer.log_sigmas = log_sigmas_of(answer.state);
  if (looks_for_outliers() && held_.cells.size() > 0) {
    settle_held(answer.state);
    answer.shapes = shapes_beside(answer.state);
  }
  const LastPose* last_pose = before.last_pose ? &*before.last_pose : nullptr;
  SumsFit fit;
  std::vector<MatrixXd> third;
  JointState last = answer.state;
  for (answer.iterations = 1;; ++answer.iterations) {
    LandmarkSums total = before;
    if (held_.cells.size() > 0) {
      auto latest = expand_held(answer, before.grid, reference, last_pose);
      for (int half = 0; !latest && half < 6 && answer.iterations > 1;
           ++half) {  // a step out of the model's domain
        put(answer.state, 0.5 * (phi_of(answer.state) + phi_of(last)), answer.log_sigmas);
        latest = expand_held(answer, before.grid, reference, last_pose);
      }
      if (!latest) {
        answer.reason =
            "the latest stops have no optimum inside the model's domain beside what was summed up before; calibrate the "
            "recording as a whole";
        end();
        return answer;
      }
      total.add(*latest);
      answer.held = std::move(latest);
    }
    fit = minimise_sums(total, alphas, order, answer.log_sigmas);
    third = std::move(total.third);
    if (!fit.ok) {
      answer.outcome = Outcome::unobservable;
      answer.reason =
          "what was summed up of the stops before does not determine curve and landmarks where the answer has gone "
          "since; calibrate the recording as a whole";
      MatrixXd here = total.at(answer.log_sigmas).hessian;
      const VectorXd delta = phi_of(answer.state) - reference;
      for (std::size_t i = 0; i < third.size(); ++i) here += delta[static_cast<Eigen::Index>(i)] * third[i];
      answer.weakest_direction = least_seen(held_, here, alphas, order);
      if (options_.random_walk)
        answer.reason =
            "what was summed up of the walk says too little where it has gone since; calibrate it as a whole";
      end();
      return answer;
    }
    const VectorXd step = fit.phi - phi_of(answer.state);
    const double moved =
        std::sqrt(std::max(0.0, step.dot(fit.hessian.topLeftCorner(step.size(), step.size()) * step)));
    log.iteration(answer.iterations, fit.nll, moved, not_known);
    last = answer.state;
    put(answer.state, fit.phi, fit.log_sigmas);
    answer.log_sigmas = fit.log_sigmas;
    // Of weights that were taken at the stops where they agreed, one more expectation at least.
    const int fewest = answer.shapes ? 2 : 1;
    if (held_.cells.size() == 0 || (moved < still && answer.iterations >= fewest)) break;
    if (answer.iterations == (answer.shapes ? most_shaped : most_gaussian)) {
      answer.outcome = Outcome::not_converged;
      answer.reason = fmt::format(
          "the answer still moves by {:.1g} standard deviations after {} updates; calibrate the recording as a whole",
          moved, answer.iterations);
      end();
      return answer;
    }
  }
  if (!fit.settled) {
    answer.outcome = Outcome::not_converged;
    answer.reason =
        fmt::format("the search for sigma_e and sigma_theta stopped where up to {:.1g} nats are left to gain",
                    fit.to_gain);
    end();
    return answer;
  }
  answer.nll = fit.nll;
  answer.at_edge = fit.at_edge;
  take_shapes_into(answer);
  MatrixXd information = fit.hessian;
  if (answer.shapes) information += information_gap(answer, gap_, 1.0);
  answer.covariance = covariance_from(information, alphas, order);
  answer.outcome = answer.covariance ? Outcome::converged : Outcome::unobservable;
  if (!answer.covariance) {
    answer.reason = "curve and landmarks are not determined by the readings";
    answer.covariance_reason = "no covariance: " + answer.reason;
    answer.weakest_direction = least_seen(held_, fit.hessian, alphas, order);
  } else if (fit.at_edge) {
    answer.reason =
        "sigma_e or sigma_theta is held at the end of the interval in which the readings were summed up";
  }
  if (answer.covariance && options_.random_walk) add_first_pose(answer, fit.hessian, third);
  if (answer.covariance && squared_) {
    LandmarkSums squared = *squared_;
    squared.grow(reference);
    if (answer.held) squared.add(*answer.held);
    MatrixXd J = information_at(squared, fit.phi - reference, fit.log_sigmas);
    if (answer.shapes && sum_w_ > 0.0) J += information_gap(answer, squared_gap_, sum_w_sq_ / sum_w_);
    const MatrixXd sandwich = *answer.covariance * J * *answer.covariance;
    const std::vector<int> free = free_entries(sandwich.rows(), alphas, order);
    if (Eigen::LLT<MatrixXd>(sandwich(free, free)).info() == Eigen::Success) answer.covariance = sandwich;
  }
  end();
  return answer;
}

double RecursiveLandmarks::readings_counted() const {
  ChannelResiduals summed;
  range_residuals_->append_to(summed);
  return summed.count() + held_.readings;
}

double RecursiveLandmarks::typical_spread(const JointState& state) const {
  ChannelResiduals residuals;
  range_residuals_->append_to(residuals);
  const ReadingErrors held = reading_errors(held_, state, {}, {});
  residuals.s.insert(residuals.s.end(), held.range_s.begin(), held.range_s.end());
  residuals.weight.insert(residuals.weight.end(), held_.cells.count.begin(),
                          held_.cells.count.begin() + static_cast<std::ptrdiff_t>(held.range_s.size()));
  return residuals.typical_spread();
}

/// What readings of the shapes tell of phi = (alpha, landmarks) beyond the cells that stand for them. Along a random walk,
/// where stops are not for themselves: none (from_sums enlarges the covariance there).
MatrixXd RecursiveLandmarks::gap_of(const JointProblem& cells, const JointState& state,
                                    const RobustShapes& shapes) const {
  if (options_.random_walk) return {};
  return shape_information_gap(cells, state, shapes.range, shapes.bearing, typical_spread(state));
}

/// The same of all that is summed up (`summed`) and of the stops held, with that of both sigmas from the readings, which
/// count `weight` each.
MatrixXd RecursiveLandmarks::information_gap(const Answer& answer, const MatrixXd& summed,
                                             double weight) const {
  const Eigen::Index phis = phi_of(answer.state).size();
  MatrixXd gap = MatrixXd::Zero(phis + 2, phis + 2);
  gap.topLeftCorner(summed.rows(), summed.cols()) += summed;
  gap.topLeftCorner(answer.gap.rows(), answer.gap.cols()) += answer.gap;
  const double readings = weight * readings_counted();
  gap(phis, phis) +=
      shape_information_of_log_sigma(answer.shapes->range, typical_spread(answer.state), readings);
  gap(phis + 1, phis + 1) +=
      shape_information_of_log_sigma(answer.shapes->bearing, answer.state.sigma_theta_rad, readings);
  return gap;
}

/// The rows held as cells of the Gaussian readings that they stand for at `state`. Throws InputError where a distance or a
/// spread is not positive there.
JointProblem RecursiveLandmarks::held_cells(const JointState& state,
                                            const std::optional<RobustShapes>& shapes) const {
  if (!looks_for_outliers()) return held_;
  return shapes ? weighted_problem(held_, state, shapes->range, shapes->bearing) : merge_rows(held_);
}

/// The stops held, expanded at the answer, whose stops move there.
std::optional<LandmarkSums> RecursiveLandmarks::expand_held(Answer& answer, const SigmaGrid& grid,
                                                            const VectorXd& reference,
                                                            const LastPose* last_pose) const {
  try {
    return expand_stops(held_cells(answer.state, answer.shapes), answer.state, grid, reference, last_pose);
  } catch (const InputError&) {  // a distance or a spread that is not positive at this state
    return std::nullopt;
  }
}

/// What the shapes make of the stops held, at the answer: the likelihood that is theirs, outliers, and what readings of
/// the shapes tell of phi.
void RecursiveLandmarks::take_shapes_into(Answer& answer) const {
  if (!answer.shapes || held_.cells.size() == 0) return;
  const JointProblem cells = held_cells(answer.state, answer.shapes);
  const double excess = excess_nll(held_, cells, answer.state, *answer.shapes);
  answer.nll += excess;
  answer.held->value.array() += excess;
  answer.outliers = outliers_among(held_, answer.state, *answer.shapes);
  answer.gap = gap_of(cells, answer.state, *answer.shapes);
}

/// The shapes summed up under, and of a channel whose noise was Gaussian so far the one that gains enough on it at the
/// residuals summed up and those of the stops held at `state`.
std::optional<RobustShapes> RecursiveLandmarks::shapes_beside(const JointState& state) const {
  RobustShapes shapes = shapes_.value_or(RobustShapes{});
  const auto known = [](const NoiseShapeParameters& shape) { return shape.shape != NoiseShape::gaussian; };
  if (known(shapes.range) && known(shapes.bearing)) return shapes;
  auto [range, bearing] = residuals_of(held_, state);
  if (range.z.empty()) return shapes_;
  range_residuals_->append_to(range);
  bearing_residuals_->append_to(bearing);
  if (!known(shapes.range)) shapes.range = shape_beside({}, range, range_shapes());
  if (!known(shapes.bearing)) shapes.bearing = shape_beside({}, bearing, bearing_shapes());
  if (ChannelShapes(shapes.range.shape, shapes.bearing.shape).gaussian()) return std::nullopt;
  return shapes;
}

/// The shape asked for, or the family that gains enough on `own` and on the Gaussian, at these residuals.
NoiseShapeParameters RecursiveLandmarks::shape_beside(const NoiseShapeParameters& own,
                                                      const ChannelResiduals& residuals,
                                                      std::span<const NoiseShape> families) const {
  if (options_.noise_shape != NoiseShape::automatic)
    return fit_residual_shape(residuals, first_residual_shape(residuals, options_.noise_shape)).shape;
  if (own.shape == NoiseShape::gaussian && !may_have_outliers(residuals)) return own;
  const RankedShapes ranked = rank_shapes(residuals, families);  // AIC above the Gaussian's
  const auto present = std::find_if(ranked.begin(), ranked.end(),
                                    [&](const auto& one) { return one.first.shape.shape == own.shape; });
  const auto& [best, aic] = ranked.front();
  if (present == ranked.end() || aic < present->second - stream_margin_aic)
    return aic < -stream_margin_aic ? best.shape : NoiseShapeParameters{};
  return present->second < -stream_margin_aic ? present->first.shape : NoiseShapeParameters{};
}

RecursiveLandmarks::Answer RecursiveLandmarks::answer(int order) const {
  if (!sums_) return first_answer(held_, order);
  Answer found = from_sums(order);
  if (!found.covariance || !found.shapes) return found;
  if (options_.random_walk) {
    const auto least = [](const NoiseShapeParameters& shape, double spread) {
      const ShapeInformation information = shape_information(shape, spread);
      return information.location / information.weight;
    };
    *found.covariance /= std::min(least(found.shapes->range, typical_spread(found.state)),
                                  least(found.shapes->bearing, found.state.sigma_theta_rad));
  }
  // The shapes' parameters are estimated beside all else.
  const double readings = readings_counted();
  const int log_sigma = static_cast<int>(found.covariance->rows()) - 2;
  found.shapes->range_std = add_shape_uncertainty(found.shapes->range, typical_spread(found.state), readings,
                                                  log_sigma, *found.covariance);
  found.shapes->bearing_std = add_shape_uncertainty(found.shapes->bearing, found.state.sigma_theta_rad,
                                                    readings, log_sigma + 1, *found.covariance);
  return found;
}

Calibration RecursiveLandmarks::calibration_of(const Answer& answer) const {
  Calibration result;
  result.method = Method::marginal;
  result.outcome = answer.outcome;
  result.reason = with_names(answer.reason, labels_);
  result.counts = counts_;
  result.iterations = answer.iterations;
  result.covariance_reason = with_names(answer.covariance_reason, labels_);
  result.weakest_direction = with_names(answer.weakest_direction, labels_);
  if (!is_usable(answer.outcome) || answer.state.alpha.size() == 0) {
    if (result.covariance_reason.empty()) result.covariance_reason = "no estimate, so no covariance";
    return result;
  }
  const Eigen::Index alphas = answer.state.alpha.size(), kept = answer.order + 1;
  const auto std_dev = [&](Eigen::Index i, double factor) -> std::optional<double> {
    if (!answer.covariance) return std::nullopt;
    return factor * std::sqrt((*answer.covariance)(i, i));
  };
  const Eigen::Index sigmas = alphas + 2 * static_cast<Eigen::Index>(labels_.size());
  result.alpha = answer.state.alpha.head(kept);
  if (answer.covariance) result.alpha_covariance = answer.covariance->topLeftCorner(kept, kept);
  result.noise = answer.state.noise;
  result.noise_estimates = {
      Estimate{result.noise.parameters[0], std_dev(sigmas, result.noise.parameters[0])}};
  result.sigma_theta_rad =
      Estimate{answer.state.sigma_theta_rad, std_dev(sigmas + 1, answer.state.sigma_theta_rad)};
  for (std::size_t l = 0; l < labels_.size(); ++l) {
    LandmarkEstimate landmark;
    landmark.label = labels_[l];
    landmark.position_m = answer.state.landmarks[l];
    const Eigen::Index at = alphas + 2 * static_cast<Eigen::Index>(l);
    if (answer.covariance) landmark.covariance = answer.covariance->block<2, 2>(at, at);
    result.landmarks.push_back(landmark);
  }
  std::tie(result.range_min_m, result.range_max_m) = distances_of(held_, answer.state, low_m_, high_m_);
  if (!std::isfinite(result.range_min_m)) result.range_min_m = 0.0;
  if (answer.shapes) {
    if (const auto shape = shape_estimate(answer.shapes->range, answer.shapes->range_std))
      result.noise_shapes["range"] = *shape;
    if (const auto shape = shape_estimate(answer.shapes->bearing, answer.shapes->bearing_std))
      result.noise_shapes["bearing"] = *shape;
    result.outlier_count = outliers_ + answer.outliers;
  }
  result.marginal_nll = answer.nll;
  const int of_shapes = answer.shapes ? shape_parameter_count(answer.shapes->range.shape) +
                                            shape_parameter_count(answer.shapes->bearing.shape)
                                      : 0;
  result.aic = 2.0 * (answer.nll + static_cast<double>(kept + 2 + of_shapes) +
                      2.0 * static_cast<double>(labels_.size()));
  return result;
}

Calibration RecursiveLandmarks::estimate() {
  if (labels_.empty()) {
    Answer none;
    none.outcome = Outcome::too_few_data;
    none.reason = "no usable reading";
    return calibration_of(none);
  }
  bool settled = false;  // of the best
  const auto best_of_orders = [&] {
    std::optional<Calibration> best;
    for (int order = options_.order.value_or(1); order <= options_.order.value_or(options_.max_order);
         ++order) {
      const Answer found = answer(order);
      const Calibration fit = calibration_of(found);
      const bool better = !best || (fit.outcome == Outcome::converged &&
                                    (best->outcome != Outcome::converged || *fit.aic < *best->aic));
      if (!better) continue;
      best = fit;
      settled = found.settled();
    }
    return *best;
  };
  const Calibration best = best_of_orders();
  return !settled && sums_ && sum_up_anew() ? best_of_orders() : best;
}

}  // namespace rangecal
