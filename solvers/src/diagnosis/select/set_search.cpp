// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/select/set_search.hpp"

#include <fmt/core.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "diagnosis/candidates.hpp"
#include "diagnosis/findings.hpp"
#include "diagnosis/free_parameters.hpp"
#include "diagnosis/generic.hpp"
#include "diagnosis/refine.hpp"
#include "diagnosis/select/decide.hpp"
#include "diagnosis/select/formula_error.hpp"
#include "diagnosis/select/linear_search.hpp"
#include "in_parallel.hpp"
#include "solver_log.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr std::size_t most_of_a_kind = 4;  ///< names of spreads, of tails, of dependence tried beside a set
/// Rounds of the search, and how many of the likeliest sets, the likeliest included, are scanned; fewer where there are many cells, whose
/// fits are slow.
constexpr int most_rounds = 16, most_rounds_of_many = 6;
constexpr std::size_t most_close = 4, most_close_of_many = 1;
constexpr int many_cells = 500;
/// How far below the likeliest these are [nats].
constexpr double close_by = 4.0;
/// Nats by which the readings could tell two fits apart, for what departs from one to be the same that departs from the other.
constexpr double cannot_be_told = 0.3;
/// Sets of the linearised problem that are fitted, so many at a time, and how far below the likeliest of their size [nats].
constexpr std::size_t most_of_sets = 10, sets_at_a_time = 4;
constexpr double fitted_window = 8.0;
/// Nats by which a fit may miss its predicted gain before it is taken for a wrong optimum.
constexpr double fell_short = 2.0;
/// Nats by which a fit may gain less than that of a subset before it is taken for a wrong optimum: the other members could be nothing.
constexpr double stuck_below = 1.0;
constexpr int most_fits = 3;   ///< of one set
constexpr int most_freed = 5;  ///< the same where other sets say that it gains less than it should
/// Nats that a member may be worth for the set without it to be fitted on the way: dropping it may pay.
constexpr double most_lost = 60.0;
/// Rounds in which the subsets of the likeliest set with one member less are fitted; one may become the likeliest.
constexpr int most_completions = 3;
/// What an exact fit and refining have added to a gain at most: nats, and a share of the gain.
constexpr double refining_adds = 5.0, refining_share = 0.2;
/// Nats below the likeliest set down to which other sets are looked at once more.
constexpr double near_the_top = 15.0;
/// The same of those that lack one of its members beside a wobble: at another period of that the member may be worth tens of nats
/// that stands for nothing.
constexpr double near_beside_a_wobble = 40.0;
/// Nats by which other optima make a set likelier, for it to be scanned once more.
constexpr double worth_another_scan = 2.0;
/// The share of what a member is worth by which the linearised problem may be off about another one in its place.
constexpr double linear_is_off_by = 0.05;
constexpr double likelier = 0.01;  ///< nats by which a fit replaces another of the same set
/// Below this share of the alarm rate the battery raises the alarm alone; above it some set has to be likelier than none, too.
constexpr double alarm_alone_share = 0.1;

using Names = std::vector<std::string>;

/// "dust + tilt (+dust)": a set, and its step from another one.
std::string step_in_words(const Names& set, const Names& from) {
  Names steps;
  for (const std::string& name : set)
    if (std::find(from.begin(), from.end(), name) == from.end()) steps.push_back("+" + name);
  for (const std::string& name : from)
    if (std::find(set.begin(), set.end(), name) == set.end()) steps.push_back("-" + name);
  std::string text = set_in_words(set) + " (";
  for (const std::string& step : steps) text += (&step == &steps.front() ? "" : ", ") + step;
  return text + (steps.empty() ? "other optima)" : ")");
}

/// Names and curves for spreads, tails and dependence, sorted.
Names names_of_no_mean(const Model& model) {
  Names names;
  for (const ActiveEffect& a : model)
    if (a.effect->info().kind != EffectKind::mean) names.push_back(member_name(*a.effect));
  std::sort(names.begin(), names.end());
  return names;
}

/// A line of a set that was fitted. `before`: the log posterior of what it is compared with.
void tell_of_fitted(const TriedSet& set, double before, const std::string& what_became_of_it) {
  tell(fmt::format(
      "hypothesis {}: log posterior {:.2f} -> {:.2f} (gain {:.2f}{}, volume {:.2f}, formula {:.2f}, prior {:.2f}): {}",
      step_in_words(set.members, set.parent), before, set.log_posterior, set.gain,
      set.predicted_gain == 0.0 ? "" : fmt::format(" of {:.2f} predicted", set.predicted_gain),
      set.parameter_volume, set.formula_allowance, set.prior_mass, what_became_of_it));
}

/// A line of a set that was refused without a comparison.
void tell_of_refused(const Names& set, const Names& from, const std::string& why) {
  tell(fmt::format("hypothesis {}: refused, {}", step_in_words(set, from), why));
}

/// Nats that a fit would lose without a member, as its covariance has it: t^T C^-1 t / 2 of its linear parameters t. 0 where it has none
/// that move means or spreads.
double loss_without(const Fit& fit, std::size_t member) {
  std::vector<Eigen::Index> own;
  for (std::size_t a = 0; a < fit.free.size(); ++a)
    if (fit.free[a].effect == static_cast<int>(member) && fit.free[a].acts != FreeParameter::Acts::numeric &&
        info_of(fit.model, fit.free[a]).linear)
      own.push_back(static_cast<Eigen::Index>(a));
  if (own.empty() || fit.covariance.rows() != static_cast<Eigen::Index>(fit.free.size())) return 0.0;
  Eigen::VectorXd t(static_cast<Eigen::Index>(own.size()));
  for (std::size_t a = 0; a < own.size(); ++a) {
    const FreeParameter& p = fit.free[static_cast<std::size_t>(own[a])];
    t[static_cast<Eigen::Index>(a)] = fit.model[static_cast<std::size_t>(p.effect)].parameters[p.index];
  }
  const Eigen::LLT<Eigen::MatrixXd> factor(fit.covariance(own, own));
  return factor.info() == Eigen::Success ? 0.5 * t.dot(factor.solve(t)) : 0.0;
}

