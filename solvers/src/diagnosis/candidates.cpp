// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/candidates.hpp"

#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>

#include "diagnosis/bookkeeping.hpp"
#include "diagnosis/rounds.hpp"
#include "in_parallel.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr int shortlist = 10;
constexpr std::size_t fewest_tried = 3;
constexpr double worth_refining = 5.0;  ///< nats
constexpr double polish = 0.3;          ///< of a gain: more than refining has ever added to it

/// Step of the grid of a parameter that only a grid can find; 0 for labels and numbers of stops, which have
/// nothing in between.
double grid_step(const std::vector<Eigen::VectorXd>& grid, Eigen::Index index) {
  std::set<double> values;
  for (const Eigen::VectorXd& start : grid) values.insert(start[index]);
  double step = 0.0;
  for (auto it = values.begin(); it != values.end(); ++it) {
    if (*it != std::round(*it) && values.size() > 1)
      step = (*values.rbegin() - *values.begin()) / static_cast<double>(values.size() - 1);
  }
  return step;
}

/// Refits from a state whose cells stay at first on the side of a switching distance on which they are: from
/// parameters that are still far off, their readings would carry them back.
Fit refit_from_sides(const Rows& rows, const Model& model, JointState state, const RefitOptions& options) {
  RefitOptions staying = options;
  staying.places_stay = true;
  if (!std::isfinite(calibrate_under(rows, model, state, staying))) return {};
  return refit(rows, model, state, options);
}

/// Scans such parameters of the model's last effect finely around the fit. Their likelihood has steps, one
/// where a reading changes sides; the middle of the highest one is taken, where no reading is about to.
void refine(const Rows& rows, const RefitOptions& options, Fit& fit) {
  constexpr int reach = 12, parts = 8;
  constexpr double level = 0.3;  // nats within which two values are on the same step
  const ActiveEffect& active = fit.model.back();
  const auto& parameters = active.effect->info().parameters;
  const auto grid = active.effect->start_grid(rows.context);
  for (std::size_t j = 0; j < parameters.size(); ++j) {
    const auto index = static_cast<Eigen::Index>(j);
    const double step = parameters[j].discrete ? grid_step(grid, index) / parts : 0.0;
    if (step == 0.0) continue;
    std::vector<Fit> scan;
    for (int k = -reach; k <= reach; ++k) {
      Model model = fit.model;
      model.back().parameters[index] += k * step;
      Fit moved = refit(rows, model, fit.state, options);
      if (moved.ok) scan.push_back(std::move(moved));
    }
    if (scan.empty()) continue;
    const auto best =
        std::min_element(scan.begin(), scan.end(), [](const Fit& a, const Fit& b) { return a.nll < b.nll; });
    auto first = best, last = best;
    while (first != scan.begin() && std::prev(first)->nll < best->nll + level) --first;
    while (std::next(last) != scan.end() && std::next(last)->nll < best->nll + level) ++last;
    Fit middle = *(first + (last - first) / 2);
    if (middle.nll < fit.nll + level) fit = std::move(middle);
  }
}

/// Carries lines of sight near a switching distance over it, one at a time, while that gains: the seed model
/// spread the jump over stops and landmarks, so that some started on the wrong side, where no small move
/// leads back.
void try_sides(const Rows& rows, const RefitOptions& options, Fit& fit) {
  constexpr int most = 4;
  constexpr double level = 0.3;  // nats
  for (int pass = 0; pass < most; ++pass) {
    Fit best = fit;
    for (auto& [model, state] : Sides::others(rows, fit.model, fit.state)) {
      Fit trial = refit_from_sides(rows, model, std::move(state), options);
      if (trial.ok && trial.nll < best.nll) best = std::move(trial);
    }
    if (!(best.nll < fit.nll - level)) return;
    fit = std::move(best);
  }
}

