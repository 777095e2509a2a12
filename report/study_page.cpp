// SPDX-License-Identifier: BSD-3-Clause
// The report of a study: its measures over the parameter with the most values, a line per estimator.
#include <fmt/core.h>

#include <algorithm>
#include <limits>
#include <map>
#include <set>

#include "page.hpp"
#include "rangecal/core/proportion.hpp"
#include "report.hpp"
#include "text.hpp"

namespace rangecal::report {
namespace {

struct Measure {
  std::string column, words;
  double factor = 1.0;
  int better = -1;     ///< -1: smaller, 1: larger, 0: neither, a share of the repeats
  std::string best{};  ///< what the best estimator has, in words
};

/// What is drawn where the study has it, most telling first.
const std::vector<Measure> measures{
    {"curve_rmse_over_bound", "curve: RMSE over the Cramér-Rao bound", 1.0, -1,
     "the curve nearest to the bound"},
    {"landmark_rmse_over_bound", "landmarks: RMSE over the bound", 1.0, -1,
     "the landmarks nearest to the bound"},
    {"mse_factor", "MSE of raw over corrected readings", 1.0, 1, "the largest gain by correction"},
    {"nmse_factor", "relative MSE, raw over corrected", 1.0, 1, "the largest gain by correction"},
    {"curve_rmse_m", "curve: RMSE [mm]", 1e3, -1, "the curve with the least error"},
    {"landmark_rmse_m", "landmarks: RMSE [mm]", 1e3, -1, "the landmarks with the least error"},
    {"curve_bias_m", "curve: bias [mm]", 1e3, -1, "the curve with the least bias"},
    {"landmark_bias_m", "landmarks: bias [mm]", 1e3, -1, "the landmarks with the least bias"},
    {"curve_coverage95", "curve: share of 95 % intervals that hold", 1.0, 0},
    {"landmark_coverage95", "landmarks: share of 95 % intervals that hold", 1.0, 0},
    {"order_1", "share that selects order 1", 1.0, 0},
    {"order_2", "share that selects order 2", 1.0, 0},
    {"order_3", "share that selects order 3", 1.0, 0},
    {"h1_best", "share in which f explains the noise best", 1.0, 0},
    {"h2_best", "share in which f² explains the noise best", 1.0, 0}};
constexpr std::size_t most_measures = 4, most_panels = 6;
constexpr double enough_answers = 0.9;  ///< of the repeats, for an estimator to be called best

/// The table with its parameters told from its measures.
struct Layout {
  const CsvTable& table;
  std::vector<std::size_t> parameters;  ///< columns
  std::size_t estimator = 0, answers = 0;
  std::optional<std::size_t> swept;      ///< the parameter on the x axis
  bool numeric = false, spread = false;  ///< all its values numbers; all positive, over more than a decade

