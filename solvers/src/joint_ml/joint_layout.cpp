// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>

#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {

JointLayout::JointLayout(const JointProblem& problem, int alphas, int taus, bool sigma_s_free)
    : alpha_count(alphas), landmark_begin(alphas), tau_count(taus) {
  phi_count = alphas + 2 * problem.landmark_count();
  tau_begin = phi_count;
  sigma_theta = tau_begin + taus;
  global_count = sigma_theta + 1;
  if (sigma_s_free) sigma_s = global_count++;

  nodes.resize(problem.place_count);
  node_of_stop.resize(problem.stops.size());
  slot_of_stop.resize(problem.stops.size());
  slot_of_cell.resize(problem.cells.size());
  for (int k = 0; k < problem.stop_count(); ++k) {
    const StopPrior& prior = problem.stops[k];
    Node& node = nodes[prior.place];
    if (prior.opens_place) {
      node.free_position = prior.sigma_xy_m > 0.0 || problem.sigma_s_shared[k];
      node.dim = node.free_position ? 2 : 0;
      node.chained = prior.chained;
      chained = chained || prior.chained;
    }
    node_of_stop[k] = prior.place;
    slot_of_stop[k] = static_cast<int>(node.stops.size());
    node.stops.push_back(k);
    node.heading.push_back(prior.sigma_heading_rad > 0.0 ? node.dim++ : -1);
    for (int i = problem.cells.stop_begin[k]; i < problem.cells.stop_begin[k + 1]; ++i) {
      const int landmark = problem.cells.landmark[i];
      const auto at = std::lower_bound(node.landmarks.begin(), node.landmarks.end(), landmark);
      if (at == node.landmarks.end() || *at != landmark) node.landmarks.insert(at, landmark);
    }
  }
  for (std::size_t i = 0; i < problem.cells.size(); ++i) {
    const std::vector<int>& seen = nodes[node_of_stop[problem.cells.stop[i]]].landmarks;
    slot_of_cell[i] =
        static_cast<int>(std::lower_bound(seen.begin(), seen.end(), problem.cells.landmark[i]) - seen.begin());
  }
  for (Node& node : nodes) {
    node.columns = alpha_count + sigma_count() + 2 * static_cast<int>(node.landmarks.size());
    node.block = arena;
    node.coordinate = coordinates;
    node.square = squares;
    squares += static_cast<std::size_t>(node.dim) * node.dim;
    arena += static_cast<std::size_t>(node.dim) * (2 * node.dim + node.columns);
    coordinates += node.dim;
  }
}

JointState step_state(const JointProblem& problem, const JointLayout& layout, const JointState& state,
                      const Eigen::VectorXd& globals, const Eigen::VectorXd& stops) {
  JointState next = state;
  next.alpha += globals.head(layout.alpha_count);
  for (int l = 0; l < problem.landmark_count(); ++l)
    next.landmarks[l] += globals.segment<2>(layout.landmark_begin + 2 * l);
  if (state.noise.law == NoiseLaw::polynomial)
    next.noise.parameters += globals.segment(layout.tau_begin, layout.tau_count);
  else
    next.noise.parameters[0] *= std::exp(globals[layout.tau_begin]);
  next.sigma_theta_rad *= std::exp(globals[layout.sigma_theta]);
  if (layout.sigma_s >= 0) *next.sigma_s_m *= std::exp(globals[layout.sigma_s]);
  for (const JointLayout::Node& node : layout.nodes)
    for (std::size_t slot = 0; slot < node.stops.size(); ++slot) {
      Pose2& pose = next.stops[node.stops[slot]];
      if (node.free_position) {
        pose.x_m += stops[node.coordinate];
        pose.y_m += stops[node.coordinate + 1];
      }
      if (node.heading[slot] >= 0) pose.heading_rad += stops[node.coordinate + node.heading[slot]];
    }
  return next;
}

}  // namespace rangecal
