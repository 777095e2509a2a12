// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/correction/candidates.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

std::string why_unusable(double reading) {
  if (std::isnan(reading)) return "missing";
  if (!std::isfinite(reading)) return "not_finite";
  return reading == 0.0 ? "zero" : reading < 0.0 ? "negative" : "";
}

CorrectionCandidate candidate_of(const CorrectionRoot& root, int number, std::string flags) {
  const auto add = [&](const char* flag) { flags += (flags.empty() ? "" : "+") + std::string(flag); };
  if (root.extrapolated && flags != "out_of_range") add("extrapolated");
  if (root.turning_point) add("turning_point");
  return {root.distance_m, root.std_dev_total_m ? root.std_dev_total_m : root.std_dev_m, number,
          flags.empty() ? "ok" : flags};
}

/// Index of a label among the calibration's, -1 where it is not one of them.
template <typename Items>
int index_of(const Items& items, const std::string& label) {
  for (std::size_t i = 0; i < items.size(); ++i)
    if (items[i].label == label) return static_cast<int>(i);
  return -1;
}

}  // namespace

std::vector<CorrectionCandidate> correction_candidates(const EffectCorrector& corrector, double reading_m,
                                                       const ReadingSetting& setting,
                                                       bool maximum_likelihood) {
  if (const std::string why = setting.complete ? why_unusable(reading_m) : "missing"; !why.empty())
    return {{std::nullopt, std::nullopt, 0, why}};
  const Correction found = corrector.correct(reading_m, setting);
  std::vector<CorrectionRoot> roots = maximum_likelihood ? found.maximum_likelihood : found.least_squares;
  std::sort(roots.begin(), roots.end(), [](const CorrectionRoot& a, const CorrectionRoot& b) {
    return a.log_likelihood > b.log_likelihood;
  });
  if (roots.empty()) {
    if (found.nearest) return {candidate_of(*found.nearest, 1, "out_of_range")};
    return {{std::nullopt, std::nullopt, 0, "out_of_range"}};
  }
  std::vector<CorrectionCandidate> candidates;
  const char* flag = found.least_squares.empty() ? "out_of_range" : roots.size() > 1 ? "ambiguous" : "";
  for (std::size_t i = 0; i < roots.size(); ++i)
    candidates.push_back(candidate_of(roots[i], static_cast<int>(i + 1), flag));
  return candidates;
}

ReadingSettings reading_settings(const Calibration& calibration, const CsvTable* table,
                                 const std::string& name, std::size_t count) {
  std::vector<std::string> covariates;
  if (table && !calibration.effects.empty())
    for (std::size_t c = 0; c < table->columns().size(); ++c)
      if (table->is_numeric(c)) covariates.push_back(table->columns()[c]);
  ReadingSettings settings{EffectCorrector(calibration, covariates), std::vector<ReadingSetting>(count)};
  if (calibration.effects.empty()) return settings;
  const auto column = [&](const char* of) { return table ? table->find(of) : std::nullopt; };
  for (const EffectCorrector::Need& need : settings.corrector.needs()) {
    const bool by_stop = need.column == "heading_rad" && column("stop") && !calibration.stops.empty();
    if (!column(need.column.c_str()) && !by_stop)
      throw InputError(name, 1, need.column,
                       "is missing: the calibration's effect " + need.effect + " needs it to be undone");
  }
  if (!table) return settings;
  double first_time = std::numeric_limits<double>::infinity();
  if (const auto time = column("time_s"))
    for (std::size_t row = 0; row < table->rows(); ++row)
      first_time = std::min(first_time, table->finite(row, *time));
  for (std::size_t row = 0; row < count; ++row) {
    ReadingSetting& at = settings.of_reading[row];
    const auto number = [&](const char* of, double& to) {
      if (const auto c = column(of)) to = table->number(row, *c).value_or(std::nan(""));
    };
    number("bearing_rad", at.bearing_rad);
    number("heading_rad", at.heading_rad);
    number("radius_m", at.radius_m);
    number("time_s", at.time_s);
    at.time_s -= first_time;
    if (const auto c = column("landmark"))
      at.landmark = index_of(calibration.landmarks, table->label(row, *c));
    if (const auto c = column("stop")) at.stop = index_of(calibration.stops, table->label(row, *c));
    if (at.stop >= 0 && !std::isfinite(at.heading_rad))
      at.heading_rad = calibration.stops[static_cast<std::size_t>(at.stop)].pose.heading_rad;
    if (const auto c = column("repeat")) at.repeat = static_cast<int>(table->number(row, *c).value_or(0.0));
    for (const EffectCorrector::Need& need : settings.corrector.needs()) {
      const auto c = column(need.column.c_str());
      if (!c || need.column == "landmark" || need.column == "stop") continue;
      const double value = table->number(row, *c).value_or(std::nan(""));
      const bool heading = need.column == "heading_rad";
      if ((heading || need.column == "bearing_rad") && std::abs(value) > 2.0 * std::numbers::pi)
        table->fail(row, *c, "is beyond 2 pi: radians are needed");
      at.complete = at.complete && (std::isfinite(value) || (heading && std::isfinite(at.heading_rad)));
    }
    for (const std::string& covariate : covariates)
      at.covariates.push_back(table->number(row, *table->find(covariate)).value_or(std::nan("")));
  }
  return settings;
}

void require_curve(const Calibration& calibration, const std::string& name) {
  const bool open_curve = calibration.outcome == Outcome::unobservable && !calibration.alpha_covariance;
  if (!is_usable(calibration.outcome) || open_curve)
    throw InputError(name + ": its outcome is " + to_string(calibration.outcome) +
                     ", so it cannot correct readings");
}

}  // namespace rangecal
