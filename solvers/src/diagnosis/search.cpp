// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/search.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

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
/// Nats over the best free curve of two names that may leave a trace, too.
constexpr double beyond_a_trace = 50.0;
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

/// The steps of the search, each on what those before it found. Of those that answer a question: true once the
/// verdict is known.
class SearchSteps {
 public:
  SearchSteps(const Rows& rows, const Bookkeeping& known, const DiagnoseOptions& options)
      : rows_(rows), known_(known), options_(options) {}

  SearchResult run() {
    result_ = scan_seed_model(rows_, known_, options_, refit_options_);
    if (options_.force)
      fit_forced(rows_, *options_.force, refit_options_, result_);
    else if (!(result_.alarm_p >= options_.alarm_rate && known_.model.empty()) && !known_suffices())
      explain();
    return std::move(result_);
  }

 private:
  void report(const char* stage, double fraction) const {
    if (options_.progress) options_.progress(stage, fraction);
  }
  /// Greedy: the best single effects, then what is left, until the battery is clean.
  void explain() {
    report("explaining", 0.3);
    try_singles();
    if (rows_.pairs) settle_evidence();  // few batches follow any curve: first what predicts them
    drop_soft_names();
    if (!rows_.pairs) settle_evidence();
    if (one_name_answers() || two_names_answer()) return;
    result_.verdict = Verdict::unexplained;
    find_partial(rows_, options_, *root_battery_, singles_, batteries_, result_);
  }

  bool known_suffices();
  void try_singles();
  void drop_soft_names();
  void settle_evidence();
  bool one_name_answers();
  bool two_names_answer();
  bool one_of_pairs_answers(const std::vector<Candidate>& pairs);
  bool pair_with_a_trace_answers(const std::vector<Candidate>& pairs);

  bool is_clean(const Candidate& candidate, std::unique_ptr<Battery>& battery) const;
  bool leaves_a_trace(const Candidate& named, const Battery& battery) const;
  double trace_of_first() const;
  void answer_with_single(std::size_t i);

  const Rows& rows_;
  const Bookkeeping& known_;
  const DiagnoseOptions& options_;
  SearchResult result_;
  RefitOptions refit_options_;
  Candidate root_;  ///< the seed model with what bookkeeping found
  std::unique_ptr<Battery> known_battery_;
  const Battery* root_battery_ = nullptr;
  std::vector<Proposal> proposals_;
  std::vector<Candidate> singles_;                   ///< best first
  std::vector<std::unique_ptr<Battery>> batteries_;  ///< what the first of them leave
  double free_curve_gain_ = 0.0;
  /// Of the singles: errors of the stops that would do, but may stand for two causes.
  std::optional<std::size_t> soaked_;
};

/// The root: the seed model with what bookkeeping found. True if that leaves nothing.
bool SearchSteps::known_suffices() {
  root_.fit = fit_root(rows_, known_, result_.baseline, refit_options_);
  root_.gain = result_.baseline.nll - root_.fit.nll;
  root_battery_ = result_.first.get();
  if (known_.model.empty()) return false;
  if (is_clean(root_, known_battery_)) {
    result_.verdict = Verdict::explained;
    result_.best = std::move(root_);
    result_.last = std::move(known_battery_);
    return true;
  }
  root_battery_ = known_battery_.get();
  refit_options_.settled = static_cast<int>(known_.model.size());
  return false;
}

/// True if the candidate, whose battery this makes, leaves nothing that would have to be explained.
bool SearchSteps::is_clean(const Candidate& candidate, std::unique_ptr<Battery>& battery) const {
  battery = std::make_unique<Battery>(rows_, candidate.fit.model, candidate.fit.state, result_.rates);
  // Readings on a grid are neither normal nor independent: their channel is judged by its means alone, and
  // a further name needs overwhelming evidence.
  const double rate = has_grid(known_.model) ? 1e-5 : clean_rate, step = known_.step_beyond_noise_m;
  for (const Question& q : battery->questions) {
    const bool below_step = step > 0.0 && q.channel == "range" && !(q.size > step);
    if (!on_grid(known_, q) && !below_step && battery->corrected(q) < rate) return false;
  }
  // In its own channel and covariate a free curve must find nothing more.
  for (const ActiveEffect& active : candidate.fit.model)
    for (const Question& q : battery->questions)
      if (!q.effect && q.shape == "smooth" && q.channel == active.effect->info().channel &&
          q.covariate == active.effect->info().covariate && q.log_p < std::log(adequacy_rate))
        return false;
  return true;
}