  explicit Layout(const CsvTable& results) : table(results) {
    estimator = table.require("estimator");
    answers = table.require("answers");
    for (std::size_t c = table.require("point") + 1; c < estimator; ++c) parameters.push_back(c);
    std::size_t most = 1;
    for (std::size_t c : parameters) {
      std::set<std::string_view> values;
      for (std::size_t r = 0; r < table.rows(); ++r) values.insert(table.text(r, c));
      if (values.size() <= most) continue;
      most = values.size();
      swept = c;
      numeric = table.is_numeric(c);
    }
    if (!swept || !numeric) return;
    double low = std::numeric_limits<double>::infinity(), high = 0.0;
    for (std::size_t r = 0; r < table.rows(); ++r) {
      const double value = *table.number(r, *swept);
      low = std::min(low, value), high = std::max(high, value);
    }
    spread = low > 0.0 && high > 10.0 * low;
  }
  /// The parameters that are not on the axis, in words: one panel each.
  std::string panel_of(std::size_t row) const {
    std::string words;
    for (std::size_t c : parameters)
      if (!swept || c != *swept)
        words += fmt::format("{}{} {}", words.empty() ? "" : ", ", table.columns()[c], table.text(row, c));
    return words;
  }
};

std::vector<Measure> measures_of(const CsvTable& table) {
  std::vector<Measure> found;
  for (const Measure& m : measures)
    if (found.size() < most_measures && table.find(m.column)) found.push_back(m);
  return found;
}

/// The column of a measure's standard errors: of "a" it is "a_se", of "a_m" "a_se_m".
std::optional<std::size_t> deviation_of(const CsvTable& t, const Measure& m) {
  const auto own = t.find(m.column + "_se");
  return own ? own : t.find(m.column.substr(0, m.column.rfind("_m")) + "_se_m");
}

/// A measure in one row: 95 % interval, and the standard error where the table has one; NaN where nothing says how sure it is.
struct Interval {
  double low = std::numeric_limits<double>::quiet_NaN(), high = low;
  std::optional<double> se;
};
Interval interval_of(const Layout& layout, const Measure& m, std::size_t row, double value) {
  const CsvTable& t = layout.table;
  if (m.better == 0) {
    const double answers = t.number(row, layout.answers).value_or(0.0);
    const auto [low, high] = wilson(value * answers, answers);
    return {low, high, std::nullopt};
  }
  const std::optional<std::size_t> column = deviation_of(t, m);
  const double se = m.factor * (column ? t.number(row, *column).value_or(0.0) : 0.0), at = m.factor * value;
  if (!(se > 0.0)) return {};
  return {at - z95 * se, at + z95 * se, se};
}

/// Values with their 95 % intervals; of rows without an answer, nothing.
Json rows_of(const Layout& layout, const Measure& m, const std::string& panel) {
  const CsvTable& t = layout.table;
  const std::size_t value = t.require(m.column);
  Json rows = Json::array();
  for (std::size_t r = 0; r < t.rows(); ++r) {
    if (layout.panel_of(r) != panel) continue;
    const std::optional<double> v = t.number(r, value);
    if (!v) continue;
    const Interval interval = interval_of(layout, m, r, *v);
    Json row{{"estimator", std::string(t.text(r, layout.estimator))},
             {"value", number(m.factor * *v)},
             {"low", number(interval.low)},
             {"high", number(interval.high)},
             {"answers", std::string(t.text(r, layout.answers))}};
    row["x"] =
        layout.numeric ? number(*t.number(r, *layout.swept)) : Json(std::string(t.text(r, *layout.swept)));
    rows.push_back(std::move(row));
  }
  return rows;
}

/// The estimators in the order of the table, each with a colour: marginal, full and approximate have those of the other pages.
std::pair<Json, Json> colours_of(const Layout& layout) {
  std::vector<std::string> names;
  for (std::size_t r = 0; r < layout.table.rows(); ++r)
    if (const std::string name(layout.table.text(r, layout.estimator));
        std::find(names.begin(), names.end(), name) == names.end())
      names.push_back(name);
  const std::map<std::string, std::string> own{
      {"marginal", "var(--after)"}, {"full", "var(--before)"}, {"approximate", "var(--fourth)"}};
  std::vector<std::string> free{"var(--third)", "var(--prior)", "var(--readings)"};
  for (const auto& [name, colour] : own)
    if (std::find(names.begin(), names.end(), name) == names.end()) free.push_back(colour);
  Json colours = Json::array();
  std::size_t next = 0;
  for (const std::string& name : names)
    colours.push_back(own.contains(name) ? own.at(name) : free[next++ % free.size()]);
  return {names, colours};
}

/// "12.34 +- 0.21", "0.940 (0.878 to 0.972)".
std::string value_in_words(const Measure& m, const Interval& interval, double value) {
  if (m.better == 0) return fmt::format("{:.3f} ({:.3f} to {:.3f})", value, interval.low, interval.high);
  return interval.se ? app::with_std(m.factor * value, *interval.se)
                     : fmt::format("{:.4g}", m.factor * value);
}

void add_panels(Page& page, const Layout& layout, const std::vector<Measure>& found) {
  std::vector<std::string> panels;
  for (std::size_t r = 0; r < layout.table.rows(); ++r)
    if (const std::string p = layout.panel_of(r); std::find(panels.begin(), panels.end(), p) == panels.end())
      panels.push_back(p);
  const std::size_t shown = std::min(panels.size(), most_panels);
  page.section(
      "Over " + layout.table.columns()[*layout.swept],
      "Bars are 95 % intervals over the repeats (of shares Wilson's, in which a repeat counts once). A missing point had no "
      "answer." +
          (shown < panels.size()
               ? fmt::format(" The first {} of {} combinations of the other parameters; the "
                             "table has all.",
                             shown, panels.size())
               : std::string()));
  const auto [estimators, colours] = colours_of(layout);
  for (std::size_t p = 0; p < shown; ++p) {
    if (!panels[p].empty()) page.heading(panels[p]);
    std::vector<Chart> pair;
    for (std::size_t m = 0; m < found.size(); ++m) {
      const std::string id = fmt::format("study-{}-{}", p, m);
      page.dataset(id, rows_of(layout, found[m], panels[p]));
      Chart chart{id, "study", {}, found[m].words, "", "plot"};
      chart.values = {{"data", id},
                      {"kind", layout.numeric ? "quantitative" : "nominal"},
                      {"scale", layout.spread ? Json("log") : Json()},
                      {"zero", layout.numeric ? Json(false) : Json()},
                      {"padding", layout.numeric ? Json(12) : Json()},
                      {"parameter", layout.table.columns()[*layout.swept]},
                      {"measure", found[m].words},
                      {"estimators", estimators},
                      {"colours", colours}};
      pair.push_back(std::move(chart));
      if (pair.size() == 2 || m + 1 == found.size()) {
        page.charts(pair);
        pair.clear();
      }
    }
  }
}

/// The estimators that are most often the best by a measure, or within two standard errors of it; points with a single
/// answer do not count.
struct Winners {
  std::string names;  ///< "full and marginal"
  int wins = 0, points = 0;
  std::vector<double> values;  ///< of the measure, over the points, of the first
};
Winners winners_by(const Layout& layout, const Measure& m) {
  const CsvTable& t = layout.table;
  const std::size_t point = t.require("point"), value = t.require(m.column);
  const std::optional<std::size_t> repeats = t.find("repeats"), deviation = deviation_of(t, m);
  struct Row {
    std::string estimator;
    double value = 0.0, se = 0.0;
  };
  std::map<std::string, std::vector<Row>> points;
  std::map<std::string, std::vector<double>> values;
  std::vector<std::string> order;
  for (std::size_t r = 0; r < t.rows(); ++r) {
    const std::optional<double> v = t.number(r, value);
    const double answers = t.number(r, layout.answers).value_or(0.0);
    if (!v || (repeats && answers < enough_answers * t.number(r, *repeats).value_or(0.0))) continue;
    const std::string estimator(t.text(r, layout.estimator));
    if (!values.contains(estimator)) order.push_back(estimator);
    values[estimator].push_back(*v);
    points[std::string(t.text(r, point))].push_back(
        {estimator, *v, deviation ? t.number(r, *deviation).value_or(0.0) : 0.0});
  }
  Winners winners;
  std::map<std::string, int> wins;
  for (const auto& [key, rows] : points) {
    if (rows.size() < 2) continue;
    ++winners.points;
    const auto best = std::max_element(rows.begin(), rows.end(), [&](const Row& a, const Row& b) {
      return m.better * a.value < m.better * b.value;
    });
    for (const Row& row : rows)
      winners.wins = std::max(winners.wins, wins[row.estimator] += m.better * (best->value - row.value) <=
                                                                   2.0 * std::max(row.se, best->se));
  }
  for (const std::string& estimator : order) {
    if (winners.wins == 0 || wins[estimator] < winners.wins) continue;
    if (winners.names.empty()) winners.values = values[estimator];
    winners.names += (winners.names.empty() ? "" : " and ") + estimator;
  }
  std::sort(winners.values.begin(), winners.values.end());
  return winners;
}

void add_verdict(Page& page, const Layout& layout, const std::vector<Measure>& found, std::size_t points) {
  const CsvTable& t = layout.table;
  std::string repeats = "?";
  if (const auto column = t.find("repeats"); column && t.rows() > 0) repeats = t.text(0, *column);
  const auto measure =
      std::find_if(found.begin(), found.end(), [](const Measure& m) { return m.better != 0; });
  const Winners winner = measure == found.end() ? Winners{} : winners_by(layout, *measure);
  std::vector<Page::Figure> figures{{std::to_string(points), "points of the grid"},
                                    {repeats, "repeats of each"}};
  std::string sentence = "The study is complete.";
  if (winner.points > 0) {
    sentence = fmt::format("Within two standard errors {} {} {} at {} of {} points.", winner.names,
                           winner.names.find(" and ") == std::string::npos ? "gives" : "give", measure->best,
                           winner.wins, winner.points);
    const std::vector<double>& v = winner.values;  // sorted
    const double low = measure->factor * v.front(), high = measure->factor * v.back(),
                 middle = measure->factor * 0.5 * (v[(v.size() - 1) / 2] + v[v.size() / 2]);
    figures.push_back(
        {fmt::format("{:.3g}", middle),
         fmt::format("{}, median over the points ({:.3g} to {:.3g})", measure->words, low, high)});
  }
  page.verdict("complete", "good", sentence);
  page.figures(figures);
}

}  // namespace

std::string study_page(const std::string& name, const CsvTable& results) {
  require_available();
  const Layout layout(results);
  const std::vector<Measure> found = measures_of(results);
  std::set<std::string_view> points, estimators;
  for (std::size_t r = 0; r < results.rows(); ++r) {
    points.insert(results.text(r, results.require("point")));
    estimators.insert(results.text(r, layout.estimator));
  }
  Page page("rangecal study " + name,
            fmt::format("{} points of the grid, {} estimators", points.size(), estimators.size()));
  add_verdict(page, layout, found, points.size());
  if (layout.swept && !found.empty()) add_panels(page, layout, found);
  page.section(
      "All results",
      "From results.csv, which holds more columns. Behind ± a standard error, in brackets a 95 % interval.");
  Table table;
  std::vector<std::size_t> columns = layout.parameters;
  columns.insert(columns.end(), {layout.estimator, layout.answers});
  for (std::size_t c : columns) table.columns.push_back({results.columns()[c], c != layout.estimator});
  for (const Measure& m : found) table.columns.push_back({m.words, true});
  for (std::size_t r = 0; r < results.rows(); ++r) {
    std::vector<std::string> row;
    for (std::size_t c : columns) row.emplace_back(results.text(r, c));
    for (const Measure& m : found) {
      const std::optional<double> v = results.number(r, results.require(m.column));
      row.push_back(v ? value_in_words(m, interval_of(layout, m, r, *v), *v) : "");
    }
    table.rows.push_back(std::move(row));
  }
  page.table(table);
  return page.html();
}

}  // namespace rangecal::report