class SetSearch {
 public:
  /// `of_root`: what its residuals were asked already; null where they were not.
  SetSearch(const Rows& rows, const Fit& root, const Battery* of_root, const Bookkeeping& known,
            const Rates& rates, const RefitOptions& options, const SelectionPriors& priors)
      : rows_(rows),
        of_root_(of_root),
        known_(known),
        rates_(rates),
        options_(options),
        priors_(priors),
        root_nll_(root.nll) {
    const WorkingProblem working = working_problem(rows, root.model, root.state);
    const Projector projector(rows, working, root.state);
    root_volume_ = projector.log_phi_volume();
    places_ = curve_places(rows, projector, root.state.sigma_theta_rad);
    std::set<std::string> places;
    for (const CurvePlace& place : places_) places.insert(member_name(*place.effect));
    counts_ = count_members(rows, static_cast<double>(places.size()));
    auto empty = std::make_unique<Hypothesis>();
    empty->fit = root;
    table_.push_back(std::move(empty));
  }

  /// `start`: effects of a set that is fitted first; none: the search starts at the root alone.
  Hypotheses run(const Model& start, const std::vector<std::shared_ptr<Effect>>& curves) {
    if (start.size() > known_count()) {
      table_.front()->curves = curves;
      fit_all(*table_.front(), {{start}});
    }
    for (int round = 0; round < (many() ? most_rounds_of_many : most_rounds); ++round) {
      if (Hypothesis* here = next_to_scan())
        look_around(*here);
      else if (!refine_likeliest() && !free_the_stuck())
        break;
    }
    for (int again = 0; again < most_completions && (complete_likeliest() || free_the_stuck()); ++again) {
    }
    std::stable_sort(table_.begin(), table_.end(),
                     [](const auto& a, const auto& b) { return a->log_posterior > b->log_posterior; });
    for (const CurvePlace& place : places_) table_.front()->curves.push_back(place.effect);
    return std::move(table_);
  }

 private:
  /// A set to be fitted from its parameters.
  struct Wanted {
    Model model;
    double predicted_gain = 0.0;  ///< total gain over the root, by the linearised problem or a score [nats]
    double log_posterior = 0.0;   ///< of a set of the linearised problem, as predicted [nats]
    bool of_linear = false;       ///< it is one
    std::shared_ptr<Effect> curve = nullptr;  ///< asked for by residuals, in the model
    bool refine = false;                      ///< other optima are looked for
    std::optional<Fit> fit = std::nullopt;    ///< where it is fitted already
    double shortfall = 0.0;                   ///< of sets with some of its members [nats]
    double expected() const { return log_posterior - shortfall; }
  };

  /// True if a set of that predicted posterior may be as likely as one of log posterior `top`. `gain`: predicted, over the set that it was
  /// predicted from.
  static bool may_reach(double top, double log_posterior, double gain) {
    return log_posterior + refining_adds + refining_share * std::max(0.0, gain) > top;
  }

  bool many() const { return rows_.cell_count > many_cells; }
  std::size_t known_count() const { return known_.model.size(); }
  Names names_of(const Hypothesis& h) const { return member_names(h.fit.model, known_count()); }

  Hypothesis& likeliest() const {
    return **std::max_element(table_.begin(), table_.end(), [](const auto& a, const auto& b) {
      return a->log_posterior < b->log_posterior;
    });
  }

  /// The likeliest sets, the likeliest first: few, and none that is more nats below it.
  std::vector<Hypothesis*> likeliest_within(double nats) const {
    const double least = likeliest().log_posterior - nats;
    std::vector<Hypothesis*> close;
    for (const auto& h : table_)
      if (h->log_posterior > least) close.push_back(h.get());
    std::stable_sort(close.begin(), close.end(), [](const Hypothesis* a, const Hypothesis* b) {
      return a->log_posterior > b->log_posterior;
    });
    close.resize(std::min(close.size(), many() ? most_close_of_many : most_close));
    return close;
  }

  /// True if the other members may have been fitted about a wrong start of this one: what moves no mean takes up what means
  /// leave (a curve of the spread what a name would), and periods, time constants, stops and landmarks have many optima.
  static bool may_hold_fast(const Effect& effect) {
    return effect.info().kind != EffectKind::mean || (!is_generic(effect) && has_many_optima(effect));
  }

  /// The likeliest set; then, for the best may not be seen from there, the next likeliest, and the likeliest without each member that
  /// may hold the others fast. Null when all of these were scanned.
  Hypothesis* next_to_scan() {
    Hypothesis& top = likeliest();
    if (!top.scanned) return &top;
    for (Hypothesis* close : likeliest_within(close_by))
      if (!close->scanned) return close;
    for (std::size_t i = known_count(); i < top.fit.model.size(); ++i) {
      if (!may_hold_fast(*top.fit.model[i].effect)) continue;
      Hypothesis* smaller = find(member_names(without(top.fit.model, i), known_count()));
      if (smaller && !smaller->scanned) return smaller;
    }
    return nullptr;
  }

  /// Cell means less what a fit makes of them, ranges and bearings in standard deviations.
  Eigen::VectorXd residuals_of(const Fit& fit) const {
    const Projector projector(rows_, working_problem(rows_, fit.model, fit.state), fit.state);
    Eigen::VectorXd of_both(2 * projector.range_residual.size());
    of_both << projector.range_residual.cwiseProduct(projector.range_information.cwiseSqrt()),
        projector.bearing_residual.cwiseProduct(projector.bearing_information.cwiseSqrt());
    return of_both;
  }

  /// True if the readings depart from this set as they do from one that was scanned, as far as they can tell, beside the same names for
  /// spreads, tails and dependence: what is missing here was looked for there (twins, and members that are nothing).
  bool departs_as_one_scanned(const Hypothesis& h) const {
    const Names rest = names_of_no_mean(h.fit.model);
    const Eigen::VectorXd own = residuals_of(h.fit);
    return std::any_of(table_.begin(), table_.end(), [&](const auto& other) {
      return other->residuals.size() == own.size() && names_of_no_mean(other->fit.model) == rest &&
             0.5 * (other->residuals - own).squaredNorm() < cannot_be_told;
    });
  }

