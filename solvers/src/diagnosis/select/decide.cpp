// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/select/decide.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "diagnosis/alternation.hpp"
#include "diagnosis/findings.hpp"
#include "diagnosis/generic_effect.hpp"
#include "diagnosis/select/rivals.hpp"
#include "diagnosis/signatures.hpp"
#include "diagnosis/twins.hpp"
#include "in_parallel.hpp"
#include "rangecal/solvers/statistics/median.hpp"
#include "solver_log.hpp"

namespace rangecal::diagnosis {
namespace {

/// Probability of every set over all of them.
std::vector<double> probabilities(const Hypotheses& table) {
  std::vector<double> p;
  double total = 0.0;
  for (const auto& h : table) {
    p.push_back(std::exp(h->log_posterior - table.front()->log_posterior));
    total += p.back();
  }
  for (double& value : p) value /= total;
  return p;
}

/// Of the sets that hold nothing but these members, the one that gains most.
const Hypothesis* likeliest_of_these(const Hypotheses& table, const Model& members, std::size_t known) {
  const std::vector<std::string> all = member_names(members, known);
  const Hypothesis* most = nullptr;
  for (const auto& h : table) {
    const std::vector<std::string> names = member_names(h->fit.model, known);
    if (std::includes(all.begin(), all.end(), names.begin(), names.end()) && (!most || h->gain > most->gain))
      most = h.get();
  }
  return most;
}

/// The members, with the parameters that another model has of them.
Model with_parameters_of(Model members, const Model& other) {
  for (ActiveEffect& a : members)
    for (const ActiveEffect& b : other)
      if (a.effect == b.effect) a.parameters = b.parameters;
  return members;
}

/// Nats that a member of the likeliest set is worth: what the set without it lacks. Infinite where that was not fitted.
double worth_of(const ActiveEffect& member, const Hypotheses& table, std::size_t known) {
  std::vector<std::string> rest = member_names(table.front()->fit.model, known);
  std::erase(rest, member_name(*member.effect));
  for (const auto& h : table)
    if (member_names(h->fit.model, known) == rest) return table.front()->log_posterior - h->log_posterior;
  return std::numeric_limits<double>::infinity();
}

/// What a curve in a name's own channel and along its covariate is worth [nats], in the likeliest set; 0 without one.
double worth_of_curve_along(const EffectInfo& name, const Hypotheses& table, std::size_t known) {
  for (const ActiveEffect& member : table.front()->fit.model)
    if (is_curve_along(*member.effect, name)) return worth_of(member, table, known);
  return 0.0;
}

/// True if a name may be an edge of an unknown shape: its law jumps at a distance that it chooses, and a curve beside it does the rest.
bool may_be_an_edge(const ActiveEffect& name, double worth, const Hypotheses& table, std::size_t known,
                    const SelectionPriors& priors) {
  return Sides::matter({name}) &&
         worth < priors.jump_beside_curve * worth_of_curve_along(name.effect->info(), table, known);
}

/// Nats by which the likeliest set is likelier than the likeliest that has a curve of another place where it has one of its names: one
/// of the same place says the same of it, and the priors decide.
double margin_over_curve(const ActiveEffect& name, const Hypotheses& table, std::size_t known) {
  std::vector<std::string> rest = member_names(without_curves(table.front()->fit.model), known);
  std::erase(rest, member_name(*name.effect));
  for (const auto& h : table) {  // the likeliest first
    const Model& model = h->fit.model;
    const bool of_its_place = std::any_of(model.begin(), model.end(), [&](const ActiveEffect& member) {
      return is_curve_along(*member.effect, name.effect->info());
    });
    if (has_generic(model) && !of_its_place && member_names(without_curves(model), known) == rest)
      return table.front()->log_posterior - h->log_posterior;
  }
  return std::numeric_limits<double>::infinity();
}

/// Nats by which the likeliest set, its formulas as they stand, is likelier than the set that has in place of one of its names a curve
/// of its channel and covariate. Where it is not, it is the allowance for a formula that is off that keeps the name: the shape is another.
/// A curve with an edge of its own says nothing against a jump.
double margin_as_it_stands(const ActiveEffect& name, const Hypotheses& table, std::size_t known) {
  const auto as_it_stands = [](const Hypothesis& h) { return h.log_posterior - h.formula_allowance; };
  const bool jumps = Sides::matter({name});
  const auto is_in_place = [&](const ActiveEffect& member) {
    return is_curve_along(*member.effect, name.effect->info()) &&
           (!jumps || dynamic_cast<const GenericEffect&>(*member.effect).smooth);
  };
  std::vector<std::string> rest = member_names(table.front()->fit.model, known);
  std::erase(rest, member_name(*name.effect));
  double margin = std::numeric_limits<double>::infinity();
  for (const auto& h : table) {
    Model others = h->fit.model;
    if (std::erase_if(others, is_in_place) == 1 && member_names(others, known) == rest)
      margin = std::min(margin, as_it_stands(*table.front()) - as_it_stands(*h));
  }
  return margin;
}

/// What that margin is at least of a name that is worth so many nats; of one without which nothing fits, anything.
double least_margin_as_it_stands(const ActiveEffect& name, double worth, const SelectionPriors& priors) {
  if (!std::isfinite(worth)) return -std::numeric_limits<double>::infinity();
  return worth * (Sides::matter({name}) ? priors.jump_over_curve : -priors.formula_misses);
}

/// The likeliest set of names alone where the likeliest set has a curve without a name, if the odds are no worse than one to twenty; else
/// null.
const Hypothesis* names_nearly_as_likely(const Hypotheses& table) {
  const double least = table.front()->log_posterior - std::log(20.0);
  if (!has_generic(table.front()->fit.model)) return nullptr;
  for (const auto& h : table)  // the likeliest first
    if (h->log_posterior >= least && !has_generic(h->fit.model)) return h.get();
  return nullptr;
}

/// Probability of sets that the linearised problem makes likely and that were not fitted, over these and those that were.
double omitted_probability(const Hypotheses& table, std::size_t known) {
  std::set<std::vector<std::string>> fitted;
  for (const auto& h : table) fitted.insert(member_names(h->fit.model, known));
  // Their log posteriors, as the likeliest set that proposes them has them.
  std::map<std::vector<std::string>, double> omitted;
  double top = table.front()->log_posterior;
  for (const auto& h : table)
    for (const TriedSet::Proposal& p : h->proposals)
      if (!fitted.count(p.members) && omitted.try_emplace(p.members, p.log_posterior).second)
        top = std::max(top, p.log_posterior);
  double of_fitted = 0.0, of_omitted = 0.0;
  for (const auto& h : table) of_fitted += std::exp(h->log_posterior - top);
  for (const auto& [members, log_posterior] : omitted) of_omitted += std::exp(log_posterior - top);
  return of_omitted / (of_fitted + of_omitted);
}

/// True if what a question found matters: its size exceeds the tolerance; of dependence, tails and errors of stops, which
/// have no size in readings, its gain is no trace of all that was explained.
/// `spread_m`, `sigma_theta_rad`: of one reading.
bool is_material(const Rows& rows, double spread_m, double sigma_theta_rad, double explained,
                 const Question& q, const SelectionPriors& priors) {
  if (q.channel == "range") return std::abs(q.size) > priors.tolerance * spread_m;
  if (q.channel == "bearing") return std::abs(q.size) > priors.tolerance * sigma_theta_rad;
  if (q.of == Question::Of::variance) return std::abs(q.size) > 2.0 * priors.tolerance;
  return gain_of(rows, q) > priors.trace * explained;
}

Candidate candidate_of(const Hypothesis& h, double probability, double baseline_nll) {
  Candidate c;
  c.fit = h.fit;
  c.gain = baseline_nll - h.fit.nll;
  c.evidence = h.log_posterior;
  c.parameters = static_cast<int>(h.fit.free.size());
  c.probability = probability;
  return c;
}

/// Nats by which the readings prefer `best` to another set. Priors alone are no reason to give one name only: where the
/// posteriors are not far apart, and the likelihoods less their parameters (AIC) by no more than two causes that the design cannot tell
/// apart differ by chance, they do not tell.
double gap_to(const Candidate& best, const Candidate& other) {
  constexpr double not_far = 8.0, by_chance = 2.0;  // nats
  const auto moves_means = [](const Candidate& c) {
    return std::all_of(c.fit.model.begin(), c.fit.model.end(),
                       [](const ActiveEffect& a) { return a.effect->info().kind == EffectKind::mean; });
  };
  const double gap = best.evidence - other.evidence;
  if (!moves_means(best) || !moves_means(other)) return gap;
  const double by_aic = best.gain - best.parameters - (other.gain - other.parameters);
  return gap < not_far && by_aic < by_chance ? std::min(gap, std::max(0.0, by_aic)) : gap;
}

/// The sets that are listed beside the likeliest as what the recording cannot tell from it, by index in the table: of its size, and another
/// in one member.
std::vector<std::size_t> listed_beside_likeliest(const Rows& rows, const Hypotheses& table, std::size_t known,
                                                 const DiagnoseOptions& options, const JointState& seed) {
  const Model& best = table.front()->fit.model;
  const Candidate likeliest = candidate_of(*table.front(), 0.0, 0.0);
  const std::vector<std::string> own = member_names(best, known);
  std::vector<std::size_t> listed;
  for (std::size_t i = 1; i < table.size(); ++i) {
    const Model& other = table[i]->fit.model;
    const std::vector<std::string> names = member_names(other, known);
    std::vector<std::string> shared;
    std::set_intersection(own.begin(), own.end(), names.begin(), names.end(), std::back_inserter(shared));
    if (names.size() != own.size() || shared.size() + 1 != own.size()) continue;
    if (is_listed(rows, options, seed, best, other, gap_to(likeliest, candidate_of(*table[i], 0.0, 0.0))))
      listed.push_back(i);
  }
  return listed;
}

/// Of a name of the likeliest set, its class's: exact twins, and what is listed as standing in its place.
double probability_of(const ActiveEffect& member, const Hypotheses& table, const std::vector<double>& p,
                      const std::vector<std::size_t>& listed) {
  const std::string& id = member.effect->info().id;
  std::vector<std::string> alike = exact_twins_of(id);
  alike.push_back(id);
  double sum = 0.0;
  for (std::size_t i = 0; i < table.size(); ++i) {
    const Model& model = table[i]->fit.model;
    const bool in_place =
        !contains(model, member.effect) && std::find(listed.begin(), listed.end(), i) != listed.end();
    if (in_place || std::any_of(alike.begin(), alike.end(),
                                [&](const std::string& one) { return contains(model, find_effect(one)); }))
      sum += p[i];
  }
  return sum;
}

/// Members of the likeliest set that have a name.
struct Named {
  Model model;
  std::vector<Member> members;  ///< what speaks for each
};

/// Those whose class has half of the probability, less what may be confounded with a curve, or a formula for another shape; the
/// one that costs most in a corrected range first.
Named named_of(const Rows& rows, const Hypotheses& table, const std::vector<double>& p, std::size_t known,
               const DiagnoseOptions& options, const SelectionPriors& priors, const JointState& seed_state) {
  const Fit& fit = table.front()->fit;
  const std::vector<std::size_t> listed = listed_beside_likeliest(rows, table, known, options, seed_state);
  const bool beside_others = fit.model.size() > known + 1;
  std::vector<double> worths(fit.model.size());
  double strongest = 0.0;  // the most that a formula for means is worth
  for (std::size_t i = known; i < fit.model.size(); ++i) {
    const Effect& effect = *fit.model[i].effect;
    if (is_generic(effect)) continue;
    worths[i] = worth_of(fit.model[i], table, known);
    if (effect.info().kind == EffectKind::mean && std::isfinite(worths[i]))
      strongest = std::max(strongest, worths[i]);
  }
  double least = beside_others ? std::max(priors.beside_names, priors.formula_leaves * strongest) : 0.0;
  if (has_generic(fit.model)) least = std::max(least, options.naming_gap_nats);
  const auto tell_of = [](const ActiveEffect& member, double worth, double probability, const char* how) {
    if (tells_outcomes())
      tell(fmt::format("name {}: {} (worth {:.2f} nats, probability {:.2f})", member.effect->info().id, how,
                       worth, probability));
  };
  std::vector<std::pair<double, Member>> costs;  // by what each costs [m]
  Model model;
  const Space seed(rows, {}, fit.state);
  for (std::size_t i = known; i < fit.model.size(); ++i) {
    const ActiveEffect& member = fit.model[i];
    if (is_generic(*member.effect)) continue;
    const double worth = worths[i];
    const double probability = probability_of(member, table, p, listed);
    const char* const against =
        probability < 0.5 ? "refused, another name is as probable"
        : margin_over_curve(member, table, known) < priors.over_curve
            ? "refused, a curve without a name is hardly less likely in its place"
        : margin_as_it_stands(member, table, known) < least_margin_as_it_stands(member, worth, priors)
            ? "refused, a curve of its own covariate does as well as its formula as it stands"
        : worth < least ? "refused, worth too little beside the others"
        : may_be_an_edge(member, worth, table, known, priors)
            ? "refused, it may be an edge of what the curve beside it stands for"
            : nullptr;
    tell_of(member, worth, probability, against ? against : "kept");
    if (against) continue;
    const double range_error = range_error_of(seed, {member, -1, seed.change({member})});
    costs.emplace_back(std::isfinite(range_error) ? range_error : 0.0,
                       Member{member.effect->info().id, std::min(1.0, probability),
                              std::isfinite(worth) ? std::optional(-worth) : std::nullopt, std::nullopt});
    model.push_back(member);
  }
  std::vector<std::size_t> order(model.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return costs[a].first > costs[b].first; });
  Named named;
  for (const std::size_t i : order) {
    named.model.push_back(model[i]);
    named.members.push_back(std::move(costs[i].second));
  }
  return named;
}

/// A member of a fit, and the fit without it.
struct Idle {
  std::size_t member = 0;
  Fit without;
};

/// Of the names that lose less than so many nats where they are left out, as what only a curve beside it makes a cause may, the
/// one that loses least.
std::optional<Idle> least_idle(const Rows& rows, const Fit& fit, std::size_t known,
                               const RefitOptions& options, double nats) {
  std::vector<Idle> each(fit.model.size() - known);
  in_parallel(
      each.size(),
      [&](std::size_t i) {
        const Model rest = without(fit.model, known + i);
        each[i] = {known + i, refit_beside(rows, fit, rest, options)};
      },
      jobs_at_once(rows.size()));
  std::erase_if(each,
                [&](const Idle& one) { return !one.without.ok || !(one.without.nll < fit.nll + nats); });
  if (each.empty()) return std::nullopt;
  return *std::min_element(each.begin(), each.end(),
                           [](const Idle& a, const Idle& b) { return a.without.nll < b.without.nll; });
}

/// True if residuals that are not clean hold something that matters.
bool leaves_something(const Rows& rows, const Battery& battery, const Candidate& answer,
                      const Bookkeeping& known, const SelectionPriors& priors) {
  const double rate = has_grid(known.model) ? priors.clean_rate_on_grid : priors.clean_rate;
  const double spread = upper_median(battery.projector().geometry().spread);
  return std::any_of(battery.questions.begin(), battery.questions.end(), [&](const Question& q) {
    return !q.effect && !on_grid(known, q) && battery.corrected(q) < rate &&
           is_material(rows, spread, answer.fit.state.sigma_theta_rad, answer.gain, q, priors);
  });
}

/// True if the means of cells with repeats lie farther from the answer's than the scatter within the cells allows, by chi-square:
/// whatever its residuals are like, that is no explanation.
bool misses_the_cells(const Rows& rows, const Battery& battery, const SelectionPriors& priors) {
  if (rows.context.largest_cell < 2) return false;
  return battery.cell_chi_sq > priors.misfit * battery.cell_dof &&
         log_chi_sq_survival(battery.cell_chi_sq, static_cast<int>(battery.cell_dof)) <
             std::log(priors.misfit_rate);
}

/// The other sets of names of the size of the answer, beside the curves of the likeliest set, the likeliest first, by how far the
/// readings prefer it. Where there are curves each is fitted without them, as the answer was.
std::vector<Candidate> others_of_its_size(const Rows& rows, const Hypotheses& table,
                                          const std::vector<double>& p, const Candidate& answer,
                                          double baseline_nll, const DiagnoseOptions& options,
                                          const RefitOptions& refit_options) {
  const Hypothesis& best = *table.front();
  const Candidate likeliest = candidate_of(best, p.front(), baseline_nll);
  const std::vector<std::string> curves = curve_names(best.fit.model);
  std::vector<Candidate> others;
  for (std::size_t i = 1; i < table.size(); ++i) {
    const Fit& fit = table[i]->fit;
    const Model names = without_curves(fit.model);
    if (names.size() != answer.fit.model.size() || curve_names(fit.model) != curves) continue;
    Candidate c = candidate_of(*table[i], p[i], baseline_nll);
    const double gap = gap_to(likeliest, c);
    if (!curves.empty()) {
      if (gap > std::max(1.0, options.naming_gap_nats)) continue;
      c.fit = refit_beside(rows, fit, names, refit_options);
      if (!c.fit.ok) continue;
      c.gain = baseline_nll - c.fit.nll;
    }
    c.evidence = answer.evidence - gap;
    others.push_back(std::move(c));
  }
  return others;
}

}  // namespace

