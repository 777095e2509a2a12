// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/select/rivals.hpp"

#include <algorithm>

#include "diagnosis/separation.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double tolerated_noncentrality = 7.0;  ///< below it two effects are twins in this design

/// The effects of a model that another does not have.
Model without(const Model& model, const Model& other) {
  Model rest;
  for (const ActiveEffect& active : model)
    if (!contains(other, active.effect)) rest.push_back(active);
  return rest;
}

}  // namespace

double tolerated_gap(const Rows& rows, const DiagnoseOptions& options, const JointState& seed,
                     const Model& best, const Model& other) {
  const Model causes = without(best, other), others = without(other, best);
  // A design that separates the two by more than the tolerated noncentrality leaves the gap to decide.
  const double apart = separation(rows, seed, causes, others, without(other, others));
  return apart > tolerated_noncentrality ? 0.5 : apart < 0.0 ? 1.0 : options.naming_gap_nats;
}

void add_rivals(const Rows& rows, const DiagnoseOptions& options, const std::vector<Candidate>& ranked,
                SearchResult& result) {
  const Model& best = result.best.fit.model;
  for (const Candidate& rival : ranked) {
    if (result.rivals.size() == most_rivals) return;
    if (without(best, rival.fit.model).empty() || without(rival.fit.model, best).empty()) continue;
    const double gap = result.best.evidence - rival.evidence;
    if (gap < std::max(1.0, options.naming_gap_nats) &&
        gap < tolerated_gap(rows, options, result.baseline.state, best, rival.fit.model))
      result.rivals.push_back(rival);
  }
}

}  // namespace rangecal::diagnosis
