// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/reference_error.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <map>
#include <utility>

namespace rangecal {
namespace {

/// Sums over the readings of one setting.
struct Setting {
  Eigen::VectorXd g;
  Eigen::MatrixXd own;  ///< sum of g_i g_i^T
};

}  // namespace

std::optional<std::string> add_reference_error(std::span<const Recording> recordings,
                                               Calibration& calibration) {
  const auto uncertain = [](const Recording& recording) { return recording.reference.sigma_m > 0.0; };
  if (!calibration.alpha_covariance || std::none_of(recordings.begin(), recordings.end(), uncertain))
    return std::nullopt;
  const Eigen::Index size = calibration.alpha.size();
  Eigen::MatrixXd shared = Eigen::MatrixXd::Zero(size, size);
  double largest = 0.0;
  for (const Recording& recording : recordings) {
    const Pairs& pairs = recording.pairs;
    const double variance = recording.reference.sigma_m * recording.reference.sigma_m;
    largest = std::max(largest, recording.reference.sigma_m);
    std::map<std::pair<int, double>, Setting> settings;
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      const double d = pairs.true_m[i], u = calibration.scale.of(d);
      const double s = calibration.noise.spread(d, calibration.f(d));
      Eigen::VectorXd g(size);
      g[0] = calibration.slope(d) / (s * s);
      for (Eigen::Index j = 1; j < size; ++j) g[j] = g[j - 1] * u;
      Setting& setting = settings[{pairs.batch.empty() ? 0 : pairs.batch[i], d}];
      if (setting.g.size() == 0) setting = {Eigen::VectorXd::Zero(size), Eigen::MatrixXd::Zero(size, size)};
      setting.g += g;
      setting.own += g * g.transpose();
    }
    for (const auto& [at, setting] : settings)
      shared += variance * (setting.g * setting.g.transpose() - setting.own);
  }
  const Eigen::MatrixXd added = *calibration.alpha_covariance * shared * *calibration.alpha_covariance;
  if (!added.allFinite()) return std::nullopt;
  *calibration.alpha_covariance += added;
  if (calibration.covariance_with_choice)
    calibration.covariance_with_choice->topLeftCorner(size, size) += added;
  return fmt::format(
      "the true distances are known to {:g} mm (reference.sigma_m): alpha's standard deviations hold one such error for each "
      "setting, the noise law holds it too",
      1e3 * largest);
}

}  // namespace rangecal
