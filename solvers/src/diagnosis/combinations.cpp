// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/combinations.hpp"

#include <algorithm>
#include <limits>
#include <string>
#include <utility>

namespace rangecal::diagnosis {
namespace {

constexpr std::size_t most_seconds = 6;  ///< effects tried beside one
constexpr std::size_t most_starts = 7;   ///< effects started from, where none makes a pair beyond doubt
constexpr double beyond_doubt = 30.0;    ///< nats over the best free curve

/// Two names for one curve of range over distance: that is a free curve, not two causes, unless they explain
/// far more than any curve does.
bool one_curve(const Model& model) {
  return std::count_if(model.begin(), model.end(), [](const ActiveEffect& a) {
           const EffectInfo& info = a.effect->info();
           return info.channel == "range" && (info.covariate == "range" || info.covariate == "disparity");
         }) > 1;
}

constexpr double bent_margin = 5.0, rigid_margin = 1.5;

/// One parameter, its size: the shape of the change is fixed.
bool is_rigid(const Effect* effect) {
  const std::vector<EffectParameter>& parameters = effect->info().parameters;
  return parameters.size() == 1 && parameters[0].linear;
}

/// The effects that were searched for, after those that bookkeeping found.
Model::const_iterator names_of(const Model& model, std::size_t known) {
  return model.begin() + static_cast<Model::difference_type>(known);
}

}  // namespace

double combination_margin(const Model& model, std::size_t known) {
  const bool rigid = std::all_of(names_of(model, known), model.end(),
                                 [](const ActiveEffect& a) { return is_rigid(a.effect); });
  return rigid ? rigid_margin : bent_margin;
}

bool Combinations::found_beyond_doubt() const {
  return !pairs_.empty() && pairs_[0].evidence > free_curve_ + beyond_doubt &&
         std::all_of(names_of(pairs_[0].fit.model, root_.model.size()), pairs_[0].fit.model.end(),
                     [](const ActiveEffect& a) { return a.effect->info().kind == EffectKind::mean; });
}

void Combinations::extend(const Candidate& first, const Battery& battery) {
  started_.insert(first.fit.model.back().effect);
  std::vector<Proposal> seconds = propose(rows_, battery, first.fit.model);
  // What a second has to gain for the pair to matter.
  const double first_gain = root_.nll - first.fit.nll;
  const double near_best =
      pairs_.empty() ? -std::numeric_limits<double>::infinity() : pairs_[0].evidence - gap_;
  const auto wanted = [&](const Effect* second) {
    Model pair = first.fit.model;
    pair.push_back({second, {}});
    double answer = std::min(free_curve_ + combination_margin(pair, root_.model.size()), enough_);
    if (one_curve(pair)) answer = std::max(answer, dominant * free_curve_);
    return std::max(answer, near_best) - first_gain;
  };
  // Shared errors of cells or stops soak up whatever a first name left over: they are no second name.
  std::erase_if(seconds, [&](const Proposal& p) {
    const std::string& id = p.effect->info().id;
    return id == "cell_effect" || id == "stop_effect" || credible_gain(p) < wanted(p.effect);
  });
  if (seconds.size() > most_seconds) seconds.resize(most_seconds);
  const double least = std::max(std::min(free_curve_ + rigid_margin, enough_), near_best) - first_gain;
  for (Candidate& pair : try_all(rows_, first.fit, seconds, rates_, options_, least)) {
    pair.gain = seed_nll_ - pair.fit.nll;
    pair.evidence = root_.nll - pair.fit.nll;
    pair.foreseen += first.foreseen;
    for (auto name = names_of(pair.fit.model, root_.model.size()); name != pair.fit.model.end(); ++name)
      pair.evidence -= price_of(*name, rates_);
    if (one_curve(pair.fit.model) && !(pair.evidence > dominant * free_curve_)) continue;
    keep(std::move(pair));
  }
  std::sort(pairs_.begin(), pairs_.end(),
            [](const Candidate& a, const Candidate& b) { return a.evidence > b.evidence; });
}

void Combinations::keep(Candidate pair) {
  const auto same = std::find_if(pairs_.begin(), pairs_.end(), [&](const Candidate& other) {
    return std::all_of(pair.fit.model.begin(), pair.fit.model.end(),
                       [&](const ActiveEffect& a) { return contains(other.fit.model, a.effect); });
  });
  if (same == pairs_.end())
    pairs_.push_back(std::move(pair));
  else if (pair.evidence > same->evidence)
    *same = std::move(pair);
}

bool Combinations::extend_alone(const Proposal& proposal) {
  if (!started_.insert(proposal.effect).second) return false;
  Candidate alone = try_model(rows_, root_, proposal, rates_, options_);
  if (!(proposal.promised > 0.0)) alone.foreseen = alone.evidence;  // nothing promised it
  if (alone.fit.ok) extend(alone, Battery(rows_, alone.fit.model, alone.fit.state, rates_));
  return true;
}

void Combinations::complete_best() {
  for (bool more = true; more && !pairs_.empty();) {
    more = false;
    const Model best = pairs_[0].fit.model;
    for (auto name = names_of(best, root_.model.size()); name != best.end() && !more; ++name)
      more = extend_alone({name->effect, name->parameters, 0.0, 0.0, 0.0, {}});
  }
}

void Combinations::extend_from_others(const std::vector<Proposal>& proposals, Until until) {
  complete_best();
  for (const Proposal& proposal : proposals) {
    const bool enough =
        until == Until::beyond_doubt && !pairs_.empty() && pairs_[0].evidence > free_curve_ + beyond_doubt;
    if (enough || started_.size() >= most_starts) break;
    if (proposal.effect->info().kind == EffectKind::mean) extend_alone(proposal);
  }
  complete_best();
}

}  // namespace rangecal::diagnosis
