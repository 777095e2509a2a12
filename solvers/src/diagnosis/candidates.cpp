// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/candidates.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include "diagnosis/bookkeeping.hpp"
#include "diagnosis/joint_scoring.hpp"
#include "diagnosis/refine.hpp"
#include "diagnosis/select/hypothesis.hpp"
#include "in_parallel.hpp"
#include "rangecal/core/quantiles.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr int shortlist = 10;

}  // namespace

std::vector<std::string> ids_of(const Model& model) {
  std::vector<std::string> ids;
  for (const ActiveEffect& active : model) ids.push_back(active.effect->info().id);
  return ids;
}

bool contains(const Model& model, const Effect* effect) {
  return std::any_of(model.begin(), model.end(), [&](const ActiveEffect& a) { return a.effect == effect; });
}

std::vector<Height> peaks_of(const std::vector<Height>& heights) {
  std::vector<Height> peaks;
  for (std::size_t i = 0; i < heights.size(); ++i) {
    const bool rises = i == 0 || heights[i].first >= heights[i - 1].first;
    const bool falls = i + 1 == heights.size() || heights[i].first > heights[i + 1].first;
    if (rises && falls) peaks.push_back(heights[i]);
  }
  std::stable_sort(peaks.begin(), peaks.end(),
                   [](const Height& a, const Height& b) { return a.first > b.first; });
  return peaks;
}

std::vector<Height> peaks_of(const Battery& battery, const Effect& effect, std::size_t most) {
  std::vector<Height> heights;
  for (const Question& q : battery.questions_of(effect)) heights.emplace_back(q.gain, q.start);
  std::vector<Height> peaks = peaks_of(heights);
  if (peaks.size() > most) peaks.resize(most);
  return peaks;
}

std::vector<Proposal> propose(const Rows& rows, const Battery& battery, const Model& model, Proposed of) {
  const auto may_be_proposed = [&](const Effect* effect) {
    return !contains(model, effect) && (of == Proposed::all || effect->info().kind != EffectKind::mean);
  };
  std::map<std::string, Proposal> best;
  std::map<std::string, std::vector<Height>> peaks;  // in the order of the grid
  for (const Question& q : battery.questions) {
    if (!q.effect || !may_be_proposed(q.effect) || is_bookkeeping(q.effect->info().kind)) continue;
    Proposal& p = best[q.effect->info().id];
    if (!p.effect || q.gain > p.predicted_gain) p = {q.effect, q.start, q.gain, q.gain - q.dof, {}};
    peaks[q.effect->info().id].emplace_back(q.gain, q.start);
  }
  // Effects on dependence, tails and the spread of stops have no mean signature: their scalar tests propose
  // them.
  for (const Effect* effect : effects_of(rows.context)) {
    const EffectInfo& info = effect->info();
    if (best.count(info.id) || !may_be_proposed(effect) || !effect->lacking(rows.context).empty()) continue;
    if (info.kind != EffectKind::dependence && info.kind != EffectKind::tail && !effect->acts_on_stops())
      continue;
    for (const Question& q : battery.questions) {
      if (q.effect) continue;
      const bool same_channel = q.channel == info.channel;
      const bool any_channel =
          info.kind == EffectKind::dependence && q.channel.find("_dependence") != std::string::npos;
      const bool any_tail = info.kind == EffectKind::tail && q.channel.find("_tail") != std::string::npos;
      if (!same_channel && !any_channel && !any_tail) continue;
      if (q.log_p > -4.0) continue;
      Proposal& p = best[info.id];
      if (p.effect && q.gain <= p.predicted_gain) continue;
      const auto grid = effect->start_grid(rows.context);
      if (grid.empty()) continue;
      p = {effect, grid[grid.size() / 2], q.gain, q.gain - q.dof, {}};
    }
  }
  // A period has many peaks of nearly the same height; the refit decides between the highest.
  for (auto& [id, p] : best) {
    const auto& parameters = p.effect->info().parameters;
    if (std::none_of(parameters.begin(), parameters.end(),
                     [](const EffectParameter& q) { return !q.linear && !q.discrete; }))
      continue;
    for (const auto& [height, start] : peaks_of(peaks[id]))
      if (p.others.size() < 3 && height > 0.6 * p.predicted_gain - 2.0 && start != p.start)
        p.others.push_back(start);
  }
  std::vector<Proposal> order;
  for (auto& [id, p] : best)
    if (p.predicted_gain > 3.0) order.push_back(p);  // less cannot pass the battery's rate
  std::stable_sort(order.begin(), order.end(),
                   [](const Proposal& a, const Proposal& b) { return a.rank > b.rank; });
  if (order.size() > shortlist) order.resize(shortlist);
  return order;
}

// Effects that change fast with distance let the fit choose, stop by stop, among many modes to lie in: gain
// far beyond what the score predicted is that choice, and no evidence.
double credible_gain(const Proposal& proposal) { return 1.5 * proposal.predicted_gain + 3.0; }

void start_tail_where_likeliest(const Rows& rows, std::size_t member, const RefitOptions& options,
                                Model& model, JointState& state) {
  constexpr std::size_t most_followed = 3;
  constexpr int most_solves = 2;  // the weights and the level of the noise follow each other
  struct Start {
    Eigen::VectorXd parameters;
    JointState state;
    double nll = 0.0;
  };
  std::vector<Start> starts;
  const auto solve = [&](Start& start) {
    model[member].parameters = start.parameters;
    start.nll = calibrate_under(rows, model, start.state, options);
  };
  // Scoring comes from far; elsewhere every start is solved for.
  const bool scored = is_scored_jointly(rows, model, state, options);
  for (const JointState& from : {state, with_robust_noise(rows, without(model, member), state)})
    for (const Eigen::VectorXd& parameters : model[member].effect->start_grid(rows.context)) {
      Start& start = starts.emplace_back(Start{parameters, from});
      model[member].parameters = parameters;
      if (scored)
        start.nll = nll_at(rows, working_problem(rows, model, from), from);
      else
        solve(start);
      if (!std::isfinite(start.nll)) starts.pop_back();
    }
  if (starts.empty()) return;
  std::stable_sort(starts.begin(), starts.end(),
                   [](const Start& a, const Start& b) { return a.nll < b.nll; });
  if (starts.size() > most_followed) starts.resize(most_followed);
  for (Start& start : starts)
    for (int i = 0; i < most_solves && std::isfinite(start.nll); ++i) solve(start);
  Start& best = *std::min_element(starts.begin(), starts.end(),
                                  [](const Start& a, const Start& b) { return a.nll < b.nll; });
  model[member].parameters = best.parameters;
  if (std::isfinite(best.nll)) state = std::move(best.state);
}

Fit fit_proposal(const Rows& rows, const Fit& base, const Proposal& proposal, const RefitOptions& options) {
  Model model = base.model;
  model.push_back({proposal.effect, proposal.start});
  std::vector<Fit> fits(1 + proposal.others.size());
  in_parallel(
      fits.size(),
      [&](std::size_t i) {
        Model from = model;
        if (i > 0) from.back().parameters = proposal.others[i - 1];
        fits[i] = refit(rows, from, base.state, options);
      },
      jobs_at_once(rows.size()));
  Fit best = std::move(fits[0]);
  for (std::size_t i = 1; i < fits.size(); ++i)
    if (fits[i].ok && (!best.ok || fits[i].nll < best.nll)) best = std::move(fits[i]);
  if (best.ok) refine_member(rows, base.state, best.model.size() - 1, options, best);
  return best;
}

}  // namespace rangecal::diagnosis
