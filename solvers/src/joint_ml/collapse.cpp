// SPDX-License-Identifier: BSD-3-Clause
#include "joint_ml/collapse.hpp"

#include <cmath>
#include <limits>
#include <vector>

#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {

namespace {

/// Channels of which every residual can be zeroed.
struct ZeroedChannels {
  bool range = false, bearing = false;
};

ZeroedChannels zeroed_channels(const JointProblem& problem, const Held& held) {
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
  return {range_zeroed, bearing_zeroed};
}

/// NLL [nats] where one sigma has fallen to a thousandth of the start's and all else has followed downhill: below that it
/// falls by the readings times the logarithm, whichever sigma it is.
double nll_of_fallen(const JointProblem& problem, const JointState& start, bool bearing) {
  constexpr double fallen = 1e-3, settled = 0.01;  // [nats]
  const JointSystem system(problem, static_cast<int>(start.alpha.size()),
                           static_cast<int>(start.noise.parameters.size()));
  JointOptions held;
  held.held.sigmas = true;
  JointState state = start;
  double nll = std::numeric_limits<double>::infinity();
  for (int round = 0; round < 10; ++round) {
    if (bearing)
      state.sigma_theta_rad = fallen * start.sigma_theta_rad;
    else
      state.noise.parameters = fallen * start.noise.parameters;
    const JointFit fit = solve_joint_block(problem, state, held);
    if (!(fit.joint_nll < nll - settled)) break;
    nll = fit.joint_nll;
    state = fit.state;
    system.profile_spreads(state);
  }
  return nll;
}

std::string no_maximum(const char* more, const std::string& what_goes) {
  return fmt::format(
      "the joint likelihood has no maximum here: no place has more {} than free coordinates and nothing repeats, so "
      "its residuals can be zeroed and {}; use the marginal method",
      more, what_goes);
}

/// Which of both sigmas goes to 0, seen from `start`.
std::string which_goes(const JointProblem& problem, const JointState& start) {
  const double of_theta = nll_of_fallen(problem, start, true), of_e = nll_of_fallen(problem, start, false);
  const double ahead = std::abs(of_theta - of_e);
  if (!std::isfinite(ahead)) return "sigma_theta or sigma_e goes to 0";
  const bool theta = of_theta < of_e;
  return fmt::format("{} goes to 0 ({} could: at a thousandth of the start's it is {:.1f} nats behind)",
                     theta ? "sigma_theta" : "sigma_e", theta ? "sigma_e" : "sigma_theta", ahead);
}

}  // namespace

std::string unbounded_channel(const JointProblem& problem, const Held& held) {
  const ZeroedChannels zeroed = zeroed_channels(problem, held);
  if (zeroed.bearing)
    return no_maximum("bearings",
                      zeroed.range ? "sigma_theta or sigma_e goes to 0" : "sigma_theta goes to 0");
  return zeroed.range ? no_maximum("ranges", "sigma_e goes to 0") : std::string();
}

bool cannot_start(const JointProblem& problem, const Held& held, JointFit& fit) {
  if (!std::isfinite(fit.start_nll)) {
    fit.reason = "the start lies outside the model's domain: a distance, f(d) or a spread is not positive";
    return true;
  }
  const ZeroedChannels zeroed = zeroed_channels(problem, held);
  if (!zeroed.range && !zeroed.bearing) return false;
  fit.reason = zeroed.range && zeroed.bearing
                   ? no_maximum("bearings, nor more ranges,", which_goes(problem, fit.state))
                   : unbounded_channel(problem, held);
  fit.outcome = Outcome::unbounded;
  return true;
}

}  // namespace rangecal
