// SPDX-License-Identifier: BSD-3-Clause
#include "scoring.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>

#include "rangecal/problems/world/physical/plants.hpp"
#include "twins.hpp"

namespace rangecal::proof {
namespace {

constexpr double told_apart = 7.0;  // noncentrality from which on two effects are not twins

std::vector<std::string> sorted(std::vector<std::string> names) {
  std::sort(names.begin(), names.end());
  return names;
}

bool contains(const std::vector<std::string>& all, const std::string& one) {
  return std::find(all.begin(), all.end(), one) != all.end();
}

bool changes_stops_spread(const std::string& id) {
  const world::EffectInfo& info = world::effect_info(id);
  return info.effect_class == world::EffectClass::dependence && contains(info.channels, "stop");
}

/// Twins by the world: mean effects by their signatures, noise effects by their log variances, a spread of the stops by their
/// variances.
bool twin_in_world(const Case& c, const std::vector<std::string>& names) {
  const SeedModel model(c.clean);
  const Signatures signatures(model, c.seed);
  std::vector<std::string> own = sorted(c.truth), others;  // what the two do not share
  for (const std::string& name : names)
    if (std::erase(own, name) == 0) others.push_back(name);
  if (own.size() == 1 && changes_stops_spread(own.front()))
    return signatures.stops_left(c.planted, others) < told_apart;
  const bool mean = std::all_of(c.truth.begin(), c.truth.end(), [](const std::string& id) {
    const world::EffectClass kind = world::effect_info(id).effect_class;
    return kind == world::EffectClass::mean || kind == world::EffectClass::absorbed;
  });
  if (mean) {
    // What the truth's own signature leaves of a large effect is the signatures' linearisation: every set has
    // it.
    const Signal signal = projected(model, c.planted);
    return signatures.left(signal, names) - signatures.left(signal, c.truth) < told_apart;
  }
  return world::effect_info(c.truth.at(0)).effect_class == world::EffectClass::noise &&
         signatures.variance_left(c.planted, names) < told_apart;
}

std::vector<std::string> less(std::vector<std::string> names, const std::string& one) {
  std::erase(names, one);
  return names;
}

bool is_named(const Diagnosis& diagnosis, const std::string& id) {
  for (const std::vector<std::string>& twins : diagnosis.twins)
    if (contains(twins, id)) return true;
  for (const Unseen& unseen : diagnosis.unseen)
    if (unseen.effect == id && std::isfinite(unseen.harm_m)) return true;
  return false;
}

Case only_causes(Case c) {
  c.truth = less(less(std::move(c.truth), c.outliers), c.unknown);
  return c;
}

bool is_at(const Finding& finding, const std::string& effect) {
  const world::EffectInfo& info = world::effect_info(effect);
  return contains(info.channels, finding.channel) && contains(info.covariates, finding.covariate);
}

/// The first finding that has no name, or none.
const Finding* first_unnamed(const Diagnosis& diagnosis) {
  const auto found = std::find_if(diagnosis.location.begin(), diagnosis.location.end(),
                                  [](const Finding& f) { return contains(f.effects, "generic"); });
  return found != diagnosis.location.end() ? &*found : nullptr;
}

bool leaves_a_rest(const Diagnosis& diagnosis) {
  return diagnosis.verdict == Verdict::partly_explained || diagnosis.verdict == Verdict::unexplained;
}

/// The answer without what it says of a rest: what it would be if its names were all.
Diagnosis names_alone(Diagnosis diagnosis) {
  if (diagnosis.verdict != Verdict::partly_explained) return diagnosis;
  diagnosis.verdict = Verdict::explained;
  diagnosis.final_effects = less(std::move(diagnosis.final_effects), "generic");
  for (Explanation& explanation : diagnosis.explanations)
    for (std::vector<std::string>& set : explanation.indistinguishable_from) set = less(set, "generic");
  return diagnosis;
}

/// Two causes and something outside the catalogue: right is both names, nothing else, and the rest at its place.
Answer class_beside_unknown(const Diagnosis& diagnosis, const Score& scored) {
  if (diagnosis.verdict == Verdict::no_mismatch || diagnosis.verdict == Verdict::unobservable)
    return Answer::missed;
  if (scored.names.wrong > 0) return Answer::wrong_name;
  return scored.names.found == scored.causes && scored.located ? Answer::right_name : Answer::unexplained;
}

/// Right is the name, alone or with `stop_effect` as a rival, or no mismatch where the answer says that a factor of two would not
/// show in this design: an answer may say so of `stop_effect`, an error of the stops too.
void score_stated_sigma(Score& out, const Diagnosis& diagnosis) {
  const std::vector<std::vector<std::string>> sets = answer_sets(diagnosis);
  out.causes = 1;
  out.names = names_of(sets, {"stated_sigma"});
  out.partly_right = out.names.found == 0 && out.names.wrong == 1 && contains(sets.front(), "stop_effect");
  const auto cannot_judge = [](const std::string& note) {
    return note.starts_with("cannot be judged") &&
           (note.find("stated_sigma") != std::string::npos || note.find("stop_effect") != std::string::npos);
  };
  out.listed = is_named(diagnosis, "stated_sigma") || is_named(diagnosis, "stop_effect") ||
               std::any_of(diagnosis.notes.begin(), diagnosis.notes.end(), cannot_judge);
  if (diagnosis.verdict == Verdict::no_mismatch)
    out.result = *out.listed ? Answer::quiet : Answer::missed;
  else if (out.names.wrong > 0)
    out.result = Answer::wrong_name;
  else if (diagnosis.verdict == Verdict::explained && out.names.found == 1)
    out.result = Answer::right_name;
  else
    out.result = diagnosis.verdict == Verdict::unobservable ? Answer::missed : Answer::unexplained;
}

bool is_said_large(const Diagnosis& diagnosis) {
  return std::any_of(diagnosis.final_effects.begin(), diagnosis.final_effects.end(),
                     [&](const std::string& id) {
                       const std::string said = id_in_words(id) + " is unusually large";
                       return std::any_of(diagnosis.notes.begin(), diagnosis.notes.end(),
                                          [&](const std::string& note) { return note.starts_with(said); });
                     });
}

/// One of two causes named and nothing wrong beside it: every set of the answer, a generic curve left
/// out, holds one of the planted effects or an exact twin of it alone.
bool is_partly_right(const Case& c, const std::vector<std::vector<std::string>>& sets) {
  const auto right = [&](const std::string& id) {
    return contains(c.truth, id) ||
           std::any_of(c.truth.begin(), c.truth.end(),
                       [&](const std::string& planted) { return contains(exact_twins_of(planted), id); });
  };
  bool any = false;
  for (const std::vector<std::string>& set : sets)
    for (const std::string& id : set) {
      if (id == "generic") continue;
      if (!right(id)) return false;
      any = true;
    }
  return any;
}

}  // namespace

const char* to_string(Answer answer) {
  switch (answer) {
    case Answer::quiet:
      return "quiet";
    case Answer::false_alarm:
      return "false alarm";
    case Answer::right_name:
      return "right name";
    case Answer::right_set:
      return "right set";
    case Answer::wrong_name:
      return "wrong name";
    case Answer::wrong_set:
      return "wrong set";
    case Answer::missed:
      return "missed";
    case Answer::unexplained:
      return "unexplained";
  }
  return "";
}

std::vector<std::vector<std::string>> answer_sets(const Diagnosis& diagnosis) {
  if (diagnosis.verdict == Verdict::no_mismatch) return {};
  if (diagnosis.verdict == Verdict::unobservable) return {{"unobservable"}};
  if (diagnosis.verdict == Verdict::unexplained) return {{"generic"}};
  std::vector<std::vector<std::string>> sets{sorted(diagnosis.final_effects)};
  if (!diagnosis.explanations.empty())
    for (const std::vector<std::string>& twin : diagnosis.explanations[0].indistinguishable_from)
      if (const auto names = sorted(twin); std::find(sets.begin(), sets.end(), names) == sets.end())
        sets.push_back(names);
  return sets;
}

std::string in_words(const std::vector<std::vector<std::string>>& sets) {
  std::string out;
  for (const std::vector<std::string>& set : sets) {
    if (!out.empty()) out += " | ";
    for (std::size_t i = 0; i < set.size(); ++i) out += (i > 0 ? "+" : "") + set[i];
  }
  return out.empty() ? "no_mismatch" : out;
}

Names names_of(const std::vector<std::vector<std::string>>& sets, const std::vector<std::string>& truth) {
  Names best;
  for (const std::vector<std::string>& set : sets) {
    Names names;
    for (const std::string& id : set)
      if (find_effect(id)) ++(contains(truth, id) ? names.found : names.wrong);
    if (names.found > best.found || &set == &sets.front()) best = names;
  }
  return best;
}

std::string probabilities_of(const Diagnosis& diagnosis,
                             const std::function<bool(const std::string&)>& is_cause) {
  const std::vector<std::vector<std::string>> sets = answer_sets(diagnosis);
  if (sets.empty()) return "";  // no mismatch
  std::string out;
  for (const Member& member : diagnosis.members) {
    if (!find_effect(id_without_column(member.effect))) continue;  // a curve
    std::vector<std::string> same = exact_twins_of(member.effect);
    same.push_back(member.effect);
    const std::vector<std::string> others = less(sets.front(), member.effect);
    for (const std::vector<std::string>& set : sets) {
      std::vector<std::string> added;
      std::set_difference(set.begin(), set.end(), others.begin(), others.end(), std::back_inserter(added));
      if (added.size() == 1) same.push_back(added.front());
    }
    out += fmt::format("{}{} {:.4f} {:d}", out.empty() ? "" : "; ", member.effect, member.probability,
                       std::any_of(same.begin(), same.end(), is_cause));
  }
  return out;
}

Answer classify(const Diagnosis& diagnosis, const std::vector<std::string>& truth,
                const std::function<bool(const std::vector<std::string>&)>& is_twin) {
  if (truth.empty()) return diagnosis.verdict == Verdict::no_mismatch ? Answer::quiet : Answer::false_alarm;
  if (diagnosis.verdict == Verdict::no_mismatch || diagnosis.verdict == Verdict::unobservable)
    return Answer::missed;
  if (diagnosis.verdict == Verdict::unexplained || diagnosis.verdict == Verdict::partly_explained)
    return Answer::unexplained;
  const std::vector<std::vector<std::string>> sets = answer_sets(diagnosis);
  const std::vector<std::string> wanted = sorted(truth);
  if (sets.size() == 1) return sets[0] == wanted ? Answer::right_name : Answer::wrong_name;
  if (sets.size() > 4 || std::find(sets.begin(), sets.end(), wanted) == sets.end()) return Answer::wrong_set;
  for (const std::vector<std::string>& set : sets)
    if (set != wanted && !is_twin(set)) return Answer::wrong_set;
  return Answer::right_set;
}

bool is_located(const Diagnosis& diagnosis, const std::vector<std::string>& truth) {
  if (diagnosis.location.empty()) return false;
  return std::any_of(truth.begin(), truth.end(),
                     [&](const std::string& id) { return is_at(diagnosis.location.front(), id); });
}

/// True if the interval holds the truth. An amplitude is positive in the answer: a negative one in the world
/// is the same thing half a period on. Axes come back to themselves after half a turn, phases after a whole
/// one.
bool within(const EffectEstimate& estimate, double value, const std::map<std::string, double>& truth) {
  const std::string id = estimate.name.substr(0, estimate.name.find('.')),
                    name = estimate.name.substr(id.size() + 1);
  double period = 0.0;
  if (name == "axis_rad") period = std::numbers::pi;
  if (name == "phase_rad") period = 2.0 * std::numbers::pi;
  for (const char* amplitude :
       {"out_of_round", "amplitude_m", "amplitude_rad", "amplitude_per_m", "angle_rad"}) {
    const auto size = truth.find(id + "." + amplitude);
    if (size == truth.end() || size->second >= 0.0 || (period == 0.0 && name != amplitude)) continue;
    if (name == amplitude && (truth.count(id + ".axis_rad") || truth.count(id + ".phase_rad")))
      value = -value;
    if (period > 0.0 && id != "tilt")
      value += 0.5 * period;  // a tilt enters by its square: its sign is nothing
  }
  const double middle = 0.5 * (estimate.low95 + estimate.high95),
               half = 0.5 * (estimate.high95 - estimate.low95);
  const double off = period > 0.0 ? std::remainder(value - middle, period) : value - middle;
  return std::abs(off) <= half;
}

Coverage coverage(const Diagnosis& diagnosis, const std::map<std::string, double>& truth) {
  Coverage out;
  if (diagnosis.explanations.empty()) return out;
  for (const EffectEstimate& estimate : diagnosis.explanations[0].parameters) {
    const auto found = truth.find(estimate.name);
    if (found == truth.end() || !std::isfinite(estimate.low95) || !std::isfinite(estimate.high95)) continue;
    ++out.intervals;
    if (within(estimate, found->second, truth)) {
      ++out.covered;
      continue;
    }
    out.outside += fmt::format("{}{} {:.6g} [{:.6g} {:.6g}]", out.outside.empty() ? "" : "; ", estimate.name,
                               found->second, estimate.low95, estimate.high95);
  }
  return out;
}

namespace {

/// Where the sensor's temperature is recorded a warm-up is a drift along it: that is the simulator's own law, offset and pointing
/// in proportion to the temperature.
Diagnosis with_warmup_by_its_column(const Case& c, Diagnosis diagnosis) {
  if (!contains(c.truth, "warmup_drift") || !c.planted.driver.temperature) return diagnosis;
  const auto rename = [](std::string& name) {
    if (name == "temperature_coefficient:temperature_c") name = "warmup_drift";
  };
  std::for_each(diagnosis.final_effects.begin(), diagnosis.final_effects.end(), rename);
  for (Member& member : diagnosis.members) rename(member.effect);
  for (Explanation& explanation : diagnosis.explanations)
    for (std::vector<std::string>& set : explanation.indistinguishable_from)
      std::for_each(set.begin(), set.end(), rename);
  return diagnosis;
}

}  // namespace

Score score(const Case& c, const Diagnosis& given) {
  const Diagnosis diagnosis = with_warmup_by_its_column(c, given);
  Score out;
  out.row = c.row, out.design = c.design, out.index = c.index, out.seed = c.seed;
  for (const std::string& id : c.truth) out.planted += (out.planted.empty() ? "" : "+") + id;
  if (c.truth.empty()) out.planted = "clean";
  out.size = c.sizes.empty() ? 0.0 : c.sizes[0];
  out.value = c.value;
  const std::vector<std::vector<std::string>> sets = answer_sets(diagnosis);
  out.answer = in_words(answer_sets(given));
  out.set_size = static_cast<int>(sets.size());
  if (!diagnosis.explanations.empty()) out.probability = diagnosis.explanations[0].probability;
  out.probabilities =
      probabilities_of(diagnosis, [&](const std::string& id) { return contains(c.truth, id); });
  out.alarm_p = diagnosis.alarm_p_value;
  if (!diagnosis.location.empty())
    out.location = diagnosis.location[0].channel + "/" + diagnosis.location[0].covariate;
  if (c.row == "stated-sigma") {
    score_stated_sigma(out, diagnosis);
    return out;
  }
  const auto class_of = [&](const Diagnosis& answer) {
    return classify(answer, c.truth, [&](const std::vector<std::string>& set) {
      return twin_in_world(only_causes(c), less(set, c.outliers));
    });
  };
  out.result = class_of(diagnosis);
  out.located = is_located(diagnosis, c.truth);
  const bool named = diagnosis.verdict == Verdict::explained;
  if (named && out.result == Answer::right_name && c.shape_error.empty())
    out.coverage = coverage(diagnosis, c.planted.truth);
  if (named && diagnosis.before.heldout_nll && diagnosis.after.heldout_nll)
    out.held_out_improves = *diagnosis.after.heldout_nll < *diagnosis.before.heldout_nll;
  if (c.truth.size() == 1) out.listed = is_named(diagnosis, c.truth[0]);
  const bool in_part = diagnosis.verdict == Verdict::partly_explained;
  const Case causes = only_causes(c);
  out.causes = static_cast<int>(causes.truth.size());
  std::vector<std::vector<std::string>> beside;
  for (const std::vector<std::string>& set : sets) beside.push_back(less(set, c.outliers));
  out.names = names_of(beside, causes.truth);
  if (!c.outliers.empty()) out.outliers_named = !sets.empty() && contains(sets.front(), c.outliers);
  if (c.truth.size() == 2) out.partly_right = is_partly_right(c, sets);
  if (in_part && !c.truth.empty() && !is_partly_right(c, sets)) out.result = Answer::wrong_name;
  // A formula that is a little off may leave a rest beside the right name.
  if (!c.shape_error.empty() && in_part) out.result = class_of(names_alone(diagnosis));
  if (c.row == "large") out.said_large = is_said_large(diagnosis);
  if (c.row == "clean-any" && diagnosis.verdict == Verdict::unobservable) out.result = Answer::quiet;
  if (!c.unknown.empty()) {
    const Finding* rest = first_unnamed(diagnosis);
    out.location = rest ? rest->channel + "/" + rest->covariate : std::string();
    out.located = leaves_a_rest(diagnosis) && rest && is_at(*rest, c.unknown);
    out.result = class_beside_unknown(diagnosis, out);
  }
  return out;
}

}  // namespace rangecal::proof
