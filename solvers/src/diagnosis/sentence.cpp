// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>
#include <fmt/ranges.h>

#include <cmath>
#include <numbers>

#include "diagnosis/bookkeeping.hpp"
#include "rangecal/problems/effects/effect.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal {
namespace {

/// "7.5 mm RMS", "0.43 degrees RMS", over the readings; or the change of a spread in percent.
std::string size_in_words(const Finding& f) {
  if (f.unit == "m") return fmt::format("{:.2g} mm RMS", 1e3 * f.size);
  if (f.unit == "rad") return fmt::format("{:.2g} degrees RMS", f.size * 180.0 / std::numbers::pi);
  if (f.channel.find("_noise") != std::string::npos)
    return fmt::format("{:.0f} % in the spread", 100.0 * std::expm1(0.5 * std::abs(f.size)));
  if (f.channel == "stop" && f.shape == "lag 1")
    return fmt::format("errors of neighbours that agree, {:.2g} times the variance stated,", f.size);
  if (f.channel == "stop") return fmt::format("{:.2g} times the squared error stated", 1.0 + f.size);
  return f.size > 0.0 ? fmt::format("{:.2g}", f.size) : "a mismatch";
}

std::string along(const Finding& f) {
  if (f.covariate == "any" || f.covariate == "constant") return "";
  std::string text = " along " + f.covariate;
  if (!f.group.empty()) return text + " (" + f.group + ")";
  if (f.from && f.to && *f.to > *f.from) text += fmt::format(" between {:.3g} and {:.3g}", *f.from, *f.to);
  if (f.from && !f.to) text += fmt::format(" from {:.3g} on", *f.from);
  return text;
}

std::string first_sentence(const std::string& text) {
  const std::size_t end = text.find(". ");
  std::string first = end == std::string::npos ? text : text.substr(0, end);
  while (!first.empty() && first.back() == '.') first.pop_back();
  return first;
}

/// Names beside `generic`: the places of those that have one come first in `location`, what they leave after
/// them.
std::string partly_explained(const Diagnosis& d) {
  std::vector<std::string> named;
  std::size_t placed = 0;
  for (const std::string& id : d.final_effects) {
    if (id == "generic") continue;
    named.push_back(id);
    const Effect* effect = find_effect(id);
    placed += effect && !diagnosis::is_bookkeeping(effect->info().kind);
  }
  std::string text = fmt::format("In part explained by {}", fmt::join(named, " and "));
  if (named.size() == 1 && placed == 1 && !d.location.empty())
    text += ", " + size_in_words(d.location[0]) + " in " + d.location[0].channel;
  if (d.location.size() <= placed) return text + "; what is left over has no name in the catalogue.";
  const Finding& left = d.location[placed];
  return text + fmt::format("; left over is {} in {}{} that nothing in the catalogue accounts for.",
                            size_in_words(left), left.channel, along(left));
}

}  // namespace

std::string verdict_sentence(const Diagnosis& d) {
  switch (d.verdict) {
    case Verdict::no_mismatch: {
      std::string text = "No mismatch: the seed model explains this recording; use the calibration as it is";
      if (d.unseen.empty()) return text + ".";
      const Unseen& worst = d.unseen[0];
      return text + fmt::format(", but {} (some {:.{}f} mm) would not show here.", worst.effect,
                                1e3 * worst.harm_m, worst.harm_m < 0.01 ? 1 : 0);
    }
    case Verdict::explained: {
      std::string named = fmt::format("{}", fmt::join(d.final_effects, " and "));
      std::string text = "Explained by " + named;
      if (!d.location.empty()) text += ", " + size_in_words(d.location[0]) + " in " + d.location[0].channel;
      if (d.final_effects.size() == 1) {
        if (const Effect* effect = find_effect(d.final_effects[0]))
          text += ": " + first_sentence(effect->info().physics);
      }
      if (!d.explanations.empty() && !d.explanations[0].indistinguishable_from.empty()) {
        std::vector<std::string> others;
        for (const auto& set : d.explanations[0].indistinguishable_from)
          others.push_back(fmt::format("{}", fmt::join(set, " and ")));
        text += fmt::format(" (or {}: this recording cannot tell)", fmt::join(others, ", or "));
      }
      return text + ".";
    }
    case Verdict::unexplained: {
      if (d.final_effects.size() > 1) return partly_explained(d);
      if (d.location.empty())
        return "Unexplained: the seed model does not fit, and nothing in the catalogue does better.";
      const Finding& f = d.location[0];
      return "Unexplained: " + size_in_words(f) + " in " + f.channel + along(f) +
             " that nothing in the catalogue accounts for; look there, and treat readings there with care.";
    }
  }
  return {};
}

}  // namespace rangecal
