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

bool is_listed(const Rows& rows, const DiagnoseOptions& options, const JointState& seed, const Model& best,
               const Model& other, double gap) {
  constexpr double where_separated = 0.5, where_not_known = 1.0;  // nats
  if (!(gap < std::max(where_not_known, options.naming_gap_nats))) return false;
  const Model causes = without(best, other), others = without(other, best);
  // A design that separates the two by more than the tolerated noncentrality leaves the gap to decide.
  const double apart = separation(rows, seed, causes, others, without(other, others));
  return gap < (apart > tolerated_noncentrality ? where_separated
                : apart < 0.0                   ? where_not_known
                                                : options.naming_gap_nats);
}

void add_rivals(const Rows& rows, const DiagnoseOptions& options, const std::vector<Candidate>& ranked,
                SearchResult& result) {
  const Model& best = result.best.fit.model;
  for (const Candidate& rival : ranked) {
    if (result.rivals.size() == most_rivals) return;
    if (without(best, rival.fit.model).empty() || without(rival.fit.model, best).empty()) continue;
    if (is_listed(rows, options, result.baseline.state, best, rival.fit.model,
                  result.best.evidence - rival.evidence))
      result.rivals.push_back(rival);
  }
}

}  // namespace rangecal::diagnosis
