// SPDX-License-Identifier: BSD-3-Clause
#include "summary.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "rangecal/core/quantiles.hpp"
#include "rangecal/solvers/calibrate/curve.hpp"
#include "text.hpp"

namespace rangecal::app {
namespace {

constexpr double degrees = 180.0 / std::numbers::pi;

const char* what_converged(Method method) {
  switch (method) {
    case Method::closed_form:
      return "computed by closed-form";
    case Method::approximate:
      return "converged by approximate: its alternation stands still";
    case Method::full:
      return "converged by full: this is the joint maximum";
    case Method::marginal:
      return "converged by marginal: this is the optimum";
  }
  return "";
}

std::string outcome_in_words(const Calibration& c) {
  switch (c.outcome) {
    case Outcome::converged:
      return fmt::format("{}{}", what_converged(c.method),
                         c.reason.empty() ? "" : "; " + shortened(c.reason));
    case Outcome::not_converged:
      return "NOT CONVERGED: the numbers below are where the search stopped, not an answer; " + c.reason;
    case Outcome::unbounded:
      return "UNBOUNDED, no answer: " + shortened(c.reason);
    case Outcome::unobservable:
      return "NOT DETERMINED by this recording: " + shortened(c.reason);
    case Outcome::too_few_data:
      return "TOO FEW DATA: " + shortened(c.reason);
    case Outcome::failed:
      return "FAILED: " + shortened(c.reason);
  }
  return {};
}

/// What to do where landmarks leave the curve open.
std::string what_would_determine(const Calibration& c) {
  if (c.reason.find("sigma_xy_m") != std::string::npos)
    return "state in recording.yaml how far a stop may be off, in metres: sigma_xy_m";
  const bool closed = c.method == Method::closed_form || c.method == Method::approximate;
  return std::string(closed ? "try --method marginal, which fits the stops too; else " : "") +
         "spread the landmarks to both sides of the path and over the distances you care about, or tape one "
         "distance between two landmarks (known_distances in recording.yaml)";
}

std::string advice(const CalibrationReport& report, const Calibration& c,
                   std::span<const Recording> recordings, const std::string& json) {
  const bool pairs = c.kind == RecordingKind::pairs;
  switch (c.outcome) {
    case Outcome::too_few_data:
      return too_few_advice(c.kind);
    case Outcome::unobservable:
      return pairs ? "record at more distances, or ask for a lower --order" : what_would_determine(c);
    case Outcome::unbounded:
      return pairs || c.method == Method::marginal
                 ? "record real readings; to try a simulation out, give its readings noise"
                 : "use --method marginal, or record several repeats at each stop";
    case Outcome::not_converged:
    case Outcome::failed:
      return "try --order 1 and --noise f2, and look for swapped labels or wrong units in the recording";
    case Outcome::converged:
      break;
  }
  std::string text;
  const auto add = [&](const std::string& sentence) { text += (text.empty() ? "" : "; ") + sentence; };
  const ResidualCheck check = check_residuals(recordings, c);
  const bool halves_differ =
      c.left_out && c.left_out->halves_p_value && *c.left_out->halves_p_value < halves_level;
  if (halves_differ || (report.noise_shape.empty() && !repeats_in_words(check).empty()))
    add(fmt::format("'rangecal diagnose {}' looks for the effect that the model lacks",
                    recordings.size() == 1 && !recordings[0].path.empty() ? recordings[0].path : "REC..."));
  if (const auto strain = stop_strain(c, recordings); strain && *strain > 1.25)
    add(
        fmt::format("stops had to move by {:.1f} times their stated sigma_xy_m: state a larger one, or "
                    "'sigma_xy_m: estimate'",
                    *strain));
  if (c.counts.read > 0 && c.counts.used < 0.9 * c.counts.read)
    add(fmt::format("{:.0f} % of the readings were dropped: see the reasons above",
                    100.0 - 100.0 * c.counts.used / c.counts.read));
  if (report.noise_shape.empty() && check.suspicious())
    add("look at the farthest readings: outliers that no noise shape takes for such, or an effect that the model lacks");
  if (c.method == Method::full && !pairs) add("use --method marginal for honest standard deviations");
  add(json.empty() ? "keep the result with --json cal.json, then 'rangecal correct cal.json readings.csv'"
                   : fmt::format("'rangecal correct {} readings.csv' turns readings into distances", json));
  add("'rangecal compare' shows the other methods beside it");
  return text;
}

std::string curve_in_words(const Calibration& c) {
  const char* u = c.scale.is_distance() ? "d" : "u";
  std::string text = "reading = ";
  for (int i = 0; i <= c.order(); ++i) {
    std::optional<double> std_dev;
    if (c.alpha_covariance) std_dev = std::sqrt(std::max(0.0, (*c.alpha_covariance)(i, i)));
    const std::string term = with_std(c.alpha[i], std_dev);
    const std::string bracketed = std_dev ? "(" + term + ")" : term;
    text += (i ? " + " : "") + bracketed +
            (i == 0   ? ""
             : i == 1 ? fmt::format(" {}", u)
                      : fmt::format(" {}^{}", u, i));
  }
  if (c.scale.is_reciprocal())
    text += fmt::format(", u = 1 / (d + {} m)",
                        c.scale.offset_std_m ? "(" + with_std(c.scale.offset_m, c.scale.offset_std_m) + ")"
                                             : with_std(c.scale.offset_m, std::nullopt));
  if (c.scale.spline)
    text += fmt::format(", u(d) a spline through {} knots (the curve has {:.1f} degrees of freedom)",
                        c.scale.spline->u.knots().size(), c.scale.spline->degrees);
  return text + fmt::format("; d the true distance in m, fitted from {:.2f} to {:.2f} m", c.range_min_m,
                            c.range_max_m);
}

std::string band_in_words(const std::optional<double>& std_dev_m) {
  return std_dev_m ? fmt::format("+- {:.1f} mm", 1e3 * z95 * *std_dev_m) : std::string("unknown");
}

/// One line of the table of the curve; the band with the choice only where there is one.
std::string curve_line(const Calibration& c, const std::array<std::string, 6>& cells) {
  std::string text = fmt::format("  {:>13}  {:>11}  {:>17}  {:>11}", cells[0], cells[1], cells[2], cells[3]);
  if (c.covariance_with_choice) text += fmt::format("  {:>15}", cells[4]);
  return text + fmt::format("  {:>20}\n", cells[5]);
}

std::string curve_table(const Calibration& c) {
  std::string text = "\n" + curve_line(c, {"true distance", "sensor says", "correction to add", "95 % band",
                                           "with the choice", "one reading scatters"});
  for (const CurvePoint& p : curve_points(c))
    text += curve_line(
        c, {fmt::format("{:.3f} m", p.distance_m), fmt::format("{:.3f} m", p.reading_m),
            fmt::format("{:.1f} mm", 1e3 * (p.distance_m - p.reading_m)), band_in_words(p.std_dev_m),
            band_in_words(p.std_dev_with_choice_m), fmt::format("{:.1f} mm", 1e3 * p.noise_m)});
  return text + "\n";
}

/// What the choice of order and noise law does to the uncertainty stated; empty where nothing was chosen.
std::string choice_in_words(const Calibration& c, const CalibrationReport& report) {
  if (c.alpha_covariance && c.scale.spline)
    return "the 95 % band has the uncertainty of the spline's shape in it, not that of the noise law";
  if (!c.alpha_covariance || report.models.size() < 2) return {};
  if (!c.scale.is_distance() && c.covariance_with_choice)
    return "the 95 % band and the standard deviations hold given order, noise law and u; the band with the choice has the "
           "uncertainty of u in it, not that of order and law";
  const std::string text = "the 95 % band and the standard deviations hold given this order and noise law; ";
  if (c.covariance_with_choice)
    return text +
           fmt::format(
               "the band with the choice weighs the {} models tried by how likely each is, its own band "
               "and how far its curve lies off; it may be the narrower where another is likely too",
               report.models.size());
  if (c.kind == RecordingKind::landmarks && c.method != Method::marginal)
    return text + "--method marginal counts their choice too";
  return text + fmt::format("none of the other {} models is likely and known well enough to count beside it",
                            report.models.size() - 1);
}

std::string least_certain(const Calibration& c) {
  const std::vector<CurvePoint> points = curve_points(c, 41);
  const auto worst =
      std::max_element(points.begin(), points.end(), [](const CurvePoint& a, const CurvePoint& b) {
        return a.std_dev_m.value_or(0.0) < b.std_dev_m.value_or(0.0);
      });
  std::string text;
  if (worst != points.end() && worst->std_dev_m)
    text = fmt::format("the curve at {:.2f} m (standard deviation {:.1f} mm)", worst->distance_m,
                       1e3 * *worst->std_dev_m);
  const LandmarkEstimate* loosest = nullptr;
  double spread = 0.0;
  for (const LandmarkEstimate& l : c.landmarks)
    if (l.covariance && l.covariance->trace() > spread) {
      spread = l.covariance->trace();
      loosest = &l;
    }
  if (loosest)
    text += fmt::format("{}landmark {} ({:.1f} mm)", text.empty() ? "" : "; ", loosest->label,
                        1e3 * std::sqrt(spread));
  return text;
}

}  // namespace

std::string too_few_advice(RecordingKind kind) {
  return kind == RecordingKind::pairs
             ? "record readings at more distances, several at each"
             : "record from at least 3 separate places, with 3 or more landmarks in view of each, repeats at each";
}

std::vector<SummaryItem> summary_items(const CalibrationReport& report, const Calibration& c,
                                       std::span<const Recording> recordings, const std::string& json) {
  std::vector<SummaryItem> items;
  const auto add = [&](const char* title, const std::string& text) { items.push_back({title, text}); };
  if (const std::string warning = not_usable_in_words(c, recordings); !warning.empty())
    add("Warning", warning);
  add("Recording", describe(recordings));
  add("Readings", describe(c.counts));
  add("Outcome", outcome_in_words(c));
  const bool curve = has_answer(c) || (c.outcome == Outcome::not_converged && c.alpha.size() > 0);
  if (curve) {
    add("Model", describe_choice(c, report));
    add("Curve f", curve_in_words(c));
    if (const std::string choice = choice_in_words(c, report); !choice.empty()) add("Choice", choice);
    if (c.sigma_theta_rad) {
      std::optional<double> std_dev = c.sigma_theta_rad->std_dev;
      if (std_dev) *std_dev *= degrees;
      add("Bearings", fmt::format("one bearing scatters by sigma_theta = {} degrees",
                                  with_std(degrees * c.sigma_theta_rad->value, std_dev)));
    }
    if (c.sigma_s_m)
      add("Stops",
          c.sigma_s_upper95_m
              ? fmt::format("no position error found: sigma_s = 0, below {:.2g} mm with 95 % confidence",
                            1e3 * *c.sigma_s_upper95_m)
              : fmt::format("position error per axis sigma_s = {} mm",
                            with_std(1e3 * c.sigma_s_m->value,
                                     c.sigma_s_m->std_dev ? std::optional(1e3 * *c.sigma_s_m->std_dev)
                                                          : std::nullopt)));
    if (const std::string left_out = left_out_in_words(c); !left_out.empty()) add("Left out", left_out);
    if (const std::string misfit = misfit_in_words(c); !misfit.empty())
      add("Misfit",
          misfit + fmt::format("; 'rangecal diagnose {}' looks for the effect that it lacks",
                               recordings.size() == 1 && !recordings[0].path.empty() ? recordings[0].path
                                                                                     : "REC..."));
    if (!c.noise_shapes.empty())
      add("Tails", shapes_in_words(c) + "; sigmas are the scales of these, not standard deviations");
    if (const std::string outliers = outlier_count_in_words(c); !outliers.empty()) add("Outliers", outliers);
    const ResidualCheck check = check_residuals(recordings, c);
    if (report.noise_shape.empty() && check.ranges > 0) {
      std::string text = outliers_in_words(check);
      if (check.suspicious())
        text += ": outliers, or an effect that the model lacks, inflate the sigmas and may bend the curve";
      else if (check.range_outliers + check.bearing_outliers < 3)
        text += ": no sign of outliers";
      if (const std::string repeats = repeats_in_words(check); !repeats.empty())
        text += "; " + repeats +
                ", so most of that scatter is constant at a stop: an effect that the model lacks";
      add("Fit", text);
    }
    const std::string loose = least_certain(c);
    if (!loose.empty()) add("Loosest", loose);
    if (c.method == Method::full && c.alpha_covariance)
      add("Caution", "standard deviations of full are optimistic: use --method marginal for honest ones");
  } else if (!c.weakest_direction.empty()) {
    add("Open", "what can change unseen: " + shortened(c.weakest_direction));
  }
  for (const std::string& note : report.notes) add("Note", note);
  add("Next", advice(report, c, recordings, json));
  return items;
}

std::string summary_page(const CalibrationReport& report, const Calibration& c,
                         std::span<const Recording> recordings, const std::string& json) {
  std::string page;
  for (const SummaryItem& item : summary_items(report, c, recordings, json)) {
    page += fmt::format("{:<10} {}\n", item.title, wrapped(item.text, 11));
    if (item.title == "Curve f") page += curve_table(c);
    if (item.title == "Outliers")
      for (const std::string& line : outlier_lines(c)) page += "           " + line + "\n";
  }
  return page;
}

}  // namespace rangecal::app
