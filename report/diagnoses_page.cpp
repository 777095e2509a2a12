// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <algorithm>
#include <map>

#include "page.hpp"
#include "report.hpp"

namespace rangecal::report {

std::string diagnoses_page(const std::vector<DiagnosisRow>& rows) {
  const auto in_words = [](std::string verdict) {
    std::replace(verdict.begin(), verdict.end(), '_', ' ');
    return verdict.empty() ? "not diagnosed" : verdict;
  };
  const auto with_sign = [](std::optional<double> value, std::optional<double> std_dev) {
    if (!value) return std::string("-");
    return fmt::format("{:+.1f}{}", *value, std_dev ? fmt::format(" +- {:.1f}", *std_dev) : std::string());
  };
  const auto in_mm = [](std::optional<double> metres) {
    return metres ? fmt::format("{:.2f}", 1e3 * *metres) : std::string("-");
  };
  std::map<std::string, int> verdicts;
  for (const DiagnosisRow& row : rows) ++verdicts[in_words(row.verdict)];
  Page page("rangecal diagnoses", fmt::format("{} recordings, each for itself", rows.size()));
  std::vector<Page::Figure> figures;
  for (const auto& [verdict, count] : verdicts) figures.push_back({fmt::format("{}", count), verdict});
  page.figures(figures);
  page.section(
      "Recordings",
      "Changes are those of the negative log likelihood [nats], of the final model against the seed model: "
      "below 0 is better. Held out: of blocks that were left out, with the standard error of the change.");
  Table table{{{"recording"},
               {"verdict"},
               {"names"},
               {"estimates"},
               {"NLL change", true},
               {"held-out change", true},
               {"held-out RMS [mm]", true},
               {"what is left"},
               {"s", true}},
              {},
              true};
  for (const DiagnosisRow& row : rows)
    table.rows.push_back({row.recording, in_words(row.verdict), row.names, row.estimates,
                          with_sign(row.nll_change, {}), with_sign(row.heldout_change, row.heldout_std),
                          row.heldout_rms_before_m
                              ? in_mm(row.heldout_rms_before_m) + " -> " + in_mm(row.heldout_rms_after_m)
                              : "-",
                          row.reason.empty() ? row.rest : row.reason, fmt::format("{:.1f}", row.seconds)});
  page.table(table);
  return page.html();
}

}  // namespace rangecal::report
