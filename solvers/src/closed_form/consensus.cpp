// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/closed_form/consensus.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "closed_form/stop_variance.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/solvers/closed_form/landmarks_from_ranges.hpp"
#include "rangecal/solvers/statistics/median.hpp"

namespace rangecal {
namespace {

constexpr double cutoff = 6.0;                  // robust spreads
constexpr double median_of_chi_sq = 0.4549364;  // of one degree of freedom
constexpr int highest_order = 4;                // of a robust curve

/// Tukey's biweight.
double biweight(double z) {
  const double u = z / cutoff;
  return std::abs(u) < 1.0 ? (1.0 - u * u) * (1.0 - u * u) : 0.0;
}

/// tau^2 with median of r_i^2 / (v_i + tau^2 g_i) = 0.455, to a few per cent; 0 where v alone is enough. `guess`: where
/// to begin; 0: nowhere in particular.
double common_variance(const std::vector<double>& r_sq, const std::vector<double>& v,
                       const std::vector<double>& g, double guess) {
  if (r_sq.empty()) return 0.0;
  std::vector<double> ratios(r_sq.size());
  const auto middle = ratios.begin() + static_cast<std::ptrdiff_t>(ratios.size() / 2);
  const auto excess_at = [&](double tau_sq) {  // 1 at the root
    for (std::size_t i = 0; i < r_sq.size(); ++i)
      ratios[i] = r_sq[i] / std::max(v[i] + tau_sq * g[i], std::numeric_limits<double>::min());
    std::nth_element(ratios.begin(), middle, ratios.end());
    return *middle / median_of_chi_sq;
  };
  if (excess_at(0.0) <= 1.0) return 0.0;
  double tau_sq = guess;
  if (!(guess > 0.0)) {  // without v: no less than the root
    for (std::size_t i = 0; i < r_sq.size(); ++i) ratios[i] = r_sq[i] / g[i];
    std::nth_element(ratios.begin(), middle, ratios.end());
    tau_sq = *middle / median_of_chi_sq;
  }
  constexpr int iterations = 12;
  constexpr double close = 0.02;
  for (int iteration = 0; iteration < iterations; ++iteration) {
    const double excess = excess_at(tau_sq);
    if (std::abs(excess - 1.0) < close) break;
    tau_sq *= std::clamp(excess, 0.2, 5.0);
  }
  return tau_sq;
}

/// f of the robust fit and the spread about it, sqrt(v + tau^2 d^(2p)).
struct RobustCurve {
  Eigen::VectorXd alpha;
  double tau_sq = 0.0, score = std::numeric_limits<double>::infinity();
  int power = 0;
  double g(double d) const { return power == 0 ? 1.0 : power == 1 ? d * d : d * d * d * d; }
  double z(double d, double y, double v) const {
    return (y - evaluate_polynomial(alpha, d)) /
           std::sqrt(std::max(v + tau_sq * g(d), std::numeric_limits<double>::min()));
  }
};

RobustCurve robust_curve(std::span<const double> d, std::span<const double> y, std::span<const double> v,
                         int order, int power) {
  RobustCurve curve;
  curve.power = power;
  const std::size_t n = d.size();
  const double longest = *std::max_element(d.begin(), d.end()), rounding = 1e-20 * longest * longest;
  std::vector<double> g(n), square(n), weight(n), own(v.begin(), v.end());
  for (std::size_t i = 0; i < n; ++i) {
    g[i] = std::max(curve.g(d[i]), 1e-12 * curve.g(longest));
    weight[i] = 1.0 / g[i];
  }
  using Row = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, highest_order + 1, 1>;  // powers of d / longest
  using Square =
      Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, highest_order + 1, highest_order + 1>;
  Row unit = Row::Ones(order + 1);
  for (int j = 1; j <= order; ++j) unit[j] = unit[j - 1] / longest;
  // Least squares, then up to five fits of least absolute deviations, then the biweight, up to twelve in all; each kind until the curve
  // moves by less than `close` spreads.
  constexpr int absolute = 5, iterations = 12;
  constexpr double close = 0.01;
  std::vector<double> f(n, std::numeric_limits<double>::infinity()), before(n);
  const auto variance_at = [&](std::size_t i) { return v[i] + curve.tau_sq * g[i] + rounding; };
  bool by_deviations = true;
  for (int iteration = 0; iteration < iterations; ++iteration) {
    Square A = Square::Zero(order + 1, order + 1);  // its lower half, which is all that LDLT reads
    Row b = Row::Zero(order + 1), row = Row::Ones(order + 1);
    for (std::size_t i = 0; i < n; ++i) {
      for (int j = 1; j <= order; ++j) row[j] = row[j - 1] * d[i] / longest;
      b += weight[i] * y[i] * row;
      for (int j = 0; j <= order; ++j)
        for (int k = 0; k <= j; ++k) A(j, k) += weight[i] * row[j] * row[k];
    }
    curve.alpha = A.ldlt().solve(b).cwiseProduct(unit);
    before.swap(f);
    for (std::size_t i = 0; i < n; ++i) {
      f[i] = evaluate_polynomial(curve.alpha, d[i]);
      square[i] = (y[i] - f[i]) * (y[i] - f[i]);
    }
    curve.tau_sq = common_variance(square, own, g, curve.tau_sq);
    double moved = 0.0;
    for (std::size_t i = 0; i < n; ++i)
      moved = std::max(moved, std::abs(f[i] - before[i]) / std::sqrt(variance_at(i)));
    if (!by_deviations && moved < close) break;
    by_deviations = by_deviations && moved >= close && iteration < absolute;
    for (std::size_t i = 0; i < n; ++i) {
      const double variance = variance_at(i), z = std::sqrt(square[i] / variance);
      weight[i] = by_deviations ? 1.0 / (variance * std::max(z, 0.1)) : biweight(z) / variance;
    }
  }
  curve.score = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    const double variance = variance_at(i), z = std::sqrt(square[i] / variance);
    curve.score += 0.5 * std::log(variance) + 0.5 * std::pow(std::min(z, 3.0), 2);
  }
  return curve;
}

/// The power of d that is likeliest.
RobustCurve likeliest_curve(std::span<const double> d, std::span<const double> y, std::span<const double> v,
                            int order) {
  RobustCurve best;
  for (const int power : {0, 1, 2}) {
    const RobustCurve curve = robust_curve(d, y, v, order, power);
    if (curve.score < best.score) best = curve;
  }
  return best;
}

/// What is known of each reading before any curve.
struct Line {
  Eigen::Vector2d stop, along, across;
  const StopVariance* of_stop;
};

class Search {
 public:
  explicit Search(const JointProblem& rows) : rows_(rows), stops_(stop_variances(rows, std::nullopt)) {
    const Cells& c = rows.cells;
    of_landmark_.resize(rows.landmark_radius_m.size());
    for (std::size_t i = 0; i < c.size(); ++i) {
      const Pose2& pose = rows.stops[c.stop[i]].commanded;
      const double phi = pose.heading_rad + c.bearing_mean[i];
      lines_.push_back({{pose.x_m, pose.y_m},
                        {std::cos(phi), std::sin(phi)},
                        {std::sin(phi), -std::cos(phi)},
                        &stops_[c.stop[i]]});
      of_landmark_[c.landmark[i]].push_back(i);
    }
  }

