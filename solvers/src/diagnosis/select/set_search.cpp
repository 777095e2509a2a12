// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/select/set_search.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "diagnosis/candidates.hpp"
#include "diagnosis/findings.hpp"
#include "diagnosis/generic.hpp"
#include "diagnosis/select/decide.hpp"
#include "diagnosis/select/linear_search.hpp"
#include "in_parallel.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr std::size_t most_of_a_kind = 4;  ///< names of spreads, of tails, of dependence tried beside a set
constexpr int most_rounds = 12;            ///< linearisations
/// Sets beside the likeliest that are scanned too, and how far below it [nats].
constexpr std::size_t most_close = 4;
constexpr double close_by = 4.0;
/// Sets of the linearised problem that are fitted, and how far below the likeliest of them [nats].
constexpr std::size_t most_of_sets = 10;
constexpr double fitted_window = 8.0;
/// Nats by which a fit may fall short of what the linearised problem says: it is elsewhere than where it belongs.
constexpr double fell_short = 2.0;
constexpr int most_fits = 3;  ///< of one set

using Names = std::vector<std::string>;

class SetSearch {
 public:
  SetSearch(const Rows& rows, const Fit& root, const Bookkeeping& known, const Rates& rates,
            const RefitOptions& options, const SelectionPriors& priors)
      : rows_(rows), known_(known), rates_(rates), options_(options), priors_(priors), root_nll_(root.nll) {
    const WorkingProblem working = working_problem(rows, root.model, root.state);
    places_ = curve_places(rows, Projector(rows, working, root.state), root.state.sigma_theta_rad);
    std::set<std::string> places;
    for (const CurvePlace& place : places_) places.insert(member_name(*place.effect));
    counts_ = count_members(rows, static_cast<double>(places.size()));
    auto empty = std::make_unique<Hypothesis>();
    empty->fit = root;
    table_.push_back(std::move(empty));
  }

  Hypotheses run() {
    for (int round = 0; round < most_rounds; ++round) {
      Hypothesis* here = next_to_scan();
      if (!here) break;
      look_around(*here);
    }
    std::stable_sort(table_.begin(), table_.end(),
                     [](const auto& a, const auto& b) { return a->log_posterior > b->log_posterior; });
    for (const CurvePlace& place : places_) table_.front()->curves.push_back(place.effect);
    return std::move(table_);
  }

 private:
  std::size_t known_count() const { return known_.model.size(); }
  Names names_of(const Hypothesis& h) const { return member_names(h.fit.model, known_count()); }

  Hypothesis& likeliest() {
    return **std::max_element(table_.begin(), table_.end(), [](const auto& a, const auto& b) {
      return a->log_posterior < b->log_posterior;
    });
  }

  /// True if the other members may have been fitted about a wrong start of this one: what moves no mean takes up what means
  /// leave, and periods, time constants, stops and landmarks have many optima.
  static bool may_hold_fast(const Effect& effect) {
    const EffectInfo& info = effect.info();
    return !is_nameless(effect) &&
           (info.kind != EffectKind::mean || std::any_of(info.parameters.begin(), info.parameters.end(),
                                                         [](const EffectParameter& p) { return !p.linear; }));
  }

