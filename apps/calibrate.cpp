// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <cmath>
#include <memory>
#include <numbers>

#include "commands.hpp"
#include "comparison.hpp"
#include "job_options.hpp"
#include "rangecal/core/calibration_io.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/solvers/calibrate/alpha_bound.hpp"
#include "rangecal/solvers/calibrate/plausibility.hpp"
#include "rangecal/solvers/tilt/leaning.hpp"
#include "report/report.hpp"
#include "summary.hpp"
#include "text.hpp"

namespace rangecal::app {
namespace {

std::string tilt_page(const LeaningFit& fit) {
  constexpr double degrees = 180.0 / std::numbers::pi;
  std::string text = fmt::format("Plane      {}\n", wrapped(fit.statement, 11)) +
                     fmt::format("Gain       {:.1f} nats by the tilt", fit.tilt_gain);
  text += fit.leans.empty() ? "\n" : fmt::format(", {:.1f} more by the leans\n", fit.lean_gain);
  if (fit.tilt_seen)
    text += fmt::format("Axis       level direction {:.0f} degrees in the sensor's frame +- {:.0f}\n",
                        fit.axis.estimate * degrees, fit.axis.std_dev * degrees);
  for (const LeanEstimate& lean : fit.leans) {
    text += fmt::format("Lean       {}: ", lean.landmark);
    text += lean.seen ? fmt::format(
                            "{:.1f} degrees ({:.1f} to {:.1f}), slope ({:.3f}, {:.3f}) +- ({:.3f}, {:.3f})\n",
                            lean.lean_rad * degrees, lean.low95_rad * degrees, lean.high95_rad * degrees,
                            lean.slope.x(), lean.slope.y(), std::sqrt(lean.covariance(0, 0)),
                            std::sqrt(lean.covariance(1, 1)))
                      : std::string("not seen by this design\n");
  }
  return text;
}

struct CalibrateCommand {
  JobOptions job;
  std::string method = "marginal", from, json, report;
  bool tilt = false;

  int run() const {
    CalibrateOptions options = job.parsed();
    if (method != "all") {
      try {
        options.methods = {method_from_string(method)};
      } catch (const InputError& error) {
        throw InputError(std::string(error.what()) + ", all");
      }
    }
    if (!from.empty()) options.from = load_calibration(from);
    if (!report.empty()) report::require_available();
    require_writable({json, report});
    std::vector<std::string> inputs = recording_files(job.recordings);
    inputs.push_back(from);
    require_apart({json, report}, inputs);
    const std::vector<Recording> recordings = load_recordings(job.recordings, {job.group_by});
    if (tilt) return out_of_the_plane(recordings, options);
    CalibrationReport result = run_job(recordings, options);
    if (!json.empty()) set_alpha_bounds(recordings, result.calibrations);
    const Calibration& best = recommended(result);
    if (!json.empty()) save_calibrations(result.calibrations, json, result.notes);
    if (!report.empty()) write_file(report, report::calibration_page(recordings, result, best, json));

    fmt::print("{}", summary_page(result, best, recordings, json));
    if (options.from) fmt::print("{}", change_page(*options.from, best));
    fmt::print("{}", numerics_page(result, best, recordings));
    if (result.calibrations.size() > 1) {
      std::vector<TruthScore> no_scores(result.calibrations.size());
      fmt::print("\nAll methods\n{}{}", comparison_table(result, no_scores),
                 footnotes_text(result, no_scores));
    }
    const bool contradicted = result.check && result.check->better_basin;
    return has_answer(best) && !contradicted ? done : not_delivered;
  }

 private:
  int out_of_the_plane(const std::vector<Recording>& recordings, const CalibrateOptions& options) const {
    if (method != "marginal" || !report.empty() || !from.empty() || options.criterion != OrderCriterion::aic)
      throw InputError("--tilt goes with --method marginal, and without --from, --criterion and --report");
    LeaningOptions leaning;
    leaning.calibrate = options;
    const LeaningFit fit = fit_leaning(recordings, leaning);
    if (fit.outcome != Outcome::converged) {
      fmt::print("Outcome    {}: {}\n", to_string(fit.outcome), fit.reason);
      return not_delivered;
    }
    CalibrationReport report_of_fit;
    report_of_fit.calibrations = {fit.calibration};
    report_of_fit.models = fit.models;
    report_of_fit.notes = plausibility_warnings(recordings, fit.calibration);
    if (!json.empty()) save_calibrations({fit.calibration}, json, report_of_fit.notes);
    fmt::print("{}\n{}", tilt_page(fit), summary_page(report_of_fit, fit.calibration, recordings, json));
    return done;
  }

  /// marginal where it was asked for, else the last method asked for.
  static const Calibration& recommended(const CalibrationReport& report) {
    for (const Calibration& c : report.calibrations)
      if (c.method == Method::marginal) return c;
    return report.calibrations.back();
  }
};

}  // namespace

void add_calibrate(CLI::App& app, Action& chosen) {
  CLI::App* command = app.add_subcommand("calibrate", "estimate the curve f, the noise, stops and landmarks");
  const auto state = std::make_shared<CalibrateCommand>();
  state->job.add_to(*command);
  command
      ->add_option("--method", state->method,
                   "closed-form, approximate, full (joint maximum), marginal (stops integrated out; "
                   "recommended), or all")
      ->capture_default_str();
  command->add_option("--from", state->from, "refine this calibration (JSON) and say what changed");
  command->add_flag("--tilt", state->tilt,
                    "estimate the tilt of the scan plane and the leans of the cylinders along, and say what "
                    "this recording can see of them");
  command->add_option("--json", state->json, "write the calibration to this file");
  command->add_option("--report", state->report,
                      "write a report to look at to this file: one HTML page that needs no network");
  command->footer(
      "The sensor reports y = f(d) + s e at the true distance d to a landmark's surface. Drive past "
      "landmarks at unknown\n"
      "places, stop, record range and bearing to each: this command finds f, the noise, and where everything "
      "stood.\n"
      "\n"
      "Examples:\n"
      "  rangecal calibrate notebooks_data/field-layout --json cal.json\n"
      "  rangecal calibrate monday tuesday --order 2 --noise f2        two recordings of one sensor\n"
      "  rangecal calibrate today --from cal.json --json new.json      has the sensor changed?\n"
      "  rangecal calibrate wall-readings --noise-shape gaussian       all readings as they are, as the papers do");
  command->callback([state, &chosen] { chosen = [state] { return state->run(); }; });
}

}  // namespace rangecal::app