  Hypothesis* find(const Names& names) const {
    for (const auto& h : table_)
      if (names_of(*h) == names) return h.get();
    return nullptr;
  }

  /// Fits what may be likelier than a set: spreads, tails and dependence beside it first, which set the scale of all else;
  /// then sets of the problem linearised there that are predicted to come near the likeliest by then, and the set without each of
  /// its members. Where it departs from the readings as a set that was scanned, only the last, those not fitted yet: one member of it may
  /// have stood in the other's place.
  void look_around(Hypothesis& here) {
    const bool is_alike = &here != &likeliest() && departs_as_one_scanned(here);
    here.scanned = true;
    here.residuals = residuals_of(here.fit);
    if (is_alike) {
      fit_all(here, sets_without_one(here, 1, most_lost));
      return;
    }
    fit_all(here, asked_of_residuals(here));
    fit_likeliest_of(here, sets_linearised_at(here));
    if (&here == table_.front().get() && falls_short_of_linear(here)) fit_all(here, names_by_score(here));
    std::vector<Wanted> wanted = sets_without_one(here, most_fits, most_lost);
    std::vector<Wanted> alone = names_alone(here);
    wanted.insert(wanted.end(), alone.begin(), alone.end());
    fit_all(here, std::move(wanted));
  }

  /// Nats by which fits fell short of what was predicted at `here` of sets with some of these members, beside its own others: along what
  /// these change the problem is not linear, and sets that hold more will fall short too. What another set predicted of them says nothing.
  double shortfall_of(const Names& names, const Names& here) const {
    double most = 0.0;
    for (const auto& h : table_) {
      const Names own = names_of(*h);
      if (h->parent == here && std::includes(names.begin(), names.end(), own.begin(), own.end()) &&
          !std::includes(here.begin(), here.end(), own.begin(), own.end()))
        most = std::max(most, h->predicted_gain - h->gain);
    }
    return most > fell_short ? most : 0.0;
  }

  /// Fits sets of the linearised problem, a few at a time: those that are likeliest after what fits have fallen short by then, as long as
  /// they may come near the likeliest; where one is far likelier, for the problem is then linearised there, only those that are predicted
  /// to be likelier still. No more where `here` is far from the likeliest and the first were no likelier.
  void fit_likeliest_of(Hypothesis& here, std::vector<Wanted> open) {
    const Names mine = names_of(here);
    const double at_first = likeliest().log_posterior;
    const bool is_far = here.log_posterior < at_first - close_by;
    for (std::size_t left = most_of_sets; left > 0;) {
      const double top = likeliest().log_posterior;
      for (Wanted& w : open) w.shortfall = shortfall_of(member_names(w.model, known_count()), mine);
      std::stable_sort(open.begin(), open.end(),
                       [](const Wanted& a, const Wanted& b) { return a.expected() > b.expected(); });
      const auto hopeless = std::find_if(open.begin(), open.end(), [&](const Wanted& w) {
        return top > at_first + close_by ? w.expected() < top
                                         : !may_reach(top, w.expected(), w.predicted_gain - here.gain);
      });
      const auto count = std::min({sets_at_a_time, left, static_cast<std::size_t>(hopeless - open.begin())});
      if (count == 0) break;
      const auto end = open.begin() + static_cast<std::ptrdiff_t>(count);
      std::vector<Wanted> next(open.begin(), end);
      open.erase(open.begin(), end);
      left -= count;
      for (const Wanted& w : next)
        for (TriedSet::Proposal& p : here.proposals)
          if (p.members == member_names(w.model, known_count())) p.fitted = true;
      fit_all(here, std::move(next));
      if (is_far && likeliest().log_posterior == at_first) break;
    }
    for (const Wanted& w : open)
      if (tells_outcomes())
        tell_of_refused(
            member_names(w.model, known_count()), mine,
            fmt::format(
                "not fitted: predicted log posterior {:.2f}{}, and enough sets are likelier", w.log_posterior,
                w.shortfall > 0.0
                    ? fmt::format(", of which sets with some of its members lacked {:.2f}", w.shortfall)
                    : ""));
  }

  /// True if some fit gained less than the problem linearised at a set predicted, by more than what an exact fit changes at most.
  bool falls_short_of_linear(const Hypothesis& here) const {
    const Names mine = names_of(here);
    return std::any_of(table_.begin(), table_.end(), [&](const auto& h) {
      const double predicted = h->predicted_gain - here.gain;
      return h->of_linear && h->parent == mine &&
             h->predicted_gain - h->gain > refining_adds + refining_share * predicted;
    });
  }

  /// The names of means whose scores promise most at the root, `here`, each added and fitted from up to four starts: what the linearised
  /// problem says of sets is not to be believed. But those that were fitted and have one optimum.
  std::vector<Wanted> names_by_score(const Hypothesis& here) const {
    std::optional<Battery> asked;
    const Battery& battery =
        of_root_ ? *of_root_ : asked.emplace(rows_, here.fit.model, here.fit.state, rates_);
    std::vector<Proposal> names = propose(rows_, battery, here.fit.model);
    std::erase_if(names, [&](const Proposal& p) {
      return p.effect->info().kind != EffectKind::mean ||
             channel_is_on_grid(known_, p.effect->info().channel) ||
             (!has_many_optima(*p.effect) && find({member_name(*p.effect)}));
    });
    std::vector<Fit> fits(names.size());
    in_parallel(
        names.size(), [&](std::size_t i) { fits[i] = fit_proposal(rows_, here.fit, names[i], options_); },
        jobs_at_once(rows_.size()));
    std::vector<Wanted> wanted;
    for (Fit& fit : fits) {
      if (!fit.ok) continue;
      wanted.push_back({fit.model});
      wanted.back().fit = std::move(fit);
    }
    return wanted;
  }