/// Tries the period of an effect that bends around the fit, by a quarter of a peak's width: the likelihood
/// has many peaks beside the highest. Each trial starts from the seed model's geometry, not from one that
/// lies on a wrong peak.
void try_periods(const Rows& rows, const Fit& base, const RefitOptions& options, Fit& fit) {
  constexpr int reach = 3;
  constexpr double part = 0.003;
  const ActiveEffect home = fit.model.back();
  const auto& parameters = home.effect->info().parameters;
  for (std::size_t j = 0; j < parameters.size(); ++j) {
    if (parameters[j].linear || parameters[j].discrete) continue;
    const auto index = static_cast<Eigen::Index>(j);
    for (int k = -reach; k <= reach; ++k) {
      Model model = base.model;
      model.push_back(home);
      for (std::size_t other = 0; other < parameters.size(); ++other)
        if (parameters[other].linear) model.back().parameters[static_cast<Eigen::Index>(other)] = 0.0;
      model.back().parameters[index] *= 1.0 + k * part;
      Fit trial = refit(rows, model, base.state, options);
      if (trial.ok && trial.nll < fit.nll) fit = std::move(trial);
    }
  }
}

/// True if some effect of the fit changes fast with distance: its likelihood has many peaks.
bool bends(const Rows& rows, const Fit& fit) {
  return !working_problem(rows, fit.model, fit.state).problem.cells.bend.empty();
}

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

std::vector<Proposal> propose(const Rows& rows, const Battery& battery, const Model& model) {
  std::map<std::string, Proposal> best;
  std::map<std::string, std::vector<Height>> peaks;  // in the order of the grid
  for (const Question& q : battery.questions) {
    if (!q.effect || contains(model, q.effect) || is_bookkeeping(q.effect->info().kind)) continue;
    Proposal& p = best[q.effect->info().id];
    if (!p.effect || q.gain > p.promised) p = {q.effect, q.start, q.gain, q.log_p, q.gain - q.dof, {}};
    peaks[q.effect->info().id].emplace_back(q.gain, q.start);
  }
  // Effects on dependence, tails and the spread of stops have no mean signature: their scalar tests propose
  // them.
  for (const auto& effect : effect_registry()) {
    const EffectInfo& info = effect->info();
    if (best.count(info.id) || contains(model, effect.get()) || !effect->missing(rows.context).empty())
      continue;
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
      if (p.effect && q.gain <= p.promised) continue;
      const auto grid = effect->start_grid(rows.context);
      if (grid.empty()) continue;
      p = {effect.get(), grid[grid.size() / 2], q.gain, q.log_p, q.gain - q.dof, {}};
    }
  }
  // A period has many peaks of nearly the same height; the refit decides between the highest.
  for (auto& [id, p] : best) {
    const auto& parameters = p.effect->info().parameters;
    if (std::none_of(parameters.begin(), parameters.end(),
                     [](const EffectParameter& q) { return !q.linear && !q.discrete; }))
      continue;
    for (const auto& [height, start] : peaks_of(peaks[id]))
      if (p.others.size() < 3 && height > 0.6 * p.promised - 2.0 && start != p.start)
        p.others.push_back(start);
  }
  std::vector<Proposal> order;
  for (auto& [id, p] : best)
    if (p.promised > 3.0) order.push_back(p);  // less cannot pass the battery's rate
  std::sort(order.begin(), order.end(), [](const Proposal& a, const Proposal& b) { return a.rank > b.rank; });
  if (order.size() > shortlist) order.resize(shortlist);
  return order;
}

double price_of(const ActiveEffect& active, const Rates& rates) {
  const auto& parameters = active.effect->info().parameters;
  const std::string& id = active.effect->info().id;
  if (!rates.within.count(id)) return static_cast<double>(parameters.size());  // no grid: all are fitted
  const auto count = [&](const auto& wanted) {
    return std::count_if(parameters.begin(), parameters.end(), wanted);
  };
  const auto linear = count([](const EffectParameter& p) { return p.linear && !p.discrete; });
  const auto fitted = linear > 0 ? linear : count([](const EffectParameter& p) { return !p.discrete; });
  return static_cast<double>(fitted) + std::log(rates.starts(id));
}

// Effects that change fast with distance let the fit choose, stop by stop, among many bends to lie on: gain
// far beyond what the score promised is that choice, and no evidence.
double credible_gain(const Proposal& proposal) { return 1.5 * proposal.promised + 3.0; }

