// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/search.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "diagnosis/combinations.hpp"
#include "diagnosis/findings.hpp"
#include "diagnosis/forced.hpp"
#include "diagnosis/grids.hpp"
#include "diagnosis/held_out.hpp"
#include "diagnosis/partial.hpp"
#include "diagnosis/rules.hpp"

namespace rangecal::diagnosis {
namespace {

/// p at which a free curve over a named effect's own covariate rejects it.
constexpr double adequacy_rate = 0.003;
/// Corrected p below which what a first name left is no trace.
constexpr double trace_rate = 3e-4;
/// Errors of the stops take up what two causes do: beside a cause that explains this share of what they
/// explain, two names are tried, and given where they gain so much more [nats].
constexpr double soaking_share = 0.4, soaked_margin = 10.0;
constexpr int largest_start = 3;  ///< single effects that pairs start from

/// True if a name for errors of the stops may stand for two causes that move them.
bool may_soak_up(const Candidate& name, const std::vector<Candidate>& others) {
  const Effect& effect = *name.fit.model.back().effect;
  return effect.info().kind == EffectKind::dependence && effect.acts_on_stops() &&
         std::any_of(others.begin(), others.end(), [&](const Candidate& other) {
           return other.fit.model.back().effect->info().kind == EffectKind::mean &&
                  other.evidence > soaking_share * name.evidence;
         });
}

/// Frees what was known before the search in the best candidates: tails that stood in for a cause shrink
/// beside it.
void let_known_move(const Rows& rows, std::vector<Candidate>& candidates) {
  for (std::size_t i = 0; i < candidates.size() && i < largest_start; ++i) {
    Fit free = refit(rows, candidates[i].fit.model, candidates[i].fit.state, RefitOptions{});
    if (!free.ok || !(free.nll < candidates[i].fit.nll)) continue;
    candidates[i].evidence += candidates[i].fit.nll - free.nll;
    candidates[i].fit = std::move(free);
  }
  std::sort(candidates.begin(), candidates.end(),
            [](const Candidate& a, const Candidate& b) { return a.evidence > b.evidence; });
}

/// Where the fit beside a grid of ranges starts: with the noise that the grid leaves of the repeats' scatter.
/// The solves come back to it by small steps only where the grid holds most of that.
JointState start_beside_grids(const Rows& rows, const Bookkeeping& known, JointState state) {
  if (!has_grid(known.model)) return state;
  const std::optional<Noise> noise = noise_within_cells(rows, known.model);
  if (noise && noise->law == state.noise.law) state.noise = *noise;
  return state;
}

}  // namespace

SearchResult search(const Rows& rows, const Bookkeeping& known, const DiagnoseOptions& options) {
  const auto report = [&](const char* stage, double fraction) {
    if (options.progress) options.progress(stage, fraction);
  };
  SearchResult result;
  RefitOptions refit_options;
  report("fitting the seed model", 0.0);
  result.baseline = fit_baseline(rows, options, refit_options, known.model);
  report("scanning the residuals", 0.1);
  result.first = std::make_unique<Battery>(rows, Model{}, result.baseline.state);
  result.first->calibrate(options.null_draws, 1);
  result.rates = result.first->rates;
  result.alarm_p = result.first->alarm_p();
  result.shapes = findings(rows, *result.first, options.alarm_rate);
  result.known = known;

  if (options.force) {
    fit_forced(rows, *options.force, refit_options, result);
    return result;
  }

  if (result.alarm_p >= options.alarm_rate && known.model.empty()) return result;

  const double coarse_step = known.step_beyond_noise_m;
  const auto clean = [&](const Candidate& candidate, std::unique_ptr<Battery>& battery) {
    battery = std::make_unique<Battery>(rows, candidate.fit.model, candidate.fit.state, result.rates);
    // Readings on a grid are neither normal nor independent: their channel is judged by its means alone, and
    // a further name needs overwhelming evidence.
    const double rate = has_grid(known.model) ? 1e-5 : clean_rate;
    for (const Question& q : battery->questions) {
      const bool below_step = coarse_step > 0.0 && q.channel == "range" && !(q.size > coarse_step);
      if (!on_grid(known, q) && !below_step && battery->corrected(q) < rate) return false;
    }
    // In its own channel and covariate a free curve must find nothing more.
    for (const ActiveEffect& active : candidate.fit.model)
      for (const Question& q : battery->questions)
        if (!q.effect && q.shape == "smooth" && q.channel == active.effect->info().channel &&
            q.covariate == active.effect->info().covariate && q.log_p < std::log(adequacy_rate))
          return false;
    return true;
  };

  // The root: the seed model with what bookkeeping found.
  Candidate root;
  root.fit = result.baseline;
  const Battery* root_battery = result.first.get();
  std::unique_ptr<Battery> known_battery;
  if (!known.model.empty()) {
    root.fit =
        refit(rows, known.model, start_beside_grids(rows, known, result.baseline.state), refit_options);
    root.gain = result.baseline.nll - root.fit.nll;
    if (!root.fit.ok) root.fit = result.baseline;
    if (clean(root, known_battery)) {
      result.verdict = Verdict::explained;
      result.best = std::move(root);
      result.last = std::move(known_battery);
      return result;
    }
    root_battery = known_battery.get();
    refit_options.settled = static_cast<int>(known.model.size());
  }

  // Greedy: the best single effects, then what is left, until the battery is clean.
  report("explaining", 0.3);
  std::vector<Proposal> proposals = propose(rows, *root_battery, root.fit.model);
  if (coarse_step > 0.0)  // nothing is left of spread, tails and dependence
    std::erase_if(proposals,
                  [](const Proposal& p) { return p.effect->info().channel.starts_with("range_"); });
  std::vector<Candidate> singles = try_all(rows, root.fit, proposals, result.rates, refit_options);
  if (refit_options.settled > 0) let_known_move(rows, singles);
  for (Candidate& candidate : singles) candidate.gain = result.baseline.nll - candidate.fit.nll;
  result.tried = singles;
  const double free_curve_gain = std::max(best_curve(*root_battery, result.rates, "range"),
                                          best_curve(*root_battery, result.rates, "bearing"));

  // Errors that the readings of a cell share take up whatever a curve would: they are a name only where no
  // curve explains as much.
  std::erase_if(singles, [&](const Candidate& c) {
    const Effect& effect = *c.fit.model.back().effect;
    return effect.info().kind == EffectKind::dependence && !effect.acts_on_stops() &&
           free_curve_gain > c.evidence;
  });

  settle_by_stops_left_out(rows, refit_options, singles);
  for (Candidate& tried : result.tried)  // probabilities compare like with like
    for (const Candidate& c : singles)
      if (c.fit.model.back().effect == tried.fit.model.back().effect) tried.evidence = c.evidence;

  // One name: clean, close to the best of its kind, and not beaten by a free curve.
  std::vector<std::unique_ptr<Battery>> batteries(std::min<std::size_t>(singles.size(), largest_start));
  const auto answer_with_single = [&](std::size_t i) {
    result.verdict = Verdict::explained;
    result.best = singles[i];
    result.last = std::move(batteries[i]);
    add_rivals(rows, options, singles, result);
  };
  std::optional<std::size_t> soaked;  // of singles: errors of the stops that would do, but may stand for two
  for (std::size_t i = 0; i < batteries.size(); ++i) {
    const bool leading = singles[i].evidence > singles[0].evidence - options.naming_gap_nats;
    if (!clean(singles[i], batteries[i]) || soaked || !leading || !equals_curve(singles[i], free_curve_gain))
      continue;
    if (!may_soak_up(singles[i], singles)) {
      answer_with_single(i);
      return result;
    }
    soaked = i;
  }

  // A very strong single cause leaves a trace of its formula's own approximation: a second name that adds
  // next to nothing to it is not a second cause. Noise and dependence have no formula that could be off.
  const bool has_formula =
      !singles.empty() && singles[0].fit.model.back().effect->info().kind == EffectKind::mean;
  const double trace = has_formula ? trace_share * (root.fit.nll - singles[0].fit.nll) : 0.0;

  // Two names. Only those are tried that could pass for an answer or keep the first from being one.
  report("combining effects", 0.5);
  const bool could_be_one = !singles.empty() && equals_curve(singles[0], free_curve_gain);
  const double enough = could_be_one ? singles[0].evidence + trace : std::numeric_limits<double>::infinity();
  Combinations combinations(rows, root.fit, result.baseline.nll, result.rates, refit_options, free_curve_gain,
                            enough, options.naming_gap_nats);
  for (std::size_t i = 0; i < batteries.size(); ++i) combinations.extend(singles[i], *batteries[i]);
  combinations.extend_from_others(proposals, Combinations::Until::beyond_doubt);
  const std::vector<Candidate>& pairs = combinations.best_first();
  // What it leaves must be a trace: faint by itself, and weaker than what was named.
  const auto leaves_a_trace = [&](const Candidate& named, const Battery& battery) {
    return std::all_of(battery.questions.begin(), battery.questions.end(), [&](const Question& q) {
      return q.effect || on_grid(known, q) ||
             (battery.corrected(q) > trace_rate && q.gain - q.dof < named.evidence);
    });
  };
  if (could_be_one && !soaked && (pairs.empty() || pairs[0].evidence - singles[0].evidence < trace) &&
      leaves_a_trace(singles[0], *batteries[0])) {
    answer_with_single(0);
    return result;
  }
  const auto is_answered = [&] {
    for (std::size_t i = 0; i < pairs.size() && i < 3; ++i) {
      std::unique_ptr<Battery> battery;
      if (pairs[i].evidence < pairs[0].evidence - options.naming_gap_nats) break;
      if (soaked && pairs[i].evidence < singles[*soaked].evidence + soaked_margin) break;
      if (std::min(pairs[i].evidence, pairs[i].foreseen) <
              free_curve_gain + combination_margin(pairs[i].fit.model, root.fit.model.size()) ||
          !clean(pairs[i], battery))
        continue;
      result.verdict = Verdict::explained;
      result.best = pairs[i];
      result.last = std::move(battery);
      add_rivals(rows, options, pairs, result);
      return true;
    }
    return false;
  };
  if (is_answered()) return result;
  if (soaked) {
    answer_with_single(*soaked);
    return result;
  }
  if (combinations.found_beyond_doubt()) {  // but leaves something: it is not the right two
    combinations.extend_from_others(proposals, Combinations::Until::end);
    if (is_answered()) return result;
  }
  result.verdict = Verdict::unexplained;
  find_partial(rows, options, *root_battery, singles, batteries, result);
  return result;
}

}  // namespace rangecal::diagnosis