  /// Of a set with three names or more on means, each of these alone beside all else: what its formula is off by may be what the
  /// others describe.
  std::vector<Wanted> names_alone(const Hypothesis& here) {
    Model names, others;
    for (const ActiveEffect& a : here.fit.model) {
      const bool has_formula = a.effect->info().kind == EffectKind::mean && !is_generic(*a.effect);
      (has_formula && !contains(known_.model, a.effect) ? names : others).push_back(a);
    }
    std::vector<Wanted> alone;
    for (const ActiveEffect& name : names) {
      Model model = others;
      model.push_back(name);
      if (names.size() > 2 && !find(member_names(model, known_count()))) alone.push_back({std::move(model)});
    }
    return alone;
  }

  /// The set without each of its members, but those that were fitted so often, and those that would lose more than `bearable` nats by
  /// what the fit says.
  std::vector<Wanted> sets_without_one(const Hypothesis& here, int often, double bearable) {
    std::vector<Wanted> smaller;
    for (std::size_t i = known_count(); i < here.fit.model.size(); ++i) {
      if (!may_hold_fast(*here.fit.model[i].effect) && loss_without(here.fit, i) > bearable) continue;
      Model rest = without(here.fit.model, i);
      const Hypothesis* known = find(member_names(rest, known_count()));
      if (rest.size() > known_count() && (!known || known->fits < often))
        smaller.push_back({std::move(rest), here.gain - loss_without(here.fit, i)});
    }
    return smaller;
  }

  /// Fits what the likeliest set is without each of its members, and with a curve in place of each name, where that was not fitted, so
  /// that of each it is known what it is worth. False if nothing was left to fit.
  bool complete_likeliest() {
    const Hypothesis& top = likeliest();
    std::vector<Wanted> wanted = sets_without_one(top, 1, std::numeric_limits<double>::infinity());
    std::vector<Wanted> curves = curves_in_place_of_names(top);
    wanted.insert(wanted.end(), curves.begin(), curves.end());
    if (wanted.empty()) return false;
    fit_all(top, std::move(wanted));
    return true;
  }

  /// The set with each smooth curve of its channel and covariate in place of a name: a formula may only come near an unknown shape. But
  /// those that were fitted, and beside such a curve.
  std::vector<Wanted> curves_in_place_of_names(const Hypothesis& here) const {
    std::vector<Wanted> wanted;
    for (std::size_t i = known_count(); i < here.fit.model.size(); ++i) {
      const EffectInfo& name = here.fit.model[i].effect->info();
      const Model rest = without(here.fit.model, i);
      if (std::any_of(rest.begin(), rest.end(),
                      [&](const ActiveEffect& a) { return is_curve_along(*a.effect, name); }))
        continue;
      for (const CurvePlace& place : places_) {
        if (!place.effect->smooth || !is_curve_along(*place.effect, name)) continue;
        Model model = rest;
        model.push_back({place.effect.get(), Eigen::VectorXd::Zero(place.effect->directions().cols())});
        if (!find(member_names(model, known_count()))) wanted.push_back({std::move(model)});
      }
    }
    return wanted;
  }

  void fit_all(const Hypothesis& here, std::vector<Wanted> wanted) {
    top_gain_ = likeliest().gain;
    choose_what_is_refined(here, wanted);
    std::vector<std::unique_ptr<Hypothesis>> made(wanted.size());
    in_parallel(
        wanted.size(), [&](std::size_t i) { made[i] = fitted(here, wanted[i]); }, jobs_at_once(rows_.size()));
    keep(std::move(made));
  }

  /// The likeliest set that holds the effect, its optima looked for; null where there is none.
  const Hypothesis* refined_with(const Effect* effect) const {
    const Hypothesis* best = nullptr;
    for (const auto& h : table_)
      if (h->refined && contains(h->fit.model, effect) && (!best || h->log_posterior > best->log_posterior))
        best = h.get();
    return best;
  }

  /// Marks, for every effect with many optima that is new here, the set of highest predicted gain to be refined; other sets then start from
  /// its optimum.
  void choose_what_is_refined(const Hypothesis& here, std::vector<Wanted>& wanted) const {
    std::map<const Effect*, Wanted*> most;
    for (Wanted& w : wanted)
      for (std::size_t i = known_count(); i < w.model.size(); ++i) {
        const Effect* effect = w.model[i].effect;
        if (!has_many_optima(*effect) || contains(here.fit.model, effect) || refined_with(effect)) continue;
        Wanted*& first = most[effect];
        if (!first || w.predicted_gain > first->predicted_gain) first = &w;
      }
    for (const auto& [effect, w] : most) w->refine = true;
  }

  /// Looks for other optima of the likeliest set, of those that lack one of its members and come near it, and of the next likeliest that
  /// may then be the likeliest. False if all had been looked for, or none is better.
  bool refine_likeliest() {
    Hypothesis& top = likeliest();
    std::vector<Hypothesis*> open;
    const auto take = [&](Hypothesis* h, double nats) {
      const bool many = h && std::any_of(h->fit.model.begin(), h->fit.model.end(),
                                         [](const ActiveEffect& a) { return has_many_optima(*a.effect); });
      if (many && !h->refined && h->log_posterior > top.log_posterior - nats) open.push_back(h);
    };
    const bool wobbles = std::any_of(top.fit.model.begin(), top.fit.model.end(), [](const ActiveEffect& a) {
      const Stage stage = a.effect->info().stage;
      return stage == Stage::light || stage == Stage::spot;
    });
    const double near = wobbles ? near_beside_a_wobble : near_the_top;
    take(&top, near_the_top);
    for (std::size_t i = known_count(); i < top.fit.model.size(); ++i)
      take(find(member_names(without(top.fit.model, i), known_count())), near);
    for (Hypothesis* close : likeliest_within(refining_adds))
      if (std::find(open.begin(), open.end(), close) == open.end()) take(close, near_the_top);
    std::vector<std::unique_ptr<Hypothesis>> made(open.size());
    in_parallel(
        open.size(),
        [&](std::size_t i) {
          const SolverLog solves_are_parts("hypothesis");
          auto better = std::make_unique<Hypothesis>(*open[i]);
          refine(better->fit);
          better->refined = true;
          if (!fill_posterior(*better)) made[i] = std::move(better);
        },
        jobs_at_once(rows_.size()));
    bool any = false;
    for (std::size_t i = 0; i < open.size(); ++i) {
      open[i]->refined = true;
      any = any || (made[i] && made[i]->log_posterior > open[i]->log_posterior + likelier);
      if (made[i]) made[i]->scanned = made[i]->log_posterior < open[i]->log_posterior + worth_another_scan;
    }
    keep(std::move(made));
    return any;
  }