/// Fits every effect that the root's residuals propose, one at a time.
void SearchSteps::try_singles() {
  proposals_ = propose(rows_, *root_battery_, root_.fit.model);
  if (known_.step_beyond_noise_m > 0.0)  // nothing is left of spread, tails and dependence
    std::erase_if(proposals_,
                  [](const Proposal& p) { return p.effect->info().channel.starts_with("range_"); });
  singles_ = try_all(rows_, root_.fit, proposals_, result_.rates, refit_options_);
  if (refit_options_.settled > 0) let_known_move(rows_, singles_);
  for (Candidate& candidate : singles_) candidate.gain = result_.baseline.nll - candidate.fit.nll;
  result_.tried = singles_;
  free_curve_gain_ = std::max(best_curve(*root_battery_, result_.rates, "range"),
                              best_curve(*root_battery_, result_.rates, "bearing"));
}

/// Errors that the readings of a cell share take up whatever a curve would: they are a name only where no
/// curve explains as much.
void SearchSteps::drop_soft_names() {
  std::erase_if(singles_, [&](const Candidate& c) {
    const Effect& effect = *c.fit.model.back().effect;
    return effect.info().kind == EffectKind::dependence && !effect.acts_on_stops() &&
           free_curve_gain_ > c.evidence;
  });
}

/// The evidence by stops left out too, where that decides; probabilities compare like with like.
void SearchSteps::settle_evidence() {
  settle_by_stops_left_out(rows_, refit_options_, singles_);
  for (Candidate& tried : result_.tried)
    for (const Candidate& c : singles_)
      if (c.fit.model.back().effect == tried.fit.model.back().effect) tried.evidence = c.evidence;
}

void SearchSteps::answer_with_single(std::size_t i) {
  result_.verdict = Verdict::explained;
  result_.best = singles_[i];
  result_.last = std::move(batteries_[i]);
  add_rivals(rows_, options_, singles_, result_);
}

/// One name: clean, close to the best of its kind, and not beaten by a free curve.
bool SearchSteps::one_name_answers() {
  batteries_.resize(std::min<std::size_t>(singles_.size(), largest_start));
  for (std::size_t i = 0; i < batteries_.size(); ++i) {
    const bool leading = singles_[i].evidence > singles_[0].evidence - options_.naming_gap_nats;
    if (!is_clean(singles_[i], batteries_[i]) || soaked_ || !leading ||
        !equals_curve(singles_[i], free_curve_gain_))
      continue;
    if (!may_soak_up(singles_[i], singles_)) {
      answer_with_single(i);
      return true;
    }
    soaked_ = i;
  }
  return false;
}

/// A very strong single cause leaves a trace of its formula's own approximation: a second name that adds
/// next to nothing to it is not a second cause. Noise and dependence have no formula that could be off.
double SearchSteps::trace_of_first() const {
  const bool has_formula =
      !singles_.empty() && singles_[0].fit.model.back().effect->info().kind == EffectKind::mean;
  return has_formula ? trace_share * (root_.fit.nll - singles_[0].fit.nll) : 0.0;
}

/// What the name leaves must be a trace: faint by itself, and weaker than what was named.
bool SearchSteps::leaves_a_trace(const Candidate& named, const Battery& battery) const {
  return std::all_of(battery.questions.begin(), battery.questions.end(), [&](const Question& q) {
    return q.effect || on_grid(known_, q) ||
           (battery.corrected(q) > trace_rate && q.gain - q.dof < named.evidence);
  });
}

