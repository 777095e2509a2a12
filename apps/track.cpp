// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <csignal>
#include <cstdio>
#include <memory>
#include <optional>

#include "commands.hpp"
#include "numbers.hpp"
#include "rangecal/core/calibration_io.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/solvers/calibrate/plausibility.hpp"
#include "text.hpp"
#include "track/tracking.hpp"

namespace rangecal::app {
namespace {

struct TrackCommand {
  TrackJob job;
  std::string order = "2", noise = "f2", noise_shape = "auto", json;
  std::vector<double> range;
  double forget = 0.0;

  int run() {
    job.options.order.reset();
    if (order != "auto") {
      if (order.size() != 1 || order[0] < '0' || order[0] > '8')
        throw InputError("--order is '" + order + "', not a number of 0 to 8 or auto");
      job.options.order = order[0] - '0';
    }
    job.options.law = noise_law_from_string(noise);
    job.options.noise_order = job.options.order.value_or(1);  // as 'calibrate' has it
    job.options.noise_shape = noise_shape_from_string(noise_shape);
    if (!range.empty()) {
      job.options.range_min_m = range[0];
      job.options.range_max_m = range[1];
    }
    if (forget != 0.0) job.options.forget = forget;
    job.options.check();
    keep_inputs();
    require_writable({job.output, json, job.changes, job.state});
    const Tracked tracked = track(job);
    if (!json.empty() && tracked.calibration) save_calibrations({*tracked.calibration}, json);
    if (!job.output.empty()) fmt::print("{}", page(tracked));
    if (job.watch > 0.0) fmt::print(job.output.empty() ? stderr : stdout, "{}", changes(tracked));
    for (const std::string& note : tracked.notes) fmt::print(stderr, "rangecal: {}\n", note);
    const std::vector<std::string> broken = faults(tracked);
    for (const std::string& fault : broken) fmt::print(stderr, "rangecal: {}\n", fault);
    if (tracked.stopped_by != 0 && !job.follow) {
      std::fflush(stdout);  // and end as if it had not been caught, which is what a shell or make looks for
      std::signal(tracked.stopped_by, SIG_DFL);
      std::raise(tracked.stopped_by);
    }
    if (!broken.empty()) return not_delivered;
    if (!job.from.empty() || (tracked.calibration && has_answer(*tracked.calibration))) return done;
    if (job.output.empty())
      fmt::print(stderr, "rangecal: no calibration: {}\n",
                 tracked.calibration ? tracked.calibration->reason : missing_data(tracked));
    return not_delivered;
  }

  /// Throws InputError for a result that would take the place of what is read.
  void keep_inputs() const {
    std::vector<std::string> inputs;
    if (!job.stops.empty()) inputs = recording_files({job.stops});
    inputs.insert(inputs.end(), {job.input == "-" ? "/dev/stdin" : job.input, job.from});
    require_apart({job.output, json, job.changes, job.state}, inputs);
  }

  /// Why what came out is not what was asked for.
  std::vector<std::string> faults(const Tracked& tracked) const {
    const std::string name = job.input == "-" ? "stdin" : job.input;
    std::vector<std::string> faults;
    if (!tracked.lost.empty())
      faults.push_back(
          fmt::format("{}: {}; the stream ends after {} rows", name, tracked.lost, tracked.rows));
    if (2 * tracked.malformed > tracked.rows)
      faults.push_back(fmt::format("{}: {} of {} rows were not understood: what the others say is no answer",
                                   name, tracked.malformed, tracked.rows));
    if (tracked.stopped_by != 0 && !job.follow)
      faults.push_back(fmt::format("{}: stopped by {} after {} rows{}", name,
                                   tracked.stopped_by == SIGINT ? "SIGINT" : "SIGTERM", tracked.rows,
                                   job.state.empty() ? "" : "; the same command goes on from there"));
    return faults;
  }

  /// Why a stream taught nothing.
  static std::string missing_data(const Tracked& tracked) {
    return tracked.landmarks ? "no row had a landmark" : "no row had a true distance";
  }

  std::string changes(const Tracked& tracked) const {
    if (tracked.changes.empty()) return "Changes    none against " + job.from + "\n";
    std::string text;
    for (const ChangeAlarm& c : tracked.changes)
      text += fmt::format("Changes    alarm at {0} {1}, since about {0} {2}{3}\n",
                          tracked.landmarks ? "reading" : "pair", c.reading, c.since,
                          c.named ? ": " + change(c) : "; not enough of them yet to say what");
    return text;
  }

