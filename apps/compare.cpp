// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <memory>

#include "commands.hpp"
#include "comparison.hpp"
#include "job_options.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/recording_io.hpp"
#include "report/report.hpp"
#include "summary.hpp"
#include "text.hpp"

namespace rangecal::app {
namespace {

int run(const JobOptions& job, const std::string& page) {
  if (!page.empty()) report::require_available();
  require_writable(page);
  require_apart({page}, recording_files(job.recordings));
  const std::vector<Recording> recordings = load_recordings(job.recordings, {job.group_by});
  const CalibrationReport report = run_job(recordings, job.parsed());
  const Calibration* stops = nullptr;
  const Calibration* best = nullptr;
  for (const Calibration& c : report.calibrations)
    if (has_answer(c)) {
      best = &c;
      if (!c.stops.empty()) stops = &c;
    }
  std::vector<TruthScore> scores;
  for (const Calibration& c : report.calibrations) {
    if (has_answer(c))
      scores.push_back(score_against_truth(recordings, c, stops));
    else
      scores.emplace_back();
  }
  const Advice advice = advise(report, recordings, scores);
  if (!page.empty()) write_file(page, report::comparison_page(recordings, report, scores, advice));
  if (best)
    if (const std::string warning = not_usable_in_words(*best, recordings); !warning.empty())
      fmt::print("{}\n", wrapped("WARNING: " + warning, 2));
  fmt::print("{}\n", wrapped(describe(recordings) + "; " + describe(report.calibrations[0].counts), 2));
  if (best) fmt::print("{}\n", wrapped(describe_choice(*best, report), 2));
  fmt::print("\n{}", comparison_table(report, scores));
  fmt::print("{}", footnotes_text(report, scores));
  if (best) {
    for (const std::string& text : {left_out_in_words(*best), outlier_count_in_words(*best)})
      if (!text.empty()) fmt::print("{}\n", wrapped(text, 2));
    for (const std::string& line : outlier_lines(*best)) fmt::print("  {}\n", line);
  }
  if (best)
    for (const std::string& bound : bound_in_words(*best, recordings))
      fmt::print("{}\n", wrapped(fmt::format("{}: {}", to_string(best->method), bound), 2));
  if (report.check) fmt::print("{}\n", wrapped("check of the full likelihood: " + report.check->report, 2));
  fmt::print("\n{}\n", wrapped(advice_text(advice), 0));
  return best && best->method == Method::marginal ? done : not_delivered;
}

}  // namespace

void add_compare(CLI::App& app, Action& chosen) {
  CLI::App* command =
      app.add_subcommand("compare", "the four methods side by side, against ground truth where it exists");
  const auto job = std::make_shared<JobOptions>();
  const auto page = std::make_shared<std::string>();
  job->add_to(*command);
  command->add_option("--report", *page,
                      "write a report to look at to this file: one HTML page that needs no network");
  command->footer(
      "All methods share one order and noise law and are scored by the same two functions: the joint NLL at "
      "their best\n"
      "stops and the marginal NLL with the stops integrated out. AIC uses the marginal one; lower is "
      "better.\n"
      "\n"
      "Example:\n"
      "  rangecal compare notebooks_data/field-layout");
  command->callback([job, page, &chosen] { chosen = [job, page] { return run(*job, *page); }; });
}

}  // namespace rangecal::app
