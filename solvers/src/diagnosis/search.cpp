// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/search.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "rangecal/core/errors.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double clean_rate = 0.005;  ///< corrected p below which a model's residuals are not clean
constexpr double adequacy_rate =
    0.003;  ///< p at which a free curve over a named effect's own covariate rejects it
/// Nats by which two names together must beat the best single free curve: one curve beats two names of a
/// kind.
constexpr double combination_margin = 10.0;
constexpr double curve_margin =
    4.0;  ///< nats by which a free curve may beat a single name before it is refused
constexpr double tolerated_noncentrality = 7.0;  ///< below it two effects are twins in this design
constexpr double trace_share = 0.05;
constexpr int largest_start = 3;  ///< single effects that pairs start from
constexpr int shortlist = 10;

bool contains(const Model& model, const Effect* effect) {
  return std::any_of(model.begin(), model.end(), [&](const ActiveEffect& a) { return a.effect == effect; });
}

/// Found by bookkeeping, not by scores.
bool is_bookkeeping(EffectKind kind) {
  return kind == EffectKind::grid || kind == EffectKind::label || kind == EffectKind::detection;
}

bool has_grid(const Bookkeeping& known) {
  return std::any_of(known.model.begin(), known.model.end(),
                     [](const ActiveEffect& a) { return a.effect->info().kind == EffectKind::grid; });
}

/// A question about dependence, tails or spread of a channel whose values sit on a grid.
bool on_grid(const Bookkeeping& known, const Question& q) {
  const auto suffix = q.channel.find('_');
  if (suffix == std::string::npos) return false;
  return std::any_of(known.findings.begin(), known.findings.end(), [&](const Question& f) {
    return f.channel == "grid" && (f.covariate == "range") == (q.channel.substr(0, suffix) == "range");
  });
}

/// Two names for one curve of range over distance: that is a free curve, not two causes.
bool one_curve(const Model& model) {
  return std::count_if(model.begin(), model.end(), [](const ActiveEffect& a) {
           const EffectInfo& info = a.effect->info();
           return info.channel == "range" && (info.covariate == "range" || info.covariate == "disparity");
         }) > 1;
}

struct Proposal {
  const Effect* effect = nullptr;
  Eigen::VectorXd start;
  double promised = 0.0, log_p = 0.0, rank = 0.0;
  std::vector<Eigen::VectorXd> others;  ///< further peaks over the start grid, best first
};

/// The catalogue's entries ordered by what their projected scores promise, best grid point of each.
std::vector<Proposal> propose(const Rows& rows, const Battery& battery, const Model& model) {
  std::map<std::string, Proposal> best;
  std::map<std::string, std::vector<std::pair<double, Eigen::VectorXd>>> peaks;
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
    auto& heights = peaks[id];  // in the order of the grid
    std::vector<std::pair<double, Eigen::VectorXd>> local;
    for (std::size_t i = 0; i < heights.size(); ++i) {
      const bool rises = i == 0 || heights[i].first >= heights[i - 1].first;
      const bool falls = i + 1 == heights.size() || heights[i].first > heights[i + 1].first;
      if (rises && falls && heights[i].first > 0.6 * p.promised - 2.0 && heights[i].second != p.start)
        local.push_back(heights[i]);
    }
    std::sort(local.begin(), local.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
    for (std::size_t i = 0; i < local.size() && i < 3; ++i) p.others.push_back(local[i].second);
  }
  std::vector<Proposal> order;
  for (auto& [id, p] : best)
    if (p.promised > 3.0) order.push_back(p);  // less cannot pass the battery's rate
  std::sort(order.begin(), order.end(), [](const Proposal& a, const Proposal& b) { return a.rank > b.rank; });
  if (order.size() > shortlist) order.resize(shortlist);
  return order;
}

/// What a score's promise is worth once the channel's sigma follows: n/2 log(1 + 2 g / n) of g.
double settled_gain(const Rows& rows, double promised) {
  const double n = static_cast<double>(rows.size());
  return 0.5 * n * std::log1p(2.0 * promised / n);
}

/// One nat per parameter that was fitted or chosen (AIC).
double price_of(const ActiveEffect& active) {
  return static_cast<double>(active.effect->info().parameters.size());
}

