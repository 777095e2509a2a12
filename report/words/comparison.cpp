// SPDX-License-Identifier: BSD-3-Clause
#include "comparison.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numbers>

#include "rangecal/solvers/calibrate/residual_check.hpp"
#include "text.hpp"

namespace rangecal::app {
namespace {

constexpr double degrees = 180.0 / std::numbers::pi;

std::string or_dash(const std::optional<double>& value, const char* format, double factor = 1.0) {
  return value ? fmt::format(fmt::runtime(format), factor * *value) : "-";
}

std::string named(const char* name, const std::string& unit) {
  return unit.empty() ? name : fmt::format("{} [{}]", name, unit);
}

bool is_optimistic(const Calibration& c) {
  return c.method == Method::full && has_answer(c) && c.alpha_covariance;
}

class Table {
 public:
  explicit Table(const CalibrationReport& report) : report_(report) {}

  /// A row of one cell per method; left out where every cell is "-".
  void row(const std::string& name, const std::function<std::string(const Calibration&, std::size_t)>& cell) {
    std::vector<std::string> cells{name};
    bool any = false;
    for (std::size_t i = 0; i < report_.calibrations.size(); ++i) {
      cells.push_back(cell(report_.calibrations[i], i));
      any = any || cells.back() != "-";
    }
    if (any) rows_.push_back(cells);
  }

  const std::vector<std::vector<std::string>>& rows() const { return rows_; }

