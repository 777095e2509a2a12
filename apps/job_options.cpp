// SPDX-License-Identifier: BSD-3-Clause
#include "job_options.hpp"

#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/solvers/calibrate/plausibility.hpp"
#include "summary.hpp"

namespace rangecal::app {
namespace {

/// A line on stderr that the next one replaces; nothing where stderr is no terminal.
class Progress {
 public:
  Progress() : shown_(::isatty(STDERR_FILENO) == 1) {}
  ~Progress() {
    if (shown_) fmt::print(stderr, "\r\033[K");
  }
  void say(const std::string& what) const {
    if (shown_) fmt::print(stderr, "\r\033[K{} ...", what);
  }

 private:
  bool shown_;
};

int order_from(const std::string& text) {
  int order = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), order);
  if (error != std::errc() || end != text.data() + text.size() || order < 0 || order > 8)
    throw InputError("--order is '" + text + "', not a whole number from 0 to 8, nor auto");
  return order;
}

}  // namespace

void JobOptions::add_to(CLI::App& command) {
  command.add_option("RECORDING", recordings, "recording folders; several share one sensor")->required();
  command
      .add_option(
          "--group-by", group_by,
          "of pairs: columns that say which readings belong together (trials, days, places), in place of the "
          "recording's own: left out are whole groups; several as a,b or a b")
      ->delimiter(',');
  command.add_option("--order", order, "order of the curve f: a number, or auto (1 to 4, by AIC)")
      ->capture_default_str();
  command
      .add_option(
          "--curve", curve,
          "of pairs: polynomial in the distance d; polynomial in 1 / (d + c) with an unknown c (reciprocal: a sensor "
          "that gives a voltage or a disparity); spline (smooth, rising or falling everywhere); or auto: the "
          "first, but where readings fall with distance the better of the first two by AIC, and a spline where low "
          "orders do not suffice. Landmarks: polynomial")
      ->capture_default_str();
  command
      .add_option("--noise", noise,
                  "how one reading's spread depends on the reading's mean f: constant, f, f2 "
                  "(triangulation), f3, d2, "
                  "polynomial, or auto (constant, f, f2, f3 by AIC)")
      ->capture_default_str();
  command
      .add_option(
          "--solver", solver,
          "of the full likelihood: block, or ceres, which takes some ten times as long to the same optimum")
      ->capture_default_str();
  command
      .add_option(
          "--noise-shape", shape,
          "density of the noise: auto (of ranges and of bearings, each by AIC), gaussian, student-t, "
          "contaminated (outliers on both sides) or one-sided (late or early echoes); no reading is thrown "
          "away. Other than gaussian, the closed forms see the readings that agree with most others")
      ->capture_default_str();
  command
      .add_option("--criterion", criterion,
                  "what chooses the order of pairs: aic, aicc, bic (these choose the noise law too), cv "
                  "(or cross-validation), or thirds (fit, order and test on a third each)")
      ->capture_default_str();
  command
      .add_option(
          "--weights", weights,
          "of the closed form's lines of sight (2021 paper): paper (eq. 22), printed (eq. 25), consistent")
      ->capture_default_str();
  command.add_flag("--check", check,
                   "solve the full likelihood a second time with NLopt and say whether they agree");
}

CalibrateOptions JobOptions::parsed() const {
  CalibrateOptions options;
  if (order != "auto") options.order = order_from(order);
  if (curve != "auto") options.curve = curve_family_from_string(curve);
  if (noise != "auto") options.noise = noise_law_from_string(noise);
  options.solver = joint_solver_from_string(solver);
  options.noise_shape = noise_shape_from_string(shape);
  options.weights = bearing_weights_from_string(weights);
  options.criterion = order_criterion_from_string(criterion);
  options.check = check;
  return options;
}

CalibrationReport run_job(const std::vector<Recording>& recordings, CalibrateOptions options) {
  using Clock = std::chrono::steady_clock;
  const Progress progress;
  std::map<Method, double> seconds;
  Clock::time_point begin;
  options.on_progress = [&](const std::string& what) { progress.say(what); };
  options.on_method = [&](Method method, bool begins) {
    if (begins)
      begin = Clock::now();
    else
      seconds[method] = std::chrono::duration<double>(Clock::now() - begin).count();
  };
  CalibrationReport report = calibrate_report(recordings, options);
  for (Calibration& calibration : report.calibrations) calibration.seconds = seconds[calibration.method];
  const std::vector<Calibration>& all = report.calibrations;
  const bool too_few = std::all_of(all.begin(), all.end(),
                                   [](const Calibration& c) { return c.outcome == Outcome::too_few_data; });
  if (too_few) {
    const std::string warning = range_limit_warning(recordings);
    throw InputError(fmt::format("{}: {}: {}; {}", recordings[0].path, to_string(Outcome::too_few_data),
                                 all[0].reason, warning.empty() ? too_few_advice(all[0].kind) : warning));
  }
  return report;
}

}  // namespace rangecal::app
