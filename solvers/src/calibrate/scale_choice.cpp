// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/scale_choice.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <boost/math/tools/minima.hpp>
#include <cmath>
#include <limits>
#include <numeric>
#include <set>

#include "calibrate/choice.hpp"
#include "calibrate/left_out_check.hpp"
#include "calibrate/smoothing_spline.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/problems/pairs/pairs_problem.hpp"
#include "rangecal/solvers/closed_form/polynomial_fit.hpp"
#include "rangecal/solvers/pairs_ml/pairs_ml.hpp"
#include "rangecal/solvers/statistics/median.hpp"

namespace rangecal {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

std::vector<double> scaled(std::span<const double> true_m, const CurveScale& scale) {
  std::vector<double> u;
  u.reserve(true_m.size());
  for (const double d : true_m) u.push_back(scale.of(d));
  return u;
}

/// The likelihood of one order and law, over the offset.
struct OverOffset {
  std::span<const double> true_m, reading_m;
  PairsOptions model;

  double nll(double offset) const {
    const CurveScale scale{CurveFamily::reciprocal, offset, {}};
    const PairsFit found = full_pairs(make_pairs_problem(scaled(true_m, scale), reading_m), model);
    return found.calibration.outcome == Outcome::converged ? found.nll : infinity;
  }
};

/// ln(c + d_min) at the best point of the grid, and at its neighbours.
struct Bracket {
  double low = 0.0, high = 0.0, at_best = infinity;
};

Bracket on_grid(const OverOffset& problem, double nearest, double width) {
  constexpr int points = 40;
  constexpr double low = 0.01, high = 20.0;  // of the width
  const double from = std::log(low * width), step = std::log(high / low) / (points - 1);
  Bracket bracket;
  for (int i = 0; i < points; ++i) {
    const double at = from + i * step, value = problem.nll(std::exp(at) - nearest);
    if (value < bracket.at_best) bracket = {at - step, at + step, value};
  }
  return bracket;
}

/// Every k-th reading, some 2000 of them.
std::vector<double> thinned(std::span<const double> values) {
  const std::size_t stride = 1 + values.size() / 2000;
  std::vector<double> taken;
  for (std::size_t i = 0; i < values.size(); i += stride) taken.push_back(values[i]);
  return taken;
}

}  // namespace