  /// Steps 1 and 2.
  void place_landmarks() {
    const Cells& c = rows_.cells;
    if (!rows_.reads_bearings) {
      for (const LandmarkFromRanges& found : landmarks_from_ranges(rows_).landmarks)
        landmarks_.push_back(found.position_m);
      bearing_z_.assign(c.size(), 0.0);
      range_z_.assign(c.size(), 0.0);
      return;
    }
    for (const std::vector<std::size_t>& own : of_landmark_) {
      std::vector<double> x, y;
      for (const std::size_t i : own) {
        const Eigen::Vector2d seen = lines_[i].stop + (c.range_mean[i] + c.radius_m[i]) * lines_[i].along;
        x.push_back(seen.x());
        y.push_back(seen.y());
      }
      landmarks_.push_back(own.empty() ? Eigen::Vector2d::Zero()
                                       : Eigen::Vector2d(upper_median(x), upper_median(y)));
    }
    constexpr int iterations = 12;
    for (int iteration = 0; iteration < iterations; ++iteration) {
      angles();
      double moved = 0.0;
      for (std::size_t l = 0; l < landmarks_.size(); ++l) moved = std::max(moved, improve(l));
      if (moved < 1e-2) break;
    }
    angles();
  }

  /// Step 3.
  void fit_ranges() {
    const Cells& c = rows_.cells;
    std::vector<double> d, y, v;
    for (std::size_t i = 0; i < c.size(); ++i) {
      const Eigen::Vector2d sight = landmarks_[c.landmark[i]] - lines_[i].stop;
      const double distance = sight.norm() - c.radius_m[i];
      if (std::abs(bearing_z_[i]) > cutoff || !(distance > 0.0)) continue;
      d.push_back(distance);
      y.push_back(c.range_mean[i]);
      v.push_back(lines_[i].of_stop->along(sight.normalized()));
    }
    if (d.size() < 8) return;
    curve_ = likeliest_curve(d, y, v, 2);
    for (std::size_t i = 0; i < c.size(); ++i) range_z_[i] = range_error(i, c.landmark[i]);
  }

