// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/location.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>
#include <string>
#include <vector>

#include "diagnosis/findings.hpp"
#include "diagnosis/places.hpp"
#include "diagnosis/residual_bins.hpp"

namespace rangecal {

void Finding::set_log_p(double value) {
  log_p = value;
  p_value = std::max(std::exp(value), least_p_value);
}

namespace diagnosis {
namespace {

bool changes_mean(const Question& q) { return q.channel == "range" || q.channel == "bearing"; }
/// True of what is confounded with a change of a mean.
bool is_confounded_with_mean(const Finding& f) {
  return f.channel.find("_dependence") != std::string::npos || f.channel.find("_tail") != std::string::npos ||
         f.channel == "stop";
}

/// The covariate that an effect's curve is a function of.
std::string curve_covariate(const EffectInfo& info) {
  const bool offset = info.channel == "range" && info.covariate == "constant";
  return offset || info.covariate == "disparity" ? "range" : info.covariate;
}

/// Excess of the seed model's chi-square over its degrees of freedom; none where that is within noise.
std::optional<double> excess_of(const Battery& battery) {
  const double excess = battery.cell_chi_sq - battery.cell_dof;
  return excess > 2.0 * std::sqrt(2.0 * battery.cell_dof) ? std::optional(excess) : std::nullopt;
}

/// What the calibration leaves of a fitted change of the means, per row, and how far it lowers chi-square.
struct Trace {
  Eigen::VectorXd range, bearing;  ///< [m], [rad]
  double fall = 0.0;               ///< s^2 / I
};

Trace trace_of(const Rows& rows, const Projector& projector, const Model& effects, const JointState& fitted) {
  const RowChanges changes = row_changes(rows, cell_geometry(rows, fitted), effects);
  Signature x = projector.of_rows(changes.range, changes.bearing);
  add_stop_changes(rows, projector, effects, x);
  const Eigen::VectorXd projected = projector.project(x);
  const double information = projector.inner(x, projected, x);
  const Eigen::Index n = static_cast<Eigen::Index>(rows.size());
  Trace trace{Eigen::VectorXd::Zero(n), Eigen::VectorXd::Zero(n), 0.0};
  if (!(information > 0.0)) return trace;
  trace.fall = std::pow(projector.score(x), 2) / information;
  const int cells = projector.cells();
  const auto left = [](double pull, double weight) { return weight > 0.0 ? pull / weight : 0.0; };
  const Eigen::VectorXd range = projector.unweighted(projected.head(cells));
  for (Eigen::Index i = 0; i < n; ++i) {
    const int c = rows.cell[static_cast<std::size_t>(i)];
    trace.range[i] = range[c];
    trace.bearing[i] = left(projected[cells + c], projector.bearing_information[c]);
    if (!x.within()) continue;
    trace.range[i] += x.range_rows[i];
    trace.bearing[i] += x.bearing_rows[i];
  }
  return trace;
}

/// The change of one channel's rows under effects: means as `trace` has them, log variances about their median.
Eigen::VectorXd change_of(const Rows& rows, const std::string& channel, const Model& effects,
                          const JointState& fitted, const Trace& trace) {
  if (!channel.ends_with("_noise")) return channel == "bearing" ? trace.bearing : trace.range;
  const RowChanges changes = row_changes(rows, cell_geometry(rows, fitted), effects);
  const Eigen::VectorXd& log_variance =
      channel == "bearing_noise" ? changes.bearing_log_variance : changes.range_log_variance;
  // About the median: an estimated noise takes up what most readings have, not what one group does to their mean.
  std::vector<double> sorted(log_variance.begin(), log_variance.end());
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  return (log_variance.array() - *middle).matrix();
}

/// The landmarks that the effects are of, where they are of one each. What the calibration leaves of such a change is on the
/// others too, since the curve follows it.
std::string landmarks_of(const Rows& rows, const Model& effects) {
  std::set<std::string> labels;
  for (const ActiveEffect& active : effects) {
    const auto& parameters = active.effect->info().parameters;
    for (std::size_t j = 0; j < parameters.size(); ++j) {
      if (parameters[j].name != "landmark" || !parameters[j].discrete) continue;
      const auto l = static_cast<std::size_t>(std::lround(active.parameters[static_cast<Eigen::Index>(j)]));
      if (l < rows.context.landmark_labels.size()) labels.insert(rows.context.landmark_labels[l]);
    }
  }
  return fmt::format("{}", fmt::join(labels, ", "));
}

Finding finding_of(const Question& q) {
  Finding f;
  f.channel = q.channel;
  f.covariate = q.covariate;
  f.shape = q.shape == "heavy tails" && q.size < 0.0 ? "light tails" : q.shape;
  f.from = q.from;
  f.to = q.to;
  f.group = q.group;
  f.size = q.size;
  // A change of the stops' mean is sized by the ranges that it moves.
  const bool moves_stops = q.channel == "stop" && q.of == Question::Of::mean && q.size > 0.0;
  f.unit = q.channel == "range" || moves_stops ? "m" : q.channel == "bearing" ? "rad" : "";
  return f;
}

/// A shape that the scan of `battery` saw, its p by the likelihood ratio.
Finding finding_of_shape(const Rows& rows, const SearchResult& found, const Question& q) {
  Finding f = finding_of(q);
  const double log_p = log_chi_sq_survival(2.0 * std::max(0.0, gain_of(rows, q)), q.dof);
  f.set_log_p(found.rates.log_corrected(found.rates.in_family(q.family, log_p)));
  return f;
}

/// What bookkeeping found, by its own p.
Finding finding_of_bookkeeping(const SearchResult& found, const Question& q) {
  Finding f = finding_of(q);
  f.set_log_p(found.rates.log_corrected(found.rates.in_family(q.family, q.log_p)));
  for (const ActiveEffect& active : found.known.model) {
    const EffectInfo& info = active.effect->info();
    if (info.channel == q.channel && (info.channel != "grid" || info.covariate == q.covariate))
      f.effects.push_back(info.id);
  }
  return f;
}

/// The strongest question about an effect, or about what it changes where none is about itself.
Question own_question(const Battery& battery, const ActiveEffect& active) {
  const EffectInfo& info = active.effect->info();
  Question own;
  for (const Question& q : battery.questions)
    if (q.effect == active.effect && q.statistic > own.statistic) own = q;
  if (own.statistic == 0.0)  // dependence, tails, stops: asked after by their channel, or its kind, alone
    for (const Question& q : battery.questions) {
      const std::size_t kind = info.channel.find('_');
      const bool same_kind =
          kind != std::string::npos && q.channel.find(info.channel.substr(kind)) != std::string::npos;
      if (!q.effect && (q.channel == info.channel || same_kind) && q.statistic > own.statistic) own = q;
    }
  if (own.shape == "effect" || own.shape.empty())  // that of the same curve, free
    for (const Question& q : battery.questions)
      if (!q.effect && q.channel == info.channel && q.covariate == info.covariate) {
        own.shape = q.shape;
        break;
      }
  own.from = own.to = std::nullopt;
  own.group.clear();
  return own;
}

/// Parameters of its effects that the fit moved.
int parameters_of(const Fit& fit, const LocatedCurve& curve) {
  return static_cast<int>(std::count_if(fit.free.begin(), fit.free.end(), [&](const FreeParameter& p) {
    return std::count(curve.numbers.begin(), curve.numbers.end(), p.effect) > 0;
  }));
}

/// ln p of a curve: by what the model loses without it.
double log_p_of_curve(const Rows& rows, const SearchResult& found, const LocatedCurve& curve) {
  const Fit& full = found.best.fit;
  Model rest;
  for (std::size_t e = 0; e < full.model.size(); ++e)
    if (std::find(curve.numbers.begin(), curve.numbers.end(), static_cast<int>(e)) == curve.numbers.end())
      rest.push_back(full.model[e]);
  double without = found.baseline.nll;
  if (!rest.empty()) {
    const Fit fit = refit_beside(rows, full, rest, RefitOptions{});
    if (fit.ok) without = found.known.model.empty() ? std::min(without, fit.nll) : fit.nll;
  }
  const int parameters = parameters_of(full, curve);
  double starts = 1.0;
  for (const ActiveEffect& active : curve.effects) starts *= found.rates.starts(active.effect->info().id);
  const double log_p = log_chi_sq_survival(2.0 * std::max(0.0, without - full.nll), std::max(1, parameters));
  return found.rates.log_corrected(log_of_smallest(log_p, starts));
}

/// Where named effects are.
void add_named_curves(const Rows& rows, const SearchResult& found, Diagnosis& result) {
  const Fit& fit = found.best.fit;
  const Projector& projector = found.first->projector();
  const CellGeometry geometry = cell_geometry(rows, found.baseline.state);
  const std::optional<double> excess = excess_of(*found.first);
  for (const LocatedCurve& curve : located_curves(fit.model)) {
    const EffectKind kind = curve.effects.front().effect->info().kind;
    Question own = own_question(*found.first, curve.effects.front());
    own.channel = curve.channel;
    own.covariate = curve.covariate;
    Finding f = finding_of(own);
    if (curve.effects.size() > 1) f.shape = "joint curve";
    f.effects = ids_of(curve.effects);
    f.set_log_p(log_p_of_curve(rows, found, curve));
    if (kind == EffectKind::mean || kind == EffectKind::noise) {
      const Trace trace = trace_of(rows, projector, curve.effects, fit.state);
      const Eigen::VectorXd change = change_of(rows, f.channel, curve.effects, fit.state, trace);
      if (curve.effects.size() > 1)
        f.size = std::sqrt(change.squaredNorm() / static_cast<double>(change.size()));
      if (f.covariate == "landmark")
        if (std::string own_landmarks = landmarks_of(rows, curve.effects); !own_landmarks.empty())
          f.group = std::move(own_landmarks);
      place_by_change(rows, geometry, change, f);
      if (kind == EffectKind::mean && excess && trace.fall > 0.0)
        f.share = (trace.fall - parameters_of(fit, curve)) / *excess;
    }
    result.location.push_back(std::move(f));
  }
}

/// True if the completed model leaves something of the finding's channel and covariate.
bool is_left(const SearchResult& found, const Question& q) {
  constexpr double significance_level = 1e-5;
  return found.last &&
         std::any_of(found.last->questions.begin(), found.last->questions.end(), [&](const Question& after) {
           return !after.effect && after.channel == q.channel && after.covariate == q.covariate &&
                  !on_grid(found.known, after) && found.last->corrected(after) < significance_level;
         });
}

/// What the scan saw of channels and covariates that have no finding yet.
void add_shapes(const Rows& rows, const SearchResult& found, const GenericModel* generic, Diagnosis& result) {
  const CellGeometry geometry = cell_geometry(rows, found.baseline.state);
  const std::optional<double> excess = excess_of(*found.first);
  const std::vector<Question>& shapes = found.partly() ? found.left : found.shapes;
  const std::size_t named = result.location.size();
  double strongest_mean = 0.0;  // ln p
  for (const Question& q : shapes)
    if (changes_mean(q)) strongest_mean = std::min(strongest_mean, finding_of_shape(rows, found, q).log_p);
  for (const Question& q : shapes) {
    const auto seen = std::find_if(result.location.begin(), result.location.end(), [&](const Finding& f) {
      return f.channel == q.channel && f.covariate == q.covariate;
    });
    // What a name leaves of its own curve is a finding of its own.
    if (seen != result.location.end() && !found.partly()) continue;
    Finding f = finding_of_shape(rows, found, q);
    if (changes_mean(q) && excess && q.covariate != "repeat" && !found.partly())
      f.share = (q.statistic - q.dof) / *excess;
    if (found.verdict == Verdict::explained && is_left(found, q)) {
      // Of effects that were asked for: none of them accounts for it.
    } else if (found.verdict == Verdict::explained) {
      double worth = 0.0;  // ln p of the causes that it is confounded with
      for (std::size_t i = 0; i < named; ++i) {
        const Finding& cause = result.location[i];
        if (cause.channel != f.channel) continue;
        f.effects.insert(f.effects.end(), cause.effects.begin(), cause.effects.end());
        worth = std::min(worth, cause.log_p);
      }
      if (f.effects.empty()) {
        f.effects = result.final_effects;
        for (std::size_t i = 0; i < named; ++i) worth = std::min(worth, result.location[i].log_p);
      }
      f.set_log_p(std::max(f.log_p, worth));
      for (std::size_t i = 0; i < named && f.share; ++i) {
        const std::optional<double>& cause = result.location[i].share;
        f.share = cause ? std::optional(std::min(*f.share, *cause)) : std::nullopt;
      }
    } else {
      f.effects = {"generic"};
      if (is_confounded_with_mean(f)) f.set_log_p(std::max(f.log_p, strongest_mean));
    }
    const bool corrected = generic && generic->effect && generic->effect->info().channel == f.channel &&
                           generic->effect->info().covariate == f.covariate;
    if (corrected) {
      const Model curve{generic->fit.model.back()};
      const Trace trace = trace_of(rows, found.first->projector(), curve, generic->fit.state);
      place_by_change(rows, geometry, change_of(rows, f.channel, curve, generic->fit.state, trace), f);
      if (changes_mean(q) && excess && found.partly())
        f.share = (trace.fall - static_cast<double>(curve.front().parameters.size())) / *excess;
    }
    close_place(rows, geometry, f);
    result.location.push_back(std::move(f));
  }
}

}  // namespace

std::vector<LocatedCurve> located_curves(const Model& model) {
  std::vector<LocatedCurve> curves;
  for (std::size_t e = 0; e < model.size(); ++e) {
    const EffectInfo& info = model[e].effect->info();
    if (is_bookkeeping(info.kind)) continue;
    const auto joint = std::find_if(curves.begin(), curves.end(), [&](const LocatedCurve& c) {
      const EffectInfo& other = c.effects.front().effect->info();
      return other.kind == info.kind && other.channel == info.channel &&
             curve_covariate(other) == curve_covariate(info);
    });
    if (joint == curves.end()) {
      curves.push_back({info.channel, info.covariate, {model[e]}, {static_cast<int>(e)}});
      continue;
    }
    if (joint->covariate != info.covariate) joint->covariate = curve_covariate(info);
    joint->effects.push_back(model[e]);
    joint->numbers.push_back(static_cast<int>(e));
  }
  return curves;
}

void order_location(std::vector<Finding>& location) {
  static constexpr double none = -std::numeric_limits<double>::infinity();
  std::stable_sort(location.begin(), location.end(), [](const Finding& a, const Finding& b) {
    if (a.log_p != b.log_p) return a.log_p < b.log_p;
    return a.share.value_or(none) > b.share.value_or(none);
  });
}

void add_location(const Rows& rows, const SearchResult& found, const GenericModel* generic,
                  Diagnosis& result) {
  result.location.clear();
  if (found.verdict == Verdict::no_mismatch) return;
  const CellGeometry geometry = cell_geometry(rows, found.baseline.state);
  const auto add_bookkeeping = [&] {
    for (const Question& q : found.known.findings) {
      result.location.push_back(finding_of_bookkeeping(found, q));
      if (!found.named())
        result.location.back().effects = result.final_effects;  // it is there, but no answer
      close_place(rows, geometry, result.location.back());
    }
  };
  if (found.named()) {
    add_bookkeeping();
    add_named_curves(rows, found, result);
  }
  add_shapes(rows, found, generic, result);
  if (!found.named()) add_bookkeeping();
  if (result.location.empty() && !found.first->questions.empty()) {
    result.location.push_back(finding_of_shape(rows, found, found.first->strongest()));
    result.location.back().effects = result.final_effects;
  }
  order_location(result.location);
}

}  // namespace diagnosis
}  // namespace rangecal
