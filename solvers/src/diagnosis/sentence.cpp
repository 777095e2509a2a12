// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <string>
#include <vector>

#include "diagnosis/bookkeeping.hpp"
#include "rangecal/problems/effects/effect.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal {
namespace {

/// "a", "a and b", "a, b and c".
std::string listed(std::vector<std::string> ids) {
  if (ids.size() < 3) return ids_in_words(ids, " and ");
  const std::string last = id_in_words(ids.back());
  ids.pop_back();
  return ids_in_words(ids, ", ") + " and " + last;
}

bool ends_with(const std::string& text, const char* end) {
  return text.size() >= std::strlen(end) &&
         text.compare(text.size() - std::strlen(end), std::string::npos, end) == 0;
}

bool contains(const std::vector<std::string>& ids, const std::string& id) {
  return std::find(ids.begin(), ids.end(), id) != ids.end();
}

std::string two_digits(double value) {
  return value >= 99.5 ? fmt::format("{:.0f}", value) : fmt::format("{:.2g}", value);
}

/// What a finding is, and how large: "7.5 mm RMS in range", "0.43 degrees RMS in bearing", "a change of 74 %
/// in the spread of the ranges".
std::string size_in_words(const Finding& f) {
  const std::string readings = f.channel.rfind("bearing", 0) == 0 ? "bearings" : "ranges";
  if (f.unit == "m" && f.channel == "stop")  // sized by what it does to the ranges
    return fmt::format("{} mm RMS in range by stops off their place", two_digits(1e3 * f.size));
  if (f.channel == "grid")
    return f.covariate == "range"
               ? fmt::format("ranges in steps of {} mm", two_digits(1e3 * f.size))
               : fmt::format("bearings in steps of {:.2g} degrees", f.size * 180.0 / std::numbers::pi);
  if (f.channel == "detection") return fmt::format("{:.2g} % of the readings missing", 100.0 * f.size);
  if (f.channel == "label") return "exchanged labels";
  if (f.unit == "m") return fmt::format("{} mm RMS in {}", two_digits(1e3 * f.size), f.channel);
  if (f.unit == "rad")
    return fmt::format("{:.2g} degrees RMS in {}", f.size * 180.0 / std::numbers::pi, f.channel);
  if (ends_with(f.channel, "_noise"))
    return fmt::format("a change of {:+.0f} % in the spread of the {}", 100.0 * std::expm1(0.5 * f.size),
                       readings);
  if (ends_with(f.channel, "_tail"))
    return f.shape == "skew" ? fmt::format("skew {} (skewness {:.2g})", readings, f.size)
           : f.size < 0.0 ? fmt::format("{} with lighter tails than a normal law's (excess kurtosis {:.2g})",
                                        readings, f.size)
                          : fmt::format("outliers among the {} (excess kurtosis {:.2g})", readings, f.size);
  if (ends_with(f.channel, "_dependence"))
    return f.shape == "lag 1" ? fmt::format("neighbouring {} that depend on each other (correlation {:.2g})",
                                            readings, f.size)
                              : fmt::format("{} of a cell that share an error", readings);
  if (f.channel == "stop" && f.shape == "lag 1")
    return fmt::format("errors of neighbouring stops that {}, by {:.2g} times the variance stated",
                       f.size < 0.0 ? "oppose each other" : "agree", std::abs(f.size));
  if (f.channel == "stop") return fmt::format("{:.2g} times the squared error stated in stop", 1.0 + f.size);
  return f.size > 0.0 ? fmt::format("{:.2g} in {}", f.size, f.channel) : "a mismatch in " + f.channel;
}

std::string along(const Finding& f) {
  if (f.covariate == "any" || f.covariate == "constant") return "";
  std::string text = " along " + f.covariate;
  if (!f.group.empty()) return text + " (" + f.group + ")";
  const bool angle = f.covariate == "sensor_bearing" || f.covariate == "heading";
  const double factor = angle ? 180.0 / std::numbers::pi : 1.0;
  const char* unit = angle                                               ? " degrees"
                     : f.covariate == "range" || f.covariate == "radius" ? " m"
                     : f.covariate == "disparity"                        ? " 1/m"
                     : f.covariate == "time"                             ? " s"
                                                                         : "";
  if (f.from && f.to && *f.to > *f.from)
    text += fmt::format(" between {:.3g} and {:.3g}{}", factor * *f.from, factor * *f.to, unit);
  if (f.from && !f.to) text += fmt::format(" from {:.3g}{} on", factor * *f.from, unit);
  return text;
}

std::string first_sentence(const std::string& text) {
  const std::size_t end = text.find(". ");
  std::string first = end == std::string::npos ? text : text.substr(0, end);
  while (!first.empty() && first.back() == '.') first.pop_back();
  return first;
}

/// Findings of names that were searched for, in the order of `location`; those that bookkeeping found where there are none.
std::vector<const Finding*> named_findings(const Diagnosis& d) {
  std::vector<const Finding*> searched, kept;
  for (const Finding& f : d.location) {
    const bool counted = std::any_of(f.effects.begin(), f.effects.end(), [](const std::string& id) {
      const Effect* effect = find_effect(id);
      return effect && !diagnosis::is_bookkeeping(effect->info().kind);
    });
    const bool unnamed = std::find(f.effects.begin(), f.effects.end(), "generic") != f.effects.end();
    if (counted) searched.push_back(&f);
    if (!counted && !unnamed) kept.push_back(&f);
  }
  return searched.empty() ? kept : searched;
}

/// Steps of readings and missing ones after what puts readings off.
std::vector<std::string> grids_last(std::vector<std::string> ids) {
  std::stable_partition(ids.begin(), ids.end(), [](const std::string& id) {
    const Effect* effect = find_effect(id);
    return !effect ||
           (effect->info().kind != EffectKind::grid && effect->info().kind != EffectKind::detection);
  });
  return ids;
}

/// What other sets that the recording cannot tell from the answer have in its stead: "b or c in place of a, or d in place of e".
std::string rivals_in_words(const std::vector<std::string>& answer,
                            const std::vector<std::vector<std::string>>& others) {
  std::vector<std::pair<std::string, std::vector<std::string>>> in_place_of;  // by what they replace
  for (const std::vector<std::string>& set : others) {
    std::vector<std::string> added = set, replaced = answer;
    std::erase_if(added, [&](const std::string& id) { return contains(answer, id); });
    std::erase_if(replaced, [&](const std::string& id) { return contains(set, id); });
    const std::string of = replaced.size() == answer.size() ? "" : listed(replaced);
    auto same =
        std::find_if(in_place_of.begin(), in_place_of.end(), [&](const auto& p) { return p.first == of; });
    if (same == in_place_of.end()) same = in_place_of.insert(same, {of, {}});
    same->second.push_back(added.empty() ? "nothing" : listed(added));
  }
  std::vector<std::string> parts;
  for (const auto& [of, sets] : in_place_of)
    parts.push_back(fmt::format("{}{}", fmt::join(sets, " or "), of.empty() ? "" : " in place of " + of));
  return fmt::format("{}", fmt::join(parts, ", or "));
}

/// What is said of a shape without a name: "that nothing in the catalogue accounts for", or which names do so nearly as well.
std::string without_a_name(const Diagnosis& d) {
  std::vector<std::string> names = d.nearly_as_likely;
  std::erase_if(names, [&](const std::string& id) { return contains(d.final_effects, id); });
  return names.empty() ? " that nothing in the catalogue accounts for"
                       : fmt::format(", for which {} {} nearly as likely as a curve without a name",
                                     listed(names), names.size() == 1 ? "is" : "are");
}

/// Names beside `generic`, and what they leave.
std::string partly_explained(const Diagnosis& d) {
  std::vector<std::string> named;
  for (const std::string& id : d.final_effects)
    if (id != "generic") named.push_back(id);
  std::string text = "In part explained by " + listed(grids_last(named));
  const std::vector<const Finding*> findings = named_findings(d);
  if (named.size() == 1 && findings.size() == 1) text += ", " + size_in_words(*findings[0]);
  const auto left = std::find_if(d.location.begin(), d.location.end(), [](const Finding& f) {
    return f.effects == std::vector<std::string>{"generic"};
  });
  if (left == d.location.end()) return text + "; what is left over has no name in the catalogue.";
  return text + fmt::format("; left over is {}{}{}.", size_in_words(*left), along(*left), without_a_name(d));
}

}  // namespace

