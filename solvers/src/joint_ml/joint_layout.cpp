// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <vector>

#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {

JointLayout::JointLayout(const JointProblem& problem, int alphas, int taus, bool sigma_s_free)
    : alpha_count(alphas), landmark_begin(alphas), tau_count(taus) {
  phi_count = alphas + 2 * problem.landmark_count();
  tau_begin = phi_count;
  sigma_theta = tau_begin + taus;
  global_count = sigma_theta + 1;
  if (sigma_s_free) sigma_s = global_count++;

  describe_nodes(problem);
  for (Node& node : nodes) {
    node.columns = alpha_count + sigma_count() + 2 * static_cast<int>(node.landmarks.size());
    node.block = arena;
    node.coordinate = coordinates;
    arena += static_cast<std::size_t>(node.dim) * (2 * node.dim + node.columns);
    coordinates += node.dim;
  }
}

void JointLayout::describe_nodes(const JointProblem& problem) {
  const std::size_t stops = problem.stops.size();
  const Cells& c = problem.cells;
  nodes.resize(problem.place_count);
  node_of_stop.resize(stops);
  slot_of_stop.resize(stops);
  std::vector<int> count(problem.place_count, 0), begin(problem.place_count + 1, 0);
  for (std::size_t k = 0; k < stops; ++k) {
    const int place = problem.stops[k].place;
    node_of_stop[k] = place;
    slot_of_stop[k] = count[place]++;
  }
  std::partial_sum(count.begin(), count.end(), begin.begin() + 1);
  stops_.resize(stops);
  headings_.resize(stops);
  for (std::size_t k = 0; k < stops; ++k) {
    const StopPrior& prior = problem.stops[k];
    Node& node = nodes[prior.place];
    if (prior.opens_place) {
      node.free_position = prior.sigma_xy_m > 0.0 || problem.sigma_s_shared[k];
      node.dim = node.free_position ? 2 : 0;
      node.chained = prior.chained;
      chained = chained || prior.chained;
    }
    const int at = begin[prior.place] + slot_of_stop[k];
    stops_[at] = static_cast<int>(k);
    headings_[at] = prior.sigma_heading_rad > 0.0 ? node.dim++ : -1;
  }

  std::vector<int> seen;
  struct Kept {
    std::size_t node, begin, size;
  };
  std::vector<Kept> kept;
  for (std::size_t j = 0; j < nodes.size(); ++j) {
    Node& node = nodes[j];
    node.stops = {stops_.data() + begin[j], static_cast<std::size_t>(count[j])};
    node.heading = {headings_.data() + begin[j], static_cast<std::size_t>(count[j])};
    seen.clear();
    for (int k : node.stops)
      seen.insert(seen.end(), c.landmark.begin() + c.stop_begin[k], c.landmark.begin() + c.stop_begin[k + 1]);
    const bool once = std::adjacent_find(seen.begin(), seen.end(), std::greater_equal<>()) == seen.end();
    if (once && count[j] == 1) {  // the cells themselves say it
      node.first_cell = c.stop_begin[node.stops[0]];
      node.landmarks = {c.landmark.data() + node.first_cell, seen.size()};
      continue;
    }
    std::sort(seen.begin(), seen.end());
    seen.erase(std::unique(seen.begin(), seen.end()), seen.end());
    kept.push_back({j, landmarks_.size(), seen.size()});
    landmarks_.insert(landmarks_.end(), seen.begin(), seen.end());
    slot_of_cell_.resize(c.size());
    for (int k : node.stops)
      for (int i = c.stop_begin[k]; i < c.stop_begin[k + 1]; ++i)
        slot_of_cell_[i] =
            static_cast<int>(std::lower_bound(seen.begin(), seen.end(), c.landmark[i]) - seen.begin());
  }
  for (const Kept& k : kept) nodes[k.node].landmarks = {landmarks_.data() + k.begin, k.size};  // at rest now
}

JointState step_state(const JointProblem& problem, const JointLayout& layout, const JointState& state,
                      const Eigen::VectorXd& globals, const Eigen::VectorXd& stops) {
  JointState next = state;
  next.alpha += globals.head(layout.alpha_count);
  for (int l = 0; l < problem.landmark_count(); ++l)
    next.landmarks[l] += globals.segment<2>(layout.landmark_begin + 2 * l);
  if (!has_sigma(state.noise.law))
    next.noise.parameters += globals.segment(layout.tau_begin, layout.tau_count);
  else
    next.noise.parameters[0] *= std::exp(globals[layout.tau_begin]);
  next.sigma_theta_rad *= std::exp(globals[layout.sigma_theta]);
  if (layout.sigma_s >= 0) *next.sigma_s_m *= std::exp(globals[layout.sigma_s]);
  for (const JointLayout::Node& node : layout.nodes)
    move_node(node, stops.segment(node.coordinate, node.dim), next);
  return next;
}

void move_node(const JointLayout::Node& node, const Eigen::Ref<const Eigen::VectorXd>& step,
               JointState& state) {
  for (std::size_t slot = 0; slot < node.stops.size(); ++slot) {
    Pose2& pose = state.stops[node.stops[slot]];
    if (node.free_position) {
      pose.x_m += step[0];
      pose.y_m += step[1];
    }
    if (node.heading[slot] >= 0) pose.heading_rad += step[node.heading[slot]];
  }
}

Eigen::VectorXd sigma_coordinates(const JointState& state, bool with_sigma_s) {
  const Eigen::Index taus = state.noise.parameters.size();
  Eigen::VectorXd s(taus + (with_sigma_s ? 2 : 1));
  if (has_sigma(state.noise.law))
    s[0] = std::log(state.noise.parameters[0]);
  else
    s.head(taus) = state.noise.parameters;
  s[taus] = std::log(state.sigma_theta_rad);
  if (with_sigma_s) s[taus + 1] = std::log(*state.sigma_s_m);
  return s;
}

}  // namespace rangecal
