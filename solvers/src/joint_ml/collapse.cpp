// SPDX-License-Identifier: BSD-3-Clause
#include "joint_ml/collapse.hpp"

#include <cmath>
#include <vector>

namespace rangecal {

std::string unbounded_channel(const JointProblem& problem, const Held& held) {
  if (held.sigmas || problem.cells.size() == 0) return {};
  const Cells& c = problem.cells;
  std::vector<int> cells(problem.place_count, 0), positions(problem.place_count, 0),
      headings(problem.place_count, 0);
  bool range_repeats = false, bearing_repeats = false;
  for (std::size_t i = 0; i < c.size(); ++i) {
    ++cells[problem.stops[c.stop[i]].place];
    range_repeats = range_repeats || c.range_mean_square[i] > 0.0;
    bearing_repeats = bearing_repeats || c.bearing_mean_square[i] > 0.0;
  }
  for (int k = 0; k < problem.stop_count(); ++k) {
    const StopPrior& prior = problem.stops[k];
    if (prior.opens_place && (prior.sigma_xy_m > 0.0 || problem.sigma_s_shared[k]))
      positions[prior.place] = 2;
    if (prior.sigma_heading_rad > 0.0) ++headings[prior.place];
  }
  bool range_zeroed = !range_repeats, bearing_zeroed = !bearing_repeats;
  for (int place = 0; place < problem.place_count; ++place) {
    range_zeroed = range_zeroed && cells[place] <= positions[place];
    bearing_zeroed = bearing_zeroed && cells[place] <= positions[place] + headings[place];
  }
  if (!range_zeroed && !bearing_zeroed) return {};
  return fmt::format(
      "the joint likelihood has no maximum here: no place has more {} than free coordinates and nothing repeats, so "
      "its residuals can be zeroed and {} goes to 0; use the marginal method",
      bearing_zeroed ? "bearings" : "ranges",
      bearing_zeroed && range_zeroed ? "sigma_theta or sigma_e"
      : bearing_zeroed               ? "sigma_theta"
                                     : "sigma_e");
}

bool cannot_start(const JointProblem& problem, const Held& held, JointFit& fit) {
  if (!std::isfinite(fit.start_nll)) {
    fit.reason = "the start lies outside the model's domain: a distance, f(d) or a spread is not positive";
    return true;
  }
  fit.reason = unbounded_channel(problem, held);
  if (fit.reason.empty()) return false;
  fit.outcome = Outcome::unbounded;
  return true;
}

}  // namespace rangecal