/// Starts the linear parameters of a proposal where the score puts them: the refit's first Gauss-Newton step
/// does it.
Candidate try_model(const Rows& rows, const Fit& base, const Proposal& proposal,
                    const RefitOptions& options) {
  Model model = base.model;
  model.push_back({proposal.effect, proposal.start});
  Candidate candidate;
  candidate.fit = refit(rows, model, base.state, options);
  for (const Eigen::VectorXd& other : proposal.others) {
    model.back().parameters = other;
    Fit fit = refit(rows, model, base.state, options);
    if (fit.ok && (!candidate.fit.ok || fit.nll < candidate.fit.nll)) candidate.fit = std::move(fit);
  }
  candidate.promised = proposal.promised;
  candidate.log_p = proposal.log_p;
  candidate.gain = candidate.fit.ok ? base.nll - candidate.fit.nll : 0.0;
  candidate.parameters = static_cast<int>(candidate.fit.free.size());
  candidate.evidence = candidate.fit.ok ? candidate.gain - price_of(candidate.fit.model.back()) : -1e9;
  return candidate;
}

std::vector<Candidate> try_all(const Rows& rows, const Fit& base, const std::vector<Proposal>& proposals,
                               const RefitOptions& options) {
  std::vector<Candidate> tried;
  double best = 0.0;
  for (const Proposal& proposal : proposals) {
    if (proposal.promised < best - 15.0 && tried.size() >= 3) break;  // cannot come near the best any more
    Candidate candidate = try_model(rows, base, proposal, options);
    // A refit that does not deliver what its score promised has left the region where the score spoke.
    if (!candidate.fit.ok || candidate.gain < 0.5 * proposal.promised - 3.0) {
      if (!candidate.fit.ok || candidate.gain < 3.0) continue;
    }
    best = std::max(best, candidate.gain);
    tried.push_back(std::move(candidate));
  }
  std::sort(tried.begin(), tried.end(),
            [](const Candidate& a, const Candidate& b) { return a.evidence > b.evidence; });
  return tried;
}

/// Findings by penalised gain, one per (channel, covariate).
std::vector<Question> findings(const Rows& rows, const Battery& battery) {
  std::vector<Question> shapes;
  for (const Question& q : battery.questions)
    if (!q.effect) shapes.push_back(q);
  const double price = 0.5 * std::log(std::max(10.0, 2.0 * rows.cell_count));
  // A shape of the mean makes readings of a cell hang together, never the other way round: dependence stands
  // back.
  const auto worth = [&](const Question& q) {
    const bool secondary = q.channel.find("_dependence") != std::string::npos ||
                           q.channel.find("_tail") != std::string::npos || q.channel == "stop";
    return (secondary ? 0.6 : 1.0) * q.gain - price * q.dof;
  };
  std::sort(shapes.begin(), shapes.end(),
            [&](const Question& a, const Question& b) { return worth(a) > worth(b); });
  std::vector<Question> kept;
  for (Question& q : shapes) {
    const bool seen = std::any_of(kept.begin(), kept.end(), [&](const Question& k) {
      return k.channel == q.channel && k.covariate == q.covariate;
    });
    if (!seen && battery.corrected(q.log_p) < 0.02) kept.push_back(std::move(q));
    if (kept.size() == 5) break;
  }
  return kept;
}

double smallest_log_p(const Battery& battery) { return battery.strongest().log_p; }

}  // namespace

double separation(const Rows& rows, const JointState& state, const ActiveEffect& cause,
                  const ActiveEffect& rival) {
  const WorkingProblem working = working_problem(rows, {}, state);
  const Projector projector(rows, working.problem, state);
  Signature x;
  x.range = x.bearing = Eigen::VectorXd::Zero(projector.cells());
  bool any = false;
  for (int j = 0; j < static_cast<int>(cause.parameters.size());
       ++j) {  // to first order: sum of slope times size
    const EffectParameter& info = cause.effect->info().parameters[j];
    if (info.discrete || !info.linear || cause.parameters[j] == 0.0) continue;
    const Signature part = effect_signature(rows, projector, cause, j);
    any = any || projector.raw_information(part) > 0.0;
    x.range += cause.parameters[j] * part.range;
    x.bearing += cause.parameters[j] * part.bearing;
    if (!part.within()) continue;
    if (!x.within()) x.range_rows = x.bearing_rows = Eigen::VectorXd::Zero(part.range_rows.size());
    x.range_rows += cause.parameters[j] * part.range_rows;
    x.bearing_rows += cause.parameters[j] * part.bearing_rows;
  }
  if (!any) return -1.0;
  std::vector<Signature> directions;
  for (int j = 0; j < static_cast<int>(rival.parameters.size()); ++j) {
    if (rival.effect->info().parameters[j].discrete) continue;
    Signature y = effect_signature(rows, projector, rival, j);
    if (projector.raw_information(y) > 0.0) directions.push_back(std::move(y));
  }
  if (directions.empty()) return -1.0;
  const Eigen::Index n = static_cast<Eigen::Index>(directions.size());
  const Eigen::VectorXd projected_x = projector.project(x);
  const double whole = projector.inner(x, projected_x, x);
  Eigen::MatrixXd information(n, n);
  Eigen::VectorXd cross(n);
  for (Eigen::Index e = 0; e < n; ++e) {
    const Eigen::VectorXd projected = projector.project(directions[e]);
    for (Eigen::Index f = 0; f < n; ++f)
      information(f, e) = projector.inner(directions[f], projected, directions[e]);
    cross[e] = projector.inner(x, projected, directions[e]);
  }
  return std::max(0.0, whole - cross.dot(information.completeOrthogonalDecomposition().solve(cross)));
}

