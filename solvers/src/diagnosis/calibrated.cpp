// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/calibrated.hpp"

#include <map>
#include <string>
#include <utility>

#include "rangecal/core/errors.hpp"

namespace rangecal::diagnosis {
namespace {

using Key = std::pair<int, std::string>;  // recording, label

void place_scene(std::span<const Recording> recordings, const Calibration& calibration, Calibrated& result) {
  std::map<Key, Eigen::Vector2d> landmarks;
  for (const LandmarkEstimate& l : calibration.landmarks) landmarks[{l.recording, l.label}] = l.position_m;
  std::map<Key, Pose2> stops;
  for (const StopEstimate& s : calibration.stops) stops[{s.recording, s.label}] = s.pose;
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    const int index = static_cast<int>(r);
    std::vector<char> read(recordings[r].landmarks.size(), 0);
    for (int l : recordings[r].readings.landmark) read[static_cast<std::size_t>(l)] = 1;
    for (std::size_t l = 0; l < recordings[r].landmarks.size(); ++l) {
      const std::string& label = recordings[r].landmarks[l].label;
      const auto found = landmarks.find({index, label});
      if (found == landmarks.end() && read[l])
        throw InputError("the calibration has no place for landmark " + label);
      result.state.landmarks.push_back(found == landmarks.end() ? Eigen::Vector2d::Zero() : found->second);
    }
    for (const Stop& stop : recordings[r].stops) {
      const auto found = stops.find({index, stop.label});
      result.state.stops.push_back(found == stops.end() ? stop.commanded : found->second);
    }
  }
}

}  // namespace

Model model_of(const Calibration& calibration) {
  Model model;
  for (const auto& [id, values] : calibration.effects) {
    const Effect* effect = find_effect(id);
    if (!effect) throw InputError("no effect is called '" + id + "'");
    const auto& parameters = effect->info().parameters;
    Eigen::VectorXd p = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(parameters.size()));
    for (std::size_t j = 0; j < parameters.size(); ++j) {
      const auto value = values.find(parameters[j].name);
      if (value == values.end())
        throw InputError("the effect " + id + " lacks its parameter " + parameters[j].name);
      p[static_cast<Eigen::Index>(j)] = value->second;
    }
    model.push_back({effect, p});
  }
  return model;
}

Calibrated calibrated(std::span<const Recording> recordings, const Calibration& calibration) {
  if (calibration.alpha.size() == 0) throw InputError("the calibration has no curve");
  Calibrated result;
  result.rows = make_rows(recordings, {calibration.scale});
  result.model = model_of(calibration);
  JointState& state = result.state;
  state.alpha = calibration.alpha;
  state.noise = calibration.noise;
  if (result.rows.pairs) {
    state.landmarks = {Eigen::Vector2d::Zero()};
    for (const StopPrior& prior : result.rows.problem.stops) state.stops.push_back(prior.commanded);
    state.sigma_theta_rad = SilentBearing::sigma_theta_rad;
    return result;
  }
  if (!result.rows.reads_bearings())
    state.sigma_theta_rad = SilentBearing::sigma_theta_rad;
  else if (calibration.sigma_theta_rad)
    state.sigma_theta_rad = calibration.sigma_theta_rad->value;
  if (calibration.sigma_s_m) state.sigma_s_m = calibration.sigma_s_m->value;
  place_scene(recordings, calibration, result);
  return result;
}

}  // namespace rangecal::diagnosis
