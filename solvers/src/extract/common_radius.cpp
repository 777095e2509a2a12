// SPDX-License-Identifier: BSD-3-Clause
#include "extract/common_radius.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "extract/arc_slope.hpp"
#include "rangecal/core/angles.hpp"

namespace rangecal::extract {
namespace {

constexpr int kRadiusPasses = 30, kLeastPasses = 3;
constexpr double kRadiusSettled = 0.02;  ///< the last step, in standard deviations
constexpr double kRadiusStep = 0.2;      ///< the largest step, as a share of R
constexpr double kProbe = 0.1;           ///< step of second differences, in standard deviations of (s, b)

/// A weighted sum of directions.
struct AxisMoment {
  double weight = 0.0, sum = 0.0;
};

/// What arcs say of R.
struct RadiusScore {
  double score = 0.0, information = 0.0, chi_squared = 0.0;
  int degrees = 0;
};

struct ArcScore {
  RadiusScore radius;
  double axis_rad = 0.0, axis_weight = 0.0;  ///< of the ranges alone
};

/// c: half the trace of the second derivatives of mu by (s, b) and the covariance of (s, b) [m].
double bend(const CircleFit& fit, double radius, double bearing, const Eigen::Matrix2d& root) {
  const auto at = [&](double s, double b) {
    return arc_point(fit.range_m + s, fit.bearing_rad + b, radius, bearing).range_m;
  };
  double sum = 0.0;
  for (int k = 0; k < 2; ++k) {
    const Eigen::Vector2d probe = kProbe * root.col(k);
    sum += at(probe(0), probe(1)) - 2.0 * at(0.0, 0.0) + at(-probe(0), -probe(1));
  }
  return 0.5 * sum / (kProbe * kProbe);
}

std::vector<Beam> beams_about(const Arc& arc, double axis_rad, double radius, double edge_cut) {
  std::vector<Beam> inner;
  for (const Beam& beam : arc.beams)
    if (std::abs((arc.range_m + radius) * std::sin(beam.bearing_rad - axis_rad)) <= edge_cut * radius)
      inner.push_back(beam);
  return inner;
}

std::optional<ArcScore> score_arc(const Arc& arc, double axis_rad, double radius, double edge_cut) {
  const std::vector<Beam> inner = beams_about(arc, axis_rad, radius, edge_cut);
  if (inner.size() < 3) return std::nullopt;
  const double half = arc.outline.half_width_rad;
  const Outline about{axis_rad, 0.5 * half, half};  // holds the axis where the ranges do not
  const double all_beams = std::numeric_limits<double>::infinity();
  const auto fit =
      fit_circle(inner, about, {.radius_m = radius, .sigma_m = arc.sigma_m, .edge_cut = all_beams});
  if (!fit) return std::nullopt;

  const auto count = static_cast<Eigen::Index>(inner.size());
  Eigen::MatrixXd slopes(count, 3);
  Eigen::VectorXd error(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Beam& beam = inner[static_cast<std::size_t>(i)];
    const ArcPoint point = arc_point(fit->range_m, fit->bearing_rad, radius, beam.bearing_rad);
    slopes.row(i) = point.slope.transpose() / arc.sigma_m;
    error(i) = (beam.range_m - point.range_m) / arc.sigma_m;
  }
  const Eigen::Matrix3d information = slopes.transpose() * slopes;
  const Eigen::Matrix2d own = information.topLeftCorner<2, 2>();
  if (!(own.determinant() > 0.0)) return std::nullopt;
  const Eigen::Matrix2d covariance = own.inverse();
  const Eigen::Matrix2d root = covariance.llt().matrixL();
  const Eigen::Vector2d share = covariance * information.topRightCorner<2, 1>();
  const Eigen::VectorXd left = slopes.col(2) - slopes.leftCols<2>() * share;

  ArcScore out;
  out.radius.chi_squared = error.squaredNorm(), out.radius.degrees = static_cast<int>(count) - 2;
  for (Eigen::Index i = 0; i < count; ++i)
    error(i) += bend(*fit, radius, inner[static_cast<std::size_t>(i)].bearing_rad, root) / arc.sigma_m;
  out.radius.score = left.dot(error), out.radius.information = left.squaredNorm();
  out.axis_rad = fit->bearing_rad, out.axis_weight = 1.0 / covariance(1, 1);
  return out;
}

/// Adds the arcs of one stop. `axes`: what each said of the axis in the pass before, from the first one's outline; renewed.
void add_stop(const std::vector<Arc>& arcs, double radius, double edge_cut, std::vector<AxisMoment>& axes,
              RadiusScore& sum) {
  AxisMoment all;
  for (const AxisMoment& axis : axes) all.weight += axis.weight, all.sum += axis.sum;
  for (std::size_t i = 0; i < arcs.size(); ++i) {
    const Outline& outline = arcs[i].outline;
    const double from = arcs.front().outline.centre_rad, off = wrap_angle(outline.centre_rad - from);
    const double weight = 1.0 / (outline.centre_sd_rad * outline.centre_sd_rad);
    const double axis =
        (weight * off + all.sum - axes[i].sum) / std::max(weight, weight + all.weight - axes[i].weight);
    const auto one = score_arc(arcs[i], outline.centre_rad + axis - off, radius, edge_cut);
    all.weight -= axes[i].weight, all.sum -= axes[i].sum;
    axes[i] = {};
    if (!one) continue;
    sum.score += one->radius.score, sum.information += one->radius.information;
    sum.chi_squared += one->radius.chi_squared, sum.degrees += one->radius.degrees;
    axes[i] = {one->axis_weight, one->axis_weight * wrap_angle(one->axis_rad - from)};
    all.weight += axes[i].weight, all.sum += axes[i].sum;
  }
}

}  // namespace

std::optional<RadiusEstimate> common_radius(const std::vector<std::vector<Arc>>& stops, double start_m,
                                            const RadiusLimits& limits) {
  std::vector<std::vector<AxisMoment>> axes;
  for (const std::vector<Arc>& arcs : stops) axes.emplace_back(arcs.size());
  // A hit at the edge that comes and goes with R makes the score jump: where the steps turn back they are halved.
  double radius = start_m, step = 0.0, share = 1.0;
  for (int pass = 1; pass <= kRadiusPasses; ++pass) {
    RadiusScore sum;
    for (std::size_t k = 0; k < stops.size(); ++k) add_stop(stops[k], radius, limits.edge_cut, axes[k], sum);
    if (!(sum.information > 0.0)) return std::nullopt;
    const double sd = 1.0 / std::sqrt(sum.information);
    const double wanted = sum.score / sum.information;
    if (pass > kLeastPasses && wanted * step < 0.0) share *= 0.5;
    step = share * std::clamp(wanted, -kRadiusStep * radius, kRadiusStep * radius);
    radius += step;
    if (!(radius >= limits.least_m && radius <= limits.most_m)) return std::nullopt;
    if (pass >= kLeastPasses && std::abs(step) < kRadiusSettled * sd)
      return RadiusEstimate{radius,
                            sd * std::sqrt(std::max(1.0, sum.chi_squared / std::max(1, sum.degrees)))};
  }
  return std::nullopt;
}

}  // namespace rangecal::extract
