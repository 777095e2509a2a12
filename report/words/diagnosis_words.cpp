// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis_words.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "rangecal/problems/effects/effect.hpp"
#include "rangecal/problems/effects/formula_effect.hpp"
#include "text.hpp"

namespace rangecal::app {
namespace {

constexpr double degree = std::numbers::pi / 180.0;

/// "0.3 mm", "5 deg", "0.01": a parameter's value in the unit that suits `like`, a value of the same parameter.
std::string value_in_words(const std::string& name, double value, double like) {
  const Shown unit = unit_of({name, like, 0.0, 0.0, 0.0, ""});
  return fmt::format("{:.3g}{}{}", unit.factor * value, unit.unit.empty() ? "" : " ", unit.unit);
}

}  // namespace

bool ends_with(const std::string& text, const std::string& end) {
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

Shown shown(const std::string& si) {
  if (si == "m") return {1e3, "mm"};
  if (si == "rad") return {1.0 / degree, "deg"};
  return {1.0, si};
}

Shown unit_of(const EffectEstimate& e) {
  const ParameterName own = parameter_name(e.name);
  if (own.name == e.name) return {1.0, ""};
  if (own.unit.starts_with("m/")) return {1e3, "m" + own.unit};
  const Shown unit = shown(own.unit);
  return unit.unit == "mm" && !(std::abs(e.estimate) < 0.5) ? Shown{1.0, "m"} : unit;
}

std::string typical_in_words(const Unseen& unseen) {
  std::string text;
  for (const auto& [name, value] : unseen.typical)
    text += fmt::format("{}{} {}", text.empty() ? "" : ", ", parameter_name(name).name,
                        value_in_words(name, value, value));
  return text;
}

std::string detectable_in_words(const Unseen& unseen) {
  if (!unseen.detectable) return "no size";
  if (unseen.typical.empty()) return fmt::format("from {:.3g} on", *unseen.detectable);
  const auto& [name, value] = *unseen.typical.begin();
  const Effect* effect = find_effect(unseen.effect);
  const bool limit = effect && effect->info().kind == EffectKind::detection;  // the lower, the more it takes
  return fmt::format(fmt::runtime(limit ? "below {}" : "from {} on"),
                     value_in_words(name, *unseen.detectable, value));
}

std::string p_in_words(double p) {
  if (p < least_p_value) return fmt::format("p < {:.0e}", least_p_value);
  return p < 1e-4 ? fmt::format("p = {:.0e}", p) : fmt::format("p = {:.2g}", p);
}

std::string size_in_words(const Finding& f) {
  const Shown unit = shown(f.unit);
  if (!f.unit.empty())
    return fmt::format("{:.3g} {} RMS{}", unit.factor * f.size, unit.unit,
                       f.channel == "stop" ? " in range" : "");
  if (ends_with(f.channel, "_noise")) return fmt::format("spread x {:.2g}", std::exp(0.5 * f.size));
  if (f.channel == "grid")
    return fmt::format("steps of {:.3g} {}", f.covariate == "range" ? 1e3 * f.size : f.size / degree,
                       f.covariate == "range" ? "mm" : "deg");
  if (f.channel == "detection") return fmt::format("{:.1f} % of the readings missing", 100.0 * f.size);
  if (f.channel == "label") return "labels exchanged";
  if (ends_with(f.channel, "_tail"))
    return fmt::format("{} {:.2g}", f.shape == "skew" ? "skewness" : "excess kurtosis", f.size);
  if (ends_with(f.channel, "_dependence"))
    return fmt::format("{} {:.2g}", f.shape == "lag 1" ? "correlation" : "log variance ratio", f.size);
  if (f.channel == "stop" && f.shape == "lag 1")
    return fmt::format("covariance {:.2g} of the variance stated", f.size);
  if (f.channel == "stop") return fmt::format("squared error x {:.2g}", 1.0 + f.size);
  return fmt::format("size {:.3g}", f.size);
}

std::string place(const Finding& f) {
  const bool angle = f.covariate == "sensor_bearing" || f.covariate == "heading";
  const std::string unit = angle                                               ? " deg"
                           : f.covariate == "range" || f.covariate == "radius" ? " m"
                           : f.covariate == "disparity"                        ? " 1/m"
                           : f.covariate == "time"                             ? " s"
                                                                               : "";
  const double factor = angle ? 1.0 / degree : 1.0;
  if (!f.group.empty()) return " at " + f.group;
  if (f.from && f.to) return fmt::format(" from {:.3g} to {:.3g}{}", factor * *f.from, factor * *f.to, unit);
  if (f.from) return fmt::format(" from {:.3g}{} on", factor * *f.from, unit);
  return "";
}

std::string finding_in_words(const Finding& f) {
  std::string text = f.channel;
  if (f.covariate != "any" && f.covariate != "constant") text += " along " + f.covariate;
  if (!f.shape.empty() && f.shape != "effect") text += fmt::format(" ({})", f.shape);
  text += place(f) + ": " + size_in_words(f);
  if (f.share)
    text +=
        *f.share >= 0.995 ? ", all of the excess" : fmt::format(", {:.0f} % of the excess", 100.0 * *f.share);
  return fmt::format("{}, {}", text, p_in_words(f.p_value));
}

std::string millimetres(double harm_m) {
  return harm_m < 1e-5 ? "< 0.01" : fmt::format("{:.2g}", 1e3 * harm_m);
}

std::string held_out_in_words(const Diagnosis& d) {
  if (d.heldout_blocks.empty() || !d.before.heldout_nll) return {};
  return fmt::format("held out: {:.0f} {}", d.heldout_effective_blocks, d.heldout_blocks);
}

std::vector<BeforeAfter> before_after_rows(const Diagnosis& d) {
  const FitSummary &a = d.before, &b = d.after;
  const auto number = [](std::optional<double> value, const char* format) {
    return value ? fmt::format(fmt::runtime(format), *value) : std::string("-");
  };
  std::vector<BeforeAfter> rows;
  const auto add = [&](const std::string& name, const std::string& before, const std::string& after,
                       const std::string& note) {
    if (d.final_effects.empty())
      rows.push_back({name, before, "", ""});
    else
      rows.push_back({name, before, after, note});
  };
  add("NLL [nats]", fmt::format("{:.1f}", a.nll), fmt::format("{:.1f}", b.nll),
      fmt::format("{:+.1f}", b.nll - a.nll));
  std::string change;
  if (a.heldout_nll && b.heldout_nll) {
    change = fmt::format("{:+.1f}", *b.heldout_nll - *a.heldout_nll);
    if (b.heldout_std && *b.heldout_std > 0.0) change += fmt::format(" +- {:.1f}", *b.heldout_std);
    if (*b.heldout_nll >= *a.heldout_nll) change += "  (no improvement)";
  }
  add("held-out NLL [nats]", number(a.heldout_nll, "{:.1f}"), number(b.heldout_nll, "{:.1f}"), change);
  const bool has_tail =
      std::any_of(d.final_effects.begin(), d.final_effects.end(), [](const std::string& id) {
        const Effect* effect = find_effect(id);
        return effect && effect->info().kind == EffectKind::tail;
      });
  const auto in_mm = [](std::optional<double> metres) {
    return metres ? std::optional(1e3 * *metres) : std::nullopt;
  };
  if (a.heldout_rms_range_m)
    add("held-out RMS [mm]", number(in_mm(a.heldout_rms_range_m), "{:.2f}"),
        number(in_mm(b.heldout_rms_range_m), "{:.2f}"), has_tail ? "outliers counted" : "");
  add("RMS range [mm]", fmt::format("{:.2f}", 1e3 * a.rms_range_m),
      fmt::format("{:.2f}", 1e3 * b.rms_range_m),
      has_tail ? "of the means of repeats; completed: less what outliers add" : "of the means of repeats");
  if (d.baseline.kind == RecordingKind::landmarks && d.baseline.sigma_theta_rad)
    add("RMS bearing [deg]", fmt::format("{:.3f}", a.rms_bearing_rad / degree),
        fmt::format("{:.3f}", b.rms_bearing_rad / degree), "");
  add("chi-square / dof", fmt::format("{:.2f}", a.chi_sq_per_dof), fmt::format("{:.2f}", b.chi_sq_per_dof),
      "");
  return rows;
}

namespace {

/// "value +- standard deviation"; what is not told from zero by its upper limit, and a lopsided interval by both.
std::string estimate_in_words(const EffectEstimate& e, double factor) {
  if (!e.note.empty()) {
    const std::string value = fmt::format("{:.3g}", factor * e.estimate);
    if (!std::isfinite(e.low95) || !std::isfinite(e.high95)) return fmt::format("{} ({})", value, e.note);
    if (e.low95 == 0.0) return fmt::format("below {:.2g} (95 %), {}", factor * e.high95, e.note);
    return fmt::format("{} ({}; 95 %: {:.2g} to {:.2g})", value, e.note, factor * e.low95, factor * e.high95);
  }
  if (!(e.std_dev > 0.0)) return with_std(factor * e.estimate, std::nullopt);
  if (!std::isfinite(e.high95)) return with_std(factor * e.estimate, factor * e.std_dev);
  const double above = e.high95 - e.estimate, below = e.estimate - e.low95;
  if (e.low95 == 0.0 && e.estimate < 0.5 * e.std_dev)
    return fmt::format("below {:.2g} (95 %)", factor * e.high95);
  if (above > 2.0 * below || below > 2.0 * above)
    return fmt::format("{:.2g} (95 %: {:.2g} to {:.2g})", factor * e.estimate, factor * e.low95,
                       factor * e.high95);
  return with_std(factor * e.estimate, factor * e.std_dev);
}

}  // namespace

std::vector<MemberRow> member_rows(const Diagnosis& d) {
  const auto nats = [](const std::optional<double>& value) {
    return value ? fmt::format("{:.1f}", *value) : std::string("-");
  };
  std::vector<MemberRow> rows;
  for (const Member& m : d.members) {
    std::optional<double> evidence, held_out;
    if (m.log_evidence_without) evidence = -*m.log_evidence_without;
    if (m.heldout_nll_without && d.after.heldout_nll)
      held_out = *m.heldout_nll_without - *d.after.heldout_nll;
    rows.push_back(
        {id_in_words(m.effect), fmt::format("{:.2f}", m.probability), nats(evidence), nats(held_out)});
  }
  return rows;
}

std::vector<LawRow> law_rows(const Diagnosis& d) {
  std::vector<LawRow> rows;
  for (const Law& law : d.laws) {
    LawRow& row = rows.emplace_back();
    row.formula = law.channel + " + " + law.formula;
    row.evidence =
        fmt::format("{:.1f} nats {} the answer without a law", std::abs(law.log_evidence_over_curve),
                    law.log_evidence_over_curve < 0.0 ? "below" : "above");
    for (const EffectEstimate& e : law.parameters) {
      const Shown unit = unit_of(e);
      const std::string text =
          fmt::format("{} = {}{}{}", parameter_name(e.name).name, estimate_in_words(e, unit.factor),
                      unit.unit.empty() ? "" : " ", unit.unit);
      row.parameters.push_back(text);
    }
    row.agrees = law.agrees_with_first;
  }
  return rows;
}

std::vector<ParameterRow> parameter_rows(const Diagnosis& d) {
  std::vector<ParameterRow> rows;
  const bool named =
      d.final_effects != std::vector<std::string>{"generic"};  // a curve's coefficients say nothing
  if (!d.explanations.empty() && named)
    for (const EffectEstimate& e : d.explanations[0].parameters) {
      if (e.name.rfind("generic.", 0) == 0) continue;
      const Shown unit = unit_of(e);
      rows.push_back({parameter_name(e.name).name, estimate_in_words(e, unit.factor), unit.unit});
    }
  const Calibration& c = d.corrected;
  for (Eigen::Index i = 0; i < c.alpha.size(); ++i) {
    std::optional<double> std_dev;
    if (c.alpha_covariance) std_dev = std::sqrt(std::max(0.0, (*c.alpha_covariance)(i, i)));
    rows.push_back({fmt::format("alpha_{}", i), with_std(c.alpha[i], std_dev),
                    coefficient_unit(static_cast<int>(i), c.scale.family)});
  }
  for (std::size_t i = 0; i < c.noise_estimates.size(); ++i)
    rows.push_back({"noise " + law_in_words(c.noise.law),
                    with_std(c.noise_estimates[i].value, c.noise_estimates[i].std_dev),
                    law_unit(c.noise.law, static_cast<int>(i))});
  if (c.sigma_theta_rad) {
    std::optional<double> std_dev = c.sigma_theta_rad->std_dev;
    if (std_dev) *std_dev /= degree;
    rows.push_back({"sigma_theta", with_std(c.sigma_theta_rad->value / degree, std_dev), "deg"});
  }
  return rows;
}

std::string rivals_in_words(const std::vector<std::string>& names, const std::vector<std::string>& others) {
  const auto less = [](std::vector<std::string> set, const std::vector<std::string>& common) {
    std::erase_if(set, [&](const std::string& id) {
      return std::find(common.begin(), common.end(), id) != common.end();
    });
    return set;
  };
  const std::vector<std::string> own = less(names, others), other = less(others, names);
  const auto in_words = [](const std::vector<std::string>& ids) {
    return ids.empty() ? std::string("nothing") : ids_in_words(ids, " + ");
  };
  return in_words(own) + " or " + in_words(other) + (own.size() < names.size() ? ", beside the others" : "");
}

}  // namespace rangecal::app
