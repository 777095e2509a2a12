// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/select/set_search.hpp"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
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

/// Additions to one set that are fitted: names that move the mean, and of each other kind.
constexpr std::size_t most_of_means = 3, most_of_others = 2;
constexpr int most_scanned = 80;  ///< sets whose residuals are scanned
constexpr int most_rounds = 8;    ///< linearisations
/// Sets of the linearised problem that are fitted, and how far below the likeliest of them [nats].
constexpr std::size_t most_of_sets = 8;
constexpr double fitted_window = 8.0;
constexpr double most_places = 30.0;  ///< of curves without a name: a channel along a covariate each

/// A member to be added to a set: a name, or a curve for what a question found.
struct Addition {
  std::optional<Proposal> name;
  std::optional<Question> curve;
  double promised = 0.0;  ///< nats
  std::string member() const {
    return name ? member_name(*name->effect) : "curve of " + curve->channel + " along " + curve->covariate;
  }
};

using Names = std::vector<std::string>;

std::string joined(const Names& names) { return fmt::format("{}", fmt::join(names, "+")); }

/// True if `larger` holds all of `smaller` and one more; both sorted.
bool one_more(const Names& larger, const Names& smaller) {
  return larger.size() == smaller.size() + 1 &&
         std::includes(larger.begin(), larger.end(), smaller.begin(), smaller.end());
}

class SetSearch {
 public:
  SetSearch(const Rows& rows, const Fit& root, const Bookkeeping& known, const Rates& rates,
            const RefitOptions& options, const SelectionPriors& priors)
      : rows_(rows), known_(known), rates_(rates), options_(options), priors_(priors), root_nll_(root.nll) {
    auto empty = std::make_unique<Hypothesis>();
    empty->fit = root;
    table_.push_back(std::move(empty));
    fitted_.insert("");
  }

  /// A curve of many parameters takes up several causes at once, and none of them alone is likelier than it: names are
  /// looked for without curves first, then both together, then the names that curves stand for.
  Hypotheses run() {
    Hypothesis& root = *table_.front();
    counts_ = count_members(rows_, most_places);
    name_causes(root);
    climb(root, true);
    for (const Hypothesis* before = nullptr; before != &best();) {
      before = &best();
      name_causes(without_curves(best()));
      climb(best(), true);
    }
    std::stable_sort(table_.begin(), table_.end(),
                     [](const auto& a, const auto& b) { return a->log_posterior > b->log_posterior; });
    return std::move(table_);
  }

 private:
  std::size_t known_count() const { return known_.model.size(); }
  Names names_of(const Hypothesis& h) const { return member_names(h.fit.model, known_count()); }
  static bool likelier(const Hypothesis& a, const Hypothesis& b) {
    return a.log_posterior > b.log_posterior + 1e-9;
  }

  Hypothesis& best() {
    return **std::max_element(table_.begin(), table_.end(), [](const auto& a, const auto& b) {
      return a->log_posterior < b->log_posterior;
    });
  }

  static bool has_curve(const Hypothesis& h) {
    return std::any_of(h.fit.model.begin(), h.fit.model.end(),
                       [](const ActiveEffect& a) { return is_nameless(*a.effect); });
  }

  /// Searches the problem linearised at a set, fits the likeliest sets that this finds, and does the same at the best of
  /// them, until that stays. Spreads, tails, dependence and errors of stops, which are not linear, are tried beside it.
  Hypothesis& name_causes(Hypothesis& start) {
    Hypothesis* here = &start;
    for (int round = 0; round < most_rounds; ++round) {
      add_members(*here, false, 0.0);
      fit_linear_sets(*here);
      Hypothesis* next = here;
      for (const auto& h : table_)
        if (!has_curve(*h) && likelier(*h, *next)) next = h.get();
      if (next == here) break;
      here = next;
    }
    return *here;
  }

  void fit_linear_sets(const Hypothesis& here) {
    Dictionary dictionary(rows_, here.fit);
    Model means, others;  // the others are part of every set
    for (const ActiveEffect& a : here.fit.model)
      (a.effect->info().kind == EffectKind::mean ? means : others).push_back(a);
    const std::vector<LinearSet> sets = search_linear(rows_, dictionary, means, counts_, priors_);
    const Names mine = names_of(here);
    double of_here = 0.0;
    for (const LinearSet& set : sets) {
      Model model = others;
      model.insert(model.end(), set.model.begin(), set.model.end());
      if (member_names(model, known_count()) == mine) of_here = set.gain;
    }
    constexpr double fell_short = 2.0;  // nats: it was fitted elsewhere than where it belongs
    std::vector<Model> wanted;
    for (const LinearSet& set : sets) {
      if (wanted.size() >= most_of_sets || set.log_posterior < sets.front().log_posterior - fitted_window)
        break;
      Model model = others;
      model.insert(model.end(), set.model.begin(), set.model.end());
      if (model.size() == known_count()) continue;
      const Hypothesis* fitted = find(member_names(model, known_count()));
      if (!fitted || fitted->gain < here.gain + set.gain - of_here - fell_short)
        wanted.push_back(std::move(model));
    }
    std::vector<std::unique_ptr<Hypothesis>> made(wanted.size());
    in_parallel(
        wanted.size(),
        [&](std::size_t i) {
          made[i] = std::make_unique<Hypothesis>();
          made[i]->fit = refit(rows_, wanted[i], here.fit.state, options_);
          if (made[i]->fit.ok) complete(*made[i], here);
        },
        jobs_at_once(rows_.size()));
    keep(std::move(made));
  }