namespace {

/// Other explanations of the same size that the data do not reject, best first, at most two.
void add_rivals(const Rows& rows, const DiagnoseOptions& options, const std::vector<Candidate>& others,
                SearchResult& result) {
  const Model& best = result.best.fit.model;
  for (const Candidate& rival : others) {
    if (result.rivals.size() == 2) return;
    const ActiveEffect *cause = nullptr, *other = nullptr;
    for (const ActiveEffect& a : best)
      if (!contains(rival.fit.model, a.effect)) cause = &a;
    for (const ActiveEffect& a : rival.fit.model)
      if (!contains(best, a.effect)) other = &a;
    if (!cause || !other) continue;
    const double gap = result.best.evidence - rival.evidence;
    // A design that separates the two by more than the tolerated noncentrality leaves the gap to decide.
    const double apart = separation(rows, result.baseline.state, *cause, *other);
    const double tolerated = apart > tolerated_noncentrality ? 0.5
                             : apart < 0.0                   ? 1.0
                                                             : options.naming_gap_nats;
    if (gap < tolerated) result.rivals.push_back(rival);
  }
}

}  // namespace

SearchResult search(const Rows& rows, const Bookkeeping& known, const DiagnoseOptions& options) {
  const auto report = [&](const char* stage, double fraction) {
    if (options.progress) options.progress(stage, fraction);
  };
  SearchResult result;
  RefitOptions refit_options;
  report("fitting the seed model", 0.0);
  result.baseline = fit_baseline(rows, options, refit_options);
  report("scanning the residuals", 0.1);
  result.first = std::make_unique<Battery>(rows, Model{}, result.baseline.state);
  result.first->calibrate(options.null_draws, 1);
  result.effective_questions = result.first->effective_questions;
  result.alarm_p = result.first->corrected(smallest_log_p(*result.first));
  result.shapes = findings(rows, *result.first);
  result.known = known;

  if (options.force) {
    Model model;
    for (const std::string& id : *options.force) {
      const Effect* effect = find_effect(id);
      if (!effect) throw InputError("no effect is called '" + id + "'");
      Proposal proposal{effect, effect->start_grid(rows.context).front(), 0.0, 0.0, 0.0, {}};
      for (const Proposal& p : propose(rows, *result.first, {}))
        if (p.effect == effect) proposal = p;
      for (const Question& q : result.first->questions)
        if (q.effect == effect && q.gain > proposal.promised)
          proposal = {effect, q.start, q.gain, q.log_p, 0.0, {}};
      Fit base = result.best.fit.ok ? result.best.fit : result.baseline;
      result.best = try_model(rows, base, proposal, refit_options);
    }
    result.best.gain = result.baseline.nll - result.best.fit.nll;
    result.verdict = Verdict::explained;
    result.last = std::make_unique<Battery>(rows, result.best.fit.model, result.best.fit.state);
    result.last->effective_questions = result.effective_questions;
    return result;
  }

  if (result.alarm_p >= options.alarm_rate && known.model.empty()) return result;

  const auto clean = [&](const Candidate& candidate, std::unique_ptr<Battery>& battery) {
    battery = std::make_unique<Battery>(rows, candidate.fit.model, candidate.fit.state);
    battery->effective_questions = result.effective_questions;
    // Readings on a grid are neither normal nor independent: their channel is judged by its means alone, and
    // a further name needs overwhelming evidence.
    double smallest = 0.0;
    for (const Question& q : battery->questions)
      if (!on_grid(known, q)) smallest = std::min(smallest, q.log_p);
    if (battery->corrected(smallest) < (has_grid(known) ? 1e-5 : clean_rate)) return false;
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
    root.fit = refit(rows, known.model, result.baseline.state, refit_options);
    root.gain = result.baseline.nll - root.fit.nll;
    if (!root.fit.ok) root.fit = result.baseline;
    if (clean(root, known_battery)) {
      result.verdict = Verdict::explained;
      result.best = std::move(root);
      result.last = std::move(known_battery);
      return result;
    }
    root_battery = known_battery.get();
  }

  // Greedy: the best single effects, then what is left, until the battery is clean.
  report("explaining", 0.3);
  std::vector<Candidate> singles =
      try_all(rows, root.fit, propose(rows, *root_battery, root.fit.model), refit_options);
  for (Candidate& candidate : singles) candidate.gain = result.baseline.nll - candidate.fit.nll;
  result.tried = singles;
  const double free_curve_gain = [&] {
    double best = 0.0;
    for (const Question& q : result.first->questions)
      if (!q.effect && (q.channel == "range" || q.channel == "bearing"))
        best = std::max(best, settled_gain(rows, q.gain) - q.dof);
    return best;
  }();

  // One name: clean, close to the best of its kind, and not beaten by a free curve.
  std::vector<std::unique_ptr<Battery>> batteries(std::min<std::size_t>(singles.size(), largest_start));
  for (std::size_t i = 0; i < batteries.size(); ++i) {
    const bool leading = singles[i].evidence > singles[0].evidence - options.naming_gap_nats;
    if (clean(singles[i], batteries[i]) && leading && singles[i].evidence > free_curve_gain - curve_margin) {
      result.verdict = Verdict::explained;
      result.best = singles[i];
      result.last = std::move(batteries[i]);
      add_rivals(rows, options, singles, result);
      return result;
    }
  }

  // Two names.
  report("combining effects", 0.5);
  std::vector<Candidate> pairs;
  const auto extend = [&](const Candidate& first, const Battery& battery) {
    std::vector<Proposal> proposals = propose(rows, battery, first.fit.model);
    // Shared errors of cells or stops soak up whatever a first name left over: they are no second name.
    std::erase_if(proposals, [](const Proposal& p) {
      return p.effect->info().id == "cell_effect" || p.effect->info().id == "stop_effect";
    });
    if (proposals.size() > 6) proposals.resize(6);
    for (Candidate& candidate : try_all(rows, first.fit, proposals, refit_options)) {
      candidate.gain = result.baseline.nll - candidate.fit.nll;
      candidate.evidence = candidate.gain;
      for (const ActiveEffect& active : candidate.fit.model) candidate.evidence -= price_of(active);
      if (one_curve(candidate.fit.model)) continue;
      const auto same = std::find_if(pairs.begin(), pairs.end(), [&](const Candidate& other) {
        return std::all_of(candidate.fit.model.begin(), candidate.fit.model.end(),
                           [&](const ActiveEffect& a) { return contains(other.fit.model, a.effect); });
      });
      if (same == pairs.end())
        pairs.push_back(std::move(candidate));
      else if (candidate.evidence > same->evidence)
        *same = std::move(candidate);
    }
    std::sort(pairs.begin(), pairs.end(),
              [](const Candidate& a, const Candidate& b) { return a.evidence > b.evidence; });
  };
  for (std::size_t i = 0; i < batteries.size(); ++i) extend(singles[i], *batteries[i]);
  if (!pairs.empty()) {  // the second of the best pair may have been hidden by the first: start from it as
                         // well
    const ActiveEffect second = pairs[0].fit.model.back();
    const bool started =
        std::any_of(singles.begin(), singles.begin() + static_cast<long>(batteries.size()),
                    [&](const Candidate& c) { return c.fit.model.back().effect == second.effect; });
    if (!started) {
      const Candidate alone =
          try_model(rows, root.fit, {second.effect, second.parameters, 0.0, 0.0, 0.0, {}}, refit_options);
      if (alone.fit.ok) extend(alone, Battery(rows, alone.fit.model, alone.fit.state));
    }
  }
  // A very strong single cause leaves a trace of its formula's own approximation: a second name that adds
  // next to nothing to it is not a second cause.
  const double trace = singles.empty() ? 0.0 : trace_share * singles[0].gain;
  const auto left_by_first = [&] {
    double left = 0.0;
    for (const Question& q : batteries[0]->questions)
      if (!q.effect && !on_grid(known, q)) left = std::max(left, q.gain - q.dof);
    return left;
  };
  if (!pairs.empty() && singles[0].evidence > free_curve_gain - curve_margin &&
      pairs[0].evidence - singles[0].evidence < trace && left_by_first() < trace + 6.0) {
    result.verdict = Verdict::explained;
    result.best = singles[0];
    result.last = std::move(batteries[0]);
    add_rivals(rows, options, singles, result);
    return result;
  }
  for (std::size_t i = 0; i < pairs.size() && i < 3; ++i) {
    std::unique_ptr<Battery> battery;
    if (pairs[i].evidence < pairs[0].evidence - options.naming_gap_nats) break;
    if (pairs[i].evidence < free_curve_gain + combination_margin || !clean(pairs[i], battery)) continue;
    result.verdict = Verdict::explained;
    result.best = pairs[i];
    result.last = std::move(battery);
    add_rivals(rows, options, pairs, result);
    return result;
  }
  result.verdict = Verdict::unexplained;
  return result;
}

}  // namespace rangecal::diagnosis
