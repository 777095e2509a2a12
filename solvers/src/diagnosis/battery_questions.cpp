// SPDX-License-Identifier: BSD-3-Clause
// What the battery asks about the means: every channel against every covariate in a handful of shapes, and
// every entry of the catalogue at every point of its start grid.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <set>

#include "diagnosis/battery.hpp"
#include "in_parallel.hpp"
#include "rangecal/core/angles.hpp"

namespace rangecal::diagnosis {
namespace {

/// Knots at equal shares of the values.
std::vector<double> quantiles(Eigen::VectorXd values, int count) {
  std::sort(values.begin(), values.end());
  std::vector<double> at;
  for (int j = 0; j < count; ++j) {
    const auto index = static_cast<Eigen::Index>(std::lround((values.size() - 1.0) * j / (count - 1.0)));
    if (at.empty() || values[index] > at.back()) at.push_back(values[index]);
  }
  return at;
}

/// Hat function over the knots, of the j-th: together a free piecewise-linear curve.
double hat(const std::vector<double>& knots, std::size_t j, double v) {
  if (v == knots[j]) return 1.0;
  if (j > 0 && v >= knots[j - 1] && v < knots[j]) return (v - knots[j - 1]) / (knots[j] - knots[j - 1]);
  if (j + 1 < knots.size() && v >= knots[j] && v < knots[j + 1])
    return (knots[j + 1] - v) / (knots[j + 1] - knots[j]);
  return 0.0;
}

/// Where a change in time can be: at the first reading of each stop, or at equal shares of a long run.
std::vector<double> change_points(const EffectContext& context) {
  constexpr std::size_t most = 40;
  std::vector<double> at;
  if (context.stop_time_s.size() > 2 && context.stop_time_s.size() <= most) {
    at = context.stop_time_s;
    std::sort(at.begin(), at.end());
    at.erase(std::unique(at.begin(), at.end()), at.end());
    at.erase(at.begin());
    return at;
  }
  for (int j = 1; j < 24; ++j) at.push_back(context.duration_s * j / 24.0);
  return at;
}

}  // namespace

/// A covariate over the rows, and the same where cells are moved as the projector says (empty: it stays).
class Battery::Values {
 public:
  explicit Values(Eigen::VectorXd at, Eigen::VectorXd moved = {})
      : at_(std::move(at)), moved_(std::move(moved)) {}
  const Eigen::VectorXd& at() const { return at_; }
  Shape map(const std::function<double(double)>& f) const {
    const auto of = [&](const Eigen::VectorXd& values) -> Eigen::VectorXd {
      return values.unaryExpr([&](double v) { return f(v); });
    };
    return {of(at_), of(moved_)};
  }
  /// Of a function that jumps: it has no slope.
  Shape jump(const std::function<double(double)>& f) const { return {map(f).at, {}}; }
  Shape itself() const { return {at_, moved_}; }
  std::vector<Shape> hats(const std::vector<double>& knots) const {
    std::vector<Shape> shapes;
    for (std::size_t j = 0; j < knots.size(); ++j)
      shapes.push_back(
          map([&](double v) { return hat(knots, j, std::clamp(v, knots.front(), knots.back())); }));
    return shapes;
  }

