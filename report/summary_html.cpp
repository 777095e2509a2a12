// SPDX-License-Identifier: BSD-3-Clause
// Fragments for notebooks: no script, styles inline, colours left to the notebook's theme.
#include <fmt/core.h>

#include "comparison.hpp"
#include "diagnosis_words.hpp"
#include "page.hpp"
#include "report.hpp"
#include "summary.hpp"

namespace rangecal::report {
namespace {

std::string table_of(const std::vector<std::vector<std::string>>& rows) {
  std::string text = "<table style=\"border-collapse:collapse\">";
  for (const std::vector<std::string>& row : rows) {
    text += "<tr>";
    for (std::size_t i = 0; i < row.size(); ++i)
      text +=
          fmt::format("<td style=\"text-align:left;padding:.15em 1.2em .15em 0\">{}</td>", escaped(row[i]));
    text += "</tr>";
  }
  return text + "</table>";
}

}  // namespace

std::string diagnosis_summary(const Diagnosis& d) {
  std::string text = fmt::format("<div><p><b>{}</b></p>", escaped(d.sentence));
  const bool same = d.final_effects.empty();
  std::vector<std::vector<std::string>> rows{{"", "seed model"}};
  if (!same) rows[0].insert(rows[0].end(), {"completed", "change"});
  for (const app::BeforeAfter& row : app::before_after_rows(d)) {
    rows.push_back({row.name, row.before});
    if (!same) rows.back().insert(rows.back().end(), {row.after, row.note});
  }
  text += table_of(rows);
  rows.clear();
  for (const app::ParameterRow& row : app::parameter_rows(d))
    rows.push_back({row.name, row.value + " " + row.unit});
  return text + table_of(rows) + "</div>";
}

std::string calibration_summary(std::span<const Recording> recordings, const CalibrationReport& report,
                                const Calibration& best) {
  std::string outcome;
  std::vector<std::vector<std::string>> rows;
  for (const app::SummaryItem& item : app::summary_items(report, best, recordings, "")) {
    if (item.title == "Outcome")
      outcome = item.text;
    else if (item.title != "Next")  // speaks of commands
      rows.push_back({item.title, item.text});
  }
  return fmt::format("<div><p><b>Calibration: {}</b></p>{}</div>", escaped(outcome), table_of(rows));
}

std::string comparison_summary(std::span<const Recording> recordings, const CalibrationReport& report,
                               const std::vector<TruthScore>& scores) {
  std::string text = fmt::format("<div><p><b>{}</b></p>{}",
                                 escaped(app::advice_text(app::advise(report, recordings, scores))),
                                 table_of(app::comparison_rows(report, scores)));
  for (const std::string& line : app::footnotes(report, scores))
    text += fmt::format("<p>{}</p>", escaped(line));
  return text + "</div>";
}

}  // namespace rangecal::report