/// Two names. Only those are tried that could pass for an answer or keep the first from being one.
bool SearchSteps::two_names_answer() {
  report("combining effects", 0.5);
  const double trace = trace_of_first();
  const bool could_be_one = !singles_.empty() && equals_curve(singles_[0], free_curve_gain_);
  const double enough = could_be_one ? singles_[0].evidence + trace : std::numeric_limits<double>::infinity();
  Combinations combinations(rows_, root_.fit, result_.baseline.nll, result_.rates, refit_options_,
                            free_curve_gain_, enough, options_.naming_gap_nats);
  for (std::size_t i = 0; i < batteries_.size(); ++i) combinations.extend(singles_[i], *batteries_[i]);
  combinations.extend_from_others(proposals_, Combinations::Until::beyond_doubt);
  const std::vector<Candidate>& pairs = combinations.best_first();
  if (could_be_one && !soaked_ && (pairs.empty() || pairs[0].evidence - singles_[0].evidence < trace) &&
      leaves_a_trace(singles_[0], *batteries_[0])) {
    answer_with_single(0);
    return true;
  }
  if (one_of_pairs_answers(pairs)) return true;
  if (soaked_) {
    answer_with_single(*soaked_);
    return true;
  }
  if (!combinations.found_beyond_doubt()) return false;
  // It leaves something: it may not be the right two.
  combinations.extend_from_others(proposals_, Combinations::Until::end);
  return one_of_pairs_answers(pairs) ||
         (combinations.found_beyond_doubt() && pair_with_a_trace_answers(pairs));
}

/// Among the best three: one beyond a free curve that leaves nothing.
bool SearchSteps::one_of_pairs_answers(const std::vector<Candidate>& pairs) {
  for (std::size_t i = 0; i < pairs.size() && i < 3; ++i) {
    std::unique_ptr<Battery> battery;
    if (pairs[i].evidence < pairs[0].evidence - options_.naming_gap_nats) break;
    if (soaked_ && pairs[i].evidence < singles_[*soaked_].evidence + soaked_margin) break;
    if (std::min(pairs[i].evidence, pairs[i].foreseen) <
            free_curve_gain_ + combination_margin(pairs[i].fit.model, root_.fit.model.size()) ||
        !is_clean(pairs[i], battery))
      continue;
    result_.verdict = Verdict::explained;
    result_.best = pairs[i];
    result_.last = std::move(battery);
    add_rivals(rows_, options_, pairs, result_);
    return true;
  }
  return false;
}

/// The best two, beyond doubt by their scores too, where what they leave is a trace of their formulas' approximation.
bool SearchSteps::pair_with_a_trace_answers(const std::vector<Candidate>& pairs) {
  const Candidate& best = pairs.front();
  if (!(std::min(best.evidence, best.foreseen) > free_curve_gain_ + beyond_a_trace)) return false;
  auto battery = std::make_unique<Battery>(rows_, best.fit.model, best.fit.state, result_.rates);
  const bool faint =
      std::all_of(battery->questions.begin(), battery->questions.end(),
                  [&](const Question& q) { return q.gain - q.dof < trace_share * best.evidence; });
  if (!faint || !leaves_a_trace(best, *battery)) return false;
  result_.verdict = Verdict::explained;
  result_.best = best;
  result_.last = std::move(battery);
  add_rivals(rows_, options_, pairs, result_);
  return true;
}

}  // namespace

Fit fit_root(const Rows& rows, const Bookkeeping& known, const Fit& baseline, const RefitOptions& options) {
  if (known.model.empty()) return baseline;
  Fit root = refit(rows, known.model, start_beside_grids(rows, known, baseline.state), options);
  return root.ok ? root : baseline;
}

SearchResult scan_seed_model(const Rows& rows, const Bookkeeping& known, const DiagnoseOptions& options,
                             RefitOptions& refit_options) {
  const auto report = [&](const char* stage, double fraction) {
    if (options.progress) options.progress(stage, fraction);
  };
  SearchResult result;
  report("fitting the seed model", 0.0);
  result.baseline = fit_baseline(rows, options, refit_options, known.model);
  report("scanning the residuals", 0.1);
  result.first = std::make_unique<Battery>(rows, Model{}, result.baseline.state);
  result.first->calibrate(options.null_draws, 1);
  result.rates = result.first->rates;
  result.alarm_p = result.first->alarm_p();
  result.shapes = findings(rows, *result.first, options.alarm_rate);
  result.known = known;
  return result;
}

SearchResult search(const Rows& rows, const Bookkeeping& known, const DiagnoseOptions& options) {
  return SearchSteps(rows, known, options).run();
}

}  // namespace rangecal::diagnosis
