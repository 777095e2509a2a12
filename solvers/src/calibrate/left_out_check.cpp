// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/left_out_check.hpp"

#include <fmt/core.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <utility>

#include "rangecal/core/polynomial.hpp"
#include "rangecal/solvers/calibrate/curve.hpp"

namespace rangecal {
namespace {

/// The root of f(d) = y that Newton's method finds from `near`; none where the curve turns on the way.
std::optional<double> inverted(const Eigen::VectorXd& alpha, double y, double near) {
  constexpr int most = 30;
  constexpr double flat = 0.05;
  double d = near;
  for (int step = 0; step < most; ++step) {
    const double slope = evaluate_derivative(alpha, d);
    if (!(std::abs(slope) > flat * std::abs(evaluate_derivative(alpha, near)))) return std::nullopt;
    const double move = (y - evaluate_polynomial(alpha, d)) / slope;
    d += move;
    if (!(d > 0.0) || d > 10.0 * near) return std::nullopt;
    if (std::abs(move) < 1e-9 * near) return d;
  }
  return std::nullopt;
}

/// The variance of a quantity, or the mean of several, by K groups left out, relative to the model's.
struct GroupedVariance {
  double stated = 0.0;    ///< by the model
  double measured = 0.0;  ///< by the groups
  double unseen = 0.0;    ///< the part of it that the groups do not see and the model states
  int groups = 0;         ///< K
  double per_group = 1.0;
  /// By the model, of what leaving a group out changes: sums over the groups of v_k, and of half its variance. 0: not known, m is
  /// taken to be what the model states, and all groups to count the same.
  double sum = 0.0, squares = 0.0;
};

/// Where the model holds, the part that the groups see has the mean m = c sum_k v_k, c `per_group`, and varies like a chi-square of
/// n = (K - 1) / K (sum v)^2 / sum v^2 degrees of freedom over n (Satterthwaite 1946; one degree is that of the groups' mean);
/// 3 / sqrt(2 n) are three standard deviations of its root. Groups may determine the quantity so unevenly that m is far above the
/// stated variance.
MisfitOfDeviations misfit_in(const GroupedVariance& of, const std::string& clusters, std::string where) {
  MisfitOfDeviations misfit;
  misfit.clusters = clusters;
  misfit.where = std::move(where);
  misfit.factor = std::sqrt(of.measured / of.stated);
  const bool known = of.sum > 0.0;
  const double evenly = of.groups - 1.0,
               degrees = known ? evenly / of.groups * of.sum * of.sum / of.squares : evenly,
               most = 1.0 + 3.0 / std::sqrt(2.0 * degrees), mean = known ? of.per_group * of.sum : of.stated;
  misfit.threshold = std::max(misfit.threshold, std::sqrt((mean * most * most + of.unseen) / of.stated));
  return misfit;
}

/// Keeps the one that exceeds its threshold by the larger factor.
void keep_worse(std::optional<MisfitOfDeviations>& kept, const MisfitOfDeviations& other) {
  if (!std::isfinite(other.factor)) return;
  if (!kept || other.factor / other.threshold > kept->factor / kept->threshold) kept = other;
}

/// The curve's variance at scale u.
GroupedVariance at_scale(double u, const Eigen::MatrixXd& stated, const Eigen::MatrixXd& measured, int groups,
                         const std::vector<Eigen::MatrixXd>& expected, double per_group) {
  GroupedVariance of;
  of.stated = evaluate_form(stated, u);
  of.measured = evaluate_form(measured, u);
  of.groups = groups;
  of.per_group = per_group;
  for (const Eigen::MatrixXd& one : expected) {
    const double v = std::max(0.0, evaluate_form(one, u));
    of.sum += v;
    of.squares += v * v;
  }
  return of;
}

/// Of the landmarks' places, the mean of their ratios: that of a single one has few degrees of freedom. The one that is most off is
/// named.
std::optional<MisfitOfDeviations> misfit_of_places(const Calibration& calibration,
                                                   const StopInfluence& influence) {
  GroupedVariance mean;
  mean.stated = 1.0;
  mean.groups = influence.groups();
  mean.per_group = influence.per_group;
  for (const double v : influence.expected_of_places) mean.sum += std::max(0.0, v);
  for (const double v : influence.squares_of_places) mean.squares += v;
  double worst = 0.0;
  std::string label;
  for (const LandmarkEstimate& landmark : calibration.landmarks) {
    if (!landmark.covariance || !landmark.covariance_by_stops) continue;
    const double stated = landmark.covariance->trace();
    if (!(stated > 0.0)) continue;
    const double ratio = landmark.covariance_by_stops->trace() / stated;
    mean.measured += ratio / static_cast<double>(calibration.landmarks.size());
    if (ratio <= worst) continue;
    worst = ratio;
    label = landmark.label;
  }
  if (label.empty()) return std::nullopt;
  return misfit_in(mean, "stops", fmt::format("the landmarks, most of all {}", label));
}

}  // namespace

LeftOutErrors left_out_errors(const JointProblem& problem, const ReferenceDistances& reference,
                              const JointState& state, const StopInfluence& influence,
                              const JointState& weighed_by) {
  const Cells& c = problem.cells;
  LeftOutErrors errors;
  std::vector<double> by_distance(c.size(), 0.0);  // derivative of raw less corrected weighted squares in d
  for (std::size_t k = 0; k < influence.stops.size(); ++k) {
    const Eigen::VectorXd alpha = state.alpha + influence.left_out[k].head(state.alpha.size());
    double raw = 0.0, corrected = 0.0, readings = 0.0, raw_weighted = 0.0, corrected_weighted = 0.0;
    for (const int stop : influence.stops[k])
      for (int cell = c.stop_begin[stop]; cell < c.stop_begin[stop + 1]; ++cell) {
        const std::size_t i = static_cast<std::size_t>(cell);
        const auto known = reference.at(i);
        const double y = c.range_mean[i], W = c.range_weight[i];
        if (!known || !(W > 0.0)) continue;
        const double d = known->d_m;
        const auto root = inverted(alpha, y, d);
        const double slope = root ? evaluate_derivative(alpha, *root) : 1.0, S_sq = c.range_mean_square[i],
                     s = weighed_by.noise.spread(d, evaluate_polynomial(weighed_by.alpha, d));
        const double variance = s * s / W + known->variance_m2;
        const double off = y - d, left = root.value_or(y) - d;
        const double raw_sq = off * off + S_sq, corrected_sq = left * left + S_sq / (slope * slope);
        raw += W * raw_sq;
        corrected += W * corrected_sq;
        readings += W;
        raw_weighted += raw_sq / variance;
        corrected_weighted += corrected_sq / variance;
        by_distance[i] = 2.0 * (left - off) / variance;
      }
    if (!(readings > 0.0)) continue;
    errors.raw_sq.push_back(raw);
    errors.corrected_sq.push_back(corrected);
    errors.readings.push_back(readings);
    errors.raw_weighted.push_back(raw_weighted);
    errors.corrected_weighted.push_back(corrected_weighted);
  }
  errors.reference_variance = reference.variance_of_sum(by_distance);
  return errors;
}

namespace {

/// Normal equations of the curve.
struct Normal {
  Eigen::MatrixXd A;
  Eigen::VectorXd b;  ///< right-hand side, of the residuals at the estimate
  explicit Normal(Eigen::Index size) : A(Eigen::MatrixXd::Zero(size, size)), b(Eigen::VectorXd::Zero(size)) {}
};

}  // namespace

LeftOutErrors left_out_errors(const KnownReadings& readings, const Calibration& calibration,
                              const Calibration& weighed_by, StopInfluence& halves) {
  LeftOutErrors errors;
  const std::size_t count = readings.true_m.size();
  const Eigen::Index size = calibration.alpha.size();
  if (count == 0 || size == 0) return errors;
  const std::span<const int> groups = readings.block;
  const std::size_t group_count =
      static_cast<std::size_t>(*std::max_element(groups.begin(), groups.end())) + 1;
  std::vector<Normal> own(group_count, Normal(size));
  std::vector<Normal> half(2, Normal(size));
  Normal all(size);
  Eigen::VectorXd powers(size);
  for (std::size_t i = 0; i < count; ++i) {
    const double d = readings.true_m[i], f = evaluate_polynomial(calibration.alpha, d);
    const double s = calibration.noise.spread(d, f), weight = readings.weight[i] / (s * s);
    if (!std::isfinite(weight)) return errors;
    powers[0] = 1.0;
    for (Eigen::Index j = 1; j < size; ++j) powers[j] = powers[j - 1] * d;
    for (Normal* one : {&own[groups[i]], &half[2 * i >= count], &all}) {
      one->A.noalias() += weight * powers * powers.transpose();
      one->b += weight * (readings.reading_m[i] - f) * powers;
    }
  }
  std::vector<Eigen::VectorXd> alpha;
  for (const Normal& one : own) {
    const Eigen::LDLT<Eigen::MatrixXd> left(all.A - one.A);
    alpha.push_back(calibration.alpha + left.solve(all.b - one.b) - all.A.ldlt().solve(all.b));
  }
  for (std::vector<double>* sums : {&errors.raw_sq, &errors.corrected_sq, &errors.readings,
                                    &errors.raw_weighted, &errors.corrected_weighted})
    sums->assign(group_count, 0.0);
  for (std::size_t i = 0; i < count; ++i) {
    const double d = readings.true_m[i], y = readings.reading_m[i];
    const std::size_t k = static_cast<std::size_t>(groups[i]);
    if (readings.judged[i] == 0 || !(d > 0.0)) continue;  // an outlier's error says nothing of the curve
    const auto root = inverted(alpha[k], y, d);
    const double s = weighed_by.noise.spread(d, evaluate_polynomial(weighed_by.alpha, d));
    const double raw = (y - d) * (y - d), corrected = std::pow(root.value_or(y) - d, 2);
    errors.readings[k] += 1.0;
    errors.raw_sq[k] += raw;
    errors.corrected_sq[k] += corrected;
    errors.raw_weighted[k] += raw / (s * s);
    errors.corrected_weighted[k] += corrected / (s * s);
  }
  const Eigen::LLT<Eigen::MatrixXd> first(half[0].A), second(half[1].A);
  if (first.info() == Eigen::Success && second.info() == Eigen::Success && first.rcond() > 1e-13 &&
      second.rcond() > 1e-13) {
    halves.halves_difference = first.solve(half[0].b) - second.solve(half[1].b);
    halves.halves_covariance = first.solve(Eigen::MatrixXd::Identity(size, size)) +
                               second.solve(Eigen::MatrixXd::Identity(size, size));
  }
  return errors;
}

Gain gain_of(const std::vector<double>& simpler, const std::vector<double>& other) {
  const double K = static_cast<double>(other.size());
  Gain gain;
  double square = 0.0;
  for (std::size_t k = 0; k < other.size(); ++k) gain.mean += (other[k] - simpler[k]) / K;
  for (std::size_t k = 0; k < other.size(); ++k) square += std::pow(other[k] - simpler[k] - gain.mean, 2);
  gain.std_dev = std::sqrt(square / (K - 1.0) / K);
  return gain;
}

std::optional<Gain> gain_of(const LeftOutErrors& simpler, const LeftOutErrors& other) {
  if (simpler.readings != other.readings || other.readings.size() < 4) return std::nullopt;
  return gain_of(simpler.corrected_weighted, other.corrected_weighted);
}

std::optional<LeftOutCheck> left_out_check(const LeftOutErrors& errors, const StopInfluence* influence,
                                           const std::string& what) {
  constexpr std::size_t fewest = 4;
  const std::size_t groups = errors.readings.size();
  const auto judged =
      std::count_if(errors.readings.begin(), errors.readings.end(), [](double n) { return n > 0.0; });
  if (judged < static_cast<std::ptrdiff_t>(fewest)) return std::nullopt;
  const double K = static_cast<double>(groups);
  LeftOutCheck check;
  check.groups = static_cast<int>(groups);
  check.what = what;
  double readings = 0.0;
  for (const double n : errors.readings) readings += n;
  const auto root_mean = [&](const std::vector<double>& squares, double& rms, double& std_dev) {
    double sum = 0.0, spread = 0.0;
    for (const double square : squares) sum += square;
    const double mean = sum / readings;
    for (std::size_t k = 0; k < groups; ++k) spread += std::pow(squares[k] - mean * errors.readings[k], 2);
    rms = std::sqrt(mean);
    std_dev = rms > 0.0 ? std::sqrt(spread * K / (K - 1.0)) / readings / (2.0 * rms) : 0.0;
  };
  root_mean(errors.raw_sq, check.rms_raw_m, check.rms_raw_std_m);
  root_mean(errors.corrected_sq, check.rms_corrected_m, check.rms_corrected_std_m);
  double mean = 0.0, square = 0.0;
  for (std::size_t k = 0; k < groups; ++k)
    mean += (errors.raw_weighted[k] - errors.corrected_weighted[k]) / K;
  for (std::size_t k = 0; k < groups; ++k)
    square += std::pow(errors.raw_weighted[k] - errors.corrected_weighted[k] - mean, 2);
  // Chance is what differs from group to group, and what the reference has in common for all.
  const double deviation = std::sqrt(square / (K - 1.0) / K + errors.reference_variance / (K * K));
  const double needed = boost::math::quantile(boost::math::students_t(K - 1.0), 0.975);
  double raw = 0.0, corrected = 0.0;
  for (std::size_t k = 0; k < groups; ++k) {
    raw += errors.raw_weighted[k];
    corrected += errors.corrected_weighted[k];
  }
  // A curve that is by chance a little too steep shrinks noise and readings together: significantly, but that is no gain.
  constexpr double matters = 0.9;  // of the squares: 5 % of the error
  const bool beyond_chance = mean > needed * deviation, enough = corrected < matters * raw,
             smaller = check.rms_corrected_m <= check.rms_raw_m;
  check.usable = beyond_chance && enough && smaller;
  if (!check.usable)
    check.reason = fmt::format(
        "corrected readings are {} ({:.3g} +- {:.1g} against {:.3g} +- {:.1g} m RMS at {} left out)",
        !smaller         ? "no better than raw ones"
        : !beyond_chance ? "not better than raw ones by more than chance"
                         : "hardly better than raw ones",
        check.rms_corrected_m, check.rms_corrected_std_m, check.rms_raw_m, check.rms_raw_std_m, what);
  if (influence && influence->halves_difference.size() > 0) {
    const Eigen::LLT<Eigen::MatrixXd> factor(influence->halves_covariance);
    if (factor.info() == Eigen::Success) {
      const double chi_sq = influence->halves_difference.dot(factor.solve(influence->halves_difference));
      const boost::math::chi_squared law(static_cast<double>(influence->halves_difference.size()));
      if (std::isfinite(chi_sq))
        check.halves_p_value = boost::math::cdf(boost::math::complement(law, chi_sq));
    }
  }
  return check;
}

std::optional<MisfitOfDeviations> misfit_of(const Calibration& calibration, const StopInfluence* by_stops,
                                            const LandmarkInfluence* by_landmarks) {
  std::optional<MisfitOfDeviations> worst;
  if (!calibration.alpha_covariance) return worst;
  const Eigen::MatrixXd& stated = *calibration.alpha_covariance;
  const Eigen::Index alphas = stated.rows();
  for (const CurvePoint& point : curve_points(calibration)) {
    const double u = calibration.scale.of(point.distance_m);
    const std::string where = fmt::format("the curve at {:.2f} m", point.distance_m);
    if (by_stops)
      keep_worse(worst, misfit_in(at_scale(u, stated, by_stops->covariance.topLeftCorner(alphas, alphas),
                                           by_stops->groups(), by_stops->expected, by_stops->per_group),
                                  "stops", where));
    if (by_landmarks) {
      GroupedVariance of = at_scale(u, stated, by_landmarks->covariance(), by_landmarks->groups,
                                    by_landmarks->expected, by_landmarks->per_group);
      of.unseen = evaluate_form(by_landmarks->of_poses, u);
      keep_worse(worst, misfit_in(of, "landmarks", where));
    }
  }
  if (by_stops)
    if (const auto of_places = misfit_of_places(calibration, *by_stops)) keep_worse(worst, *of_places);
  return worst;
}

}  // namespace rangecal
