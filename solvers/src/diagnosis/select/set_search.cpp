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
#include "in_parallel.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr std::size_t tried_at_once = 5;  ///< additions to one set that are fitted
constexpr int most_expanded = 60;         ///< sets whose residuals are scanned

/// A member to be added to a set: a name, or a curve for what a question found.
struct Addition {
  std::optional<Proposal> name;
  std::optional<Question> curve;
  double outlook = 0.0;  ///< nats that its score promises, less what its parameters cost by a rule of thumb
  std::string member() const {
    return name ? member_name(*name->effect) : "curve of " + curve->channel + " along " + curve->covariate;
  }
};

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

  Hypotheses run() {
    climb();
    while (exchange()) climb();
    std::stable_sort(table_.begin(), table_.end(),
                     [](const auto& a, const auto& b) { return a->log_posterior > b->log_posterior; });
    return std::move(table_);
  }

 private:
  std::size_t known_count() const { return known_.model.size(); }

  Hypothesis& best() {
    return **std::max_element(table_.begin(), table_.end(), [](const auto& a, const auto& b) {
      return a->log_posterior < b->log_posterior;
    });
  }

  /// Adds to the best set, and drops from it, until neither gains.
  void climb() {
    for (;;) {
      Hypothesis& top = best();
      if (top.expanded || expanded_ >= most_expanded) return;
      drop_members(top);
      if (&best() != &top) continue;
      expand(top, -std::numeric_limits<double>::infinity());
    }
  }

  /// Every member of the best set exchanged for what is proposed without it; true if that finds a better set.
  bool exchange() {
    Hypothesis& top = best();
    if (top.fit.model.size() <= known_count() + 0) return false;
    const std::string key = key_of(top.fit.model, known_count());
    const double level = top.log_posterior;
    for (std::size_t i = known_count(); i < top.fit.model.size() && expanded_ < most_expanded; ++i) {
      Hypothesis* without = find(key_without(top.fit.model, i));
      if (!without || without->expanded) continue;
      expand(*without, level - without->log_posterior);
      if (best().log_posterior > level + 1e-9) return true;
    }
    return false;
  }

  std::string key_without(const Model& model, std::size_t member) const {
    Model rest = model;
    rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(member));
    return key_of(rest, known_count());
  }

  Hypothesis* find(const std::string& key) {
    for (const auto& hypothesis : table_)
      if (key_of(hypothesis->fit.model, known_count()) == key) return hypothesis.get();
    return nullptr;
  }

  /// The set without each of its members, where that was not fitted before.
  void drop_members(const Hypothesis& from) {
    std::vector<std::size_t> members;
    for (std::size_t i = known_count(); i < from.fit.model.size(); ++i)
      if (fitted_.insert(key_without(from.fit.model, i)).second) members.push_back(i);
    std::vector<std::unique_ptr<Hypothesis>> made(members.size());
    in_parallel(members.size(), [&](std::size_t n) {
      Model rest = from.fit.model;
      rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(members[n]));
      auto made_here = std::make_unique<Hypothesis>();
      made_here->fit = refit(rows_, rest, from.fit.state, options_);
      made_here->curves = from.curves;
      if (made_here->fit.ok) complete(*made_here, from);
      made[n] = std::move(made_here);
    });
    keep(std::move(made));
  }

  /// Gain and posterior of a set just fitted.
  void complete(Hypothesis& h, const Hypothesis& from) const {
    h.parent = member_names(from.fit.model, known_count());
    h.gain = root_nll_ - h.fit.nll;
    h.parameter_volume = log_parameter_volume(rows_, h.fit, known_count(), options_, priors_);
    h.prior_mass = log_prior_mass(h.fit.model, known_count(), counts_, priors_);
    h.log_posterior = h.gain + h.parameter_volume + h.prior_mass;
    if (!std::isfinite(h.log_posterior)) h.log_posterior = -std::numeric_limits<double>::infinity();
  }

  void keep(std::vector<std::unique_ptr<Hypothesis>> made) {
    for (auto& h : made)
      if (h && h->fit.ok) table_.push_back(std::move(h));
  }

  /// Fits what the scores of its residuals propose to add, where they promise more than `wanted` nats.
  void expand(Hypothesis& from, double wanted) {
    from.expanded = true;
    ++expanded_;
    const Battery battery(rows_, from.fit.model, from.fit.state, rates_);
    if (&from == table_.front().get()) counts_ = count_members(rows_, places_of(battery));
    std::vector<Addition> additions = additions_to(from, battery);
    for (const Addition& a : additions) from.proposals.push_back({a.member(), a.outlook, false});
    std::erase_if(additions, [&](const Addition& a) { return a.outlook < std::max(0.0, wanted - 3.0); });
    std::erase_if(additions, [&](const Addition& a) {
      std::vector<std::string> names = member_names(from.fit.model, known_count());
      names.insert(std::upper_bound(names.begin(), names.end(), a.member()), a.member());
      return fitted_.count(fmt::format("{}", fmt::join(names, "+"))) > 0;
    });
    if (additions.size() > tried_at_once) additions.resize(tried_at_once);
    for (TriedSet::Proposal& p : from.proposals)
      p.fitted = std::any_of(additions.begin(), additions.end(),
                             [&](const Addition& a) { return a.member() == p.member; });
    std::vector<std::unique_ptr<Hypothesis>> made(additions.size());
    in_parallel(
        additions.size(), [&](std::size_t i) { made[i] = add(from, additions[i], battery); },
        jobs_at_once(rows_.size()));
    for (const auto& h : made)
      if (h && h->fit.ok) fitted_.insert(key_of(h->fit.model, known_count()));
    keep(std::move(made));
  }

  std::unique_ptr<Hypothesis> add(const Hypothesis& from, const Addition& addition,
                                  const Battery& battery) const {
    auto made = std::make_unique<Hypothesis>();
    made->curves = from.curves;
    if (addition.name) {
      made->fit = try_model(rows_, from.fit, *addition.name, rates_, options_).fit;
      made->promised = addition.name->promised;
    } else {
      std::optional<CurveFit> curve =
          fit_curve(rows_, battery.projector(), from.fit, *addition.curve, options_);
      if (!curve) return nullptr;
      made->fit = std::move(curve->fit);
      made->curves.push_back(std::move(curve->effect));
      made->promised = addition.curve->gain;
    }
    if (made->fit.ok) complete(*made, from);
    return made;
  }

  /// Places of curves without a name: a channel along a covariate each.
  static double places_of(const Battery& battery) {
    std::set<std::string> places;
    for (const Question& q : battery.questions)
      if (!q.effect && curve_channel_of(q.channel) != CurveChannel::none) places.insert(q.family);
    return static_cast<double>(places.size());
  }

  std::vector<Addition> additions_to(const Hypothesis& from, const Battery& battery) const {
    const double per_parameter = 0.5 * std::log(std::max(10.0, 2.0 * rows_.cell_count));
    std::vector<Addition> additions;
    for (Proposal& p : propose(rows_, battery, from.fit.model)) {
      if (known_.step_beyond_noise_m > 0.0 && p.effect->info().channel.starts_with("range_")) continue;
      Addition a;
      a.outlook = p.promised;
      a.name = std::move(p);
      additions.push_back(std::move(a));
    }
    std::map<std::string, Addition> curves;  // the best of each channel
    for (const Question& q : battery.questions) {
      if (q.effect || on_grid(known_, q) || curve_channel_of(q.channel) == CurveChannel::none) continue;
      const std::string member = "curve of " + q.channel + " along " + q.covariate;
      const bool has = std::any_of(from.fit.model.begin(), from.fit.model.end(),
                                   [&](const ActiveEffect& m) { return member_name(*m.effect) == member; });
      const double outlook = q.gain - per_parameter * q.dof;
      if (has || !(outlook > 0.0)) continue;
      Addition& best = curves[q.channel];
      if (best.curve && best.outlook >= outlook) continue;
      best.curve = q;
      best.outlook = outlook;
    }
    std::stable_sort(additions.begin(), additions.end(),
                     [](const Addition& a, const Addition& b) { return a.outlook > b.outlook; });
    // A curve is fitted only where it promises as much as the names do: it is there to beat them.
    const double names = additions.empty() ? 0.0 : additions.front().outlook;
    if (additions.size() > tried_at_once - 1) additions.resize(tried_at_once - 1);
    std::optional<Addition> curve;
    for (auto& [channel, a] : curves)
      if (!curve || a.outlook > curve->outlook) curve = a;
    if (curve && curve->outlook > 0.7 * names) additions.insert(additions.begin(), std::move(*curve));
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
  int expanded_ = 0;
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