  static std::string change(const ChangeAlarm& c) {
    if (c.kind == ChangeKind::outliers)
      return fmt::format("outliers, now a share of {} (probability {:.2f})", with_std(c.size, c.std_dev),
                         c.probability);
    const bool length = c.kind == ChangeKind::window || c.kind == ChangeKind::encoder;
    const char* unit = length ? " m" : c.kind == ChangeKind::pointing ? " 1/m" : "";
    return fmt::format(
        "{} by {}{}{} (probability {:.2f})", to_string(c.kind), with_std(c.size, c.std_dev), unit,
        c.phase_rad ? fmt::format(" at a phase of {} rad", with_std(c.phase_rad->value, c.phase_rad->std_dev))
                    : "",
        c.probability);
  }

  /// Of a curve that is no answer there are no numbers.
  static std::string unobservable_text(const Calibration& c) {
    if (c.outcome != Outcome::unobservable) return "";
    const std::string unseen =
        c.weakest_direction.empty() ? "" : ": what can change unseen is " + c.weakest_direction;
    return "Curve f    " + wrapped("not determined" + unseen, 11) + "\n";
  }

  std::string page(const Tracked& tracked) const {
    std::string text =
        fmt::format("Readings   {} rows, {} corrected, {} out of range, {} not understood; {}: {}\n",
                    tracked.rows, tracked.corrected, tracked.out_of_range, tracked.malformed,
                    tracked.landmarks ? "of landmarks" : "pairs", describe(tracked.counts));
    if (!tracked.calibration) return text + fmt::format("Curve f    {}\n", missing_data(tracked));
    const Calibration& c = *tracked.calibration;
    text += fmt::format("Outcome    {} by {}{}{}\n", to_string(c.outcome), to_string(c.method),
                        c.reason.empty() ? "" : ": ", c.reason);
    if (!has_answer(c)) return text + unobservable_text(c);
    if (std::isfinite(job.options.forget))
      text += fmt::format("Memory     time constant {} {}; {:.0f} readings count\n", job.options.forget,
                          tracked.landmarks ? "stops"
                          : tracked.timed   ? "s"
                                            : "readings",
                          tracked.effective);
    text += fmt::format("Model      order {}, noise {}", c.order(), law_in_words(c.noise.law));
    for (Eigen::Index j = 0; j < c.noise.parameters.size(); ++j)
      text += fmt::format(", {:.3g} +- {:.2g} {}", c.noise.parameters[j],
                          c.noise_estimates[static_cast<std::size_t>(j)].std_dev.value_or(0.0),
                          law_unit(c.noise.law, static_cast<int>(j)));
    text += "\nCurve f    reading =";
    for (Eigen::Index i = 0; i < c.alpha.size(); ++i) {
      std::optional<double> std_dev;
      if (c.alpha_covariance) std_dev = std::sqrt((*c.alpha_covariance)(i, i));
      text += fmt::format("{}({}){}", i == 0 ? " " : " + ", with_std(c.alpha[i], std_dev),
                          i == 0   ? ""
                          : i == 1 ? " d"
                                   : fmt::format(" d^{}", i));
    }
    text += fmt::format("; d in m, seen from {:.3g} to {:.3g} m\n", c.range_min_m, c.range_max_m);
    if (const std::string outliers = outlier_count_in_words(c); !outliers.empty())
      text += "Outliers   " + wrapped(outliers, 11) + "\n";
    for (const LandmarkEstimate& landmark : c.landmarks) {
      const auto std_dev = [&](int k) -> std::optional<double> {
        if (!landmark.covariance) return std::nullopt;
        return std::sqrt((*landmark.covariance)(k, k));
      };
      text += fmt::format("Landmark   {} at ({}, {}) m\n", landmark.label,
                          with_std(landmark.position_m.x(), std_dev(0)),
                          with_std(landmark.position_m.y(), std_dev(1)));
    }
    for (const std::string& warning : plausibility_warnings({}, c))
      text += "Note       " + wrapped(warning, 11) + "\n";
    return text;
  }
};

}  // namespace

void add_track(CLI::App& app, Action& chosen) {
  CLI::App* command = app.add_subcommand("track", "calibrate and correct readings as they come");
  const auto state = std::make_shared<TrackCommand>();
  command
      ->add_option(
          "FILE", state->job.input,
          "CSV with reading_m (or range_m), and true_m, time_s where known; or stop, landmark, range_m, bearing_rad; - or nothing: stdin")
      ->capture_default_str();
  command->add_flag("--follow", state->job.follow, "wait for more at the end of FILE until Ctrl-C");
  command->add_option("--state", state->job.state,
                      "keep the state in this file: a run that was stopped or killed goes on there");
  command->add_option("--every", state->job.every, "rows from one saving of the state to the next")
      ->check(CLI::Range(1, 100000000))
      ->capture_default_str();
  command->add_option("--from", state->job.from,
                      "calibration (JSON) to correct by until the stream has its own");
  command
      ->add_option("--order", state->order,
                   "of f: 0 to 8, or auto: the lowest AIC of 1 to 4 at each estimate")
      ->capture_default_str();
  command
      ->add_option("--noise", state->noise,
                   "noise law: constant, f, f2, f3, d2, polynomial (of f's order; pairs only)")
      ->capture_default_str();
  command
      ->add_option(
          "--noise-shape", state->noise_shape,
          "auto (by AIC), gaussian, student-t, contaminated, one-sided (late returns or early echoes)")
      ->capture_default_str();
  command
      ->add_option(
          "--forget", state->forget,
          "time constant of the memory: seconds, or readings where there is no time_s; of landmarks: stops")
      ->check(positive());
  command->add_option("--range", state->range, "true distances taken [m]: MIN MAX (0.05 50)")->expected(2);
  command->add_flag(
      "--approximate", state->job.approximate,
      "the approximate model instead of full likelihood: alpha by least squares of weights d^-4 (2016 paper, eq. 21-25), the noise by its law from the residuals");
  command->add_option(
      "--stops", state->job.stops,
      "readings of landmarks: the recording whose stops and landmarks the stream names by label");
  command
      ->add_option("--sigma-xy", state->job.sigma_xy_m,
                   "how far a stop may be from its pose [m], where nothing else says")
      ->check(not_negative())
      ->capture_default_str();
  command->add_option("--sigma-heading", state->job.sigma_heading_rad, "the same of its heading [rad]")
      ->check(not_negative())
      ->capture_default_str();
  command->add_flag(
      "--random-walk", state->job.random_walk,
      "these are errors of the step from the stop before and add up (--stops: as the recording says)");
  command
      ->add_option("--radius", state->job.radius_m, "radius of landmarks that nothing else says one of [m]")
      ->check(not_negative())
      ->capture_default_str();
  command
      ->add_option("--watch", state->job.watch,
                   "watch for a change against --from; so many pairs or readings of landmarks lie between "
                   "two false alarms (100000, say)")
      ->check(CLI::Range(100.0, 1e12));
  command->add_option("--changes", state->job.changes, "keep a table of the alarms of --watch in this file");
  command->add_option("-o,--output", state->job.output,
                      "write the corrected distances here and a summary to stdout");
  command->add_option("--json", state->json, "write the last calibration to this file");
  command->footer(
      "Every row gives a line reading_m, distance_m, std_m, flag as soon as it is read: the most likely "
      "distance under the\n"
      "calibration so far. Rows with true_m also teach the calibration, in constant memory; it is estimated "
      "anew each time the\n"
      "pairs have grown by 2 %. A row that cannot be understood is flagged 'malformed', named on stderr, and "
      "skipped. With --state\n"
      "(and -o) a killed run goes on where it was saved: no row is lost, none counts twice.\n"
      "Columns stop, landmark, range_m, bearing_rad (and no true_m): landmarks in unknown places, the "
      "readings of a stop together.\n"
      "Each row then has x_m, y_m, heading_rad of its stop (sigma_xy_m, sigma_heading_rad, place, radius_m "
      "where they differ), or\n"
      "--stops names the recording that lists the stops. The answer is that of 'calibrate --method "
      "marginal'.\n"
      "--watch tells within some hundred pairs what changed: window (offset), baseline (scale), pointing "
      "(disparity), noise, and\n"
      "with a column bearing_rad encoder (once a turn). For readings of landmarks --from is a calibration "
      "made of landmarks.\n"
      "A resumed run compares what was read of FILE and --stops before, and refuses another one. Stopped "
      "before the end of the\n"
      "stream it keeps what it has and ends by the signal; with --follow that is the end.\n"
      "Exit code 1 where the stream did not determine a calibration and --from gives none, where more than "
      "half of the rows were\n"
      "not understood, and where a file that is followed is cut back or replaced.\n"
      "\n"
      "Examples:\n"
      "  rangecal track notebooks_data/pairs-2016/pairs.csv -o distances.csv --json cal.json\n"
      "  sensor-program | rangecal track --from cal.json --forget 3600\n"
      "  rangecal track notebooks_data/field-layout/observations.csv --stops notebooks_data/field-layout -o "
      "distances.csv\n"
      "  rangecal track today.csv --from cal.json --watch 100000 -o distances.csv\n"
      "  rangecal track log.csv --follow --state track.json -o distances.csv");
  command->callback([command, state, &chosen] {
    for (const char* option :
         {"--range", "--stops", "--sigma-xy", "--sigma-heading", "--random-walk", "--radius"})
      if (command->count(option) > 0) state->job.given.push_back(option);
    chosen = [state] { return state->run(); };
  });
}

}  // namespace rangecal::app
