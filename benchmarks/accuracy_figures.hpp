// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

namespace rangecal::benchmark {

/// A mean over the repeats with its standard error.
struct Mean {
  double value = 0.0, error = 0.0;
};

inline Mean mean_of(const std::vector<double>& values) {
  const double n = static_cast<double>(values.size());
  if (values.empty()) return {std::nan(""), std::nan("")};
  double sum = 0.0, square = 0.0;
  for (const double value : values) sum += value / n;
  for (const double value : values) square += (value - sum) * (value - sum);
  return {sum, std::sqrt(square / n / std::max(n - 1.0, 1.0))};
}

/// sqrt(mean square / bound), its error by the delta method.
inline Mean rmse_over(const std::vector<double>& squares, double bound) {
  const Mean mean = mean_of(squares);
  const double ratio = std::sqrt(mean.value / bound);
  return {ratio, 0.5 * ratio * mean.error / mean.value};
}

/// 1.012(14), at most nine characters.
inline std::string text(const Mean& mean) {
  if (!std::isfinite(mean.value)) return "-";
  const int thousandths = static_cast<int>(std::lround(1000.0 * mean.error));
  return thousandths < 100 ? fmt::format("{:.3f}({:02d})", mean.value, thousandths)
                           : fmt::format("{:.2f}({})", mean.value, (thousandths + 5) / 10);
}

/// The name of a setting without what stands in parentheses.
inline std::string short_name(const std::string& setting) {
  const std::size_t open = setting.find(" ("), close = setting.find(')');
  return open == std::string::npos ? setting : setting.substr(0, open) + setting.substr(close + 1);
}

/// How often a requirement held: as a figure, and not contradicted by it at two standard errors.
struct Requirement {
  const char* name;
  double low, high;
  int asked = 0, met = 0, within_chance = 0;
  std::string worst{};
  double worst_excess = 0.0;

  void ask(const std::string& setting, const Mean& mean) {
    ++asked;
    const double excess = std::max(low - mean.value, mean.value - high);
    met += excess <= 0.0;
    within_chance += excess <= 2.0 * mean.error;
    if (!worst.empty() && excess <= worst_excess) return;
    worst_excess = excess;
    worst = text(mean) + ": " + short_name(setting);
  }
};

struct Requirements {
  Requirement landmarks{"RMSE / bound, landmarks", 0.95, 1.05}, curve{"RMSE / bound, curve", 0.95, 1.05},
      bias{"bias of f at 0.5, 2, 5 m", -0.15, 0.15}, theta{"sigma_theta / true", 0.97, 1.03},
      e{"sigma_e / true", 0.97, 1.03}, z_curve{"variance of z, curve", 0.9, 1.1},
      z_landmarks{"variance of z, landmarks", 0.9, 1.1};
  int failures = 0, worse = 0, repeats = 0;

  void print() const {
    fmt::print("\nmarginal: {} repeats, {} without an answer, {} with a worse likelihood than the seed\n",
               repeats, failures, worse);
    fmt::print("{:<26} {:>13} {:>5} {:>4} {:>8}  {}\n", "requirement", "interval", "asked", "met", "in 2 se",
               "farthest");
    for (const Requirement& r : {landmarks, curve, bias, theta, e, z_curve, z_landmarks})
      fmt::print("{:<26} {:>13} {:>5} {:>4} {:>8}  {}\n", r.name, fmt::format("[{}, {}]", r.low, r.high),
                 r.asked, r.met, r.within_chance, r.worst);
  }
};

}  // namespace rangecal::benchmark
