// SPDX-License-Identifier: BSD-3-Clause
#include "shape_error.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/problems/world/physical/plants.hpp"

namespace rangecal::proof {
namespace {

/// The covariate of a law, and whether it comes back to itself after a turn.
struct Covariate {
  Eigen::VectorXd values;
  bool periodic = false;
};

Covariate covariate_of(const std::string& name, const world::World& world, const world::Expected& readings) {
  Covariate out{Eigen::VectorXd(static_cast<Eigen::Index>(readings.stop.size())),
                name == "sensor_bearing" || name == "heading"};
  for (std::size_t i = 0; i < readings.stop.size(); ++i) {
    double& value = out.values[static_cast<Eigen::Index>(i)];
    if (name == "sensor_bearing")
      value = readings.bearing_mean_rad[i];
    else if (name == "heading")
      value = world.robot.stops[static_cast<std::size_t>(readings.stop[i])].commanded.heading_rad;
    else if (name == "time" || name == "stop")
      value = readings.time_s[i];
    else if (name == "repeat")
      value = readings.repeat[i];
    else
      value = readings.distance_m[i];
  }
  return out;
}

/// Coefficients of g.
using Harmonics = std::array<double, 6>;

Eigen::ArrayXd smooth(const Covariate& x, const Harmonics& a) {
  if (x.periodic) {
    const auto turn = x.values.array();
    return a[0] * turn.cos() + a[1] * turn.sin() + a[2] * (2.0 * turn).cos() + a[3] * (2.0 * turn).sin() +
           a[4] * (3.0 * turn).cos() + a[5] * (3.0 * turn).sin();
  }
  const double low = x.values.minCoeff(), high = x.values.maxCoeff();
  const Eigen::ArrayXd t = (2.0 * x.values.array() - low - high) / std::max(high - low, 1e-12);
  return a[0] * t + a[2] * (1.5 * t.square() - 0.5) + a[4] * (2.5 * t.cube() - 1.5 * t);
}

}  // namespace

Eigen::VectorXd change_of_means(const world::Expected& to, const world::Expected& from) {
  const auto n = static_cast<Eigen::Index>(from.stop.size());
  Eigen::VectorXd change(2 * n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto at = static_cast<std::size_t>(i);
    change[i] = to.range_mean_m[at] - from.range_mean_m[at];
    change[n + i] = wrap_angle(to.bearing_mean_rad[at] - from.bearing_mean_rad[at]);
  }
  return change;
}

std::vector<double> shape_error(const world::World& clean, const world::World& planted, const std::string& id,
                                Random& random) {
  const world::Expected before = world::expected(clean), after = world::expected(planted);
  const auto n = static_cast<Eigen::Index>(before.stop.size());
  Eigen::VectorXd u = change_of_means(after, before);
  for (Eigen::Index i = 0; i < n; ++i) {
    u[i] /= before.range_sd_m[static_cast<std::size_t>(i)];
    u[n + i] /= before.bearing_sd_rad[static_cast<std::size_t>(i)];
  }
  Harmonics a;
  for (std::size_t j = 0; j < a.size(); ++j) a[j] = random.normal() / (1.0 + static_cast<double>(j / 2));
  for (const std::string& name : {world::effect_info(id).covariates.front(), std::string("range")}) {
    const Eigen::ArrayXd g = smooth(covariate_of(name, clean, before), a);
    const Eigen::VectorXd gu = (g.replicate(2, 1) * u.array()).matrix();
    const double c = u.dot(gu) / u.squaredNorm(), off = (gu - c * u).norm();
    if (!(off > 1e-6 * gu.norm())) continue;  // the same for all that changes: no other shape
    const Eigen::ArrayXd e = shape_off * u.norm() / off * (g - c);
    return {e.begin(), e.end()};
  }
  throw InputError("the change that '" + id + "' makes has one value: it has no shape");
}

void add_shape_error(Recording& recording, const world::World& clean, const world::World& planted,
                     const std::vector<double>& error, std::uint64_t seed) {
  const Eigen::VectorXd change = change_of_means(world::expected(planted, world::placing_of(planted, seed)),
                                                 world::expected(clean, world::placing_of(planted, seed)));
  const auto landmarks = static_cast<int>(clean.landmarks.size());
  Readings& readings = recording.readings;
  for (std::size_t i = 0; i < readings.size(); ++i) {
    const int at =
        (readings.stop[i] * landmarks + readings.landmark[i]) * clean.timing.repeats + readings.repeat[i];
    const double e = error[static_cast<std::size_t>(at)];
    readings.range_m[i] += e * change[at];
    readings.bearing_rad[i] =
        wrap_angle(readings.bearing_rad[i] + e * change[static_cast<Eigen::Index>(error.size()) + at]);
  }
}

}  // namespace rangecal::proof