  Consensus result() {
    const Cells& c = rows_.cells;
    Consensus found;
    found.kept.assign(c.size(), 1);
    found.fits_landmark.assign(c.size(), -1);
    for (const std::vector<std::size_t>& own : of_landmark_) {
      std::size_t agree = 0;
      for (const std::size_t i : own) agree += agrees(i);
      if (5 * agree < 3 * own.size()) continue;
      for (const std::size_t i : own)
        if (!agrees(i)) {
          found.kept[i] = 0;
          ++found.left_out;
          found.fits_landmark[i] = other_landmark(i);
        }
    }
    found.problem = merge_rows(rows_, found.kept);
    return found;
  }

 private:
  bool agrees(std::size_t i) const {
    return std::abs(bearing_z_[i]) <= cutoff && std::abs(range_z_[i]) <= cutoff;
  }

  double angle_to(std::size_t i, std::size_t landmark) const {
    const Eigen::Vector2d sight = landmarks_[landmark] - lines_[i].stop;
    return std::atan2(sight.dot(lines_[i].across), sight.dot(lines_[i].along));
  }
  double angle_variance(std::size_t i, std::size_t landmark) const {
    const double distance = (landmarks_[landmark] - lines_[i].stop).norm();
    return lines_[i].of_stop->off_line(lines_[i].across, distance) / (distance * distance);
  }
  double range_error(std::size_t i, std::size_t landmark) const {
    if (curve_.alpha.size() == 0) return 0.0;
    const Eigen::Vector2d sight = landmarks_[landmark] - lines_[i].stop;
    const double d = sight.norm() - rows_.landmark_radius_m[landmark];
    if (!(d > 0.0)) return 0.0;
    return curve_.z(d, rows_.cells.range_mean[i], lines_[i].of_stop->along(sight.normalized()));
  }

  /// tau and the standardised angles at the present landmarks.
  void angles() {
    const Cells& c = rows_.cells;
    std::vector<double> angle(c.size()), square(c.size()), own(c.size());
    for (std::size_t i = 0; i < c.size(); ++i) {
      angle[i] = angle_to(i, c.landmark[i]);
      square[i] = angle[i] * angle[i];
      own[i] = angle_variance(i, c.landmark[i]);
    }
    tau_sq_ = std::max(common_variance(square, own, std::vector<double>(c.size(), 1.0), tau_sq_), 1e-14);
    bearing_z_.resize(c.size());
    range_z_.assign(c.size(), 0.0);
    for (std::size_t i = 0; i < c.size(); ++i) bearing_z_[i] = angle[i] / std::sqrt(own[i] + tau_sq_);
  }