  /// A gain on the linearised problem, which holds the noise, with the noise fitted anew: N readings gain -N/2 ln(1 - 2 gain / N) nats.
  /// Exact for one channel; too little if only one of two channels changes.
  double gain_with_its_own_noise(double gain) const {
    constexpr double most = 0.99;  // of the squares: beyond it nothing is linear
    const double readings = static_cast<double>(rows_.size() * (rows_.reads_bearings() ? 2 : 1));
    const double share = 2.0 * gain / readings;
    return share > 0.0 ? -0.5 * readings * std::log1p(-std::min(share, most)) : gain;
  }

  /// True if a set has a member with many optima that another one lacks.
  static bool has_new_optima(const Model& model, const Model& other) {
    return std::any_of(model.begin(), model.end(), [&](const ActiveEffect& a) {
      return has_many_optima(*a.effect) && !contains(other, a.effect);
    });
  }

  /// Nats that a name more gains at least beside these members, to be given: the share of the strongest that its formula may leave
  /// (decide.cpp). None is worth more than all together, whatever the squares say that it moves the readings by: under tails they do not
  /// add up.
  double least_of_another_name(const Hypothesis& here) const {
    double strongest = 0.0;
    for (std::size_t i = known_count(); i < here.fit.model.size(); ++i) {
      const Effect& effect = *here.fit.model[i].effect;
      if (effect.info().kind == EffectKind::mean && !is_generic(effect))
        strongest = std::max(strongest, loss_without(here.fit, i));
    }
    return priors_.formula_leaves * std::min(strongest, here.gain);
  }

  /// How many names a model has beside the members of a set.
  static double names_more_than_in(const Hypothesis& here, const Model& model) {
    return static_cast<double>(std::count_if(model.begin(), model.end(), [&](const ActiveEffect& a) {
      return !is_generic(*a.effect) && !contains(here.fit.model, a.effect);
    }));
  }

  std::vector<Wanted> sets_linearised_at(Hypothesis& here) {
    Dictionary dictionary(rows_, here.fit, places_);
    Model means, others;  // the others are part of every set
    for (const ActiveEffect& a : here.fit.model)
      (a.effect->info().kind == EffectKind::mean ? means : others).push_back(a);
    const std::vector<LinearSet> sets = search_linear(rows_, dictionary, means, counts_, priors_);
    const auto with_others = [&](const LinearSet& set) {
      Model model = others;
      model.insert(model.end(), set.model.begin(), set.model.end());
      return model;
    };
    const Names mine = names_of(here);
    std::map<Names, const LinearSet*> by_names;
    for (const LinearSet& set : sets) by_names.emplace(member_names(with_others(set), known_count()), &set);
    const LinearSet nothing, &own = by_names.count(mine) ? *by_names.at(mine) : nothing;
    // What the linearised problem makes an exchange of one member lose, as far as that may be its own error: of an effect far beyond the noise
    // a per cent is many nats, and a twin would never be fitted.
    const auto may_be_off = [&](const Names& names, double gain) {
      Names rest;
      std::set_intersection(names.begin(), names.end(), mine.begin(), mine.end(), std::back_inserter(rest));
      const auto without = by_names.find(rest);
      if (names.size() != mine.size() || rest.size() + 1 != mine.size() || without == by_names.end())
        return 0.0;
      return std::max(0.0, std::min(own.gain - gain, linear_is_off_by * (own.gain - without->second->gain)));
    };
    std::vector<Wanted> wanted;
    std::map<std::size_t, double> likeliest_of_size;
    const double top = likeliest().log_posterior, least_of_one = least_of_another_name(here);
    for (const LinearSet& set : sets) {
      Model model = with_others(set);
      const Names names = member_names(model, known_count());
      const double off = may_be_off(names, set.gain), linear_posterior = set.log_posterior + off;
      // Gains on the linearised problem can be believed for a few steps only: sets are compared within their size, and kept if they may
      // reach the likeliest.
      const double more = set.gain + off - own.gain, rescaled = gain_with_its_own_noise(more);
      const double log_posterior =
          here.log_posterior + linear_posterior - own.log_posterior + rescaled - more;
      const double gain = here.gain + rescaled;
      const double best = likeliest_of_size.try_emplace(set.model.size(), linear_posterior).first->second;
      const bool likely = linear_posterior > best - fitted_window && may_reach(top, log_posterior, rescaled);
      const Hypothesis* known = names.empty() ? table_.front().get() : find(names);
      const bool again =
          known && (names.empty() || known->gain > gain - fell_short || known->fits >= most_fits);
      // A larger set whose additional members are not worth their prior is not fitted, unless the place or period of a new one was only taken
      // from a grid (may_add).
      const bool larger = std::includes(names.begin(), names.end(), mine.begin(), mine.end());
      const double may_add =
          has_new_optima(model, here.fit.model) ? refining_adds + refining_share * more : 0.0;
      const bool idle = larger && (linear_posterior + may_add < own.log_posterior ||
                                   rescaled + may_add < least_of_one * names_more_than_in(here, model));
      if (!likely) continue;
      here.proposals.push_back({names, gain, log_posterior, known != nullptr});
      if (idle && !again && tells_outcomes())
        tell_of_refused(
            names, mine,
            fmt::format("not fitted: predicted log posterior {:.2f}, what it has more is worth too little",
                        log_posterior));
      if (!again && !idle) wanted.push_back({std::move(model), gain, log_posterior, true});
    }
    return wanted;
  }

