// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/correction/effect_correction.hpp"

#include <algorithm>
#include <cmath>
#include <functional>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"

namespace rangecal {
namespace {

double known(double value, double otherwise) { return std::isfinite(value) ? value : otherwise; }

}  // namespace

EffectCorrector::EffectCorrector(const Calibration& calibration, std::vector<std::string> covariates)
    : calibration_(calibration) {
  context_.kind = calibration.kind;
  context_.range_min_m = calibration.range_min_m;
  context_.range_max_m = calibration.range_max_m;
  context_.stop_count = static_cast<int>(calibration.stops.size());
  for (const LandmarkEstimate& landmark : calibration.landmarks)
    context_.landmark_labels.push_back(landmark.label);
  context_.landmark_count = static_cast<int>(context_.landmark_labels.size());
  context_.landmark_radius_m.assign(context_.landmark_labels.size(), 0.0);
  context_.covariates = std::move(covariates);
  for (const auto& [id, values] : calibration.effects) {
    const Effect* effect = find_effect(id);
    if (!effect) throw InputError("the calibration holds the effect " + id + ", which is in no catalogue");
    const auto& info = effect->info().parameters;
    Eigen::VectorXd p = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(info.size()));
    for (std::size_t j = 0; j < info.size(); ++j) {
      const auto value = values.find(info[j].name);
      if (value == values.end())
        throw InputError("the calibration's effect " + id + " lacks its parameter " + info[j].name);
      p[static_cast<Eigen::Index>(j)] = value->second;
    }
    // A change of the skew alone, or a grid that the noise holds already, shifts no reading.
    if (effect->noise_before_reciprocal() || effect->info().kind == EffectKind::grid) continue;
    active_.push_back({effect, p});
  }
}

ReadingView<double> EffectCorrector::view(double d, const ReadingSetting& setting) const {
  ReadingView<double> at;
  at.d = d;
  at.radius = known(setting.radius_m, 0.0);
  at.axis_distance = d + at.radius;
  at.bearing = known(setting.bearing_rad, 0.0);
  at.f = evaluate_polynomial(calibration_.alpha, d);
  at.slope = evaluate_derivative(calibration_.alpha, d);
  at.curvature = 0.0;
  double power = 1.0;
  for (Eigen::Index i = 2; i < calibration_.alpha.size(); ++i, power *= d)
    at.curvature += static_cast<double>(i * (i - 1)) * calibration_.alpha[i] * power;
  at.spread = calibration_.noise.spread(d, at.f);
  at.heading = known(setting.heading_rad, 0.0);
  at.time_s = known(setting.time_s, 0.0);
  at.stop = setting.stop;
  at.landmark = setting.landmark;
  at.repeat = setting.repeat;
  at.covariate = setting.covariates.empty() ? nullptr : setting.covariates.data();
  at.context = &context_;
  return at;
}

ReadingChange<double> EffectCorrector::change(double d, const ReadingSetting& setting) const {
  const ReadingView<double> at = view(d, setting);
  ReadingChange<double> sum;
  for (const Active& active : active_) {
    const ReadingChange<double> own = active.effect->reading(at, active.parameters.data());
    sum.range += own.range;
    sum.range_log_variance += own.range_log_variance;
  }
  return sum;
}

EffectCorrector::Expected EffectCorrector::at(double d, const ReadingSetting& setting) const {
  const double f = evaluate_polynomial(calibration_.alpha, d), s = calibration_.noise.spread(d, f);
  double curve = 0.0;
  if (const auto& covariance = calibration_.alpha_covariance) {  // phi^T C phi, as two of Horner's rules
    for (Eigen::Index i = covariance->rows(); i-- > 0;) {
      double row = 0.0;
      for (Eigen::Index j = covariance->cols(); j-- > 0;) row = row * d + (*covariance)(i, j);
      curve = curve * d + row;
    }
  }
  if (active_.empty()) return {f, std::sqrt(s * s + curve)};
  const ReadingChange<double> own = change(d, setting);
  return {f + own.range, std::sqrt(s * s * std::exp(own.range_log_variance) + curve)};
}

std::vector<double> EffectCorrector::turning_points(double low_m, double high_m) const {
  const Eigen::VectorXd& alpha = calibration_.alpha;
  if (alpha.size() < 3) return {};
  Eigen::VectorXd slope(alpha.size() - 1);
  for (Eigen::Index i = 1; i < alpha.size(); ++i) slope[i - 1] = static_cast<double>(i) * alpha[i];
  std::vector<double> points = real_roots(slope, low_m, high_m);
  std::erase_if(points, [&](double d) { return d <= low_m || d >= high_m; });
  return points;
}

