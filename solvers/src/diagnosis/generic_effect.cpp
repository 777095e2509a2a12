// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/generic_effect.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace rangecal::diagnosis {

namespace {

/// A covariate of docs/formats.md that is no column.
struct NamedCovariate {
  const char* name;
  double (*value)(const ReadingView<double>&);
  bool of_cell = true;  ///< the same for all readings of a cell
};

constexpr std::array<NamedCovariate, 10> named_covariates{{
    {"range", [](const ReadingView<double>& at) { return at.d; }},
    {"disparity", [](const ReadingView<double>& at) { return 1.0 / at.d; }},
    {"sensor_bearing", [](const ReadingView<double>& at) { return at.bearing; }},
    {"heading", [](const ReadingView<double>& at) { return at.heading; }},
    {"time", [](const ReadingView<double>& at) { return at.time_s; }, false},
    {"stop", [](const ReadingView<double>& at) { return static_cast<double>(at.stop); }},
    {"repeat", [](const ReadingView<double>& at) { return static_cast<double>(at.repeat); }, false},
    {"landmark", [](const ReadingView<double>& at) { return static_cast<double>(at.landmark); }},
    {"radius", [](const ReadingView<double>& at) { return at.radius; }},
    {"constant", [](const ReadingView<double>&) { return 1.0; }},
}};

const NamedCovariate* named_covariate(const std::string& name) {
  const auto found = std::find_if(named_covariates.begin(), named_covariates.end(),
                                  [&](const NamedCovariate& covariate) { return name == covariate.name; });
  return found == named_covariates.end() ? nullptr : &*found;
}

bool differs_within_cells(const std::string& covariate) {
  const NamedCovariate* named = named_covariate(covariate);
  return covariate != range_by_landmark && !(named && named->of_cell);
}

}  // namespace

CovariateOf covariate_of(const Rows& rows, const std::string& name) {
  if (const NamedCovariate* named = named_covariate(name)) return named->value;
  if (name == range_by_landmark)
    return [low = rows.context.range_min_m, high = rows.context.range_max_m](const auto& at) {
      const double share = std::clamp((at.d - low) / std::max(high - low, 1e-12), 0.0, 1.0);
      return static_cast<double>(at.landmark) + 0.9 * share;
    };
  const auto& names = rows.context.covariates;
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) return {};
  return [column = found - names.begin()](const auto& at) { return at.covariate[column]; };
}

Eigen::VectorXd values_along(const Rows& rows, const CellGeometry& geometry, const CovariateOf& covariate) {
  Eigen::VectorXd x(static_cast<Eigen::Index>(rows.size()));
  for (Eigen::Index i = 0; i < x.size(); ++i)
    x[i] = covariate(view_of(rows, geometry, static_cast<std::size_t>(i)));
  return x;
}

bool has_cells_for(const Rows& rows, const CurveBasis& basis) {
  return cells_of_parameter * basis.size() <= rows.cell_count;
}

std::vector<double> knots_at_equal_shares(const std::vector<double>& sorted, int count) {
  const double apart = 1e-9 * (sorted.back() - sorted.front());
  std::vector<double> knots;
  for (int j = 0; j < count; ++j) {
    const double v = sorted[static_cast<std::size_t>(
        std::lround((static_cast<double>(sorted.size()) - 1.0) * j / (count - 1.0)))];
    if (knots.empty() || v > knots.back() + apart) knots.push_back(v);
  }
  return knots;
}

CurveChannel curve_channel_of(const std::string& name) {
  if (name == "range") return CurveChannel::range;
  if (name == "bearing") return CurveChannel::bearing;
  if (name == "range_noise") return CurveChannel::range_noise;
  if (name == "bearing_noise") return CurveChannel::bearing_noise;
  return CurveChannel::none;
}

GenericEffect::GenericEffect(CurveChannel channel, const std::string& channel_name,
                             const std::string& covariate_name, CovariateOf covariate, CurveBasis basis,
                             Eigen::MatrixXd directions, double typical)
    : channel_(channel),
      covariate_(std::move(covariate)),
      basis_(std::move(basis)),
      directions_(std::move(directions)) {
  differs_between_repeats_ = differs_within_cells(covariate_name);
  info_.id = "generic";
  info_.kind = is_mean(channel) ? EffectKind::mean : EffectKind::noise;
  info_.channel = channel_name;
  info_.covariate = covariate_name;
  info_.physics =
      "A smooth correction of " + channel_name + " against " + covariate_name + ", of unknown cause.";
  unit_ = channel == CurveChannel::range ? "m" : channel == CurveChannel::bearing ? "rad" : "log_variance";
  // A spread that is no twentieth of what it is elsewhere, nor twenty times as much: without a bound a curve with many knots leaves readings
  // that happen to be alike no spread at all, and gains without end beside tails.
  const double bound = is_mean(channel) ? 1e3 * typical : 2.0 * std::log(20.0);
  for (Eigen::Index j = 0; j < directions_.cols(); ++j)
    info_.parameters.push_back(
        {.name = fmt::format("c{}_{}", j + 1, unit_), .typical = typical, .low = -bound, .high = bound});
}

ReadingChange<double> GenericEffect::of_channel(double change) const {
  switch (channel_) {
    case CurveChannel::range:
      return {.range = change};
    case CurveChannel::bearing:
      return {.bearing = change};
    case CurveChannel::range_noise:
      return {.range_log_variance = change};
    case CurveChannel::bearing_noise:
      return {.bearing_log_variance = change};
    case CurveChannel::none:
      break;
  }
  return {};
}

ReadingChange<double> GenericEffect::reading(const ReadingView<double>& at, const double* p) const {
  const Eigen::Map<const Eigen::VectorXd> parameters(p, directions_.cols());
  return of_channel(
      basis_.value_of(covariate_(at), [&](Eigen::Index k) { return directions_.row(k).dot(parameters); }));
}

std::optional<ReadingChange<double>> GenericEffect::slope(const ReadingView<double>& at, const double*,
                                                          int parameter) const {
  return of_channel(
      basis_.value_of(covariate_(at), [&](Eigen::Index k) { return directions_(k, parameter); }));
}

std::vector<std::pair<std::string, double>> GenericEffect::reported(const EffectContext&,
                                                                    const double* p) const {
  const Eigen::VectorXd c = coefficients(p);
  std::vector<std::pair<std::string, double>> values;
  for (Eigen::Index k = 0; k < c.size(); ++k)
    values.emplace_back(
        basis_.wavenumber > 0.0
            ? fmt::format("{}_at_wavenumber_{:.4g}_{}", k == 0 ? "cosine" : "sine", basis_.wavenumber, unit_)
            : fmt::format("at_{:.4g}_{}", basis_.knots[static_cast<std::size_t>(k)], unit_),
        c[k]);
  return values;
}

}  // namespace rangecal::diagnosis
