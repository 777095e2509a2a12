// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/next_experiments.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "diagnosis/reveal_unseen.hpp"
#include "diagnosis/twins.hpp"
#include "rangecal/core/distributions.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double separable =
    2.0;  ///< noncentrality below which a change tells two models no better than chance
constexpr double worth_listing = 0.2;  ///< power

/// One of the models that explain the mismatch.
struct Member {
  std::vector<std::string> ids;
  Model model;          ///< empty: an unknown of the robot (heading_zero)
  bool fitted = false;  ///< its parameters are estimates
};

bool same_ids(std::vector<std::string> a, std::vector<std::string> b) {
  std::sort(a.begin(), a.end());
  std::sort(b.begin(), b.end());
  return a == b;
}

std::vector<Member> members_of(const SearchResult& found, const Space& space, const Diagnosis& result) {
  std::vector<Member> members{{ids_of(found.best.fit.model), found.best.fit.model, true}};
  for (const auto& set : result.explanations[0].indistinguishable_from) {
    Member member{set, {}, false};
    for (const Candidate& rival : found.rivals)
      if (same_ids(ids_of(rival.fit.model), set)) member = {set, rival.fit.model, true};
    if (!member.fitted)
      for (const std::string& id : set)
        if (const Effect* effect = find_effect(id)) {
          const auto grid = effect->start_grid(space.rows().context);
          if (!grid.empty()) member.model.push_back({effect, grid[grid.size() / 2]});
        }
    members.push_back(std::move(member));
  }
  return members;
}

/// Sets that differ by exact twins alone.
bool exact_twins(const std::vector<std::string>& a, const std::vector<std::string>& b) {
  const auto matched = [](const std::string& id, const std::vector<std::string>& others) {
    const std::vector<std::string> twins = exact_twins_of(id);
    return std::any_of(others.begin(), others.end(), [&](const std::string& other) {
      return other == id || std::find(twins.begin(), twins.end(), other) != twins.end();
    });
  };
  return a.size() == b.size() &&
         (std::all_of(a.begin(), a.end(), [&](const std::string& id) { return matched(id, b); }) ||
          std::all_of(b.begin(), b.end(), [&](const std::string& id) { return matched(id, a); }));
}

/// What B's parameters can do to the readings in the extended design.
std::vector<Space::Direction> span_of(const Space& space, const ExtendedDesign& design, const Member& b) {
  std::vector<Space::Direction> span;
  for (std::size_t e = 0; e < b.model.size(); ++e) {
    const auto& parameters = b.model[e].effect->info().parameters;
    for (std::size_t j = 0; j < parameters.size(); ++j) {
      if (parameters[j].discrete) continue;
      const double step = difference_step(parameters[j], b.model[e].parameters[static_cast<Eigen::Index>(j)]);
      Model up = b.model, down = b.model;
      up[e].parameters[static_cast<Eigen::Index>(j)] += step;
      down[e].parameters[static_cast<Eigen::Index>(j)] -= step;
      span.push_back(space.difference(in_design(design, up), in_design(design, down), 0.5 / step));
    }
  }
  if (b.model.empty()) {
    const std::vector<Eigen::Vector3d> turned(static_cast<std::size_t>(space.rows().problem.stop_count()),
                                              Eigen::Vector3d(0.0, 0.0, 1.0));
    span.push_back(space.of_signature(space.projector().of_stops(turned)));
  }
  if (b.fitted) span.push_back(space.change(in_design(design, b.model)));
  return span;
}

double shapes_of(const Space& space, const Model& model) {
  double sum = 0.0;
  for (const ActiveEffect& active : model) sum += shape_noncentrality(space, active);
  return sum;
}

/// Noncentrality of A against B refitted, less what A's own directions leave of it: a large change is not its
/// linearisation, and that tells nothing from its twin.
double distance(const Space& space, const ExtendedDesign& design, const Member& a, const Member& b) {
  if (exact_twins(a.ids, b.ids)) return 0.0;
  const Space::Direction change = space.change(in_design(design, a.model));
  const Member own{a.ids, a.model, false};
  const double means = std::max(
      0.0, space.left(change, span_of(space, design, b)) - space.left(change, span_of(space, design, own)));
  const double of_a = shapes_of(space, a.model), of_b = shapes_of(space, b.model);
  return means + (of_b > 0.0 && of_a > 0.0 ? 0.0 : b.fitted || of_b == 0.0 ? of_a : 0.0);
}

double separation_power(double noncentrality, double gap_nats) {
  if (!(noncentrality > 0.0)) return 0.0;
  return normal_below((noncentrality - 2.0 * gap_nats) / (2.0 * std::sqrt(noncentrality)));
}