 private:
  Eigen::VectorXd at_, moved_;
};

void Battery::ask_means() {
  const Eigen::Index n = static_cast<Eigen::Index>(rows_.size());
  const CellGeometry& g = projector_.geometry();
  const auto per_row = [&](const std::function<double(std::size_t)>& value) {
    Eigen::VectorXd values(n);
    for (Eigen::Index i = 0; i < n; ++i) values[i] = value(static_cast<std::size_t>(i));
    return values;
  };
  const auto of_cells = [&](const std::vector<double>& values) {
    return per_row([&](std::size_t i) { return values[rows_.cell[i]]; });
  };
  const Values time(per_row([&](std::size_t i) { return rows_.time_s[i]; }));
  const double duration = std::max(rows_.context.duration_s, 1e-9);
  const bool has_bearing = !rows_.pairs || of_cells(g.bearing).cwiseAbs().maxCoeff() > 0.0;

  // Shapes are gathered, and asked about together: so many that their rows fit well into memory.
  struct Waiting {
    Question question;
    std::vector<Shape> shapes;
    bool of_bearing;
  };
  std::vector<Waiting> waiting;
  const auto most_waiting =
      static_cast<std::size_t>(std::clamp<Eigen::Index>(1000000 / std::max<Eigen::Index>(n, 1), 8, 128));
  const auto ask_waiting = [&] {
    std::vector<Asked> asked(waiting.size());
    in_parallel(waiting.size(), [&](std::size_t i) {
      asked[i] = asked_of_rows(std::move(waiting[i].question), waiting[i].shapes, waiting[i].of_bearing);
    });
    for (Asked& a : asked) add(std::move(a));
    waiting.clear();
  };
  for (bool of_bearing : {false, true}) {
    if (of_bearing && rows_.pairs) continue;
    const std::string channel = of_bearing ? "bearing" : "range";
    const CellGeometry* moved = projector_.moved(of_bearing);
    const Values d(of_cells(g.d), moved ? of_cells(moved->d) : Eigen::VectorXd());
    const Values bearing(of_cells(g.bearing), moved ? of_cells(moved->bearing) : Eigen::VectorXd());
    const auto ask = [&](const std::string& covariate, const std::string& shape, std::vector<Shape> shapes,
                         std::optional<double> from = {}, std::optional<double> to = {},
                         const std::string& group = {}) {
      Question q;
      q.channel = channel;
      q.covariate = covariate;
      q.shape = shape;
      q.from = from;
      q.to = to;
      q.group = group;
      waiting.push_back({std::move(q), std::move(shapes), of_bearing});
      if (waiting.size() >= most_waiting) ask_waiting();
    };
    const auto smooth = [&](const std::string& covariate, const Values& values, int knots) {
      const std::vector<double> at = quantiles(values.at(), knots);
      if (at.size() < 3) return;
      ask(covariate, "smooth", values.hats(at));
      for (std::size_t j = 0; j + 2 < at.size(); ++j)  // a bump over two neighbouring intervals
        ask(covariate, "bump",
            {values.jump([&](double v) { return v >= at[j] && v <= at[j + 2] ? 1.0 : 0.0; })}, at[j],
            at[j + 2]);
    };
    // One bump somewhere, exp(-u^2 / 2) with u the distance from its middle in widths: at two widths,
    // everywhere.
    const auto local = [&](const std::string& covariate, const Values& values,
                           const std::function<double(double, double)>& difference) {
      const double low = values.at().minCoeff(), span = values.at().maxCoeff() - low;
      if (!(span > 0.0)) return;
      for (const double share : {0.03, 0.06}) {
        const double width = share * span;
        for (double middle = low; middle <= low + span; middle += width)
          ask(covariate, "local bump", {values.map([&](double v) {
                return std::exp(-0.5 * std::pow(difference(v, middle) / width, 2));
              })},
              middle - 2.0 * width, middle + 2.0 * width);
      }
    };
    const auto fixed = [&](const std::function<double(std::size_t)>& value) {
      return Shape{per_row(value), {}};
    };
    ask("constant", "offset", {fixed([](std::size_t) { return 1.0; })});
    ask("range", "linear", {d.itself()});
    ask("range", "quadratic", {d.map([](double v) { return v * v; })});
    ask("range", "cubic", {d.map([](double v) { return v * v * v; })});
    ask("disparity", "linear", {d.map([](double v) { return 1.0 / v; })});
    smooth("range", d, 9);
    local("range", d, [](double a, double b) { return a - b; });
    if (has_bearing) {
      ask("sensor_bearing", "linear", {bearing.itself()});
      for (int k : {1, 2, 3, 4, 6, 8})
        ask("sensor_bearing", fmt::format("harmonic {}", k),
            {bearing.map([k](double b) { return std::cos(k * b); }),
             bearing.map([k](double b) { return std::sin(k * b); })});
      smooth("sensor_bearing", bearing, 9);
      local("sensor_bearing", bearing, [](double a, double b) { return wrap_angle(a - b); });
    }
    if (rows_.context.headings > 0.05) {
      const Values heading(per_row([&](std::size_t i) { return rows_.heading_rad[i]; }));
      for (int k : {1, 2})
        ask("heading", fmt::format("harmonic {}", k),
            {heading.map([k](double h) { return std::cos(k * h); }),
             heading.map([k](double h) { return std::sin(k * h); })});
    }
    if (rows_.context.duration_s > 0.0) {
      ask("time", "linear", {time.itself()});
      ask("time", "quadratic", {time.map([](double t) { return t * t; })});
      for (double share : {0.05, 0.15, 0.4})
        ask("time", "exponential", {time.map([&](double t) { return std::exp(-t / (share * duration)); })});
      for (const double at : change_points(rows_.context))
        ask("time", "change point", {time.map([&](double t) { return t >= at ? 1.0 : 0.0; })}, at);
      for (int k = 1; k <= 40; ++k) {
        const double omega = 2.0 * std::numbers::pi * k / (2.0 * duration);
        ask("time", "periodic",
            {time.map([&](double t) { return std::cos(omega * t); }),
             time.map([&](double t) { return std::sin(omega * t); })});
      }
      smooth("time", time, 9);
    }
    if (rows_.context.largest_cell > 2) {
      const Values repeat(per_row([&](std::size_t i) { return rows_.repeat[i]; }));
      ask("repeat", "linear", {repeat.itself()});
      for (double t : {0.7, 2.0})
        ask("repeat", "exponential", {repeat.map([t](double r) { return std::exp(-r / t); })});
    }
    for (int l = 0; l < rows_.context.landmark_count && rows_.context.landmark_count > 1; ++l) {
      const auto own = [&](std::size_t i) { return rows_.landmark[i] == l ? 1.0 : 0.0; };
      const std::string& label = rows_.context.landmark_labels[l];
      ask("landmark", "one group", {fixed(own)}, {}, {}, label);
      const auto of_own = [&](const std::vector<double>& values) {
        return per_row([&](std::size_t i) { return own(i) * values[rows_.cell[i]]; });
      };
      ask("landmark", "one group, linear in range",
          {{of_own(g.d), moved ? of_own(moved->d) : Eigen::VectorXd()}}, {}, {}, label);
      if (rows_.context.duration_s > 0.0)
        for (int j = 1; j < 6; ++j)
          ask("landmark", "one group, change point", {fixed([&](std::size_t i) {
                return own(i) * (rows_.time_s[i] > duration * j / 6.0 ? 1.0 : 0.0);
              })},
              duration * j / 6.0, {}, label);
    }
    if (!rows_.pairs && rows_.context.stop_count <= 400)
      for (int k = 0; k < rows_.context.stop_count; ++k)
        ask("stop", "one group", {fixed([&](std::size_t i) { return rows_.stop[i] == k ? 1.0 : 0.0; })}, k, k,
            std::to_string(k));
    if (rows_.context.several_radii)
      ask("radius", "linear", {fixed([&](std::size_t i) { return rows_.radius_m[i]; })});
    for (std::size_t column = 0; column < rows_.context.covariates.size(); ++column) {
      const std::string& name = rows_.context.covariates[column];
      double mean = 0.0, count = 0.0;
      for (Eigen::Index i = 0; i < n; ++i) {
        const double v = rows_.covariates[i * rows_.context.covariates.size() + column];
        if (std::isfinite(v)) mean += v, count += 1.0;
      }
      if (count < 3) continue;
      mean /= count;
      const Values v(per_row([&](std::size_t i) {
        const double value = rows_.covariates[i * rows_.context.covariates.size() + column];
        return std::isfinite(value) ? value - mean : 0.0;
      }));
      if (v.at().cwiseAbs().maxCoeff() < 1e-12) continue;
      ask(name, "linear", {v.itself()});
      ask(name, "quadratic", {v.map([](double x) { return x * x; })});
      const std::vector<double> at = quantiles(v.at(), 9);
      for (std::size_t j = 1; j + 1 < at.size(); ++j)
        ask(name, "threshold", {v.jump([&](double x) { return x > at[j] ? 1.0 : 0.0; })}, at[j] + mean);
      if (at.size() >= 3) ask(name, "smooth", v.hats(at));
    }
  }
  ask_waiting();
}

void Battery::ask_catalogue() {
  const auto& effects = effect_registry();
  std::vector<std::vector<Asked>> asked(effects.size());
  in_parallel(
      effects.size(), [&](std::size_t e) { asked[e] = asked_of_effect(*effects[e]); },
      jobs_at_once(rows_.size()));
  for (std::vector<Asked>& of_effect : asked)
    for (Asked& a : of_effect) add(std::move(a));
}

std::vector<Battery::Asked> Battery::asked_of_effect(const Effect& effect) const {
  std::vector<Asked> asked;
  const EffectInfo& info = effect.info();
  if (!effect.missing(rows_.context).empty()) return asked;
  bool any_linear = false;
  for (const EffectParameter& p : info.parameters) any_linear = any_linear || (p.linear && !p.discrete);
  bool acts_on_mean = false, acts_on_variance = false;
  for (const Eigen::VectorXd& start : effect.start_grid(rows_.context)) {
    const bool unknown = !acts_on_mean && !acts_on_variance;  // a sector may lie where no reading does
    ActiveEffect active{&effect, start};
    std::vector<Signature> block;
    std::vector<Eigen::VectorXd> range_variance, bearing_variance;
    for (int j = 0; j < static_cast<int>(info.parameters.size()); ++j) {
      const EffectParameter& p = info.parameters[j];
      if (p.discrete || (any_linear && !p.linear)) continue;
      if (unknown || acts_on_mean) {
        Signature x = effect_signature(rows_, projector_, active, j);
        if (projector_.raw_information(x) > 0.0) {
          acts_on_mean = true;
          block.push_back(std::move(x));
        }
      }
      if (unknown || acts_on_variance) {
        Eigen::VectorXd range, bearing;
        variance_signature(rows_, projector_.geometry(), active, j, range, bearing);
        acts_on_variance = acts_on_variance || range.squaredNorm() + bearing.squaredNorm() > 0.0;
        if (acts_on_variance) {
          range_variance.push_back(range);
          bearing_variance.push_back(bearing);
        }
      }
    }
    Question q;
    q.channel = info.channel;
    q.covariate = info.covariate;
    q.shape = "effect";
    q.effect = &effect;
    q.start = start;
    if (!block.empty()) asked.push_back(asked_of_mean(q, std::move(block)));
    // The spread that goes along with a mean is no question of its own.
    if (acts_on_variance && info.kind != EffectKind::mean)
      ask_variance_of_rows(q, range_variance, bearing_variance, asked);
    if (!acts_on_mean && !acts_on_variance && info.kind != EffectKind::mean && info.kind != EffectKind::noise)
      break;
  }
  return asked;
}

}  // namespace rangecal::diagnosis