void decide(const Rows& rows, const Fit& root, Hypotheses table, const DiagnoseOptions& options,
            const RefitOptions& refit_options, const SelectionPriors& priors, SearchResult& result) {
  const std::size_t known = result.known.model.size();
  if (options.trace) {
    const std::vector<double> p = probabilities(table);
    for (std::size_t i = 0; i < table.size(); ++i) options.trace(tried_set(*table[i], p[i], known));
  }
  result.evidence_omitted = omitted_probability(table, known);
  const Hypothesis& best = *table.front();
  const std::vector<double> p = probabilities(table);
  if (tells_outcomes())
    tell(fmt::format("search: {} sets were fitted, the likeliest is {} (probability {:.2f})", table.size(),
                     set_in_words(member_names(best.fit.model, known)), p.front()));
  result.verdict = Verdict::unexplained;
  if (const Hypothesis* names = names_nearly_as_likely(table))
    result.nearly_as_likely = member_names(names->fit.model, known);

  Named named = named_of(rows, table, p, known, options, priors, result.baseline.state);
  Model names(root.model.begin(), root.model.begin() + static_cast<std::ptrdiff_t>(known));
  names.insert(names.end(), named.model.begin(), named.model.end());
  Candidate answer = candidate_of(best, p.front(), result.baseline.nll);
  if (ids_of(names) != ids_of(best.fit.model)) {  // the names alone, and in their order
    Fit alone = refit_beside(rows, best.fit, names, refit_options);
    if (const Hypothesis* smaller = likeliest_of_these(table, names, known)) {
      // What was left out may have held the fit where it was: a curve of the spread, say, the level of the noise.
      Fit again =
          refit(rows, with_parameters_of(names, smaller->fit.model), smaller->fit.state, refit_options);
      if (again.ok && !(alone.ok && alone.nll <= again.nll)) alone = std::move(again);
    }
    if (!alone.ok) return;
    while (has_generic(best.fit.model)) {
      std::optional<Idle> idle = least_idle(rows, alone, known, refit_options, options.naming_gap_nats);
      if (!idle) break;
      const auto at = static_cast<std::ptrdiff_t>(idle->member - known);
      if (tells_outcomes())
        tell(fmt::format("name {}: refused, without it {:.2f} nats are lost once the curve is taken out",
                         named.model[static_cast<std::size_t>(at)].effect->info().id,
                         idle->without.nll - alone.nll));
      named.model.erase(named.model.begin() + at);
      named.members.erase(named.members.begin() + at);
      alone = std::move(idle->without);
    }
    answer.fit = std::move(alone);
    answer.gain = result.baseline.nll - answer.fit.nll;
  }
  auto battery = std::make_unique<Battery>(rows, answer.fit.model, answer.fit.state, result.rates);
  const bool has_curve = has_generic(best.fit.model);
  const bool rest = has_curve || leaves_something(rows, *battery, answer, result.known, priors) ||
                    misses_the_cells(rows, *battery, priors);
  if (named.model.empty() && (known == 0 || rest)) return;
  result.best = std::move(answer);
  result.last = std::move(battery);
  result.members = std::move(named.members);
  if (rest) result.left = findings(rows, *result.last, options.alarm_rate);
  result.verdict = result.left.empty() ? Verdict::explained : Verdict::partly_explained;
  add_rivals(rows, options,
             others_of_its_size(rows, table, p, result.best, result.baseline.nll, options, refit_options),
             result);
}

}  // namespace rangecal::diagnosis