  /// Moves a landmark to the weighted crossing of its lines; how far, in spreads of a line there.
  double improve(std::size_t l) {
    Eigen::Matrix2d A = Eigen::Matrix2d::Zero();
    Eigen::Vector2d b = Eigen::Vector2d::Zero();
    double all = 0.0;
    for (const std::size_t i : of_landmark_[l]) {
      const Line& line = lines_[i];
      const double distance = (landmarks_[l] - line.stop).norm();
      const double w =
          biweight(bearing_z_[i]) / ((angle_variance(i, l) + tau_sq_) * std::max(distance * distance, 1e-12));
      A += w * line.across * line.across.transpose();
      b += w * line.across * line.across.dot(line.stop - landmarks_[l]);
      all += w;
    }
    constexpr double parallel = 1e-4;  // of the sum of both eigenvalues: lines within about half a degree
    if (!(A.determinant() > parallel * all * all)) return 0.0;
    const Eigen::Vector2d step = A.inverse() * b;
    landmarks_[l] += step;
    return std::sqrt(step.dot(A * step) / std::max(1.0, static_cast<double>(of_landmark_[l].size())));
  }

  /// Another landmark of the same recording that both readings of row i agree with; -1 for none.
  int other_landmark(std::size_t i) const {
    constexpr double close = 4.0;
    int best = -1;
    double nearest = 2.0 * close * close;
    for (std::size_t l = 0; rows_.reads_bearings && l < landmarks_.size(); ++l) {
      if (static_cast<int>(l) == rows_.cells.landmark[i] || of_landmark_[l].empty() ||
          rows_.landmark_recording[l] != rows_.landmark_recording[rows_.cells.landmark[i]])
        continue;
      const double a = angle_to(i, l) / std::sqrt(angle_variance(i, l) + tau_sq_), r = range_error(i, l);
      if (std::abs(a) > close || std::abs(r) > close || a * a + r * r >= nearest) continue;
      nearest = a * a + r * r;
      best = static_cast<int>(l);
    }
    return best;
  }

  const JointProblem& rows_;
  std::vector<StopVariance> stops_;
  std::vector<Line> lines_;
  std::vector<std::vector<std::size_t>> of_landmark_;
  std::vector<Eigen::Vector2d> landmarks_;
  std::vector<double> bearing_z_, range_z_;
  double tau_sq_ = 0.0;
  RobustCurve curve_;
};

}  // namespace

Consensus find_consensus(const JointProblem& rows) {
  if (rows.cells.size() == 0) return {rows, {}, {}, 0};
  Search search(rows);
  search.place_landmarks();
  search.fit_ranges();
  return search.result();
}

std::vector<char> agreeing_pairs(std::span<const double> true_m, std::span<const double> reading_m) {
  const std::size_t n = true_m.size();
  std::vector<char> kept(n, 1);
  std::vector<double> distinct(true_m.begin(), true_m.end());
  std::sort(distinct.begin(), distinct.end());
  distinct.erase(std::unique(distinct.begin(), distinct.end()), distinct.end());
  const int order = std::min(highest_order, static_cast<int>(distinct.size()) - 1);
  if (n < 12 || order < 1 || !(distinct.front() > 0.0)) return kept;
  const std::vector<double> exact(n, 0.0);
  const RobustCurve curve = likeliest_curve(true_m, reading_m, exact, order);
  std::vector<std::size_t> by_distance(n);
  std::iota(by_distance.begin(), by_distance.end(), std::size_t{0});
  std::stable_sort(by_distance.begin(), by_distance.end(),
                   [&](std::size_t a, std::size_t b) { return true_m[a] < true_m[b]; });
  const std::size_t stretches = std::clamp<std::size_t>(n / 10, 1, 20);
  for (std::size_t part = 0; part < stretches; ++part) {
    const std::size_t begin = n * part / stretches, end = n * (part + 1) / stretches;
    std::size_t agree = 0;
    std::vector<char> own(end - begin);
    for (std::size_t j = begin; j < end; ++j) {
      const std::size_t i = by_distance[j];
      own[j - begin] = std::abs(curve.z(true_m[i], reading_m[i], 0.0)) <= cutoff;
      agree += own[j - begin];
    }
    if (5 * agree < 3 * (end - begin)) continue;
    for (std::size_t j = begin; j < end; ++j) kept[by_distance[j]] = own[j - begin];
  }
  return kept;
}

}  // namespace rangecal
