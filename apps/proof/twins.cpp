// SPDX-License-Identifier: BSD-3-Clause
#include "twins.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <boost/math/tools/minima.hpp>
#include <cmath>
#include <limits>

#include "rangecal/core/angles.hpp"

namespace rangecal::proof {
namespace {

using Index = Eigen::Index;
using std::size_t;

constexpr double enough = 3.0;  // noncentrality below which a closer fit decides nothing

/// Squared length of x left by the columns, whose coefficients stay within +-limits (physical sizes).
double left_by(const Eigen::MatrixXd& columns, const Eigen::VectorXd& limits, const Eigen::VectorXd& x) {
  if (columns.cols() == 0) return x.squaredNorm();
  const Eigen::VectorXd length = columns.colwise().norm();
  Eigen::MatrixXd used(columns.rows(), columns.cols());
  Eigen::VectorXd most(columns.cols());
  Index count = 0;
  for (Index j = 0; j < columns.cols(); ++j)
    if (length[j] > 1e-9 * (1.0 / limits[j])) {
      most[count] = limits[j] * length[j];
      used.col(count++) = columns.col(j) / length[j];
    }
  if (count == 0) return x.squaredNorm();
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(used.leftCols(count));
  qr.setThreshold(1e-9);
  const Eigen::VectorXd best = qr.solve(x);
  return (x - used.leftCols(count) * best.cwiseMax(-most.head(count)).cwiseMin(most.head(count)))
      .squaredNorm();
}

Eigen::VectorXd joined(const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
  Eigen::VectorXd out(a.size() + b.size());
  out << a, b;
  return out;
}

}  // namespace

Signatures::Signatures(const SeedModel& model, std::uint64_t seed)
    : model_(model), recording_(world::simulate(model.clean(), seed)) {
  const world::Expected& truth = model.expected();
  EffectContext& c = context_;
  c.stop_count = model.stop_count(), c.landmark_count = model.landmark_count();
  for (const Landmark& landmark : recording_.landmarks) {
    c.landmark_labels.push_back(landmark.label);
    c.landmark_radius_m.push_back(landmark.radius_m);
    c.several_radii = c.several_radii || landmark.radius_m != recording_.landmarks[0].radius_m;
  }
  double cosines = 0.0, sines = 0.0;
  for (size_t k = 0; k < recording_.stops.size(); ++k) {
    const Pose2& pose = recording_.stops[k].commanded;
    const Pose2& before = recording_.stops[k > 0 ? k - 1 : 0].commanded;
    c.commanded.push_back(pose);
    c.path_m.push_back((k > 0 ? c.path_m.back() : 0.0) +
                       std::hypot(pose.x_m - before.x_m, pose.y_m - before.y_m));
    cosines += std::cos(pose.heading_rad), sines += std::sin(pose.heading_rad);
  }
  const double mean = std::min(1.0, std::hypot(cosines, sines) / c.stop_count);
  c.headings = std::sqrt(std::max(0.0, -2.0 * std::log(std::max(mean, 1e-12))));
  const double first = *std::min_element(truth.time_s.begin(), truth.time_s.end());
  c.stop_time_s.assign(recording_.stops.size(), std::numeric_limits<double>::infinity());
  for (size_t i = 0; i < truth.time_s.size(); ++i) {
    c.duration_s = std::max(c.duration_s, truth.time_s[i] - first);
    double& at = c.stop_time_s[static_cast<size_t>(truth.stop[i])];
    at = std::min(at, truth.time_s[i] - first);
  }
  for (size_t i = 0; i < truth.time_s.size(); ++i)
    c.stay_s =
        std::max(c.stay_s, truth.time_s[i] - first - c.stop_time_s[static_cast<size_t>(truth.stop[i])]);
  const auto [near, far] = std::minmax_element(truth.distance_m.begin(), truth.distance_m.end());
  c.range_min_m = *near, c.range_max_m = *far;
  c.largest_cell = model.repeats();
  for (const auto& [name, values] : recording_.readings.covariates) c.covariates.push_back(name);
  for (size_t i = 0; i < truth.stop.size(); ++i)
    for (const auto& [name, values] : recording_.readings.covariates) covariates_.push_back(values[i]);
}

ReadingView<double> Signatures::view(size_t i) const {
  const world::Expected& truth = model_.expected();
  const Eigen::Vector3d& alpha = model_.state().alpha;
  ReadingView<double> v;
  v.stop = truth.stop[i], v.landmark = truth.landmark[i], v.repeat = truth.repeat[i];
  v.d = truth.distance_m[i];
  v.radius = recording_.landmarks[static_cast<size_t>(v.landmark)].radius_m;
  v.axis_distance = v.d + v.radius;
  v.bearing = truth.bearing_mean_rad[i];
  v.f = alpha[0] + v.d * (alpha[1] + v.d * alpha[2]);
  v.slope = alpha[1] + 2.0 * v.d * alpha[2];
  v.curvature = 2.0 * alpha[2];
  v.spread = truth.range_sd_m[i];
  v.heading = context_.commanded[static_cast<size_t>(v.stop)].heading_rad;
  v.time_s = truth.time_s[i] - truth.time_s.front();
  v.time = context_.duration_s > 0.0 ? std::max(0.0, v.time_s) / context_.duration_s : 0.0;
  v.covariate = context_.covariates.empty() ? nullptr : &covariates_[i * context_.covariates.size()];
  v.context = &context_;
  return v;
}

std::vector<Signatures::Point> Signatures::grid(const std::string& id) const {
  const Effect* effect = find_effect(id);
  if (!effect || !effect->lacking(context_).empty()) return {};
  return effect->start_grid(context_);
}

std::vector<StopPrior> Signatures::stated_stops() const {
  std::vector<StopPrior> priors(context_.commanded.size());
  for (size_t k = 0; k < priors.size(); ++k) {
    priors[k].commanded = context_.commanded[k];
    priors[k].sigma_xy_m = model_.sigma_xy_m(), priors[k].sigma_heading_rad = model_.sigma_heading_rad();
    priors[k].place = model_.place(static_cast<int>(k));
  }
  return priors;
}

Signatures::Columns Signatures::columns(const std::string& id, const Point& point) const {
  const Effect& effect = *find_effect(id);
  const std::vector<EffectParameter>& parameters = effect.info().parameters;
  const Index rows = static_cast<Index>(model_.expected().stop.size()), n = model_.cells();
  std::vector<Point> steps;  // one parameter vector per column
  for (Index j = 0; j < point.size(); ++j) {
    const EffectParameter& parameter = parameters[static_cast<size_t>(j)];
    if (!parameter.linear) continue;
    steps.push_back(point);
    for (Index other = 0; other < point.size(); ++other)
      if (parameters[static_cast<size_t>(other)].linear) steps.back()[other] = 0.0;
    steps.back()[j] = 1e-3 * (parameter.typical != 0.0 ? parameter.typical : 1.0);
  }
  Columns out;
  out.limits = Eigen::VectorXd::Constant(std::max<Index>(1, static_cast<Index>(steps.size())), 1e6);
  for (Index j = 0, column = 0; j < point.size(); ++j) {
    const EffectParameter& parameter = parameters[static_cast<size_t>(j)];
    if (!parameter.linear) continue;
    const double most = std::max(std::abs(parameter.low), std::abs(parameter.high));
    if (most > 0.0 && std::isfinite(most))
      out.limits[column] = most / std::abs(steps[static_cast<size_t>(column)][j]);
    ++column;
  }
  if (steps.empty()) steps.push_back(point), out.limits[0] = 10.0;
  out.means = Eigen::MatrixXd::Zero(model_.jacobian().rows(), static_cast<Index>(steps.size()));
  out.rows = Eigen::MatrixXd::Zero(2 * rows, static_cast<Index>(steps.size()));
  const double root = std::sqrt(static_cast<double>(model_.repeats()));
  for (Index j = 0; j < out.means.cols(); ++j) {
    const Point& p = steps[static_cast<size_t>(j)];
    auto means = out.means.col(j), deviations = out.rows.col(j);
    for (Index i = 0; i < rows; ++i) {
      const ReadingView<double> v = view(static_cast<size_t>(i));
      const int c = model_.cell(v.stop, v.landmark);
      const ReadingChange<double> change = effect.reading(v, p.data());
      deviations[i] = change.range / model_.range_sd_m(c);
      deviations[rows + i] = change.bearing / model_.bearing_sd_rad(c);
      means[c] += deviations[i] / model_.repeats(), means[n + c] += deviations[rows + i] / model_.repeats();
    }
    for (Index i = 0; i < rows; ++i) {
      const int c = model_.cell(model_.expected().stop[static_cast<size_t>(i)],
                                model_.expected().landmark[static_cast<size_t>(i)]);
      deviations[i] -= means[c], deviations[rows + i] -= means[n + c];
    }
    means.head(2 * n) *= root;
    if (!effect.acts_on_stops()) continue;
    // Where the stops are led: by the priors' rows.
    std::vector<StopPrior> priors = stated_stops();
    // Stops of one place share a position error, so what moves them apart acts on the readings themselves: all of
    // the move is carried through the derivative by position of each stop.
    effect.stops(context_, p.data(), priors);
    for (int k = 0; k < model_.stop_count(); ++k) {
      const Pose2 &to = priors[static_cast<size_t>(k)].commanded,
                  &from = context_.commanded[static_cast<size_t>(k)];
      const Index place = 3 + 2 * model_.landmark_count() + 2 * model_.place(k);
      const Index heading = 3 + 2 * model_.landmark_count() + 2 * model_.place_count() + k;
      for (int l = 0; l < model_.landmark_count(); ++l)
        for (const Index row : {static_cast<Index>(model_.cell(k, l)), n + model_.cell(k, l)})
          means[row] += model_.jacobian()(row, place) * (to.x_m - from.x_m) +
                        model_.jacobian()(row, place + 1) * (to.y_m - from.y_m) +
                        model_.jacobian()(row, heading) * wrap_angle(to.heading_rad - from.heading_rad);
    }
  }
  return out;
}

double Signatures::left(const Signal& signal, std::span<const std::string> effects) const {
  const Eigen::VectorXd x = joined(model_.project(signal.means), signal.rows);
  struct Choice {
    Eigen::MatrixXd columns;
    Eigen::VectorXd limits;
    Point point;
  };
  const auto choice_at = [&](const std::string& id, const Point& point) {
    const Columns c = columns(id, point);
    Choice out{Eigen::MatrixXd(x.size(), c.means.cols()), c.limits, point};
    for (Index j = 0; j < c.means.cols(); ++j)
      out.columns.col(j) = joined(model_.project(c.means.col(j)), c.rows.col(j));
    return out;
  };
  std::vector<Choice> chosen(effects.size(),
                             Choice{Eigen::MatrixXd(x.size(), 0), Eigen::VectorXd(0), Point(0)});
  std::vector<std::vector<Choice>> choices(effects.size());
  for (size_t e = 0; e < effects.size(); ++e) {
    if (effects[e] == "heading_zero") {
      Eigen::VectorXd means = Eigen::VectorXd::Zero(signal.means.size());
      for (int c = 0; c < model_.cells(); ++c) means[model_.cells() + c] = 1.0 / model_.bearing_sd_rad(c);
      chosen[e] = {joined(model_.project(means), Eigen::VectorXd::Zero(signal.rows.size())),
                   Eigen::VectorXd::Constant(1, 1e6), Point(0)};
      continue;
    }
    for (const Point& point : grid(effects[e])) choices[e].push_back(choice_at(effects[e], point));
  }
  double best = std::numeric_limits<double>::infinity();
  for (int round = 0; round < (effects.size() > 1 ? 2 : 1); ++round)
    for (size_t e = 0; e < effects.size(); ++e) {
      const auto value = [&](const Choice& mine) {
        Index total = mine.columns.cols();
        for (size_t o = 0; o < effects.size(); ++o) total += o == e ? 0 : chosen[o].columns.cols();
        Eigen::MatrixXd all(x.size(), total);
        Eigen::VectorXd limits(total);
        Index at = 0;
        for (size_t o = 0; o < effects.size(); ++o) {
          const Choice& part = o == e ? mine : chosen[o];
          all.middleCols(at, part.columns.cols()) = part.columns;
          limits.segment(at, part.limits.size()) = part.limits;
          at += part.columns.cols();
        }
        return left_by(all, limits, x);
      };
      double least = value(chosen[e]);
      for (const Choice& choice : choices[e])
        if (const double now = value(choice); now < least) least = now, chosen[e] = choice;
      // Parameters that are neither linear nor discrete: a pattern search around the best start.
      for (Index j = 0; least >= enough && j < chosen[e].point.size(); ++j) {
        const Effect& effect = *find_effect(effects[e]);
        const EffectParameter& parameter = effect.info().parameters[static_cast<size_t>(j)];
        const auto [low, high] = effect.bounds(context_, static_cast<size_t>(j));
        if (parameter.linear || parameter.discrete || !std::isfinite(high - low)) continue;
        double step = 0.05 * (high - low);
        for (int halving = 0; halving < 6; ++halving, step *= 0.5)
          for (const double way : {-step, step}) {
            Point point = chosen[e].point;
            point[j] = std::clamp(point[j] + way, low, high);
            Choice choice = choice_at(effects[e], point);
            if (const double now = value(choice); now < least) least = now, chosen[e] = std::move(choice);
          }
      }
      best = std::min(best, least);
    }
  return effects.empty() ? x.squaredNorm() : best;
}

Eigen::MatrixXd Signatures::variance_columns(const std::string& id, const Point& point) const {
  const Effect& effect = *find_effect(id);
  const Index rows = static_cast<Index>(model_.expected().stop.size());
  Eigen::MatrixXd out(rows, 0);
  Point scaled = point;
  for (Index j = 0; j < point.size(); ++j)
    if (effect.info().parameters[static_cast<size_t>(j)].linear)
      scaled[j] = 0.5 * effect.info().parameters[static_cast<size_t>(j)].typical;
  Eigen::VectorXd column(rows);
  for (Index i = 0; i < rows; ++i)
    column[i] = effect.reading(view(static_cast<size_t>(i)), scaled.data()).range_log_variance;
  if (column.norm() > 1e-12) {
    out.resize(rows, 1);
    out.col(0) = column;
  }
  return out;
}

double Signatures::variance_left(const world::World& planted, std::span<const std::string> effects) const {
  const world::Expected target = world::expected(planted);
  const Index rows = static_cast<Index>(target.stop.size());
  Eigen::VectorXd x(rows);
  for (Index i = 0; i < rows; ++i) {
    const auto at = static_cast<size_t>(i);
    x[i] = std::sqrt(2.0) *
           std::log(target.range_sd_m[at] / model_.expected().range_sd_m[at]);  // sqrt(1/2) log var
  }
  double least = std::numeric_limits<double>::infinity();
  for (const std::string& id : effects)
    for (const Point& point : grid(id)) {
      const Eigen::MatrixXd mine = variance_columns(id, point);
      Eigen::MatrixXd all(rows, 1 + mine.cols());
      all.col(0).setOnes();
      all.rightCols(mine.cols()) = mine;
      least = std::min(least, left_by(all, Eigen::VectorXd::Constant(all.cols(), 1e6), x));
    }
  return least;
}

double Signatures::stops_left(const world::World& planted, std::span<const std::string> effects) const {
  double least = std::numeric_limits<double>::infinity();
  const Effect* effect = effects.size() == 1 ? find_effect(effects.front()) : nullptr;
  if (!effect || !effect->acts_on_stops() || effect->info().kind != EffectKind::dependence ||
      planted.robot.walk_sigma_m > 0.0)
    return least;
  const std::vector<StopPrior> stated = stated_stops();
  const std::vector<EffectParameter>& parameters = effect->info().parameters;
  for (size_t j = 0; j < parameters.size(); ++j) {
    if (parameters[j].discrete) continue;
    const auto [low, high] = effect->bounds(context_, j);
    const auto left = [&, j](double value) {
      Point point = Point::Zero(static_cast<Index>(parameters.size()));
      point[static_cast<Index>(j)] = value;
      std::vector<StopPrior> stops = stated;
      effect->stops(context_, point.data(), stops);
      double sum = 0.0;
      for (size_t k = 0; k < stops.size(); ++k) {
        if (stops[k].chained || stops[k].sigma_heading_rad != stated[k].sigma_heading_rad) return 1e100;
        const double q = std::pow(stops[k].sigma_xy_m / planted.robot.placing_sigma_m, 2);
        sum += q > 0.0 ? 2.0 * (q - 1.0 - std::log(q)) : 1e100;
      }
      return sum;
    };
    least = std::min(least, boost::math::tools::brent_find_minima(left, low, high, 30).second);
  }
  return least;
}

}  // namespace rangecal::proof