  /// The likeliest set; then, for the best may not be seen from there, the next likeliest, and the likeliest without each
  /// member that may hold the others fast. Null when all of these were scanned.
  Hypothesis* next_to_scan() {
    Hypothesis& top = likeliest();
    if (!top.scanned) return &top;
    std::vector<Hypothesis*> close;
    for (const auto& h : table_)
      if (h->log_posterior > top.log_posterior - close_by) close.push_back(h.get());
    std::stable_sort(close.begin(), close.end(), [](const Hypothesis* a, const Hypothesis* b) {
      return a->log_posterior > b->log_posterior;
    });
    for (std::size_t i = 0; i < close.size() && i < most_close; ++i)
      if (!close[i]->scanned) return close[i];
    for (std::size_t i = known_count(); i < top.fit.model.size(); ++i) {
      if (!may_hold_fast(*top.fit.model[i].effect)) continue;
      Model rest = top.fit.model;
      rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(i));
      Hypothesis* without = find(member_names(rest, known_count()));
      if (without && !without->scanned) return without;
    }
    return nullptr;
  }

  Hypothesis* find(const Names& names) {
    for (const auto& h : table_)
      if (names_of(*h) == names) return h.get();
    return nullptr;
  }

  /// Fits what may be likelier than a set: sets of the problem linearised there, spreads, tails and dependence beside it, and
  /// it without each of its members.
  void look_around(Hypothesis& here) {
    here.scanned = true;
    std::vector<Wanted> wanted = sets_linearised_at(here);
    for (std::size_t i = known_count(); i < here.fit.model.size(); ++i) {
      Model rest = here.fit.model;
      rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(i));
      const Hypothesis* known = find(member_names(rest, known_count()));
      if (rest.size() > known_count() && (!known || known->fits < most_fits))
        wanted.push_back({std::move(rest)});
    }
    const std::vector<Wanted> spreads = spreads_beside(here);
    wanted.insert(wanted.end(), spreads.begin(), spreads.end());
    std::vector<std::unique_ptr<Hypothesis>> made(wanted.size());
    in_parallel(
        wanted.size(), [&](std::size_t i) { made[i] = fitted(here, wanted[i]); }, jobs_at_once(rows_.size()));
    keep(std::move(made));
  }

  /// A set to be fitted from its parameters.
  struct Wanted {
    Model model;
    double promised = 0.0;                    ///< gain [nats]
    std::shared_ptr<Effect> curve = nullptr;  ///< of a spread, in the model
  };

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
    double of_here = 0.0;
    for (const LinearSet& set : sets)
      if (member_names(with_others(set), known_count()) == mine) of_here = set.gain;
    std::vector<Wanted> wanted;
    std::set<std::size_t> sizes;
    for (const LinearSet& set : sets) {
      // Far from the truth only the next few steps can be believed: the likeliest set of every size, too.
      const bool likely = set.log_posterior > sets.front().log_posterior - fitted_window ||
                          sizes.insert(set.model.size()).second;
      Model model = with_others(set);
      const Names names = member_names(model, known_count());
      const double gain = here.gain + set.gain - of_here;
      const Hypothesis* known = names.empty() ? table_.front().get() : find(names);
      const bool again = known && (names.empty() || known->gain > gain - fell_short);
      sizes.insert(set.model.size());
      const bool fit = likely && wanted.size() < most_of_sets && !again;
      if (likely) here.proposals.push_back({names, gain, fit || known});
      if (fit) wanted.push_back({std::move(model), gain});
    }
    return wanted;
  }

  /// The curves of the channels' spreads that promise most for their parameters.
  void add_curves_of_spreads(const Hypothesis& here, const Battery& battery,
                             std::vector<Wanted>& wanted) const {
    const double per_parameter = price_of_curve_parameter(rows_);
    std::map<std::string, std::pair<double, const Question*>> best;
    for (const Question& q : battery.questions) {
      const CurveChannel channel = curve_channel_of(q.channel);
      if (q.effect || on_grid(known_, q) || channel == CurveChannel::none || is_mean(channel)) continue;
      const double worth = q.gain - per_parameter * q.dof;
      auto& [most, question] = best[q.channel];
      if (worth > 0.0 && (!question || worth > most)) most = worth, question = &q;
    }
    for (const auto& [channel, found] : best) {
      if (!found.second) continue;
      std::optional<CurveFit> curve =
          fit_curve(rows_, battery.projector(), here.fit, *found.second, options_);
      if (!curve) continue;
      Wanted added{std::move(curve->fit.model), here.gain + found.second->gain, std::move(curve->effect)};
      const std::string name = member_name(*added.curve);
      const bool has = std::any_of(here.fit.model.begin(), here.fit.model.end(),
                                   [&](const ActiveEffect& a) { return member_name(*a.effect) == name; });
      if (!has) wanted.push_back(std::move(added));
    }
  }

  std::vector<Wanted> spreads_beside(const Hypothesis& here) const {
    const Battery battery = Battery::of_spreads(rows_, here.fit.model, here.fit.state, rates_);
    std::vector<Wanted> wanted;
    std::map<EffectKind, std::size_t> taken;
    for (Proposal& p : propose(rows_, battery, here.fit.model)) {
      const EffectInfo& info = p.effect->info();
      if (info.kind == EffectKind::mean) continue;
      if (known_.step_beyond_noise_m > 0.0 && info.channel.starts_with("range_")) continue;
      if (taken[info.kind]++ >= most_of_a_kind) continue;
      Model larger = here.fit.model;
      larger.push_back({p.effect, p.start});
      wanted.push_back({std::move(larger), here.gain + p.promised});
    }
    add_curves_of_spreads(here, battery, wanted);
    return wanted;
  }

  std::unique_ptr<Hypothesis> fitted(const Hypothesis& here, const Wanted& wanted) const {
    auto made = std::make_unique<Hypothesis>();
    made->fit = refit(rows_, wanted.model, here.fit.state, options_);
    made->promised = wanted.promised;
    made->parent = names_of(here);
    made->curves = here.curves;
    if (wanted.curve) made->curves.push_back(wanted.curve);
    return made->fit.ok && weigh(*made) ? std::move(made) : nullptr;
  }

  /// The three terms of a fit's posterior; false if they are no numbers.
  bool weigh(Hypothesis& h) const {
    h.gain = root_nll_ - h.fit.nll;
    h.parameter_volume = log_parameter_volume(rows_, h.fit, known_count(), options_, priors_);
    h.prior_mass = log_prior_mass(h.fit.model, known_count(), counts_, priors_);
    h.log_posterior = h.gain + h.parameter_volume + h.prior_mass;
    return std::isfinite(h.log_posterior);
  }

  /// Enters sets into the table; of one that was fitted before, the better fit stands.
  void keep(std::vector<std::unique_ptr<Hypothesis>> made) {
    constexpr double better = 0.01;  // nats
    for (auto& h : made) {
      if (!h) continue;
      Hypothesis* known = find(names_of(*h));
      if (!known) {
        table_.push_back(std::move(h));
        continue;
      }
      h->fits = ++known->fits;
      if (h->fit.nll < known->fit.nll - better && known != table_.front().get()) {
        h->proposals = std::move(known->proposals);
        *known = std::move(*h);
      }
    }
  }

  const Rows& rows_;
  const Bookkeeping& known_;
  const Rates& rates_;
  const RefitOptions& options_;
  const SelectionPriors& priors_;
  const double root_nll_;
  std::vector<CurvePlace> places_;
  MemberCounts counts_;
  Hypotheses table_;
};

}  // namespace

Hypotheses search_sets(const Rows& rows, const Fit& root, const Bookkeeping& known, const Rates& rates,
                       const RefitOptions& options, const SelectionPriors& priors) {
  return SetSearch(rows, root, known, rates, options, priors).run();
}

SearchResult search_by_sets(const Rows& rows, const Bookkeeping& known, const DiagnoseOptions& options) {
  RefitOptions refit_options;
  SearchResult result = scan_seed_model(rows, known, options, refit_options);
  if (result.alarm_p >= options.alarm_rate && known.model.empty()) return result;
  const Fit root = fit_root(rows, known, result.baseline, refit_options);
  refit_options.settled = static_cast<int>(known.model.size());
  if (options.progress) options.progress("searching for causes", 0.3);
  const SelectionPriors priors;
  Hypotheses table = search_sets(rows, root, known, result.rates, refit_options, priors);
  decide(rows, root, std::move(table), options, refit_options, priors, result);
  return result;
}

}  // namespace rangecal::diagnosis
