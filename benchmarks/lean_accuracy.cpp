// SPDX-License-Identifier: BSD-3-Clause
// Cylinders that lean, each in a direction of its own, seen by a tilted plane from a loop with turns at the
// stops: accuracy of landmarks, curve, tilt and leans with the leans as unknowns of the joint likelihood
// (fit_leaning). Physical world (rays in three dimensions), another unit of the sensor for each run. Leans
// are known up to one sign for all of them.
//
//   lean_accuracy [runs of each row, default 20]

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <numbers>

#include "rangecal/core/errors.hpp"
#include "rangecal/problems/world/physical/simulate.hpp"
#include "rangecal/solvers/calibrate/truth_score.hpp"
#include "rangecal/solvers/tilt/leaning.hpp"
#include "tilted_worlds.hpp"

namespace {

using namespace rangecal;

constexpr double degree = std::numbers::pi / 180.0;

struct Run {
  bool ok = false, tilt_covered = false, leans_seen = false;
  double landmarks = 0.0, curve = 0.0;  ///< squares [m^2]
  double tilt = 0.0;                    ///< square of the error [rad^2]
  int leans = 0, covered = 0;           ///< estimated and seen; whose 95 % interval holds the true lean
  double lean_sq = 0.0;                 ///< sum of squares of the error of the slopes
};

Run run_of(double tilt_rad, double lean_rad, std::uint64_t repeat) {
  Random random(seed_from("tilt accuracy", {1u, repeat}));
  const world::World world = bench::tilted_world(true, tilt_rad, lean_rad, repeat, random);
  const Recording recording = simulate(world, random.bits());
  const LeaningFit fit = fit_leaning({&recording, 1});
  Run run;
  if (fit.outcome != Outcome::converged) return run;
  const TruthScore score = score_against_truth({&recording, 1}, fit.calibration);
  if (!score.landmark_rmse_m) return run;
  run.ok = true;
  run.landmarks = std::pow(*score.landmark_rmse_m, 2);
  run.curve = bench::curve_error_sq(world.sensor, fit.calibration);
  run.tilt = std::pow(fit.tilt.estimate - tilt_rad, 2);
  run.tilt_covered = fit.tilt.low95 <= tilt_rad && tilt_rad <= fit.tilt.high95;
  run.leans_seen = fit.leans_seen;
  std::array<double, 2> by_sign{};
  for (std::size_t l = 0; l < fit.leans.size(); ++l) {
    const LeanEstimate& lean = fit.leans[l];
    if (!lean.seen) continue;
    ++run.leans;
    run.covered += lean.low95_rad <= lean_rad && lean_rad <= lean.high95_rad;
    const world::Cylinder& cylinder = world.landmarks[l];
    const Eigen::Vector2d truth = std::tan(lean_rad) * Eigen::Vector2d(std::cos(cylinder.lean_azimuth_rad),
                                                                       std::sin(cylinder.lean_azimuth_rad));
    by_sign[0] += (lean.slope - truth).squaredNorm();
    by_sign[1] += (lean.slope + truth).squaredNorm();
  }
  run.lean_sq = std::min(by_sign[0], by_sign[1]);
  return run;
}

}  // namespace

int main(int count, char** arguments) {
  const int runs = count > 1 ? std::atoi(arguments[1]) : 20;
  fmt::print("{:>6} {:>6} {:>6} {:>12} {:>12} {:>14} {:>9} {:>12} {:>12} {:>14} {:>9}\n", "lean", "tilt",
             "runs", "landmarks", "curve", "tilt RMSE", "covered", "leans taken", "leans seen", "slope RMSE",
             "covered");
  fmt::print("{:>6} {:>6} {:>6} {:>12} {:>12} {:>14} {:>9} {:>12} {:>12} {:>14} {:>9}\n", "[deg]", "[deg]",
             "", "RMSE [mm]", "RMSE [mm]", "[deg]", "", "", "", "[deg]", "");
  for (const int lean : {0, 5})
    for (const int tilt : {0, 2, 4, 6, 8, 10}) {
      std::vector<Run> all(static_cast<std::size_t>(runs));
      tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t i) {
        try {
          all[i] = run_of(tilt * degree, lean * degree, i);
        } catch (const InputError&) {
          all[i].ok = false;
        }
      });
      Run sum;
      double used = 0.0, tilt_covered = 0.0, taken = 0.0, cylinders = 0.0;
      for (const Run& run : all) {
        if (!run.ok) continue;
        used += 1.0;
        cylinders += 6.0;
        sum.landmarks += run.landmarks, sum.curve += run.curve, sum.tilt += run.tilt;
        sum.leans += run.leans, sum.covered += run.covered, sum.lean_sq += run.lean_sq;
        tilt_covered += run.tilt_covered;
        taken += run.leans_seen;
      }
      if (used == 0.0) continue;
      const std::string slope =
          sum.leans > 0 ? fmt::format("{:.2f}", std::sqrt(sum.lean_sq / (2.0 * sum.leans)) / degree) : "-";
      const std::string covered =
          sum.leans > 0 ? fmt::format("{:.0f} %", 100.0 * sum.covered / sum.leans) : "-";
      fmt::print(
          "{:>6} {:>6} {:>6} {:>12.1f} {:>12.1f} {:>14.2f} {:>7.0f} % {:>10.0f} % {:>10.0f} % {:>14} {:>9}\n",
          lean, tilt, used, 1e3 * std::sqrt(sum.landmarks / used), 1e3 * std::sqrt(sum.curve / used),
          std::sqrt(sum.tilt / used) / degree, 100.0 * tilt_covered / used, 100.0 * taken / used,
          100.0 * sum.leans / cylinders, slope, covered);
    }
  return 0;
}
