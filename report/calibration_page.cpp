// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "comparison.hpp"
#include "fit_view.hpp"
#include "rangecal/core/errors.hpp"
#include "report.hpp"
#include "summary.hpp"
#include "text.hpp"

namespace rangecal::report {
namespace {

const std::vector<std::string> plain_covariates{"range", "sensor_bearing"};

/// The charts of one calibration that has an answer.
void add_charts(Page& page, std::span<const Recording> recordings, const CalibrationReport& report,
                const Calibration& best, const std::vector<NamedCurve>& curves) {
  const FitView view = view_of({recordings.begin(), recordings.end()}, best, plain_covariates);
  add_readings(page, view);
  add_scene(page, view);
  add_curves(page, curves, report.models);
  page.section("Residuals", residuals_lead);
  add_plain_residuals(page, view);
  add_noise(page, view);
}

void add_methods(Page& page, const CalibrationReport& report, const std::vector<TruthScore>& scores) {
  const std::vector<std::vector<std::string>> rows = app::comparison_rows(report, scores);
  Table table{{}, {rows.begin() + 1, rows.end()}, false};
  for (const std::string& title : rows.front()) table.columns.push_back({title, !title.empty()});
  page.table(table);
  page.list(app::footnotes(report, scores));
}

void add_fit(Page& page, const CalibrationReport& report, const Calibration& c) {
  page.section("How the fit went");
  std::vector<std::string> items;
  items.push_back(
      fmt::format("{} by {} after {} iterations.", to_string(c.outcome), to_string(c.method), c.iterations));
  if (c.joint_nll && c.kind == RecordingKind::landmarks)
    items.push_back(fmt::format("Joint NLL {:.4f}.", *c.joint_nll));
  if (c.marginal_nll)
    items.push_back(fmt::format("{} {:.4f}, AIC {:.3f}.",
                                c.kind == RecordingKind::pairs ? "NLL" : "Marginal NLL", *c.marginal_nll,
                                c.aic.value_or(NAN)));
  if (!c.covariance_reason.empty())
    items.push_back("Covariance: " + app::shortened(c.covariance_reason) + ".");
  if (!c.weakest_direction.empty()) items.push_back("Weakest direction: " + c.weakest_direction + ".");
  if (report.check) items.push_back("Check of the full likelihood: " + report.check->report);
  page.list(items);
}

/// Behind the sentence about the choice of the model: which band the chart of the curve has.
const char* which_band(const Calibration& c) {
  if (!app::has_answer(c)) return "";
  return c.covariance_with_choice ? "; the chart of the curve shows the band with the choice"
                                  : "; the chart of the curve shows the band given them";
}

const char* badge_colour(const Calibration& c) { return app::has_answer(c) ? "good" : "bad"; }

}  // namespace

std::string calibration_page(std::span<const Recording> recordings, const CalibrationReport& report,
                             const Calibration& best, const std::string& json) {
  require_available();
  Page page("rangecal calibration", app::describe(recordings));
  const std::vector<app::SummaryItem> items = app::summary_items(report, best, recordings, json);
  Table summary{{{""}, {""}}, {}, true};
  std::string outcome;
  for (const app::SummaryItem& item : items) {
    if (item.title == "Outcome")
      outcome = item.text;
    else if (item.title != "Recording")
      summary.rows.push_back({item.title, item.title == "Choice" ? item.text + which_band(best) : item.text});
  }
  page.verdict(to_string(best.outcome), badge_colour(best), outcome);
  page.table(summary);
  if (app::has_answer(best))
    add_charts(page, recordings, report, best, {{to_string(best.method), "var(--after)", &best}});
  if (report.calibrations.size() > 1) {
    page.section("All methods");
    add_methods(page, report, std::vector<TruthScore>(report.calibrations.size()));
  }
  add_fit(page, report, best);
  return page.html();
}

std::string comparison_page(std::span<const Recording> recordings, const CalibrationReport& report,
                            const std::vector<TruthScore>& scores, const app::Advice& advice) {
  require_available();
  Page page("rangecal comparison of methods", app::describe(recordings));
  static const char* const colours[] = {"var(--third)", "var(--fourth)", "var(--before)", "var(--after)"};
  const Calibration* best = nullptr;
  std::vector<NamedCurve> curves;
  for (const Calibration& c : report.calibrations)
    if (app::has_answer(c)) {
      best = &c;
      curves.push_back({to_string(c.method), colours[static_cast<std::size_t>(c.method) % 4], &c});
    }
  page.verdict(best ? fmt::format("best: {}", to_string(best->method)) : "no answer", best ? "good" : "bad",
               app::advice_text({advice.trust, {}, advice.against}));
  if (!advice.others.empty()) page.list(advice.others);
  page.section("The methods side by side");
  add_methods(page, report, scores);
  if (best) {
    add_charts(page, recordings, report, *best, curves);
    add_fit(page, report, *best);
  }
  return page.html();
}

}  // namespace rangecal::report