/// Starts the linear parameters of a proposal where the score puts them: the refit's first Gauss-Newton step
/// does it.
Candidate try_model(const Rows& rows, const Fit& base, const Proposal& proposal, const Rates& rates,
                    const RefitOptions& options, double wanted) {
  Model model = base.model;
  model.push_back({proposal.effect, proposal.start});
  // Tails and dependence named before stay as they are while starts are compared, and move at the end.
  RefitOptions held = options;
  held.settled = std::max(options.settled, static_cast<int>(base.model.size()));
  Candidate candidate;
  std::vector<Fit> fits(1 + proposal.others.size());
  in_parallel(
      fits.size(),
      [&](std::size_t i) {
        Model from = model;
        if (i > 0) from.back().parameters = proposal.others[i - 1];
        fits[i] = refit(rows, from, base.state, held);
      },
      jobs_at_once(rows.size()));
  candidate.fit = std::move(fits[0]);
  for (std::size_t i = 1; i < fits.size(); ++i)
    if (fits[i].ok && (!candidate.fit.ok || fits[i].nll < candidate.fit.nll))
      candidate.fit = std::move(fits[i]);
  const double first = base.nll - candidate.fit.nll;
  if (candidate.fit.ok && first > worth_refining && (1.0 + polish) * first + worth_refining > wanted) {
    refine(rows, held, candidate.fit);
    if (Sides::matter({candidate.fit.model.back()})) {
      try_sides(rows, held, candidate.fit);
      refine(rows, held, candidate.fit);
    }
    const bool of_mean = proposal.effect->info().kind == EffectKind::mean;
    if (of_mean && bends(rows, candidate.fit)) try_periods(rows, base, held, candidate.fit);
    if (held.settled > options.settled) {
      Fit free = refit(rows, candidate.fit.model, candidate.fit.state, options);
      if (free.ok && free.nll < candidate.fit.nll) candidate.fit = std::move(free);
    }
  }
  candidate.promised = proposal.promised;
  candidate.log_p = proposal.log_p;
  candidate.gain = candidate.fit.ok ? base.nll - candidate.fit.nll : 0.0;
  candidate.parameters = static_cast<int>(candidate.fit.free.size());
  const double credible = credible_gain(proposal);
  const bool chosen =
      candidate.fit.ok && candidate.gain > credible && proposal.promised > 0.0 && bends(rows, candidate.fit);
  const double price = price_of(model.back(), rates);
  candidate.evidence = candidate.fit.ok ? (chosen ? credible : candidate.gain) - price : -1e9;
  candidate.foreseen = proposal.promised - price;
  return candidate;
}

std::vector<Candidate> try_all(const Rows& rows, const Fit& base, const std::vector<Proposal>& proposals,
                               const Rates& rates, const RefitOptions& options, double wanted) {
  std::vector<Candidate> tried;
  double best = 0.0;
  // Cannot come near the best any more; what cells share gains more than the test that proposed it says.
  const auto is_beaten = [&](const Proposal& proposal) {
    const bool shared =
        proposal.effect->info().kind == EffectKind::dependence && !proposal.effect->acts_on_stops();
    return proposal.promised < best - 15.0 && tried.size() >= fewest_tried && !shared;
  };
  // Those that are tried whatever comes of them first, then as many at a time as there are cores. Which of
  // them count is decided in their order, as if one had been tried after the other.
  const auto cores = static_cast<std::size_t>(std::max(1, tbb::this_task_arena::max_concurrency()));
  for (std::size_t next = 0; next < proposals.size();) {
    const std::size_t together = tried.size() < fewest_tried ? fewest_tried - tried.size() : cores;
    std::vector<const Proposal*> wave;
    for (; next < proposals.size() && wave.size() < together; ++next)
      if (!is_beaten(proposals[next])) wave.push_back(&proposals[next]);
    std::vector<Candidate> candidates(wave.size());
    in_parallel(
        wave.size(),
        [&](std::size_t i) { candidates[i] = try_model(rows, base, *wave[i], rates, options, wanted); },
        jobs_at_once(rows.size()));
    for (std::size_t i = 0; i < wave.size(); ++i) {
      Candidate& candidate = candidates[i];
      if (is_beaten(*wave[i])) continue;
      // A refit that does not deliver what its score promised has left the region where the score spoke.
      const double least = std::min(3.0, 0.5 * wave[i]->promised - 3.0);
      if (!candidate.fit.ok || candidate.gain < least) continue;
      best = std::max(best, candidate.gain);
      tried.push_back(std::move(candidate));
    }
  }
  std::sort(tried.begin(), tried.end(),
            [](const Candidate& a, const Candidate& b) { return a.evidence > b.evidence; });
  return tried;
}

}  // namespace rangecal::diagnosis
