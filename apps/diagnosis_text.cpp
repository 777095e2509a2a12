// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis_text.hpp"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "text.hpp"

namespace rangecal::app {
namespace {

constexpr double degree = std::numbers::pi / 180.0;
constexpr std::size_t width = 96;

bool ends_with(const std::string& text, const std::string& end) {
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

/// Factor and name of the unit that a value stored in SI is shown in.
struct Shown {
  double factor = 1.0;
  std::string unit;
};
Shown shown(const std::string& si) {
  if (si == "m") return {1e3, "mm"};
  if (si == "rad") return {1.0 / degree, "deg"};
  return {1.0, si};
}

/// "range_eccentricity.amplitude_m" -> its unit by the name's ending. Lengths of centimetres and less are in mm.
Shown unit_of(const EffectEstimate& e) {
  if (ends_with(e.name, "_rad")) return {1.0 / degree, " deg"};
  if (ends_with(e.name, "_per_m")) return {1.0, " 1/m"};
  if (ends_with(e.name, "_m")) return std::abs(e.estimate) < 0.5 ? Shown{1e3, " mm"} : Shown{1.0, " m"};
  if (ends_with(e.name, "_s")) return {1.0, " s"};
  return {1.0, ""};
}

std::string p_in_words(double p) { return p < 1e-300 ? "p < 1e-300" : p < 1e-4 ? fmt::format("p = {:.0e}", p) : fmt::format("p = {:.2g}", p); }

std::string size_in_words(const Finding& f) {
  const Shown unit = shown(f.unit);
  if (!f.unit.empty()) return fmt::format("{:.3g} {}", unit.factor * f.size, unit.unit);
  if (ends_with(f.channel, "_noise")) return fmt::format("spread x {:.2g}", std::exp(0.5 * f.size));
  if (f.channel == "grid") return fmt::format("steps of {:.3g} {}", f.covariate == "range" ? 1e3 * f.size : f.size / degree,
                                              f.covariate == "range" ? "mm" : "deg");
  if (f.channel == "detection") return fmt::format("{:.1f} % of the readings missing", 100.0 * f.size);
  if (f.channel == "label") return "labels exchanged";
  if (ends_with(f.channel, "_tail")) return fmt::format("{} {:.2g}", f.shape == "skew" ? "skewness" : "excess kurtosis", f.size);
  if (ends_with(f.channel, "_dependence")) return fmt::format("{} {:.2g}", f.shape == "lag 1" ? "correlation" : "log variance ratio", f.size);
  if (f.channel == "stop") return fmt::format("squared error x {:.2g}", 1.0 + f.size);
  return fmt::format("size {:.3g}", f.size);
}

/// A place along a covariate, in the unit a user reads it in.
std::string place(const Finding& f) {
  const bool angle = f.covariate == "sensor_bearing" || f.covariate == "heading";
  const std::string unit = angle ? " deg" : f.covariate == "range" ? " m" : f.covariate == "time" ? " s" : "";
  const double factor = angle ? 1.0 / degree : 1.0;
  if (!f.group.empty()) return " at " + f.group;
  if (f.from && f.to) return fmt::format(" from {:.3g} to {:.3g}{}", factor * *f.from, factor * *f.to, unit);
  if (f.from) return fmt::format(" from {:.3g}{} on", factor * *f.from, unit);
  return "";
}

std::string where(const Finding& f) {
  std::string line = f.channel;
  if (f.covariate != "any" && f.covariate != "constant") line += " along " + f.covariate;
  if (!f.shape.empty() && f.shape != "effect") line += fmt::format(" ({})", f.shape);
  line += place(f) + ": " + size_in_words(f);
  if (f.share > 0.0) line += fmt::format(", {:.0f} % of the excess", 100.0 * f.share);
  std::string text = "  " + wrapped(fmt::format("{}, {}", line, p_in_words(f.p_value)), 4, width) + "\n";
  if (f.residuals.empty()) return text;
  std::vector<double> before, after;
  double limit = 0.0;
  for (const BinnedResidual& b : f.residuals) {
    before.push_back(b.before);
    after.push_back(b.after);
    limit = std::max({limit, std::abs(b.before), std::abs(b.after), 2.0 * b.std_dev});
  }
  const bool noise = f.unit.empty();
  const Shown unit = shown(f.unit);
  const std::string scale = noise ? fmt::format("bars: log variance ratio within +-{:.2g}", limit)
                                  : fmt::format("bars: mean residual within +-{:.2g} {}", unit.factor * limit, unit.unit);
  return text + fmt::format("    before {}   after {}   {}\n", sparkline(before, limit), sparkline(after, limit), scale);
}

std::string table_line(const std::string& name, const std::string& before, const std::string& after, const std::string& note = "") {
  return fmt::format("  {:<22}{:>12}{:>12}   {}", name, before, after, note);
}

std::string before_after(const Diagnosis& d) {
  const FitSummary &a = d.before, &b = d.after;
  const auto number = [](std::optional<double> value, const char* format) {
    return value ? fmt::format(fmt::runtime(format), *value) : std::string("-");
  };
  std::vector<std::string> lines;
  const bool same = d.final_effects.empty();
  lines.push_back(table_line("", "seed model", same ? "" : "completed"));
  const auto add = [&](const std::string& name, const std::string& before, const std::string& after, const std::string& note) {
    lines.push_back(table_line(name, before, same ? "" : after, same ? "" : note));
  };
  add("NLL [nats]", fmt::format("{:.1f}", a.nll), fmt::format("{:.1f}", b.nll), fmt::format("{:+.1f}", b.nll - a.nll));
  std::string change;
  if (a.heldout_nll && b.heldout_nll) {
    change = fmt::format("{:+.1f}", *b.heldout_nll - *a.heldout_nll);
    if (b.heldout_std && *b.heldout_std > 0.0) change += fmt::format(" +- {:.1f}", *b.heldout_std);
    if (*b.heldout_nll >= *a.heldout_nll) change += "  (no improvement)";
  }
  add("held-out NLL [nats]", number(a.heldout_nll, "{:.1f}"), number(b.heldout_nll, "{:.1f}"), change);
  add("RMS range [mm]", fmt::format("{:.2f}", 1e3 * a.rms_range_m), fmt::format("{:.2f}", 1e3 * b.rms_range_m), "of the means of repeats");
  if (d.baseline.kind == RecordingKind::landmarks)
    add("RMS bearing [deg]", fmt::format("{:.3f}", a.rms_bearing_rad / degree), fmt::format("{:.3f}", b.rms_bearing_rad / degree), "");
  add("chi-square / dof", fmt::format("{:.2f}", a.chi_sq_per_dof), fmt::format("{:.2f}", b.chi_sq_per_dof), "");
  std::string text;
  for (std::string& line : lines) {
    line.erase(line.find_last_not_of(' ') + 1);
    text += line + "\n";
  }
  return text;
}

std::string parameters(const Diagnosis& d) {
  std::string text;
  for (const EffectEstimate& e : d.explanations[0].parameters) {
    if (d.final_effects == std::vector<std::string>{"generic"}) break;  // the coefficients of a curve say nothing
    const Shown unit = unit_of(e);
    std::string name = e.name;  // the unit is said behind the value
    for (const char* ending : {"_per_m", "_rad", "_m", "_s"})
      if (ends_with(name, ending)) {
        name.resize(name.size() - std::string(ending).size());
        break;
      }
    text += fmt::format("  {:<44} {}{}\n", name, with_std(unit.factor * e.estimate, unit.factor * e.std_dev), unit.unit);
  }
  const Calibration& c = d.corrected;
  for (Eigen::Index i = 0; i < c.alpha.size(); ++i) {
    std::optional<double> std_dev;
    if (c.alpha_covariance) std_dev = std::sqrt(std::max(0.0, (*c.alpha_covariance)(i, i)));
    const std::string unit = coefficient_unit(static_cast<int>(i));
    text += fmt::format("  {:<44} {}{}{}\n", fmt::format("alpha_{}", i), with_std(c.alpha[i], std_dev), unit.empty() ? "" : " ", unit);
  }
  for (std::size_t i = 0; i < c.noise_estimates.size(); ++i)
    text += fmt::format("  {:<44} {} {}\n", "noise " + law_in_words(c.noise.law),
                        with_std(c.noise_estimates[i].value, c.noise_estimates[i].std_dev), law_unit(c.noise.law, static_cast<int>(i)));
  if (c.sigma_theta_rad) {
    std::optional<double> std_dev = c.sigma_theta_rad->std_dev;
    if (std_dev) *std_dev /= degree;
    text += fmt::format("  {:<44} {} deg\n", "sigma_theta", with_std(c.sigma_theta_rad->value / degree, std_dev));
  }
  return text;
}

std::string set_in_words(const std::vector<std::string>& set) { return fmt::format("{}", fmt::join(set, " + ")); }

std::string cannot_tell_apart(const Diagnosis& d) {
  std::string text;
  if (!d.explanations.empty()) {
    const Explanation& best = d.explanations[0];
    for (const auto& set : best.indistinguishable_from)
      text += fmt::format("  {} or {}\n", set_in_words(best.effects), set_in_words(set));
    if (!best.indistinguishable_from.empty() && !best.separated_by.empty())
      text += "    " + wrapped("told apart by: " + best.separated_by, 4, width) + "\n";
  }
  for (const auto& set : d.twins) text += "  " + wrapped(fmt::format("{}", fmt::join(set, " = ")), 4, width) + "\n";
  return text;
}

std::string could_be_hidden(const Diagnosis& d) {
  std::string text;
  constexpr std::size_t most = 8;
  for (std::size_t i = 0; i < d.unseen.size() && i < most; ++i) {
    const Unseen& u = d.unseen[i];
    std::string typical;
    for (const auto& [name, value] : u.typical) typical += fmt::format("{}{} {:.3g}", typical.empty() ? "" : ", ", name, value);
    std::string line = fmt::format("{} ({}): costs {:.2g} mm RMS", u.effect, typical, 1e3 * u.harm_m);
    line += u.detectable ? fmt::format("; would show from {:.3g} on", *u.detectable) : std::string("; no size would show");
    if (!u.settled_by.empty()) line += "; " + u.settled_by;
    text += "  " + wrapped(line, 4, width) + "\n";
  }
  if (d.unseen.size() > most) text += fmt::format("  and {} more (--json lists all)\n", d.unseen.size() - most);
  return text;
}

std::string do_next(const Diagnosis& d) {
  std::string text;
  for (const NextExperiment& e : d.next_experiments)
    text += "  " + wrapped(fmt::format("{} (settles {}; power {:.2f})", e.change, fmt::join(e.settles, ", "), e.power), 4, width) + "\n";
  return text;
}

std::string section(const std::string& title, const std::string& body) { return body.empty() ? "" : "\n" + title + "\n" + body; }

}  // namespace

std::string sparkline(const std::vector<double>& values, double limit) {
  static const char* const bars[] = {"▁", "▂", "▃", "▄", "▅", "▆", "▇", "█"};
  std::string text;
  for (double v : values) {
    const double share = limit > 0.0 && std::isfinite(v) ? 0.5 + 0.5 * v / limit : 0.5;
    text += bars[std::clamp(static_cast<int>(share * 8.0), 0, 7)];
  }
  return text;
}

std::string diagnosis_text(const Diagnosis& d) {
  std::string text = wrapped(d.sentence.empty() ? verdict_sentence(d) : d.sentence, 2, width) + "\n\n" + before_after(d);
  std::string places;
  for (const Finding& f : d.location) places += where(f);
  text += section("Where", places);
  if (!d.explanations.empty()) {
    const Explanation& best = d.explanations[0];
    std::string why;
    if (d.verdict == Verdict::explained)
      why = "  " + wrapped(fmt::format("{} (probability {:.2f}, {:.1f} nats, {}). {}", set_in_words(best.effects), best.probability,
                                       d.before.nll - best.nll, p_in_words(best.p_value), best.physics), 4, width) + "\n";
    text += section("Why", why);
    text += section("Parameters", parameters(d));
  }
  text += section("Cannot tell apart", cannot_tell_apart(d));
  text += section("Could be hidden", could_be_hidden(d));
  text += section("Do next", do_next(d));
  std::string notes;
  for (const std::string& note : d.notes) notes += "  " + wrapped(note, 4, width) + "\n";
  return text + section("Notes", notes);
}

}  // namespace rangecal::app