  /// Steps to the likeliest neighbour by one member more, one less or another one, until none is likelier.
  void climb(Hypothesis& start, bool curves) {
    Hypothesis* here = &start;
    while (scanned_ < most_scanned) {
      drop_members(*here);
      add_members(*here, curves, 0.0);
      Hypothesis* next = likeliest_neighbour(*here, curves);
      if (next == here) next = exchange(*here, curves);
      if (next == here) return;
      here = next;
    }
  }

  Hypothesis* likeliest_neighbour(Hypothesis& here, bool curves) {
    const Names mine = names_of(here);
    Hypothesis* next = &here;
    for (const auto& h : table_) {
      if (!likelier(*h, *next) || (!curves && has_curve(*h))) continue;
      const Names theirs = names_of(*h);
      if (one_more(theirs, mine) || one_more(mine, theirs)) next = h.get();
    }
    return next;
  }

  /// Every member exchanged for what is proposed without it.
  Hypothesis* exchange(Hypothesis& here, bool curves) {
    const Names mine = names_of(here);
    for (std::size_t i = 0; i < mine.size() && scanned_ < most_scanned; ++i) {
      Names rest = mine;
      rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(i));
      Hypothesis* without = find(rest);
      if (!without) continue;
      add_members(*without, curves, here.gain - without->gain);
      Hypothesis* next = likeliest_neighbour(*without, curves);
      if (likelier(*next, here)) return next;
    }
    return &here;
  }

  Hypothesis* find(const Names& names) {
    for (const auto& h : table_)
      if (names_of(*h) == names) return h.get();
    return nullptr;
  }

  Hypothesis& without_curves(Hypothesis& h) {
    if (!has_curve(h)) return h;
    Hypothesis* rest = make_without(h, [](const ActiveEffect& a) { return is_nameless(*a.effect); });
    return rest ? *rest : *table_.front();
  }

  template <typename Left>
  Hypothesis* make_without(const Hypothesis& from, const Left& left_out) {
    Model rest = from.fit.model;
    std::erase_if(rest, left_out);
    const Names names = member_names(rest, known_count());
    if (Hypothesis* known = find(names)) return known;
    auto made = std::make_unique<Hypothesis>();
    made->fit = refit(rows_, rest, from.fit.state, options_);
    made->curves = from.curves;
    if (!made->fit.ok) return nullptr;
    complete(*made, from);
    fitted_.insert(joined(names));
    table_.push_back(std::move(made));
    return table_.back().get();
  }

  /// The set without each of its members, from where it stands: it may be fitted better than it was from elsewhere.
  void drop_members(const Hypothesis& from) {
    const std::size_t members = from.fit.model.size() - known_count();
    std::vector<std::unique_ptr<Hypothesis>> made(members);
    in_parallel(members, [&](std::size_t n) {
      Model rest = from.fit.model;
      rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(known_count() + n));
      made[n] = std::make_unique<Hypothesis>();
      made[n]->fit = refit(rows_, rest, from.fit.state, options_);
      made[n]->curves = from.curves;
      if (made[n]->fit.ok) complete(*made[n], from);
    });
    keep(std::move(made));
  }

  /// Gain and posterior of a set just fitted.
  void complete(Hypothesis& h, const Hypothesis& from) const {
    h.parent = names_of(from);
    h.gain = root_nll_ - h.fit.nll;
    h.parameter_volume = log_parameter_volume(rows_, h.fit, known_count(), options_, priors_);
    h.prior_mass = log_prior_mass(h.fit.model, known_count(), counts_, priors_);
    h.log_posterior = h.gain + h.parameter_volume + h.prior_mass;
    if (!std::isfinite(h.log_posterior)) h.log_posterior = -std::numeric_limits<double>::infinity();
  }

  /// Enters sets into the table; of one that was fitted before, the better fit stands.
  void keep(std::vector<std::unique_ptr<Hypothesis>> made) {
    constexpr double better = 0.01;  // nats
    for (auto& h : made) {
      if (!h || !h->fit.ok) continue;
      const Names names = names_of(*h);
      fitted_.insert(joined(names));
      Hypothesis* known = find(names);
      if (!known)
        table_.push_back(std::move(h));
      else if (h->fit.nll < known->fit.nll - better && known != table_.front().get()) {
        h->proposals = std::move(known->proposals);
        *known = std::move(*h);
      }
    }
  }

  /// Fits what the scores of a set's residuals propose to add: names where that was not done, curves where they are
  /// allowed. Only what promises to make up for `lost` nats.
  void add_members(Hypothesis& from, bool curves, double lost) {
    const bool names = !from.names_tried;
    curves = curves && !from.curves_tried;
    if (!names && !curves) return;
    ++scanned_;
    const Battery battery(rows_, from.fit.model, from.fit.state, rates_);
    std::vector<Addition> additions;
    if (names) additions = name_additions(from, battery);
    if (curves)
      for (Addition& a : curve_additions(from, battery)) additions.push_back(std::move(a));
    from.names_tried = true;
    from.curves_tried = from.curves_tried || curves;
    const Names mine = names_of(from);
    std::erase_if(additions, [&](const Addition& a) {
      Names larger = mine;
      larger.insert(std::upper_bound(larger.begin(), larger.end(), a.member()), a.member());
      const bool fitted = fitted_.count(joined(larger)) > 0;
      const bool worth = a.promised > lost - 0.3 * lost - 3.0;
      from.proposals.push_back({a.member(), a.promised, fitted || worth});
      return fitted || !worth;
    });
    std::vector<std::unique_ptr<Hypothesis>> made(additions.size());
    in_parallel(
        additions.size(), [&](std::size_t i) { made[i] = add(from, additions[i], battery); },
        jobs_at_once(rows_.size()));
    keep(std::move(made));
  }

  std::unique_ptr<Hypothesis> add(const Hypothesis& from, const Addition& addition,
                                  const Battery& battery) const {
    auto made = std::make_unique<Hypothesis>();
    made->curves = from.curves;
    made->promised = addition.promised;
    if (addition.name) {
      made->fit = try_model(rows_, from.fit, *addition.name, rates_, options_).fit;
    } else {
      std::optional<CurveFit> curve =
          fit_curve(rows_, battery.projector(), from.fit, *addition.curve, options_);
      if (!curve) return nullptr;
      made->fit = std::move(curve->fit);
      made->curves.push_back(std::move(curve->effect));
    }
    if (made->fit.ok) complete(*made, from);
    return made;
  }

  /// The names whose scores promise most, so many of each kind: what scores promise is comparable within a kind alone.
  std::vector<Addition> name_additions(const Hypothesis& from, const Battery& battery) const {
    std::vector<Addition> additions;
    std::map<EffectKind, std::size_t> taken;
    for (Proposal& p : propose(rows_, battery, from.fit.model)) {
      const EffectInfo& info = p.effect->info();
      if (known_.step_beyond_noise_m > 0.0 && info.channel.starts_with("range_")) continue;
      const std::size_t most = info.kind == EffectKind::mean ? most_of_means : most_of_others;
      if (taken[info.kind]++ >= most) continue;
      Addition a;
      a.promised = p.promised;
      a.name = std::move(p);
      additions.push_back(std::move(a));
    }
    return additions;
  }

  /// The curve of most promise for its parameters in every channel.
  std::vector<Addition> curve_additions(const Hypothesis& from, const Battery& battery) const {
    const double per_parameter = 0.5 * std::log(std::max(10.0, 2.0 * rows_.cell_count));
    std::map<std::string, std::pair<double, const Question*>> best;
    for (const Question& q : battery.questions) {
      if (q.effect || on_grid(known_, q) || curve_channel_of(q.channel) == CurveChannel::none) continue;
      const std::string member = "curve of " + q.channel + " along " + q.covariate;
      const bool has = std::any_of(from.fit.model.begin(), from.fit.model.end(),
                                   [&](const ActiveEffect& m) { return member_name(*m.effect) == member; });
      const double worth = q.gain - per_parameter * q.dof;
      if (has || !(worth > 0.0)) continue;
      auto& [most, question] = best[q.channel];
      if (!question || worth > most) most = worth, question = &q;
    }
    std::vector<Addition> additions;
    for (const auto& [channel, found] : best) {
      Addition a;
      a.curve = *found.second;
      a.promised = found.second->gain;
      additions.push_back(std::move(a));
    }
    return additions;
  }

  const Rows& rows_;
  const Bookkeeping& known_;
  const Rates& rates_;
  const RefitOptions& options_;
  const SelectionPriors& priors_;
  const double root_nll_;
  MemberCounts counts_;
  Hypotheses table_;
  std::set<std::string> fitted_;  ///< keys
  int scanned_ = 0;
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
  Fit root = result.baseline;
  if (!known.model.empty()) {
    root = refit(rows, known.model, start_beside_grids(rows, known, result.baseline.state), refit_options);
    if (!root.ok) root = result.baseline;
    refit_options.settled = static_cast<int>(known.model.size());
  }
  if (options.progress) options.progress("searching for causes", 0.3);
  const SelectionPriors priors;
  Hypotheses table = search_sets(rows, root, known, result.rates, refit_options, priors);
  decide(rows, root, std::move(table), options, refit_options, priors, result);
  return result;
}

}  // namespace rangecal::diagnosis
