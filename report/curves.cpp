// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>

#include "fit_view.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/solvers/calibrate/curve.hpp"
#include "text.hpp"

namespace rangecal::report {

void add_curves(Page& page, const std::vector<NamedCurve>& curves, const std::vector<ModelScore>& scores) {
  Json rows = Json::array(), names = Json::array(), colours = Json::array();
  std::vector<double> heights;
  // Bands are compared by eye, so all are of one kind.
  const auto knows = [](const NamedCurve& curve) {
    return curve.calibration->covariance_with_choice.has_value();
  };
  const bool with_choice = std::all_of(curves.begin(), curves.end(), knows);
  const bool mixed = !with_choice && std::any_of(curves.begin(), curves.end(), knows);
  for (const NamedCurve& curve : curves) {
    names.push_back(curve.name);
    colours.push_back(curve.colour);
    for (const CurvePoint& p : curve_points(*curve.calibration, 61)) {
      const double excess = 1e3 * (p.reading_m - p.distance_m);
      const std::optional<double> std_dev = with_choice ? p.std_dev_with_choice_m : p.std_dev_m;
      const double band = std_dev ? 1e3 * z95 * *std_dev : 0.0;
      rows.push_back({{"model", curve.name},
                      {"d", number(p.distance_m)},
                      {"excess", number(excess)},
                      {"low", number(excess - band)},
                      {"high", number(excess + band)},
                      {"band", number(band)}});
      heights.insert(heights.end(), {excess - 3e3 * p.noise_m, excess + 3e3 * p.noise_m});
    }
  }
  page.dataset("curves", rows);
  const Limits limits = limits_of(heights);
  page.section("The curve f");
  std::vector<Chart> charts{
      {"curve",
       "curve",
       {{"models", names}, {"colours", colours}, {"low", limits.low}, {"high", limits.high}},
       "What the sensor says beyond the true distance",
       std::string("f(d) − d with its 95 % band, ") +
           (with_choice ? "the choice of order and noise law in it, "
            : mixed     ? "given this order and noise law, "
                        : "") +
           "over the readings as they were read.",
       "plot"}};
  std::vector<ModelScore> sane;  // of the family that was taken
  std::copy_if(scores.begin(), scores.end(), std::back_inserter(sane), [&](const ModelScore& s) {
    return std::isfinite(s.aic) && !curves.empty() && s.family == curves.back().calibration->scale.family;
  });
  if (!sane.empty()) {
    const ModelScore& best = *std::min_element(
        sane.begin(), sane.end(), [](const ModelScore& a, const ModelScore& b) { return a.aic < b.aic; });
    Json orders = Json::array();
    for (const ModelScore& s : sane)
      orders.push_back({{"order", s.order},
                        {"law", app::law_in_words(s.law)},
                        {"aic", number(s.aic)},
                        {"above", number(s.aic - best.aic)}});
    page.dataset("orders", orders);
    std::string caption = "AIC of the seed model, above the lowest: 0 is best, within 2 is a tie.";
    const int chosen = curves.back().calibration->order();
    if (curves.front().name == "seed model" && chosen < best.order)
      caption += fmt::format(
          " The diagnosis keeps to order {}: what bends the curve more is looked for as an effect.", chosen);
    charts.push_back(
        {"orders", "orders", {}, "Which order and noise law the readings ask for", caption, "plot"});
  }
  page.charts(charts);
}

}  // namespace rangecal::report