  /// Per channel the curve whose gain exceeds the price of its parameters by most, if its corrected p is below `chance`.
  void add_curves(const Hypothesis& here, const Battery& battery, std::vector<Wanted>& wanted) const {
    constexpr double chance = 0.05;  // corrected p
    const double per_parameter = price_of_curve_parameter(rows_);
    std::map<std::string, std::pair<double, const Question*>> best;
    for (const Question& q : battery.questions) {
      if (q.effect || on_grid(known_, q) || curve_channel_of(q.channel) == CurveChannel::none) continue;
      const double worth = q.gain - per_parameter * q.dof;
      auto& [most, question] = best[q.channel];
      if (worth > 0.0 && (!question || worth > most) && battery.corrected(q) < chance)
        most = worth, question = &q;
    }
    std::vector<const Question*> asked;
    for (const auto& [channel, found] : best)
      if (found.second) asked.push_back(found.second);
    std::vector<std::optional<CurveFit>> curves(asked.size());
    in_parallel(
        asked.size(), [&](std::size_t i) { curves[i] = curve_for(here, battery, *asked[i]); },
        jobs_at_once(rows_.size()));
    for (std::size_t i = 0; i < asked.size(); ++i) {
      if (!curves[i]) continue;
      Wanted w{curves[i]->fit.model, here.gain + asked[i]->gain};
      w.curve = std::move(curves[i]->effect);
      w.fit = std::move(curves[i]->fit);
      wanted.push_back(std::move(w));
    }
  }

  /// A curve beside the set, or in place of one along the same covariate.
  std::optional<CurveFit> curve_for(const Hypothesis& here, const Battery& battery, const Question& q) const {
    Model rest = here.fit.model;
    std::erase_if(rest, [&](const ActiveEffect& a) {
      return is_generic(*a.effect) && member_name(*a.effect) == curve_name(q.channel, q.covariate);
    });
    if (rest.size() == here.fit.model.size())
      return fit_curve(rows_, battery.projector(), here.fit, q, options_);
    const Fit base = refit_beside(rows_, here.fit, rest, options_);
    if (!base.ok) return std::nullopt;
    const Projector projector(rows_, working_problem(rows_, base.model, base.state), base.state);
    return fit_curve(rows_, projector, base, q, options_);
  }

  /// Beside the set: names for spreads, tails and dependence, and curves, as its residuals ask for them.
  std::vector<Wanted> asked_of_residuals(const Hypothesis& here) const {
    std::optional<Battery> asked;
    const bool is_root = &here == table_.front().get();
    const Battery& battery =
        is_root && of_root_
            ? *of_root_
            : asked.emplace(Battery::of_shapes(rows_, here.fit.model, here.fit.state, rates_));
    std::vector<Wanted> wanted;
    std::map<EffectKind, std::size_t> taken;
    const double top = likeliest().log_posterior,
                 least = std::max(-log_prior_of_one_more_name(counts_, priors_), least_of_another_name(here));
    for (Proposal& p : propose(rows_, battery, here.fit.model, Proposed::but_means)) {
      const EffectInfo& info = p.effect->info();
      if (channel_is_on_grid(known_, info.channel)) continue;  // it is judged by its means alone
      const bool exact_fit_may_gain_more =
          info.kind != EffectKind::noise;  // then it may gain more than its test says
      const double gain = exact_fit_may_gain_more ? credible_gain(p) : p.predicted_gain;
      if (gain < least || !may_reach(top, here.log_posterior + gain, gain)) continue;
      if (taken[info.kind]++ >= most_of_a_kind) continue;
      Model larger = here.fit.model;
      larger.push_back({p.effect, p.start});
      wanted.push_back({std::move(larger), here.gain + p.predicted_gain});
    }
    add_curves(here, battery, wanted);
    return wanted;
  }

  std::unique_ptr<Hypothesis> fitted(const Hypothesis& here, Wanted wanted) const {
    const SolverLog solves_are_parts("hypothesis");
    auto made = std::make_unique<Hypothesis>();
    if (wanted.fit) {
      made->fit = std::move(*wanted.fit);
    } else {
      JointState start = start_beside(rows_, here.fit, wanted.model);
      for (std::size_t i = known_count(); i < wanted.model.size(); ++i)
        if (is_tail(wanted.model[i]) && !contains(here.fit.model, wanted.model[i].effect))
          start_tail_where_likeliest(rows_, i, options_, wanted.model, start);
      made->fit = refit(rows_, wanted.model, start, options_);
      if (made->fit.ok && root_nll_ - made->fit.nll < wanted.predicted_gain - fell_short)
        start_elsewhere(wanted.model, made->fit);
      const Hypothesis& within = largest_within(member_names(wanted.model, known_count()));
      if (!made->fit.ok || root_nll_ - made->fit.nll < within.gain - stuck_below)
        start_from(within, wanted.model, *made);
    }
    const double gain = root_nll_ - made->fit.nll;
    if (made->fit.ok && wanted.refine && gain + refining_adds + refining_share * gain > top_gain_) {
      refine(made->fit);
      made->refined = true;
    }
    made->predicted_gain = wanted.predicted_gain;
    made->parent = names_of(here);
    made->of_linear = wanted.of_linear;
    keep_alive(here.curves, *made);
    if (wanted.curve) made->curves.push_back(wanted.curve);
    const char* against = made->fit.ok ? fill_posterior(*made) : "its fit did not converge";
    if (against && tells_outcomes())
      tell_of_refused(names_of(*made), made->parent,
                      against + (made->fit.reason.empty() ? "" : ": " + made->fit.reason));
    return against ? nullptr : std::move(made);
  }

  /// From the stops and landmarks of the seed model, and the places and periods of the likeliest refined sets that hold the effects.
  void start_elsewhere(Model model, Fit& fit) const {
    for (std::size_t i = known_count(); i < model.size(); ++i) {
      const Hypothesis* other = has_many_optima(*model[i].effect) ? refined_with(model[i].effect) : nullptr;
      if (!other) continue;
      for (const ActiveEffect& a : other->fit.model)
        if (a.effect == model[i].effect) model[i].parameters = a.parameters;
    }
    Fit again = refit(rows_, model, table_.front()->fit.state, options_);
    if (again.ok && again.nll < fit.nll) fit = std::move(again);
  }