bool readings_fall(std::span<const double> true_m, std::span<const double> reading_m) {
  const std::size_t third = true_m.size() / 3;
  if (third == 0) return false;
  std::vector<std::size_t> order(true_m.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto nearer = [&](std::size_t a, std::size_t b) {
    return std::pair(true_m[a], a) < std::pair(true_m[b], b);
  };
  const auto near = order.begin() + static_cast<std::ptrdiff_t>(third),
             far = order.end() - static_cast<std::ptrdiff_t>(third);
  std::nth_element(order.begin(), near, order.end(), nearer);
  std::nth_element(near, far, order.end(), nearer);
  const auto median_of = [&](auto begin, auto end) {
    std::vector<double> values;
    for (auto i = begin; i != end; ++i) values.push_back(reading_m[*i]);
    return upper_median(values);
  };
  return median_of(far, order.end()) < median_of(order.begin(), near);
}

std::optional<ScaleChoice> choose_reciprocal(std::span<const double> true_m,
                                             std::span<const double> reading_m,
                                             const CalibrateOptions& options) {
  if (true_m.empty()) return std::nullopt;
  const auto [low, high] = std::minmax_element(true_m.begin(), true_m.end());
  const double nearest = *low, width = *high - *low;
  if (!(nearest >= 0.0) || !(width > 0.0)) return std::nullopt;
  const std::vector<double> few_d = thinned(true_m), few_y = thinned(reading_m);
  std::vector<ScaleChoice> fitted;
  std::vector<ModelScore> models;
  for (const NoiseLaw law : laws_to_try(options))
    for (int order = options.order.value_or(1); order <= options.order.value_or(options.max_order); ++order) {
      PairsOptions model;
      model.order = order;
      model.law = law;
      const Bracket bracket = on_grid({few_d, few_y, model}, nearest, width);
      models.push_back(
          {order, law, std::numeric_limits<double>::quiet_NaN(), infinity, CurveFamily::reciprocal});
      if (!std::isfinite(bracket.at_best)) continue;
      const OverOffset all{true_m, reading_m, model};
      const auto [at, nll] = boost::math::tools::brent_find_minima(
          [&](double x) { return all.nll(std::exp(x) - nearest); }, bracket.low, bracket.high, 26);
      if (!std::isfinite(nll)) continue;
      constexpr int noise_and_offset = 2;
      models.back().nll = nll;
      models.back().aic = 2.0 * (nll + order + 1 + noise_and_offset);
      const double value = criterion_of(models.back(), options.criterion, static_cast<double>(true_m.size()));
      fitted.push_back({{CurveFamily::reciprocal, std::exp(at) - nearest, {}}, order, law, value, order, {}});
    }
  if (fitted.empty()) return std::nullopt;
  const ScaleChoice lowest =
      *std::min_element(fitted.begin(), fitted.end(),
                        [](const ScaleChoice& a, const ScaleChoice& b) { return a.value < b.value; });
  constexpr double nearly = 4.0;
  ScaleChoice chosen = *std::find_if(fitted.begin(), fitted.end(), [&](const ScaleChoice& one) {
    return one.law == lowest.law && one.value < lowest.value + nearly;
  });
  chosen.order_of_lowest = lowest.order;
  chosen.models = std::move(models);
  return chosen;
}

namespace {

/// Weights of readings by a power law at f = level + factor u(d).
std::vector<double> weights_at(NoiseLaw law, std::span<const double> true_m, const CurveScale& scale,
                               double level, double factor) {
  const Noise unit{law, Eigen::VectorXd::Ones(1)};
  std::vector<double> weights;
  for (const double d : true_m) weights.push_back(std::pow(unit.spread(d, level + factor * scale.of(d)), -2));
  return weights;
}

/// The spline of one law.
std::optional<SmoothingSpline> spline_under(NoiseLaw law, std::span<const double> true_m,
                                            std::span<const double> reading_m) {
  constexpr int rounds = 3;  // a law's weights change by a share of what the curve does, a few percent
  std::optional<SmoothingSpline> spline = smoothing_spline(true_m, reading_m);
  for (int round = 0; round < rounds && spline && form_of(law).power_of_f > 0; ++round) {
    const std::vector<double> weights = weights_at(law, true_m, spline->scale, spline->level, spline->factor);
    spline = smoothing_spline(true_m, reading_m, weights);
  }
  return spline;
}

}  // namespace

std::optional<ScaleChoice> choose_spline(std::span<const double> true_m, std::span<const double> reading_m,
                                         const CalibrateOptions& options) {
  std::optional<ScaleChoice> lowest;
  std::vector<ModelScore> models;
  for (const NoiseLaw law : laws_to_try(options)) {
    std::optional<SmoothingSpline> spline = spline_under(law, true_m, reading_m);
    if (!spline) continue;
    CurveScale& scale = spline->scale;
    PairsOptions model;
    model.order = 1;
    model.law = law;
    const PairsFit fit = full_pairs(make_pairs_problem(scaled(true_m, scale), reading_m), model);
    models.push_back({1, law, fit.nll, infinity, CurveFamily::spline});
    if (fit.calibration.outcome != Outcome::converged) continue;
    constexpr double line_and_noise = 3.0;
    models.back().aic = 2.0 * (fit.nll + line_and_noise + scale.parameters());
    const double value = criterion_of(models.back(), options.criterion, static_cast<double>(true_m.size()));
    if (lowest && !(value < lowest->value)) continue;
    lowest = {std::move(scale), 1, law, value, 1, {}};
    lowest->alpha = fit.calibration.alpha;
    if (spline->stiffened)
      lowest->note =
          "the likeliest spline turns, or nearly, where a reading can stand for two distances; this is a smoother one that does not, and its "
          "band knows nothing of that: a curve over 1 / (d + c) may turn (--curve reciprocal)";
  }
  if (lowest) lowest->models = std::move(models);
  return lowest;
}

namespace {

/// For every reading the number of its stretch of distance, a twentieth of the readings each; readings of one distance stay
/// together.
std::vector<int> stretches_of(std::span<const double> true_m) {
  constexpr std::size_t wanted = 20;
  std::vector<double> sorted(true_m.begin(), true_m.end());
  std::sort(sorted.begin(), sorted.end());
  std::vector<int> number;
  for (const double d : true_m) {
    const auto rank =
        static_cast<std::size_t>(std::lower_bound(sorted.begin(), sorted.end(), d) - sorted.begin());
    number.push_back(static_cast<int>(rank * wanted / sorted.size()));
  }
  return number;
}

struct LeftOutFit {
  std::vector<double> d, y, weight;
  int order = 0;

  PolynomialFit on(const CurveScale& scale) const {
    return fit_polynomial(scaled(d, scale), y, order, weight);
  }
  /// The offset of least squares, near that of `scale`; the smoothing spline.
  std::optional<CurveScale> refitted(CurveScale scale, double nearest) const {
    if (scale.family == CurveFamily::spline) {
      const auto spline = smoothing_spline(d, y, weight);
      return spline ? std::optional(spline->scale) : std::nullopt;
    }
    if (scale.is_distance()) return scale;
    const double at = std::log(scale.offset_m + nearest);
    const auto squares = [&](double x) {
      const PolynomialFit fit = on({CurveFamily::reciprocal, std::exp(x) - nearest, {}});
      return fit.usable() ? fit.sigma_sq : infinity;
    };
    scale.offset_m =
        std::exp(boost::math::tools::brent_find_minima(squares, at - 0.5, at + 0.5, 20).first) - nearest;
    return scale;
  }
};

}  // namespace

std::optional<LeftOutStretches> stretches_left_out(std::span<const double> true_m,
                                                   std::span<const double> reading_m,
                                                   std::span<const double> weights, const CurveScale& scale,
                                                   int order) {
  const std::vector<int> stretch = stretches_of(true_m);
  const std::set<int> all(stretch.begin(), stretch.end());
  if (all.size() < 6) return std::nullopt;
  const double nearest = *std::min_element(true_m.begin(), true_m.end());
  LeftOutStretches errors;
  for (auto left_out = std::next(all.begin()); left_out != std::prev(all.end()); ++left_out) {
    LeftOutFit rest;
    rest.order = order;
    for (std::size_t i = 0; i < true_m.size(); ++i) {
      if (stretch[i] == *left_out) continue;
      rest.d.push_back(true_m[i]);
      rest.y.push_back(reading_m[i]);
      if (!weights.empty()) rest.weight.push_back(weights[i]);
    }
    const std::optional<CurveScale> own = rest.refitted(scale, nearest);
    if (!own) return std::nullopt;
    const PolynomialFit fit = rest.on(*own);
    if (!fit.usable()) return std::nullopt;
    double squares = 0.0, readings = 0.0;
    for (std::size_t i = 0; i < true_m.size(); ++i) {
      if (stretch[i] != *left_out) continue;
      squares += (weights.empty() ? 1.0 : weights[i]) *
                 std::pow(reading_m[i] - evaluate_polynomial(fit.alpha, own->of(true_m[i])), 2);
      readings += 1.0;
    }
    errors.mean_square.push_back(squares / readings);
    errors.readings.push_back(readings);
  }
  return errors;
}

bool spline_predicts_better(const Pairs& pairs, const ScaleChoice& spline, const CurveScale& other,
                            int order) {
  constexpr double clearly = 2.0;
  const std::vector<double> weights =
      weights_at(spline.law, pairs.true_m, spline.scale, spline.alpha[0], spline.alpha[1]);
  const auto own = stretches_left_out(pairs.true_m, pairs.reading_m, weights, spline.scale, spline.order),
             of_other = stretches_left_out(pairs.true_m, pairs.reading_m, weights, other, order);
  if (!own || !of_other) return false;
  const Gain gain = gain_of(own->mean_square, of_other->mean_square);
  return gain.mean > clearly * gain.std_dev;
}

Recording on_scale(Recording recording, const CurveScale& scale) {
  recording.pairs.true_m = scaled(recording.pairs.true_m, scale);
  return recording;
}

void take_scale(const CurveScale& scale, const Recording& over_distance, std::span<const double> weight,
                Calibration& calibration) {
  calibration.scale = scale;
  if (calibration.range_max_m > calibration.range_min_m) {  // over u, which may fall with the distance
    const double one = scale.distance(calibration.range_min_m),
                 other = scale.distance(calibration.range_max_m);
    calibration.range_min_m = std::min(one, other);
    calibration.range_max_m = std::max(one, other);
  }
  if (!scale.is_reciprocal() || !calibration.alpha_covariance) return;
  const Eigen::Index n = calibration.alpha.size();
  Eigen::VectorXd by_offset = Eigen::VectorXd::Zero(n + 1);  // f_c in powers of u
  for (Eigen::Index i = 1; i < n; ++i) by_offset[i + 1] = -static_cast<double>(i) * calibration.alpha[i];
  const std::vector<double>& d = over_distance.pairs.true_m;
  const auto rows = static_cast<Eigen::Index>(d.size());
  Eigen::MatrixXd basis(rows, n);
  Eigen::VectorXd change(rows);
  for (Eigen::Index k = 0; k < rows; ++k) {
    const auto i = static_cast<std::size_t>(k);
    const double s = calibration.noise.spread(d[i], calibration.f(d[i]));
    const double root = std::sqrt(weight.empty() ? 1.0 : weight[i]) / s;
    const Eigen::VectorXd powers = powers_of(scale.of(d[i]), n + 1);
    basis.row(k) = root * powers.head(n).transpose();
    change[k] = root * powers.dot(by_offset);
  }
  if (!basis.allFinite() || !change.allFinite()) return;
  const Eigen::VectorXd taken = basis.colPivHouseholderQr().solve(change);
  const double information = (change - basis * taken).squaredNorm();
  if (!(information > 0.0)) return;
  calibration.scale.offset_std_m = 1.0 / std::sqrt(information);
  Eigen::VectorXd t = by_offset;
  t.head(n) -= taken;
  Eigen::MatrixXd C = t * t.transpose() / information;
  C.topLeftCorner(n, n) += *calibration.alpha_covariance;
  calibration.covariance_with_choice = std::move(C);
}

}  // namespace rangecal
