// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/effects/effect.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace rangecal {

double difference_step(const EffectParameter& parameter, double value) {
  constexpr double relative = 1e-6, least_size = 1e-9;
  const bool positive = parameter.low > 0.0 && value > 0.0;
  return relative * std::max(positive ? value : std::abs(parameter.typical), least_size);
}

double Effect::switching_distance(const double*) const { return std::numeric_limits<double>::quiet_NaN(); }

std::pair<double, double> Effect::bounds(const EffectContext&, std::size_t parameter) const {
  return {info().parameters[parameter].low, info().parameters[parameter].high};
}

std::vector<std::pair<std::string, double>> Effect::reported(const EffectContext&, const double* p) const {
  std::vector<std::pair<std::string, double>> values;
  for (std::size_t i = 0; i < info().parameters.size(); ++i)
    values.emplace_back(info().parameters[i].name, p[i]);
  return values;
}

std::vector<Eigen::VectorXd> grid_of(const std::vector<std::vector<double>>& axes) {
  std::vector<Eigen::VectorXd> points{Eigen::VectorXd::Zero(static_cast<Eigen::Index>(axes.size()))};
  for (std::size_t axis = 0; axis < axes.size(); ++axis) {
    std::vector<Eigen::VectorXd> next;
    for (const Eigen::VectorXd& point : points)
      for (double value : axes[axis]) {
        next.push_back(point);
        next.back()[static_cast<Eigen::Index>(axis)] = value;
      }
    points = std::move(next);
  }
  return points;
}

const Effect* find_effect(const std::string& id) {
  for (const auto& effect : effect_registry())
    if (effect->info().id == id) return effect.get();
  return nullptr;
}

}  // namespace rangecal
