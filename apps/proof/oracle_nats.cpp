// SPDX-License-Identifier: BSD-3-Clause
// Expected log-likelihood gain of the true law over the seed model.
//
//   y: cell means of range and bearing, whitened by the clean spreads; A: orthonormal complement of alpha, landmarks
//   baseline  S0 = A^T (diag(c^2, 1) + J P0 J^T) A     planted  S1 = A^T (N1 + J P1 J^T) A
//   between = 1/2 [tr(S0^-1 S1) + m^T S0^-1 m - n + log|S0| - log|S1|],  m = A^T (mean difference)
//   within, per cell = 1/2 [tr K / c^2 - (R-1) (1 - log c^2) - log|K|],  K: covariance of the deviations
//
// c, the factor of the range spread, minimises the sum.
#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "noncentrality.hpp"
#include "rangecal/core/distributions.hpp"

namespace rangecal::proof {
namespace {

using Index = Eigen::Index;

/// Variance of the extra error of a reading that has one, evenly between `low` and `high`, with probability `share`.
double extra_variance(double share, double low, double high) {
  const double middle = 0.5 * (low + high), width = high - low;
  return share * (width * width / 12.0 + (1.0 - share) * middle * middle);
}

/// Negentropy of N(0, 1) with probability 1 - share, N(0, 1) + uniform(low, high) otherwise: log-likelihood per
/// reading that its shape gains over a normal law of the same mean and variance [nats].
double mixture_negentropy(double share, double low, double high) {
  const double width = high - low;
  if (!(share > 0.0) || !(width > 2e-6)) return 0.0;
  double entropy = 0.0;
  const double step = 0.02;
  for (double z = std::min(low, 0.0) - 8.0; z <= std::max(high, 0.0) + 8.0; z += step) {
    const double narrow = std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
    const double wide = (normal_below(z - low) - normal_below(z - high)) / width;
    const double p = (1.0 - share) * narrow + share * std::max(wide, 0.0);
    if (p > 1e-300) entropy -= step * p * std::log(p);
  }
  const double variance = 1.0 + extra_variance(share, low, high);
  return std::max(0.0, 0.5 * std::log(2.0 * std::numbers::pi * std::numbers::e * variance) - entropy);
}

/// The same of y = 1 / (1 + v z), z ~ N(0, 1): noise before the reciprocal.
double reciprocal_negentropy(double v) {
  double total = 0.0, first = 0.0, second = 0.0, logs = 0.0;
  for (double z = -6.0; z <= 6.0; z += 0.02) {
    const double base = 1.0 + v * z;
    if (base < 0.05) continue;
    const double weight = std::exp(-0.5 * z * z), y = 1.0 / base;
    total += weight, first += weight * y, second += weight * y * y,
        logs += weight * std::log(v / (base * base));
  }
  const double mean = first / total, variance = second / total - mean * mean;
  return std::max(0.0, 0.5 * std::log(variance) - logs / total);  // h(y) = h(z) + E log|dy/dz|
}

double negentropy(const SeedModel& model, const world::World& planted, const world::Expected& target) {
  double sum = 0.0;
  const int repeats = model.repeats();
  for (std::size_t i = 0; i < target.stop.size(); ++i) {
    if (target.repeat[i] != 0) continue;  // all repeats of a cell share one law
    const double sd = target.range_sd_m[i];
    sum += repeats *
           mixture_negentropy(target.tail_share[i], target.tail_low_m[i] / sd, target.tail_high_m[i] / sd);
    if (planted.noise.before_inversion)
      sum += repeats * reciprocal_negentropy(planted.noise.speckle_per_m * target.range_mean_m[i]);
  }
  return sum;
}

double missing_nats(const world::Expected& target) {
  double mean = 0.0, sum = 0.0;
  for (const double p : target.detection) mean += p / static_cast<double>(target.detection.size());
  if (mean > 1.0 - 1e-9) return 0.0;
  const auto part = [](double p, double q) { return p > 0.0 ? p * std::log(p / q) : 0.0; };
  for (const double p : target.detection)
    sum += part(p, mean) + part(1.0 - p, 1.0 - mean) - (p > 0.0 ? p * std::log(p) : 0.0);
  return sum;
}

double grid_nats(const world::Expected& target) {
  constexpr double written = 1e-7;  // digits of a recording [m, rad, 1/m]
  double sum = 0.0;
  for (const double step : {target.bearing_grid_rad, target.disparity_step_per_m, target.range_step_m})
    if (step > written) sum += static_cast<double>(target.stop.size()) * std::log(step / written);
  return sum;
}

/// Covariance of (places, headings), stacked as in the seed model's Jacobian.
Eigen::MatrixXd stop_covariance(const SeedModel& model, double placing, double walk, double heading) {
  const Index places = model.place_count(), stops = model.stop_count();
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(2 * places + stops, 2 * places + stops);
  for (Index a = 0; a < places; ++a)
    for (Index b = 0; b < places; ++b) {
      const double shared =
          walk * walk * static_cast<double>(std::min(a, b)) + (a == b ? placing * placing : 0.0);
      out(2 * a, 2 * b) = out(2 * a + 1, 2 * b + 1) = shared;
    }
  for (Index k = 0; k < stops; ++k) out(2 * places + k, 2 * places + k) = heading * heading;
  return out;
}

}  // namespace

double oracle_nats(const SeedModel& model, const world::World& planted) {
  const world::Expected target = world::expected(planted);
  const double extra = negentropy(model, planted, target) + missing_nats(target) + grid_nats(target);
  if (planted.driver.far_limit_m > 0.0) return extra;
  if (!planted.driver.swaps.empty()) return extra + 0.5 * model.fit(target).residual.squared_norm();

  const Index n = model.cells();
  const double repeats = model.repeats();
  Eigen::VectorXd range_ratio = Eigen::VectorXd::Zero(n),
                  bearing_ratio = Eigen::VectorXd::Zero(n);  // variances
  for (std::size_t i = 0; i < target.stop.size(); ++i) {
    const int c = model.cell(target.stop[i], target.landmark[i]);
    const double tail = extra_variance(target.tail_share[i], target.tail_low_m[i], target.tail_high_m[i]);
    const double sd = target.range_sd_m[i], known = model.range_sd_m(c);
    const double seen = target.detection[i] > 1e-6 ? (sd * sd + tail) / (known * known) : 1.0;
    range_ratio[c] += seen / repeats;
    bearing_ratio[c] += std::pow(target.bearing_sd_rad[i] / model.bearing_sd_rad(c), 2) / repeats;
  }
  // AR(1) over R repeats: variance of the mean, trace and log-determinant of the deviations.
  const double rho = target.smoothing, left = 1.0 - rho * rho;
  double ones = repeats;  // 1^T K 1
  for (int lag = 1; lag < model.repeats(); ++lag) ones += 2.0 * (repeats - lag) * std::pow(rho, lag);
  const double mean_gain = ones / repeats, trace = repeats - ones / repeats;
  const double inverse_ones = (repeats - (repeats - 2.0) * rho) / (1.0 + rho);
  const double log_det = (repeats - 1.0) * std::log(left) + std::log(inverse_ones / repeats);

  const Eigen::MatrixXd& jacobian = model.jacobian();
  const Index shared = 3 + 2 * model.landmark_count(), priors = jacobian.cols() - shared;
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(jacobian.topLeftCorner(2 * n, shared));
  Eigen::MatrixXd full = qr.householderQ() * Eigen::MatrixXd::Identity(2 * n, 2 * n);
  const Eigen::MatrixXd a = full.rightCols(2 * n - shared);
  const Eigen::MatrixXd stops = a.transpose() * jacobian.topRightCorner(2 * n, priors);
  const auto covariance = [&](const Eigen::VectorXd& readings, double placing, double walk, double heading) {
    return Eigen::MatrixXd(a.transpose() * readings.asDiagonal() * a +
                           stops * stop_covariance(model, placing, walk, heading) * stops.transpose());
  };
  Eigen::VectorXd readings1(2 * n);
  for (Index c = 0; c < n; ++c) {
    readings1[c] = range_ratio[c] * mean_gain +
                   repeats * std::pow(target.cell_sd_m / model.range_sd_m(static_cast<int>(c)), 2);
    readings1[n + c] = bearing_ratio[c];
  }
  const double heading1 = std::max(1e-6, target.heading_sigma_rad);
  const Eigen::MatrixXd s1 = covariance(readings1, target.placing_sigma_m, target.walk_sigma_m, heading1);
  const double log1 = 2.0 * s1.llt().matrixLLT().diagonal().array().log().sum();
  const SeedFit fit = model.fit(target);
  // The projected mean difference: undo the absorbed stops, they are in the covariance here.
  const Eigen::VectorXd moved = [&] {
    const world::Expected& clean = model.expected();
    Eigen::VectorXd mean = Eigen::VectorXd::Zero(2 * n);
    for (std::size_t i = 0; i < target.stop.size(); ++i) {
      if (!(target.detection[i] > 0.5)) continue;
      const int c = model.cell(target.stop[i], target.landmark[i]);
      const double root = std::sqrt(repeats);
      mean[c] += (target.range_mean_m[i] - clean.range_mean_m[i]) / model.range_sd_m(c) / root;
      mean[n + c] +=
          std::remainder(target.bearing_mean_rad[i] - clean.bearing_mean_rad[i], 2.0 * std::numbers::pi) /
          model.bearing_sd_rad(c) / root;
    }
    return Eigen::VectorXd(a.transpose() * mean);
  }();
  const double inside = fit.residual.rows.squaredNorm();  // means that change within a cell

  const auto divergence = [&](double log_c) {
    const double c_sq = std::exp(2.0 * log_c);
    double sum = 0.5 * inside / c_sq;
    for (Index c = 0; c < n; ++c) {
      const double q = range_ratio[c] / c_sq, b = bearing_ratio[c];
      sum += 0.5 * (q * trace - (repeats - 1.0) * (1.0 + std::log(q)) - log_det);
      sum += 0.5 * (repeats - 1.0) * (b - 1.0 - std::log(b));
    }
    Eigen::VectorXd readings0 = Eigen::VectorXd::Ones(2 * n);
    readings0.head(n).setConstant(c_sq);
    const Eigen::MatrixXd s0 = covariance(readings0, model.sigma_xy_m(), 0.0, model.sigma_heading_rad());
    const Eigen::LLT<Eigen::MatrixXd> llt(s0);
    const double log0 = 2.0 * llt.matrixLLT().diagonal().array().log().sum();
    return sum + 0.5 * (llt.solve(s1).trace() + moved.dot(llt.solve(moved)) - static_cast<double>(a.cols()) +
                        log0 - log1);
  };
  // c from the deviations within cells, then one parabola.
  const double first = 0.5 * std::log(range_ratio.mean() * trace / (repeats - 1.0)), h = 0.05;
  const double middle = divergence(first), low = divergence(first - h), high = divergence(first + h);
  const double bend = low - 2.0 * middle + high;
  double best = std::min({middle, low, high});
  if (bend > 0.0) {
    const double shift = std::clamp(0.5 * h * (low - high) / bend, -1.0, 1.0);
    best = std::min(best, divergence(first + shift));
  }
  return extra + best;
}

}  // namespace rangecal::proof
