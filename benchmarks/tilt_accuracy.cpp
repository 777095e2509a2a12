// SPDX-License-Identifier: BSD-3-Clause
// Accuracy over the tilt of the scan plane, 0 to 10 degrees about a random level axis, in the physical world (rays in three
// dimensions), on a straight line and on a loop with turns at the stops: of the seed model, and of the model with the tilt as a
// further unknown of the joint likelihood. Another unit of the sensor for each run. With a second argument the cylinders lean,
// each in a direction of its own.
//
//   tilt_accuracy [runs of each row, default 20] [lean of the cylinders in degrees, default 0]

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <cmath>
#include <cstdlib>
#include <numbers>

#include "rangecal/core/errors.hpp"
#include "rangecal/problems/world/physical/simulate.hpp"
#include "rangecal/solvers/calibrate/truth_score.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"
#include "tilted_worlds.hpp"

namespace {

using namespace rangecal;

struct Run {
  bool ok = false;
  double landmarks_seed = 0.0, landmarks_tilt = 0.0, curve_seed = 0.0, curve_tilt = 0.0;  ///< squares [m^2]
  double gain = 0.0;     ///< nats by the tilt
  double angle = 0.0;    ///< estimated [rad]
  bool covered = false;  ///< its 95 % interval holds the true one
};

Run run_of(bool turning, double tilt_rad, double lean_rad, std::uint64_t repeat) {
  Random random(seed_from("tilt accuracy", {turning ? 1u : 0u, repeat}));
  const world::World world = bench::tilted_world(turning, tilt_rad, lean_rad, repeat, random);
  const Recording recording = simulate(world, random.bits());
  DiagnoseOptions options;
  options.held_out = options.unseen = options.next_experiments = false;
  options.null_draws = 20;
  options.force = std::vector<std::string>{"tilt"};
  Run run;
  const Diagnosis diagnosis = diagnose({&recording, 1}, options);
  if (!is_usable(diagnosis.baseline.outcome) || diagnosis.explanations.empty()) return run;
  const TruthScore before = score_against_truth({&recording, 1}, diagnosis.baseline),
                   after = score_against_truth({&recording, 1}, diagnosis.corrected);
  if (!before.landmark_rmse_m || !after.landmark_rmse_m) return run;
  run.landmarks_seed = std::pow(*before.landmark_rmse_m, 2);
  run.landmarks_tilt = std::pow(*after.landmark_rmse_m, 2);
  run.curve_seed = bench::curve_error_sq(world.sensor, diagnosis.baseline);
  run.curve_tilt = bench::curve_error_sq(world.sensor, diagnosis.corrected);
  run.gain = diagnosis.before.nll - diagnosis.after.nll;
  for (const EffectEstimate& e : diagnosis.explanations[0].parameters)
    if (e.name == "tilt.angle_rad") {
      run.angle = e.estimate;
      run.covered = e.low95 <= tilt_rad && tilt_rad <= e.high95;
      run.ok = true;
    }
  return run;
}

}  // namespace

int main(int count, char** arguments) {
  const int runs = count > 1 ? std::atoi(arguments[1]) : 20;
  const double lean_rad = (count > 2 ? std::atof(arguments[2]) : 0.0) * std::numbers::pi / 180.0;
  fmt::print("{:<8} {:>6} {:>6} {:>22} {:>22} {:>10} {:>16} {:>9}\n", "design", "tilt", "runs",
             "landmarks RMSE [mm]", "curve RMSE [mm]", "gain", "tilt estimated", "covered");
  fmt::print("{:<8} {:>6} {:>6} {:>11} {:>10} {:>11} {:>10} {:>10} {:>16} {:>9}\n", "", "[deg]", "", "seed",
             "tilted", "seed", "tilted", "[nats]", "[deg]", "");
  for (const bool turning : {false, true})
    for (const int degrees : {0, 1, 2, 4, 6, 8, 10}) {
      std::vector<Run> all(static_cast<std::size_t>(runs));
      tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t i) {
        try {
          all[i] = run_of(turning, degrees * std::numbers::pi / 180.0, lean_rad, i);
        } catch (const InputError&) {
          all[i].ok = false;
        }
      });
      Run sum;
      double used = 0.0, covered = 0.0, square = 0.0;
      for (const Run& run : all) {
        if (!run.ok) continue;
        used += 1.0;
        sum.landmarks_seed += run.landmarks_seed;
        sum.landmarks_tilt += run.landmarks_tilt;
        sum.curve_seed += run.curve_seed;
        sum.curve_tilt += run.curve_tilt;
        sum.gain += run.gain;
        sum.angle += run.angle;
        square += run.angle * run.angle;
        covered += run.covered;
      }
      if (used == 0.0) continue;
      const double mean = sum.angle / used, deg = 180.0 / std::numbers::pi;
      fmt::print("{:<8} {:>6} {:>6} {:>11.1f} {:>10.1f} {:>11.1f} {:>10.1f} {:>10.1f} {:>16} {:>7.0f} %\n",
                 turning ? "turning" : "line", degrees, used, 1e3 * std::sqrt(sum.landmarks_seed / used),
                 1e3 * std::sqrt(sum.landmarks_tilt / used), 1e3 * std::sqrt(sum.curve_seed / used),
                 1e3 * std::sqrt(sum.curve_tilt / used), sum.gain / used,
                 fmt::format("{:.2f} +- {:.2f}", deg * mean,
                             deg * std::sqrt(std::max(0.0, square / used - mean * mean))),
                 100.0 * covered / used);
    }
  return 0;
}
