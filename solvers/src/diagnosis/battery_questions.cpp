// SPDX-License-Identifier: BSD-3-Clause
// What the battery asks about the means: every channel against every covariate in a handful of shapes.
#include <fmt/core.h>

#include <cmath>
#include <numbers>

#include "diagnosis/battery_means.hpp"
#include "rangecal/core/angles.hpp"

namespace rangecal::diagnosis {
namespace {

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

void Battery::MeanQuestions::ask_range() {
  const Values d = of_geometry(&CellGeometry::d);
  ask("constant", "offset", {fixed([](std::size_t) { return 1.0; })});
  ask("range", "linear", {d.itself()});
  ask("range", "quadratic", {d.map([](double v) { return v * v; })});
  ask("range", "cubic", {d.map([](double v) { return v * v * v; })});
  ask("disparity", "linear", {d.map([](double v) { return 1.0 / v; })});
  ask_smooth("range", d, 9);
  ask_local("range", d, [](double a, double b) { return a - b; });
}

void Battery::MeanQuestions::ask_sensor_bearing() {
  if (rows_.pairs && !(of_cells(geometry_.bearing).cwiseAbs().maxCoeff() > 0.0)) return;
  const Values bearing = of_geometry(&CellGeometry::bearing);
  ask("sensor_bearing", "linear", {bearing.itself()});
  for (int k : {1, 2, 3, 4, 6, 8})
    ask("sensor_bearing", fmt::format("harmonic {}", k),
        {bearing.map([k](double b) { return std::cos(k * b); }),
         bearing.map([k](double b) { return std::sin(k * b); })});
  ask_smooth("sensor_bearing", bearing, 9);
  ask_local("sensor_bearing", bearing, [](double a, double b) { return wrap_angle(a - b); });
}

void Battery::MeanQuestions::ask_heading() {
  if (!(context_.headings > 0.05)) return;
  const Values heading(per_row([&](std::size_t i) { return rows_.heading_rad[i]; }));
  for (int k : {1, 2})
    ask("heading", fmt::format("harmonic {}", k),
        {heading.map([k](double h) { return std::cos(k * h); }),
         heading.map([k](double h) { return std::sin(k * h); })});
}

void Battery::MeanQuestions::ask_time() {
  if (!(context_.duration_s > 0.0)) return;
  const Values time(per_row([&](std::size_t i) { return rows_.time_s[i]; }));
  ask("time", "linear", {time.itself()});
  ask("time", "quadratic", {time.map([](double t) { return t * t; })});
  for (double share : {0.05, 0.15, 0.4})
    ask("time", "exponential",
        {time.map([=, this](double t) { return std::exp(-t / (share * duration_)); })});
  for (const double at : change_points(context_))
    ask("time", "change point", {time.map([at](double t) { return t >= at ? 1.0 : 0.0; })}, at);
  for (int k = 1; k <= 40; ++k) {
    const double omega = 2.0 * std::numbers::pi * k / (2.0 * duration_);
    ask("time", "periodic",
        {time.map([omega](double t) { return std::cos(omega * t); }),
         time.map([omega](double t) { return std::sin(omega * t); })});
  }
  ask_smooth("time", time, 9);
}

void Battery::MeanQuestions::ask_repeat() {
  if (context_.largest_cell <= 2) return;
  const Values repeat(per_row([&](std::size_t i) { return rows_.repeat[i]; }));
  ask("repeat", "linear", {repeat.itself()});
  for (double t : {0.7, 2.0})
    ask("repeat", "exponential", {repeat.map([t](double r) { return std::exp(-r / t); })});
}

void Battery::MeanQuestions::ask_landmarks() {
  for (int l = 0; l < context_.landmark_count && context_.landmark_count > 1; ++l) {
    const auto own = [this, l](std::size_t i) { return rows_.landmark[i] == l ? 1.0 : 0.0; };
    const std::string& label = context_.landmark_labels[l];
    ask("landmark", "one group", {fixed(own)}, {}, {}, label);
    ask("landmark", "one group, linear in range", {[this, own, moved = moved_] {
          Shape own_distance{per_row([&](std::size_t i) { return own(i) * geometry_.d[rows_.cell[i]]; }), {}};
          if (moved) own_distance.moved = by_cells(moved->d);
          for (Eigen::Index c = 0; c < own_distance.moved.size(); ++c)
            own_distance.moved[c] *=
                own(static_cast<std::size_t>(rows_.cell_begin[static_cast<std::size_t>(c)]));
          return own_distance;
        }},
        {}, {}, label);
    if (context_.duration_s > 0.0)
      for (int j = 1; j < 6; ++j)
        ask("landmark", "one group, change point", {fixed([this, own, j](std::size_t i) {
              return own(i) * (rows_.time_s[i] > duration_ * j / 6.0 ? 1.0 : 0.0);
            })},
            duration_ * j / 6.0, {}, label);
  }
}

void Battery::MeanQuestions::ask_stops() {
  if (rows_.pairs || context_.stop_count > 400) return;
  for (int k = 0; k < context_.stop_count; ++k)
    ask("stop", "one group", {fixed([this, k](std::size_t i) { return rows_.stop[i] == k ? 1.0 : 0.0; })}, k,
        k, std::to_string(k));
}

void Battery::MeanQuestions::ask_radius() {
  if (context_.several_radii)
    ask("radius", "linear", {fixed([this](std::size_t i) { return rows_.radius_m[i]; })});
}

void Battery::MeanQuestions::ask_covariate(std::size_t column) {
  const std::string& name = context_.covariates[column];
  const auto value_of = [&](std::size_t i) {
    return rows_.covariates[i * context_.covariates.size() + column];
  };
  double mean = 0.0, count = 0.0;
  for (std::size_t i = 0; i < rows_.size(); ++i)
    if (const double value = value_of(i); std::isfinite(value)) mean += value, count += 1.0;
  if (count < 3) return;
  mean /= count;
  const Values v(per_row([&](std::size_t i) {
    const double value = value_of(i);
    return std::isfinite(value) ? value - mean : 0.0;
  }));
  if (v.at().cwiseAbs().maxCoeff() < 1e-12) return;
  ask(name, "linear", {v.itself()});
  ask(name, "quadratic", {v.map([](double x) { return x * x; })});
  const std::vector<double> at = v.quantiles(9);
  for (std::size_t j = 1; j + 1 < at.size(); ++j)
    ask(name, "threshold", {v.jump([limit = at[j]](double x) { return x > limit ? 1.0 : 0.0; })},
        at[j] + mean);
  if (at.size() >= 3) ask(name, "smooth", v.hats(at));
}

}  // namespace rangecal::diagnosis