std::string verdict_sentence(const Diagnosis& d) {
  switch (d.verdict) {
    case Verdict::no_mismatch: {
      std::string text = "No mismatch: the seed model explains this recording; use the calibration as it is";
      if (d.unseen.empty()) return text + ".";
      const Unseen& worst = d.unseen[0];
      return text + fmt::format(", but {} (some {:.{}f} mm) would not show here.", id_in_words(worst.effect),
                                1e3 * worst.harm_m, worst.harm_m < 0.01 ? 1 : 0);
    }
    case Verdict::explained: {
      std::string text = "Explained by " + listed(grids_last(d.final_effects));
      if (const auto findings = named_findings(d); !findings.empty())
        text += ", " + size_in_words(*findings[0]);
      if (d.final_effects.size() == 1) {
        if (const Effect* effect = find_effect(d.final_effects[0]))
          text += ": " + first_sentence(effect->info().physics);
      }
      if (!d.explanations.empty() && !d.explanations[0].indistinguishable_from.empty()) {
        text += fmt::format(" (or {}: this recording cannot tell)",
                            rivals_in_words(d.final_effects, d.explanations[0].indistinguishable_from));
      }
      return text + ".";
    }
    case Verdict::partly_explained:
      return partly_explained(d);
    case Verdict::unexplained: {
      if (d.location.empty())
        return "Unexplained: the seed model does not fit, and nothing in the catalogue does better.";
      const Finding& f = d.location[0];
      return "Unexplained: " + size_in_words(f) + along(f) + without_a_name(d) +
             "; look there, and treat readings there with care.";
    }
    case Verdict::unobservable: {
      const std::string& open = d.corrected.weakest_direction;
      return "Unobservable: this recording does not determine the calibration: " + d.corrected.reason +
             (open.empty() || d.corrected.reason.find(open) != std::string::npos
                  ? ""
                  : "; the weakest direction is " + open) +
             ". Use no curve of it.";
    }
  }
  return {};
}

}  // namespace rangecal