std::vector<EffectCorrector::Need> EffectCorrector::needs() const {
  std::vector<Need> needs;
  EffectContext context = context_;
  context.covariates.push_back("temperature_c");
  context.covariates.push_back("intensity");
  std::vector<double> columns(context.covariates.size(), 20.0);
  for (const Active& active : active_) {
    const auto ask = [&](const std::string& column,
                         const std::vector<std::function<void(ReadingView<double>&)>>& moves) {
      for (double share : {0.1, 0.5, 0.9}) {
        const double d =
            calibration_.range_min_m + share * (calibration_.range_max_m - calibration_.range_min_m);
        for (int landmark = 0; landmark <= std::max(0, context.landmark_count - 1); ++landmark) {
          ReadingSetting base{.bearing_rad = 0.3,
                              .heading_rad = 0.2,
                              .time_s = 1.0,
                              .radius_m = 0.05,
                              .landmark = landmark,
                              .stop = 0,
                              .repeat = 0,
                              .covariates = columns};
          ReadingView<double> at = view(d, base);
          at.context = &context;
          at.stop = std::max(0, context.stop_count - 1);
          const ReadingChange<double> before = active.effect->reading(at, active.parameters.data());
          for (const auto& move : moves) {
            ReadingView<double> moved = at;
            move(moved);
            const ReadingChange<double> after = active.effect->reading(moved, active.parameters.data());
            if (after.range == before.range && after.range_log_variance == before.range_log_variance)
              continue;
            needs.push_back({column, active.effect->info().id});
            return;
          }
        }
      }
    };
    ask("bearing_rad", {[](auto& v) { v.bearing = 1.1; }, [](auto& v) { v.bearing = -2.0; },
                        [](auto& v) { v.bearing = 2.9; }});
    ask("heading_rad", {[](auto& v) { v.heading = 1.2; }});
    ask("time_s", {[](auto& v) { v.time_s = 100.0; }});
    ask("radius_m", {[](auto& v) {
          v.radius = 0.02;
          v.axis_distance = v.d + 0.02;
        }});
    ask("landmark", {[](auto& v) { v.landmark = -1; }});
    ask("stop", {[](auto& v) { v.stop = 0; }});
    ask("repeat", {[](auto& v) { v.repeat = 1; }});
    for (std::size_t c = 0; c < context.covariates.size(); ++c) {
      if (std::find(context.covariates.begin(), context.covariates.begin() + static_cast<long>(c),
                    context.covariates[c]) != context.covariates.begin() + static_cast<long>(c))
        continue;
      std::vector<double> other = columns;
      for (std::size_t same = 0; same < other.size(); ++same)
        if (context.covariates[same] == context.covariates[c]) other[same] = 35.0;
      ask(context.covariates[c], {[&](auto& v) { v.covariate = other.data(); }});
    }
  }
  return needs;
}

Correction EffectCorrector::correct(double reading_m, const ReadingSetting& setting,
                                    const CorrectionOptions& options) const {
  Correction plain = rangecal::correct(calibration_, reading_m, options);
  if (active_.empty()) return plain;
  const auto settle = [&](const CorrectionRoot& start, bool maximum_likelihood) {
    CorrectionRoot root = start;
    for (int iteration = 0; iteration < 50; ++iteration) {
      const double y = reading_m - change(root.distance_m, setting).range;
      if (!(y > 0.0)) break;
      const Correction moved = rangecal::correct(calibration_, y, options);
      const std::vector<CorrectionRoot>& roots =
          maximum_likelihood ? moved.maximum_likelihood : moved.least_squares;
      CorrectionRoot next;
      if (!roots.empty())
        next = *std::min_element(
            roots.begin(), roots.end(), [&](const CorrectionRoot& a, const CorrectionRoot& b) {
              return std::abs(a.distance_m - root.distance_m) < std::abs(b.distance_m - root.distance_m);
            });
      else if (moved.nearest)
        next = *moved.nearest;
      else
        break;
      const double step = std::abs(next.distance_m - root.distance_m);
      root = next;
      if (step < 1e-10) break;
    }
    const double factor = std::exp(0.5 * change(root.distance_m, setting).range_log_variance);
    if (root.std_dev_m) {
      const double own = *root.std_dev_m;
      if (root.std_dev_total_m)
        root.std_dev_total_m = std::sqrt(std::max(
            0.0, *root.std_dev_total_m * *root.std_dev_total_m + (factor * factor - 1.0) * own * own));
      root.std_dev_m = factor * own;
    }
    return root;
  };
  Correction result = plain;
  for (CorrectionRoot& root : result.least_squares) root = settle(root, false);
  for (CorrectionRoot& root : result.maximum_likelihood) root = settle(root, true);
  if (result.least_squares.empty() &&
      result.nearest) {  // the effect may have moved the reading beyond what f reaches
    const CorrectionRoot settled = settle(*result.nearest, false);
    const double misfit = evaluate_polynomial(calibration_.alpha, settled.distance_m) +
                          change(settled.distance_m, setting).range - reading_m;
    if (std::abs(misfit) < 1e-8) {
      result.least_squares = {settled};
      result.best_least_squares = 0;
      result.nearest.reset();
      result.outcome = Outcome::converged;
      result.reason.clear();
    } else {
      result.nearest = settled;
    }
  }
  return result;
}

}  // namespace rangecal