  /// A fit refers to its curves, which all hypotheses that use them own together.
  static void keep_alive(const std::vector<std::shared_ptr<Effect>>& curves, Hypothesis& h) {
    for (const auto& curve : curves)
      if (std::find(h.curves.begin(), h.curves.end(), curve) == h.curves.end()) h.curves.push_back(curve);
  }

  /// The set of the largest gain with some of these members and no other; the root if there is none.
  const Hypothesis& largest_within(const Names& names) const {
    const Hypothesis* most = table_.front().get();
    for (const auto& h : table_) {
      const Names own = names_of(*h);
      if (h->gain > most->gain && own.size() < names.size() &&
          std::includes(names.begin(), names.end(), own.begin(), own.end()))
        most = h.get();
    }
    return *most;
  }

  /// From where a set within this one has its members, stops and landmarks, the linear parameters of the others at 0: the fit gains no less,
  /// but beside a random walk of the stops, which takes the place of independent errors at every size.
  void start_from(const Hypothesis& within, Model model, Hypothesis& made) const {
    for (std::size_t i = known_count(); i < model.size(); ++i) {
      ActiveEffect& member = model[i];
      const auto same = std::find_if(
          within.fit.model.begin(), within.fit.model.end(),
          [&](const ActiveEffect& a) { return member_name(*a.effect) == member_name(*member.effect); });
      if (same != within.fit.model.end()) {
        member = *same;
        continue;
      }
      const auto& parameters = member.effect->info().parameters;
      for (std::size_t j = 0; j < parameters.size(); ++j)
        if (parameters[j].linear) member.parameters[static_cast<Eigen::Index>(j)] = 0.0;
    }
    Fit again = refit(rows_, model, within.fit.state, options_);
    if (!again.ok || (made.fit.ok && again.nll > made.fit.nll)) return;
    made.fit = std::move(again);
    keep_alive(within.curves, made);
  }

  /// A set of one member less than `larger` gains less by so many nats than that one says it should.
  struct Below {
    const Hypothesis* larger = nullptr;
    std::size_t member = 0;
    double lost = 0.0;
  };

  /// Of the sets with one member more, the one that says so of this set by most: of the member, whose change is linear, it loses less by
  /// its own fit. What that is off by, of much, is allowed for.
  Below below_larger(const Hypothesis& h) const {
    Below most;
    const Names own = names_of(h);
    for (const auto& larger : table_) {
      const Model& model = larger->fit.model;
      if (larger->gain < h.gain || model.size() != h.fit.model.size() + 1) continue;
      const Names names = names_of(*larger);
      if (!std::includes(names.begin(), names.end(), own.begin(), own.end())) continue;
      std::size_t more = known_count();
      while (std::binary_search(own.begin(), own.end(), member_name(*model[more].effect))) ++more;
      if (model[more].effect->info().kind != EffectKind::mean) continue;
      const double loss = loss_without(larger->fit, more);
      const double lost = larger->gain - (1.0 + refining_share) * loss - h.gain;
      if (loss > 0.0 && lost > most.lost) most = {larger.get(), more, lost};
    }
    return most;
  }

  /// Fits a set anew that gains less than it should, and would come near the likeliest if it gained that: less than a set with some of its
  /// members, or than a set with one member more says. False if there is no such thing.
  bool free_if_stuck(const Hypothesis& h) {
    if (h.fits >= most_freed || &h == table_.front().get()) return false;
    const double within = largest_within(names_of(h)).gain - h.gain;
    const Below below = below_larger(h);
    const double lost = std::max(within, below.lost);
    if (!(lost > stuck_below) || !(h.log_posterior + lost > likeliest().log_posterior - near_the_top))
      return false;
    if (within >= below.lost)
      fit_all(h, {{h.fit.model}});  // each holds its own curves
    else
      fit_all(*below.larger, {{without(below.larger->fit.model, below.member)}});
    return true;
  }

  /// Frees all sets that are stuck. False if there are none.
  bool free_the_stuck() {
    bool any = false;
    for (std::size_t i = 0, count = table_.size(); i < count; ++i) any |= free_if_stuck(*table_[i]);
    return any;
  }

  void refine(Fit& fit) const {
    for (std::size_t i = known_count(); i < fit.model.size(); ++i)
      if (has_many_optima(*fit.model[i].effect))
        refine_member(rows_, table_.front()->fit.state, i, options_, fit);
  }

  /// True if what an effect does to the readings differs more from repeat to repeat than from setting to setting, as that of a temperature
  /// may that is never the same twice: every reading is then a setting of its own.
  bool differs_within_cells(const ActiveEffect& active, const CellGeometry& geometry) const {
    const Eigen::VectorXd change = row_changes(rows_, geometry, {active}).range;
    double within = 0.0, of_means = 0.0;
    for (int c = 0; c < rows_.cell_count; ++c) {
      const auto begin = rows_.cell_begin[static_cast<std::size_t>(c)];
      const auto cell =
          change.segment(begin, rows_.cell_begin[static_cast<std::size_t>(c) + 1] - begin).array();
      within += (cell - cell.mean()).square().sum();
      of_means +=
          static_cast<double>(cell.size()) * (cell.mean() - change.mean()) * (cell.mean() - change.mean());
    }
    return within > of_means;
  }

  /// True if known distances that were read repeatedly are settings enough for the parameters of means.
  bool has_settings_for(const Fit& fit) const {
    if (!rows_.pairs || rows_.context.largest_cell < 2) return true;
    const CellGeometry geometry = cell_geometry(rows_, fit.state);
    std::vector<bool> within;
    for (const ActiveEffect& active : fit.model) within.push_back(differs_within_cells(active, geometry));
    const auto of_means = std::count_if(fit.free.begin(), fit.free.end(), [&](const FreeParameter& p) {
      return p.acts == FreeParameter::Acts::mean && !within[static_cast<std::size_t>(p.effect)];
    });
    return cells_of_parameter * of_means <= rows_.cell_count;
  }

  /// True of tails beside a correlation of the repeats: weighted by a tail, residuals are no normal errors any more, and the correlation
  /// gains the more the less the outliers weigh.
  bool mixes_tails_and_repeats(const Model& model) const {
    return rows_.sequence.empty() && dependence_of(model).range_correlation != 0.0 && has_tails(model);
  }