 private:
  const CalibrationReport& report_;
  std::vector<std::vector<std::string>> rows_;
};

/// The method's marginal NLL above the best one's, in words; empty where one of them has none.
std::string behind(const Calibration& c, const Calibration& best) {
  if (!c.marginal_nll || !best.marginal_nll) return {};
  return fmt::format("{:+.1f} nats", *c.marginal_nll - *best.marginal_nll);
}

}  // namespace

std::vector<std::vector<std::string>> comparison_rows(const CalibrationReport& report,
                                                      const std::vector<TruthScore>& scores) {
  int order = -1;
  Eigen::Index taus = 0;
  NoiseLaw law = NoiseLaw::f_squared;
  bool pairs = false;
  CurveFamily family = CurveFamily::polynomial;
  for (const Calibration& c : report.calibrations) {
    if (c.alpha.size() == 0) continue;
    family = c.scale.family;
    order = std::max(order, c.order());
    if (c.noise.parameters.size() >= taus) law = c.noise.law;
    taus = std::max(taus, c.noise.parameters.size());
    pairs = c.kind == RecordingKind::pairs;
  }
  Table table(report);
  table.row("", [](const Calibration& c, std::size_t) {
    return std::string(to_string(c.method)) + (is_optimistic(c) ? " *" : "");
  });
  table.row("outcome", [](const Calibration& c, std::size_t) { return std::string(to_string(c.outcome)); });
  for (int i = 0; i <= order; ++i)
    table.row(named(fmt::format("alpha_{}", i).c_str(), coefficient_unit(i, family)),
              [&](const Calibration& c, std::size_t) {
                if (i > c.order() || !has_answer(c)) return std::string("-");
                std::optional<double> std_dev;
                if (c.alpha_covariance) std_dev = std::sqrt(std::max(0.0, (*c.alpha_covariance)(i, i)));
                return with_std(c.alpha[i], std_dev);
              });
  if (family == CurveFamily::reciprocal)
    table.row("offset c [m]", [](const Calibration& c, std::size_t) {
      return has_answer(c) ? with_std(c.scale.offset_m, c.scale.offset_std_m) : std::string("-");
    });
  if (family == CurveFamily::spline)
    table.row("degrees of freedom", [](const Calibration& c, std::size_t) {
      return has_answer(c) && c.scale.spline ? fmt::format("{:.1f}", c.scale.spline->degrees)
                                             : std::string("-");
    });
  for (Eigen::Index j = 0; j < taus; ++j)
    table.row(named(!has_sigma(law) ? fmt::format("beta_{}", j).c_str() : "sigma_e",
                    law_unit(law, static_cast<int>(j))),
              [&](const Calibration& c, std::size_t) {
                const std::size_t index = static_cast<std::size_t>(j);
                if (!has_answer(c) || index >= c.noise_estimates.size()) return std::string("-");
                return with_std(c.noise_estimates[index].value, c.noise_estimates[index].std_dev);
              });
  table.row("sigma_theta [deg]", [](const Calibration& c, std::size_t) {
    if (!c.sigma_theta_rad || !has_answer(c)) return std::string("-");
    std::optional<double> std_dev = c.sigma_theta_rad->std_dev;
    if (std_dev) *std_dev *= degrees;
    return with_std(degrees * c.sigma_theta_rad->value, std_dev);
  });
  table.row("sigma_s [mm]", [](const Calibration& c, std::size_t) {
    if (!c.sigma_s_m || !has_answer(c)) return std::string("-");
    if (c.sigma_s_upper95_m) return fmt::format("0 (< {:.2g} at 95 %)", 1e3 * *c.sigma_s_upper95_m);
    std::optional<double> std_dev = c.sigma_s_m->std_dev;
    if (std_dev) *std_dev *= 1e3;
    return with_std(1e3 * c.sigma_s_m->value, std_dev);
  });
  for (const char* channel : {"range", "bearing"})
    table.row(fmt::format("{} tails", channel), [&](const Calibration& c, std::size_t) {
      const auto found = c.noise_shapes.find(channel);
      if (found == c.noise_shapes.end()) return std::string("-");
      const std::map<std::string, double>& at = found->second.parameters;
      if (at.count("nu")) {
        const auto std_dev = found->second.std_dev.find("nu");
        return fmt::format("t, nu {:.3g}", at.at("nu")) +
               (std_dev == found->second.std_dev.end() ? "" : fmt::format(" +- {:.2g}", std_dev->second));
      }
      if (at.at("outlier_share") < 1e-5) return std::string("no outlier");
      const double percent = 100.0 * at.at("outlier_share");
      if (const auto mean = at.find("outlier_mean"); mean != at.end())
        return fmt::format("{:.2g} % {} by {:.2g} m", percent, mean->second > 0.0 ? "late" : "early",
                           std::abs(mean->second));
      return fmt::format("{:.2g} % x {:.3g}", percent, at.at("outlier_scale"));
    });
  if (!pairs)
    table.row("joint NLL", [](const Calibration& c, std::size_t) {
      return has_answer(c) ? or_dash(c.joint_nll, "{:.2f}") : "-";
    });
  table.row(pairs ? "NLL" : "marginal NLL", [](const Calibration& c, std::size_t) {
    return has_answer(c) ? or_dash(c.marginal_nll, "{:.2f}") : "-";
  });
  table.row("AIC",
            [](const Calibration& c, std::size_t) { return has_answer(c) ? or_dash(c.aic, "{:.2f}") : "-"; });
  table.row("time [ms]",
            [](const Calibration& c, std::size_t) { return fmt::format("{:.2f}", 1e3 * c.seconds); });
  table.row("std by stops / std", [](const Calibration& c, std::size_t) {
    if (!c.misfit || !has_answer(c)) return std::string("-");
    return fmt::format("{:.2f}{}", c.misfit->factor,
                       c.misfit->clusters == "stops" ? "" : " by " + c.misfit->clusters);
  });
  table.row("left out, RMS [mm]", [](const Calibration& c, std::size_t) {
    if (!c.left_out || !has_answer(c)) return std::string("-");
    return fmt::format("{:.1f} -> {:.1f}", 1e3 * c.left_out->rms_raw_m, 1e3 * c.left_out->rms_corrected_m);
  });
  table.row("landmark RMSE [mm]", [&](const Calibration&, std::size_t i) {
    return or_dash(scores[i].landmark_rmse_m, "{:.1f}", 1e3);
  });
  table.row("landmark error / std",
            [&](const Calibration&, std::size_t i) { return or_dash(scores[i].landmark_strain, "{:.2f}"); });
  table.row("range RMSE [mm]", [&](const Calibration&, std::size_t i) {
    if (!scores[i].mse_ratio) return std::string("-");
    return fmt::format("{:.1f} -> {:.1f}", 1e3 * scores[i].rmse_raw_m, 1e3 * scores[i].rmse_corrected_m);
  });
  table.row("MSE ratio", [&](const Calibration&, std::size_t i) {
    return or_dash(scores[i].mse_ratio, scores[i].mse_ratio < 1e6 ? "{:.2f}" : "{:.2g}");
  });
  return table.rows();
}

std::string comparison_table(const CalibrationReport& report, const std::vector<TruthScore>& scores) {
  const std::vector<std::vector<std::string>> rows = comparison_rows(report, scores);
  std::vector<std::size_t> width(report.calibrations.size() + 1, 0);
  for (const auto& cells : rows)
    for (std::size_t i = 0; i < cells.size(); ++i) width[i] = std::max(width[i], cells[i].size());
  std::string result;
  for (const auto& cells : rows) {
    std::string line;
    for (std::size_t i = 0; i < cells.size(); ++i) line += fmt::format("{:<{}}", cells[i], width[i] + 3);
    line.erase(line.find_last_not_of(' ') + 1);
    result += line + "\n";
  }
  return result;
}

std::vector<std::string> footnotes(const CalibrationReport& report, const std::vector<TruthScore>& scores) {
  std::vector<std::string> lines;
  const auto line = [&](const std::string& sentence) { lines.push_back(sentence); };
  for (const Calibration& c : report.calibrations)
    if (is_optimistic(c))
      line(c.kind == RecordingKind::pairs ? "* optimistic: its sigma_e is not corrected for the coefficients "
                                            "fitted, nor are its standard deviations"
                                          : "* optimistic: its sigmas and standard deviations are too small, "
                                            "since it fits every stop to the same "
                                            "readings and does not pay for it");
  std::map<std::string, std::string> reasons;  // reason -> the methods that give it
  for (const Calibration& c : report.calibrations) {
    std::string& methods = reasons[c.reason];
    methods += (methods.empty() ? "" : ", ") + std::string(to_string(c.method));
  }
  for (const auto& [reason, methods] : reasons)
    if (!reason.empty()) line(methods + ": " + shortened(reason));
  if (report.models.size() > 1)
    line(
        "time: after order, noise law and noise shapes were chosen; by then marginal is solved for the most part");
  bool truth = false, estimated = false;
  for (const TruthScore& score : scores) {
    truth = truth || score.mse_ratio;
    estimated = estimated || (score.mse_ratio && score.estimated_stops);
  }
  if (truth)
    line(
        "MSE ratio: mean square error of the raw readings over that of the corrected ones; 1 is no gain, "
        "more is better");
  if (estimated)
    line(
        "there is no truth for the stops: true distances are from the true landmarks to the stops as "
        "estimated by "
        "the best method, so range RMSE and MSE ratio are only as good as these");
  return lines;
}

std::string footnotes_text(const CalibrationReport& report, const std::vector<TruthScore>& scores) {
  std::string text;
  for (const std::string& line : footnotes(report, scores)) text += wrapped(line, 2) + "\n";
  for (const std::string& note : report.notes) text += wrapped("note: " + note, 2) + "\n";
  return text;
}

namespace {

/// Where ground truth speaks against the method trusted, in words.
std::string contradiction(const CalibrationReport& report, const std::vector<TruthScore>& scores,
                          std::size_t best) {
  const TruthScore& score = scores[best];
  if (score.landmark_strain.value_or(0.0) > 2.0) {
    std::string text =
        fmt::format("its landmarks are off by {:.1f} of their standard deviations", *score.landmark_strain);
    for (std::size_t i = 0; i < scores.size(); ++i)
      if (scores[i].landmark_rmse_m && *scores[i].landmark_rmse_m < 0.8 * *score.landmark_rmse_m)
        return text + fmt::format(" ({:.0f} mm RMS, {} by {:.0f} mm)", 1e3 * *score.landmark_rmse_m,
                                  to_string(report.calibrations[i].method), 1e3 * *scores[i].landmark_rmse_m);
    return text;
  }
  if (score.mse_ratio && *score.mse_ratio < 0.95)
    return fmt::format("against the ground truth it makes the readings worse (RMSE {:.0f} to {:.0f} mm)",
                       1e3 * score.rmse_raw_m, 1e3 * score.rmse_corrected_m);
  return {};
}

std::string what_full_gives_away(const Calibration& full, const Calibration& best) {
  if (best.kind == RecordingKind::pairs) return "differs by that correction only";
  if (!full.sigma_theta_rad || !best.sigma_theta_rad) return "fits the stops along";
  const double off = 100.0 * (full.sigma_theta_rad->value / best.sigma_theta_rad->value - 1.0);
  return fmt::format("fits the stops along and gives away honest sigmas (its sigma_theta is {:.0f} % {})",
                     std::abs(off), off < 0.0 ? "lower" : "higher");
}

/// What a method gives away against the best, with its NLL above the best one's.
std::string what_it_gives_away(const Calibration& c, const Calibration& best) {
  if (!has_answer(c)) return fmt::format("has no answer here ({})", to_string(c.outcome));
  const bool pairs = best.kind == RecordingKind::pairs;
  const std::string nats = behind(c, best), cost = nats.empty() ? "" : " (" + nats + ")";
  switch (c.method) {
    case Method::closed_form:
      return (pairs ? "weighs all readings alike"
              : best.sigma_theta_rad
                  ? "takes the commanded stops for true and uses no range to place landmarks"
                  : "takes the commanded stops for true, and raw ranges for distances where it places landmarks") +
             cost;
    case Method::approximate:
      return (pairs ? "weighs readings as if noise grew with d^2"
                    : "weighs readings as if noise grew with d^2 and takes the commanded stops for true") +
             cost;
    case Method::full:
      return what_full_gives_away(c, best);
    case Method::marginal:
      return "is the recommended one";
  }
  return "";
}

std::string why_marginal(const Calibration& marginal, std::span<const Recording> recordings) {
  if (marginal.kind == RecordingKind::pairs)
    return "Trust marginal: it has the exact likelihood and a sigma_e corrected for the coefficients fitted";
  std::size_t stops = 0;
  for (const Recording& recording : recordings) stops += recording.stops.size();
  return fmt::format(
      "Trust marginal: it has the exact likelihood and integrates the {} uncertain stops out, so neither curve nor "
      "sigmas are bent to fit them",
      stops);
}

}  // namespace

Advice advise(const CalibrationReport& report, std::span<const Recording> recordings,
              const std::vector<TruthScore>& scores) {
  std::size_t best = report.calibrations.size();
  for (Method method : all_methods())
    for (std::size_t i = 0; i < report.calibrations.size(); ++i)
      if (report.calibrations[i].method == method && has_answer(report.calibrations[i])) best = i;
  Advice advice;
  if (best == report.calibrations.size()) {
    const Calibration& last = report.calibrations.back();
    advice.trust = fmt::format("Trust none of them ({}): {}", to_string(last.outcome),
                               last.reason.empty() ? "no method has an answer" : shortened(last.reason));
    return advice;
  }
  const Calibration& trusted = report.calibrations[best];
  if (trusted.method != Method::marginal) {
    advice.trust = fmt::format("Trust {} only with care: marginal, the recommended method, ended as {}",
                               to_string(trusted.method), to_string(report.calibrations.back().outcome));
    return advice;
  }
  advice.trust = why_marginal(trusted, recordings);
  const std::string useless = not_usable_in_words(trusted, recordings);
  if (!useless.empty()) advice.trust = fmt::format("Trust marginal before the others, but {}", useless);
  for (const Calibration& c : report.calibrations) {
    if (c.method != trusted.method)
      advice.others.push_back(fmt::format("{} {}", to_string(c.method), what_it_gives_away(c, trusted)));
  }
  std::vector<std::string> against{contradiction(report, scores, best), misfit_in_words(trusted)};
  const ResidualCheck check = check_residuals(recordings, trusted);
  if (report.noise_shape.empty() && check.suspicious()) against.push_back(outliers_in_words(check));
  against.push_back(repeats_in_words(check));
  std::erase(against, std::string());
  if (!against.empty())
    advice.against = fmt::format(
        "BUT {}: the recording holds something that no method here models and no standard deviation above counts",
        fmt::join(against, ", and "));
  return advice;
}

std::string advice_text(const Advice& advice) {
  std::vector<std::string> parts{advice.trust};
  parts.insert(parts.end(), advice.others.begin(), advice.others.end());
  if (!advice.against.empty()) parts.push_back(advice.against);
  return fmt::format("{}.", fmt::join(parts, "; "));
}

}  // namespace rangecal::app