void settle_set(const std::vector<PossibleChange>& menu, const SearchResult& found,
                const DiagnoseOptions& options, const Space& here, Diagnosis& result) {
  const std::vector<Member> members = members_of(found, here, result);
  const std::size_t n = members.size();
  std::vector<std::vector<double>> distances;  // per change, pairs in order
  for (const PossibleChange& change : menu) {
    Space space(change.design.rows, {}, change.design.state);
    if (change.design.first_new_stop >= 0)
      space.mute(change.design.switched_off, change.design.first_new_stop);
    distances.emplace_back();
    for (std::size_t a = 0; a < n; ++a)
      for (std::size_t b = 0; b < a; ++b) {
        double least = distance(space, change.design, members[b], members[a]);
        if (members[a].fitted)
          least = std::min(least, distance(space, change.design, members[a], members[b]));
        distances.back().push_back(least);
      }
  }
  // Members that no change separates count as one.
  std::vector<std::size_t> group(n);
  std::iota(group.begin(), group.end(), std::size_t{0});
  std::size_t pair = 0;
  for (std::size_t a = 0; a < n; ++a)
    for (std::size_t b = 0; b < a; ++b, ++pair) {
      double best = 0.0;
      for (const auto& row : distances) best = std::max(best, row[pair]);
      if (best >= separable) continue;
      const std::size_t from = group[a], to = group[b];
      std::replace(group.begin(), group.end(), from, to);
    }
  std::vector<NextExperiment> list;
  for (std::size_t m = 0; m < menu.size(); ++m) {
    double least = 1e300;
    pair = 0;
    for (std::size_t a = 0; a < n; ++a)
      for (std::size_t b = 0; b < a; ++b, ++pair)
        if (group[a] != group[b]) least = std::min(least, distances[m][pair]);
    if (least > 1e299) continue;
    NextExperiment next{
        menu[m].entry.code, menu[m].entry.change, {}, separation_power(least, options.naming_gap_nats)};
    if (next.power < worth_listing) continue;
    for (const Member& member : members)
      for (const std::string& id : member.ids)
        if (std::find(next.settles.begin(), next.settles.end(), id) == next.settles.end())
          next.settles.push_back(id);
    list.push_back(std::move(next));
  }
  // The menu of pairs goes by cost, which decides between powers that are alike: 1 and all from 0.95 on.
  const auto rank = [&here](double power) { return here.rows().pairs ? std::round(10.0 * power) : power; };
  std::stable_sort(list.begin(), list.end(), [&](const NextExperiment& a, const NextExperiment& b) {
    return rank(a.power) > rank(b.power);
  });
  Explanation& explanation = result.explanations[0];
  bool together = false, exact = false;  // members that no change separates; that nothing ever will
  for (std::size_t a = 0; a < n; ++a)
    for (std::size_t b = 0; b < a; ++b) {
      together = together || group[a] == group[b];
      exact = exact || exact_twins(members[a].ids, members[b].ids);
    }
  std::string words = list.empty() ? "" : list.front().change;
  if (together || list.empty()) {
    if (!words.empty()) words += "; beyond that, ";
    if (here.rows().pairs) {  // what settles an effect is told for stops and landmarks
      words += exact      ? "exact twins, which no recording with this sensor tells apart"
               : together ? "no change on the menu separates them"
                          : "no single change on the menu separates all of them";
      explanation.separated_by = words;
      result.next_experiments = std::move(list);
      return;
    }
    words += exact ? "exact twins, which no recording with this sensor and robot tells apart: "
                   : "no change on the menu separates them; ";
    std::string settled_by = found.best.fit.model.back().effect->info().settled_by;
    for (std::size_t m = 0; m < n; ++m)
      if (together && std::count(group.begin(), group.end(), group[m]) > 1 && !members[m].model.empty()) {
        settled_by = members[m].model.back().effect->info().settled_by;
        break;
      }
    words += settled_by;
  }
  explanation.separated_by = words;
  result.next_experiments = std::move(list);
}

}  // namespace

void add_next_experiments(const Space& space, const SearchResult& found, const DiagnoseOptions& options,
                          const JointState& state, const std::vector<TypicalEffect>& effects,
                          Diagnosis& result) {
  std::vector<PossibleChange> menu;
  for (const MenuEntry& entry : menu_for(space.rows())) {
    ExtendedDesign design = extend(space.rows(), state, entry.code);
    // Lights and waiting only tell of the effects that they take away; the rest is a run repeated.
    const auto taken_away = [&](const std::string& id) { return design.switched_off.count(id) > 0; };
    bool asked = design.switched_off.empty();
    for (const Explanation& explanation : result.explanations) {
      asked = asked || std::any_of(explanation.effects.begin(), explanation.effects.end(), taken_away);
      for (const auto& set : explanation.indistinguishable_from)
        asked = asked || std::any_of(set.begin(), set.end(), taken_away);
    }
    if (asked && design.rows.cell_count > 0) menu.push_back({entry, std::move(design)});
  }
  if (found.verdict == Verdict::explained && !result.explanations.empty() &&
      !result.explanations[0].indistinguishable_from.empty())
    settle_set(menu, found, options, space, result);
  if (options.unseen) reveal_unseen(menu, found, options, space, effects, result);
}

}  // namespace rangecal::diagnosis