  /// Fills the four terms of the log posterior and their sum. Why the set is left out, if it is; else null.
  const char* fill_posterior(Hypothesis& h) const {
    if (!has_settings_for(h.fit)) return "too few settings for its parameters";
    if (mixes_tails_and_repeats(h.fit.model))
      return "tails beside repeats that hang together have no likelihood";
    h.gain = root_nll_ - h.fit.nll;
    const Projector projector(rows_, working_problem(rows_, h.fit.model, h.fit.state), h.fit.state);
    h.parameter_volume = log_parameter_volume(rows_, h.fit, known_count(), options_, priors_) +
                         projector.log_phi_volume() - root_volume_;
    h.formula_allowance = log_formula_allowance(rows_, projector, h.fit, known_count(), priors_);
    h.prior_mass = log_prior_mass(h.fit.model, known_count(), counts_, priors_);
    h.log_posterior = h.gain + h.parameter_volume + h.formula_allowance + h.prior_mass;
    return std::isfinite(h.log_posterior) ? nullptr : "its posterior is no number";
  }

  /// True if a fit of the set `known` is to stand in its place.
  bool replaces(const Hypothesis& h, const Hypothesis& known) const {
    return h.log_posterior > known.log_posterior + likelier && &known != table_.front().get();
  }

  void tell_of_kept(const Hypothesis& h, const Hypothesis* known) {
    const TriedSet set = tried_set(h, not_known, known_count());
    if (known) {
      tell_of_fitted(set, known->log_posterior,
                     replaces(h, *known) ? "kept, likelier than its last fit"
                                         : "refused, no likelier than its last fit");
      return;
    }
    const Hypothesis* parent = find(h.parent);
    tell_of_fitted(set, parent ? parent->log_posterior : 0.0,
                   h.log_posterior > likeliest().log_posterior
                       ? "kept, the likeliest so far"
                       : fmt::format("kept, below {}", set_in_words(names_of(likeliest()))));
  }

  /// Enters sets into the table; of one that was fitted before, the likelier fit stands.
  void keep(std::vector<std::unique_ptr<Hypothesis>> made) {
    for (auto& h : made) {
      if (!h) continue;
      Hypothesis* known = find(names_of(*h));
      if (tells_outcomes()) tell_of_kept(*h, known);
      if (!known) {
        table_.push_back(std::move(h));
        continue;
      }
      h->fits = ++known->fits;
      if (replaces(*h, *known)) {
        h->proposals = std::move(known->proposals);
        *known = std::move(*h);
      }
    }
  }

  const Rows& rows_;
  const Battery* of_root_;  ///< what the root's residuals were asked; null where they were not
  const Bookkeeping& known_;
  const Rates& rates_;
  const RefitOptions& options_;
  const SelectionPriors& priors_;
  const double root_nll_;
  double root_volume_ = 0.0;  ///< of its calibration
  double top_gain_ = 0.0;     ///< of the likeliest set before the round [nats]
  std::vector<CurvePlace> places_;
  MemberCounts counts_;
  Hypotheses table_;
};

/// The search beside a seed model with a law of the noise that is given, or that fits it best.
struct SearchedSets {
  SearchResult result;
  Fit root;
  Hypotheses table;  ///< empty without an alarm
  RefitOptions refit_options;

  /// ln of the evidence, of the likeliest set, up to what all seed models have in common.
  double log_evidence() const { return table.front()->log_posterior - root.nll; }
};

SearchedSets searched(const Rows& rows, const Bookkeeping& known, const DiagnoseOptions& options,
                      const SelectionPriors& priors, std::optional<NoiseLaw> law = std::nullopt,
                      const Hypothesis& start = {}) {
  SearchedSets all;
  all.result = scan_seed_model(rows, known, options, all.refit_options, law);
  if (all.result.alarm_p >= options.alarm_rate && known.model.empty()) {
    if (tells_outcomes())
      tell(fmt::format("search: p = {:.2g} raises no alarm at a rate of {:g}, so no cause is looked for",
                       all.result.alarm_p, options.alarm_rate));
    return all;
  }
  all.root = fit_root(rows, known, all.result.baseline, all.refit_options);
  all.refit_options.settled = static_cast<int>(known.model.size());
  all.refit_options.gradient_tolerance = close_enough;
  if (options.progress) options.progress("searching for causes", 0.3);
  SetSearch search(rows, all.root, known.model.empty() ? all.result.first.get() : nullptr, known,
                   all.result.rates, all.refit_options, priors);
  all.table = search.run(without_law(start.fit.model), start.curves);
  const bool weak = all.result.alarm_p >= alarm_alone_share * options.alarm_rate && known.model.empty();
  if (weak && all.table.front()->fit.model.empty()) {
    all.result.known.notes.push_back(fmt::format(
        "the questions asked of the residuals have p = {:.2g}, but no set of causes, named or not, is likelier than none",
        all.result.alarm_p));
    if (tells_outcomes()) tell("search: " + all.result.known.notes.back());
    all.table.clear();
  }
  return all;
}

}  // namespace

SearchResult search_by_sets(const Rows& rows, const Bookkeeping& known, const DiagnoseOptions& options) {
  const SelectionPriors priors;
  SearchedSets found = searched(rows, known, options, priors);
  if (found.table.empty()) return std::move(found.result);
  // The law of the noise was chosen with no cause in the model: with these another may fit better.
  const Hypothesis& likeliest = *found.table.front();
  if (const auto law = law_beside(rows, likeliest.fit, options, found.refit_options)) {
    if (tells_outcomes())
      tell(fmt::format("search: once more, noise {} beside {}", to_string(*law),
                       set_in_words(member_names(likeliest.fit.model, known.model.size()))));
    SearchedSets again = searched(rows, known, options, priors, law, likeliest);
    if (again.table.empty()) return std::move(again.result);
    if (again.log_evidence() > found.log_evidence() - law_margin) found = std::move(again);
  }
  decide(rows, found.root, std::move(found.table), options, found.refit_options, priors, found.result);
  return std::move(found.result);
}

}  // namespace rangecal::diagnosis
