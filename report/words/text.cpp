// SPDX-License-Identifier: BSD-3-Clause
#include "text.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

namespace rangecal::app {

std::string with_std(double value, std::optional<double> std_dev) {
  if (!std_dev || !(*std_dev > 0.0) || !std::isfinite(*std_dev)) return fmt::format("{:.5g}", value);
  const int digits = 1 - static_cast<int>(std::floor(std::log10(*std_dev)));
  if (digits > 7 || digits < -4) return fmt::format("{:.4g} +- {:.2g}", value, *std_dev);
  const int places = std::max(0, digits);
  return fmt::format("{:.{}f} +- {:.{}f}", value, places, *std_dev, places);
}

std::string coefficient_unit(int power, CurveFamily family) {
  if (power == 0) return "m";
  if (family == CurveFamily::reciprocal) return fmt::format("m^{}", power + 1);
  if (power == 1) return "";
  return power == 2 ? "1/m" : fmt::format("1/m^{}", power - 1);
}

std::string law_in_words(NoiseLaw law) {
  const NoiseForm form = form_of(law);
  if (!form.has_sigma) return "beta_0 + beta_1 d + ...";
  const auto power = [](const char* of, int p) -> std::string {
    if (p == 0) return "";
    return p == 1 ? fmt::format(" {}", of) : fmt::format(" {}^{}", of, p);
  };
  return "sigma_e" + power("f", form.power_of_f) + power("d", form.power_of_d);
}

std::string law_unit(NoiseLaw law, int index) {
  const NoiseForm form = form_of(law);
  return coefficient_unit(form.has_sigma ? form.power_of_f + form.power_of_d : index);
}

std::string describe(std::span<const Recording> recordings) {
  std::size_t stops = 0, landmarks = 0, readings = 0;
  for (const Recording& recording : recordings) {
    stops += recording.stops.size();
    landmarks += recording.landmarks.size();
    readings += recording.kind == RecordingKind::pairs ? recording.pairs.size() : recording.readings.size();
  }
  const Recording& first = recordings[0];
  std::string text = recordings.size() == 1 ? first.path : fmt::format("{} recordings", recordings.size());
  if (!first.sensor.name.empty()) text += fmt::format(", sensor {}", first.sensor.name);
  if (!first.sensor.principle.empty()) text += fmt::format(" ({})", first.sensor.principle);
  if (first.kind == RecordingKind::pairs)
    return text + fmt::format(": {} readings at known distances", readings);
  return text + fmt::format(": {} stops, {} landmarks, {} readings", stops, landmarks, readings);
}

std::string describe(const Counts& counts) {
  std::string text = fmt::format("{} read, {} used", counts.read, counts.used);
  const std::string dropped = dropped_in_words(counts);
  text += dropped.empty() ? "; none dropped" : "; dropped: " + dropped;
  if (counts.cells_left_out > 0)
    text +=
        fmt::format("; {} cells left out whole, since a limit of the sensor cut them", counts.cells_left_out);
  return text;
}

namespace {

/// "order 2", "reciprocal of order 1", "spline". `named`: a polynomial, too.
std::string model_in_words(CurveFamily family, int order, bool named) {
  if (family == CurveFamily::spline) return "spline";
  const std::string of_order = fmt::format("order {}", order);
  return family == CurveFamily::polynomial && !named ? of_order
                                                     : std::string(to_string(family)) + " of " + of_order;
}

}  // namespace

std::string describe_choice(const Calibration& calibration, const CalibrationReport& report) {
  std::string text =
      fmt::format("{}, noise {}", model_in_words(calibration.scale.family, calibration.order(), false),
                  law_in_words(calibration.noise.law));
  if (report.models.empty()) return text + " (as asked)";
  if (report.criterion == OrderCriterion::cross_validation || report.criterion == OrderCriterion::thirds)
    return text + fmt::format(" (order by {}, noise by AIC of {} models)",
                              report.criterion == OrderCriterion::thirds ? "thirds" : "cross-validation",
                              report.models.size());
  std::vector<ModelScore> models = report.models;
  const char* name = report.criterion == OrderCriterion::aicc  ? "AICc"
                     : report.criterion == OrderCriterion::bic ? "BIC"
                                                               : "AIC";
  const auto value = [&](const ModelScore& m) {
    return criterion_of(m, report.criterion, calibration.counts.used);
  };
  std::sort(models.begin(), models.end(), [&](const auto& a, const auto& b) { return value(a) < value(b); });
  const auto is_chosen = [&](const ModelScore& m) {
    return m.order == calibration.order() && m.law == calibration.noise.law &&
           m.family == calibration.scale.family;
  };
  const auto chosen = std::find_if(models.begin(), models.end(), is_chosen),
             other = std::find_if_not(models.begin(), models.end(), is_chosen);
  const bool lowest = chosen == models.begin() || chosen == models.end();
  text += lowest ? fmt::format(" (lowest {} of {} models", name, models.size())
                 : fmt::format(" (of {} models", models.size());
  const double base = lowest ? value(models[0]) : value(*chosen);
  if (other != models.end() && std::isfinite(value(*other)) && std::isfinite(base))
    text += fmt::format("; {}: {}, {}, {} {:+.1f}", lowest ? "next" : "lowest",
                        model_in_words(other->family, other->order, !calibration.scale.is_distance()),
                        law_in_words(other->law), name, value(*other) - base);
  return text + ")";
}

std::string shapes_in_words(const Calibration& calibration) {
  std::string text;
  for (const char* channel : {"range", "bearing"}) {
    const auto found = calibration.noise_shapes.find(channel);
    if (found == calibration.noise_shapes.end()) continue;
    text += fmt::format("{}{} noise is {}", text.empty() ? "" : ", ", channel, in_words(found->second));
  }
  return text;
}

std::string not_usable_in_words(const Calibration& calibration, std::span<const Recording> recordings) {
  if (!calibration.left_out || calibration.left_out->usable) return {};
  const std::string which =
      recordings.size() == 1 && !recordings[0].path.empty() ? recordings[0].path : "REC...";
  return fmt::format("do not use this curve: {}; 'rangecal diagnose {}' looks for what the model lacks",
                     calibration.left_out->reason, which);
}

std::string left_out_in_words(const Calibration& calibration) {
  if (!calibration.left_out) return {};
  const LeftOutCheck& check = *calibration.left_out;
  std::string text =
      fmt::format("readings of {} {} left out in turn: raw {} mm RMS, corrected {} mm", check.groups,
                  check.what, with_std(1e3 * check.rms_raw_m, 1e3 * check.rms_raw_std_m),
                  with_std(1e3 * check.rms_corrected_m, 1e3 * check.rms_corrected_std_m));
  if (check.halves_p_value) {
    text += fmt::format("; the curves of both halves of the recording {} (p = {:.2g})",
                        *check.halves_p_value < halves_level ? "DISAGREE" : "agree", *check.halves_p_value);
  }
  return text;
}

std::string misfit_in_words(const Calibration& calibration) {
  if (!calibration.misfit || calibration.misfit->holds()) return {};
  const std::string& clusters = calibration.misfit->clusters;
  return fmt::format(
      "the model does not hold: standard deviations by {} (how far the answer moves when a {} is left out) are {:.1f} "
      "times those stated for {}",
      clusters, clusters.substr(0, clusters.size() - 1), calibration.misfit->factor,
      calibration.misfit->where);
}

std::string outlier_count_in_words(const Calibration& calibration) {
  if (calibration.outlier_count == 0) return {};
  constexpr double many = 0.2;
  const double share = static_cast<double>(calibration.outlier_count) / std::max(1, calibration.counts.used);
  return fmt::format("{} of {} readings ({:.2g} %) are outliers by the noise shape; none is thrown away{}{}",
                     calibration.outlier_count, calibration.counts.used, 100.0 * share,
                     share > many ? "; so many are rather an effect that the model lacks" : "",
                     calibration.outliers.empty() ? "" : "; the gravest, in spreads of the others");
}

std::vector<std::string> outlier_lines(const Calibration& calibration) {
  std::vector<std::string> lines;
  bool several = false;
  for (const OutlierReading& one : calibration.outliers) several = several || one.recording > 0;
  const char* file = calibration.kind == RecordingKind::pairs ? "pairs.csv" : "observations.csv";
  for (const OutlierReading& one : calibration.outliers)
    lines.push_back(fmt::format("row {:>6} of {}{}  {:<7}  {:+8.1f}  {}", one.row, file,
                                several ? fmt::format(" of recording {}", one.recording + 1) : "",
                                one.channel, one.sigmas, one.reason));
  return lines;
}

std::string outliers_in_words(const ResidualCheck& check) {
  constexpr double tail = 6.334e-5;  // P(|z| > 4), z ~ N(0, 1)
  std::string text = fmt::format("{} of {} ranges", check.range_outliers, check.ranges);
  if (check.bearings > 0)
    text += fmt::format(" and {} of {} bearings", check.bearing_outliers, check.bearings);
  text += fmt::format(" lie beyond 4 sigma, where about {:.1f} would by chance",
                      tail * (check.ranges + check.bearings));
  const auto add = [&](const ResidualCheck::Farthest& farthest, const char* what) {
    if (!farthest.place.empty())
      text += fmt::format("; the farthest {} by {:.1f} ({})", what, farthest.sigmas, farthest.place);
  };
  add(check.farthest_range, "range");
  add(check.farthest_bearing, "bearing");
  return text;
}

std::string repeats_in_words(const ResidualCheck& check) {
  const double range = check.range_repeats.value_or(1.0), bearing = check.bearing_repeats.value_or(1.0);
  std::string text;
  if (range < 0.5) text += fmt::format("ranges {:.1f} times better than sigma_e", 1.0 / range);
  if (bearing < 0.5)
    text += fmt::format("{}bearings {:.1f} times better than sigma_theta", text.empty() ? "" : " and ",
                        1.0 / bearing);
  if (text.empty()) return {};
  return "repeats at one stop agree in " + text + " states";
}

bool has_answer(const Calibration& c) {
  if (c.alpha.size() == 0) return false;
  return c.outcome == Outcome::converged || (c.outcome == Outcome::unobservable && c.alpha_covariance);
}

std::string shortened(const std::string& reason) {
  const std::string separator = "; landmark ";
  const std::size_t second = reason.find(separator);
  if (second == std::string::npos) return reason;
  std::size_t more = 0, last = second;
  for (std::size_t at = second; at != std::string::npos; at = reason.find(separator, at + 1)) {
    ++more;
    last = at;
  }
  if (more < 2) return reason;
  const std::size_t rest = reason.find("; ", last + 1);
  return reason.substr(0, second) + fmt::format("; and {} more landmarks likewise", more) +
         (rest == std::string::npos ? "" : reason.substr(rest));
}

std::string wrapped(const std::string& text, std::size_t indent, std::size_t width) {
  std::string result, line;
  std::size_t begin = 0;
  bool first = true;
  const auto flush = [&] {
    if (!first) result += "\n" + std::string(indent, ' ');
    result += line;
    line.clear();
    first = false;
  };
  while (begin < text.size()) {
    std::size_t end = text.find(' ', begin);
    if (end == std::string::npos) end = text.size();
    const std::string word = text.substr(begin, end - begin);
    if (!line.empty() && indent + line.size() + 1 + word.size() > width) flush();
    if (!word.empty()) line += (line.empty() ? "" : " ") + word;
    begin = end + 1;
  }
  if (!line.empty()) flush();
  return result;
}

}  // namespace rangecal::app
