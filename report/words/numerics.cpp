// SPDX-License-Identifier: BSD-3-Clause
// The pages behind the summary: what changed against --from, and the numbers.
#include <fmt/core.h>

#include <cmath>

#include "rangecal/solvers/calibrate/alpha_bound.hpp"
#include "rangecal/solvers/calibrate/batch_check.hpp"
#include "rangecal/solvers/calibrate/curve.hpp"
#include "rangecal/solvers/closed_form/pairs_approximate.hpp"
#include "summary.hpp"
#include "text.hpp"

namespace rangecal::app {
namespace {

/// Whether f moved by more than chance, and by what law.
std::string significance(const CurveChange& change) {
  if (!change.p_value) return "significance: unknown, since " + change.reason;
  const std::string law =
      change.noise_degrees_of_freedom
          ? fmt::format("F with {} and {:.0f} degrees of freedom", change.degrees_of_freedom,
                        *change.noise_degrees_of_freedom)
          : fmt::format("chi-square with {} degrees of freedom", change.degrees_of_freedom);
  return fmt::format(
      "{}: T^2 = {:.1f} over {} coefficients, p = {:.2g} by {}{}{}",
      *change.p_value < 0.05 ? "the change is significant" : "the change is within chance", *change.chi_sq,
      change.degrees_of_freedom, *change.p_value, law,
      change.given_the_model ? ", given order and noise law" : "",
      change.first_taken_as_exact
          ? " (the calibration before states no uncertainty and is taken as exact)"
          : " (both taken as independent; where they share data the change is more significant)");
}

/// "p < 0.05 in 1 of 20 batches".
std::string test_in_words(const BatchTest& test) {
  return test.tested > 0 ? fmt::format("p < 0.05 in {} of {} batches", test.low, test.tested)
                         : "no batch is long enough";
}

std::string noise_order_in_words(const NoiseOrder& noise) {
  if (noise.outcome != Outcome::converged) return noise.reason;
  std::string text;
  for (const NoiseOrderHypothesis& h : noise.hypotheses)
    text += fmt::format("{}H{} {:.1f}", text.empty() ? "" : ", ", h.power, h.log_likelihood);
  return text + fmt::format(": H{} is best", noise.best_power);
}

/// The three tests that need no curve, for pairs with batches; empty otherwise.
std::string batch_table(std::span<const Recording> recordings) {
  const std::optional<BatchCheck> check = check_batches(recordings);
  if (!check) return {};
  std::string text =
      fmt::format("  {} batches at one distance each; by chance p < 0.05 in one of 20\n", check->batches);
  const auto row = [&](const char* name, const std::string& result) {
    text += fmt::format("    {:<42}{}\n", name, wrapped(result, 46));
  };
  row("independent (runs test)", test_in_words(check->independence));
  row("normal (Shapiro-Wilk)", test_in_words(check->normality));
  row("log-likelihood of noise sigma_e f^s, Hs", noise_order_in_words(check->noise));
  return text;
}

/// sigma_e^2 of the approximate method in both readings of the 2016 paper; empty elsewhere.
std::string approximate_variances(const Calibration& c, std::span<const Recording> recordings) {
  if (c.method != Method::approximate || c.kind != RecordingKind::pairs || !has_answer(c)) return {};
  std::vector<double> d, y;
  for (const Recording& recording : recordings) {
    d.insert(d.end(), recording.pairs.true_m.begin(), recording.pairs.true_m.end());
    y.insert(y.end(), recording.pairs.reading_m.begin(), recording.pairs.reading_m.end());
  }
  const PairsApproximate fit = approximate_pairs_fit(d, y, c.order());
  if (fit.outcome != Outcome::converged) return {};
  return fmt::format(
      "sigma_e^2 as printed (noise d^2, eq. 26) {:.4g} 1/m^2, re-weighted (noise f^2) {:.4g} 1/m^2",
      fit.sigma_e_sq_printed, fit.sigma_e_sq_reweighted);
}

std::string numbers_in_words(const Eigen::VectorXd& values) {
  std::string text;
  for (const double value : values) text += fmt::format("{}{:.3g}", text.empty() ? "" : ", ", value);
  return text;
}

}  // namespace

std::optional<double> stop_strain(const Calibration& c, std::span<const Recording> recordings) {
  double sum = 0.0;
  int count = 0;
  std::size_t k = 0;
  for (const Recording& recording : recordings)
    for (const Stop& stop : recording.stops) {
      if (k >= c.stops.size()) return std::nullopt;
      const Pose2& pose = c.stops[k++].pose;
      const double sigma = sigma_xy_of(recording, stop);
      if (recording.stop_error != StopErrorModel::independent || recording.estimate_sigma_xy ||
          !(sigma > 0.0))
        return std::nullopt;
      sum += std::pow((pose.x_m - stop.commanded.x_m) / sigma, 2) +
             std::pow((pose.y_m - stop.commanded.y_m) / sigma, 2);
      count += 2;
    }
  if (count == 0) return std::nullopt;
  return std::sqrt(sum / count);
}

std::string change_page(const Calibration& before, const Calibration& after) {
  if (after.alpha.size() == 0 || !(after.range_max_m > after.range_min_m)) return {};
  const CurveChange change = compare_curves(before, after);
  std::string page = "\nWhat changed against --from, over the range fitted now\n";
  page += fmt::format("  f moved by up to {:.1f} mm (RMS {:.1f} mm)\n", 1e3 * change.largest_m,
                      1e3 * change.rms_m);
  for (const CurveChange::At& at : change.at)
    page += fmt::format(
        "  {:>10.3f} m  {:>8.1f} mm{}\n", at.distance_m, 1e3 * at.change_m,
        at.std_dev_m ? fmt::format("  (standard deviation {:.1f} mm)", 1e3 * *at.std_dev_m) : std::string());
  return page + "  " + wrapped(significance(change), 2) + "\n";
}

std::vector<std::string> bound_in_words(const Calibration& c, std::span<const Recording> recordings) {
  const std::optional<AlphaBound> bound = has_answer(c) ? alpha_bound(recordings, c) : std::nullopt;
  if (!bound) return {};
  std::vector<std::string> lines{"Cramer-Rao bound of alpha (standard deviations) at the estimate: " +
                                 numbers_in_words(bound->at_estimate)};
  if (bound->at_truth)
    lines.push_back("the same at the true stops and landmarks, curve and sigmas as estimated: " +
                    numbers_in_words(*bound->at_truth));
  return lines;
}

std::string numerics_page(const CalibrationReport& report, const Calibration& c,
                          std::span<const Recording> recordings) {
  std::string page = "\nNumerics\n";
  const auto line = [&](const std::string& text) { page += "  " + wrapped(text, 4) + "\n"; };
  const bool numbers = has_answer(c) || c.outcome == Outcome::not_converged;
  for (std::size_t j = 0; numbers && j < c.noise_estimates.size(); ++j)
    line(fmt::format("{} = {} {}", !has_sigma(c.noise.law) ? fmt::format("beta_{}", j) : "sigma_e",
                     with_std(c.noise_estimates[j].value, c.noise_estimates[j].std_dev),
                     law_unit(c.noise.law, static_cast<int>(j))));
  if (const std::string both = approximate_variances(c, recordings); !both.empty()) line(both);
  for (const LandmarkEstimate& l : c.landmarks) {
    if (!numbers) break;
    std::optional<double> x, y;
    if (l.covariance) {
      x = std::sqrt((*l.covariance)(0, 0));
      y = std::sqrt((*l.covariance)(1, 1));
    }
    line(fmt::format("landmark {}{}: x = {} m, y = {} m", l.label,
                     recordings.size() > 1 ? fmt::format(" of recording {}", l.recording + 1) : std::string(),
                     with_std(l.position_m.x(), x), with_std(l.position_m.y(), y)));
  }
  if (const auto strain = stop_strain(c, recordings))
    line(fmt::format("stops moved by {:.2f} sigma_xy_m (RMS per axis)", *strain));
  for (const std::string& bound : bound_in_words(c, recordings)) line(bound);
  page += batch_table(recordings);
  if (!c.covariance_reason.empty()) line("covariance: " + shortened(c.covariance_reason));
  if (!c.weakest_direction.empty()) line("weakest direction: " + shortened(c.weakest_direction));
  if (c.joint_nll && c.kind == RecordingKind::landmarks) line(fmt::format("joint NLL {:.6f}", *c.joint_nll));
  if (c.marginal_nll)
    line(fmt::format("{} {:.6f}, AIC {:.4f}", c.kind == RecordingKind::pairs ? "NLL" : "marginal NLL",
                     *c.marginal_nll, c.aic.value_or(NAN)));
  line(fmt::format("{} iterations, {:.2f} ms", c.iterations, 1e3 * c.seconds));
  if (report.check) line(fmt::format("check of the full likelihood: {}", report.check->report));
  return page;
}

}  // namespace rangecal::app
