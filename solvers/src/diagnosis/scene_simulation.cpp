// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/diagnosis/scene_simulation.hpp"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <utility>

#include "diagnosis/simulation_draw.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/problems/world/scene_recording.hpp"

namespace rangecal {
namespace {

constexpr double most_readings_with_effects = 1e7;

/// Parameter of an effect that the scene holds.
double parameter_of(const Scene& scene, const char* id, const char* name) {
  return scene.effects.at(id).at(name);
}

/// Every reading that could be: all repeats of each landmark from each stop, or of each batch, at their times.
void add_every_reading(const Scene& scene, Recording& recording) {
  const std::vector<double> starts = start_times_s(scene);
  Pairs& pairs = recording.pairs;
  for (std::size_t b = 0; b < scene.batches.size(); ++b)
    for (int i = 0; i < scene.batches[b].readings; ++i) {
      pairs.true_m.push_back(scene.batches[b].distance_m);
      if (!starts.empty()) pairs.time_s.push_back(starts[b] + i * scene.timing->sweep_s);
    }
  Readings& readings = recording.readings;
  for (std::size_t k = 0; k < recording.stops.size(); ++k)
    for (std::size_t l = 0; l < recording.landmarks.size(); ++l)
      for (int repeat = 0; repeat < scene.repeats; ++repeat) {
        readings.stop.push_back(static_cast<int>(k));
        readings.landmark.push_back(static_cast<int>(l));
        readings.repeat.push_back(repeat);
        if (!starts.empty()) readings.time_s.push_back(starts[k] + repeat * scene.timing->sweep_s);
      }
}

void check_count(const Scene& scene, std::size_t landmarks) {
  double count = static_cast<double>(scene.stops.size()) * static_cast<double>(landmarks) * scene.repeats;
  for (const SceneBatch& batch : scene.batches) count += batch.readings;
  if (count > most_readings_with_effects)
    throw InputError(fmt::format("scene: {:.3g} readings are more than 1e7, the most with effects", count));
}

/// What a calibration without error would say of the scene, its effects among it.
Calibration truth_of(const Scene& scene, const Recording& layout) {
  Calibration truth;
  truth.kind = scene.kind;
  truth.outcome = Outcome::converged;
  truth.alpha = scene.alpha;
  truth.noise = scene.noise;
  truth.sigma_theta_rad = Estimate{scene.sigma_theta_rad, std::nullopt};
  for (std::size_t l = 0; l < layout.landmarks.size(); ++l)
    truth.landmarks.push_back({0, layout.landmarks[l].label, *layout.truth.landmarks[l], std::nullopt});
  truth.effects = scene.effects;
  return truth;
}

/// Exchanges labels as they are written, of who was read in truth.
void swap_labels(int first, int second, int from_stop, int to_stop, Readings& readings) {
  for (std::size_t i = 0; i < readings.size(); ++i) {
    int& landmark = readings.landmark[i];
    if (readings.stop[i] < from_stop || readings.stop[i] > to_stop) continue;
    if (landmark == first)
      landmark = second;
    else if (landmark == second)
      landmark = first;
  }
}

Recording with_effects(Scene scene, std::uint64_t seed) {
  if (scene.effects.count("reciprocal_noise") > 0)
    scene.noise = {NoiseLaw::f_squared,
                   Eigen::VectorXd::Constant(1, parameter_of(scene, "reciprocal_noise", "cv_per_m"))};
  Recording layout = laid_out(scene, seed);
  check_count(scene, layout.landmarks.size());
  add_every_reading(scene, layout);
  SimulationModel model;
  model.calibration = truth_of(scene, layout);
  // The formulas of a diagnosis say what is left of these in the readings that are there; here it happens.
  model.calibration.effects.erase("dropout");
  model.calibration.effects.erase("label_swap");
  model.recordings.push_back(std::move(layout));
  Recording recording =
      std::move(diagnosis::drawn_recordings(model, seed, {scene.visible_min_m, scene.visible_max_m}).front());
  for (auto& stop : recording.truth.stops) stop->heading_rad = wrap_angle(stop->heading_rad);
  const bool dropout = scene.effects.count("dropout") > 0;
  keep_reported(scene,
                dropout ? parameter_of(scene, "dropout", "limit_m") : std::numeric_limits<double>::infinity(),
                recording);
  if (scene.effects.count("label_swap") > 0) {
    const auto index = [&scene](const char* name) {
      return static_cast<int>(std::lround(parameter_of(scene, "label_swap", name)));
    };
    swap_labels(index("first"), index("second"), index("from_stop"), index("to_stop"), recording.readings);
  }
  return recording;
}

}  // namespace

Recording simulate_scene(const Scene& scene, std::uint64_t seed) {
  if (scene.effects.empty()) return simulate(scene, seed);
  Recording recording = with_effects(scene, seed);
  if (!scene.reads_bearings) recording.readings.bearing_rad.clear();
  return recording;
}

}  // namespace rangecal
