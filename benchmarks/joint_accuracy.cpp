// SPDX-License-Identifier: BSD-3-Clause
// Monte-Carlo accuracy of the estimators of the 2021 problem against the hybrid Cramer-Rao bound at the
// truth.
//
// usage: joint_accuracy [repeats = 1000] [repeats at K = 200 = 200] [scene folder = notebooks_data/scenes]
//
// Per setting and method: RMSE of landmarks and of the curve f over 0.5 ... 5 m as multiples of the bound,
// bias of f at 0.5, 2 and 5 m in standard deviations of the bound, mean of sigma over its true value,
// variance of z-scores (error over the method's own standard deviation), repeats without an answer / with a
// worse likelihood than the seed, milliseconds per solve. 1.012(14) is 1.012 with a Monte-Carlo standard
// error of 0.014. At the end the requirements on `marginal` are counted.
//
// The settings are those of accuracy_settings.hpp; a name gives the noise s(d), sigma_theta and sigma_s.
#include <fmt/core.h>
#include <tbb/parallel_for.h>

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <string>
#include <vector>

#include "accuracy_figures.hpp"
#include "accuracy_settings.hpp"
#include "joint_estimators.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/covariance/cramer_rao.hpp"
#include "rangecal/solvers/study/bound.hpp"

namespace {

using namespace rangecal;
using namespace rangecal::benchmark;

struct Trial {
  Estimated found;
  Eigen::VectorXd phi, z;  ///< z is empty where there is no covariance
  double milliseconds = 0.0;
};

struct Estimator {
  const char* name;
  std::function<Estimated(const JointProblem&, NoiseLaw)> solve;
};

void run(const AccuracySetting& setting, int repeats, const std::vector<Estimator>& estimators,
         Requirements& requirements) {
  const Scene& scene = setting.scene;
  const int coefficients = order + 1, landmarks = static_cast<int>(scene.positions.size()),
            phi_count = coefficients + 2 * landmarks;
  Eigen::VectorXd truth(phi_count);
  truth.head(coefficients) = scene.alpha;
  for (int l = 0; l < landmarks; ++l) truth.segment<2>(coefficients + 2 * l) = scene.positions[l];

  const SceneTruth at = scene_truth(scene, seed_from(setting.name, {0}));
  const auto bound = hybrid_cramer_rao_bound(at.problem, at.state, 400, 1);
  fmt::print("{}, {} repeats\n", setting.name, repeats);
  if (!bound) {
    fmt::print("  no bound: singular information\n");
    return;
  }
  const Eigen::MatrixXd phi_bound = bound->topLeftCorner(phi_count, phi_count);
  const Eigen::MatrixXd curve = curve_rows(curve_points, coefficients),
                        three = curve_rows({0.5, 2.0, 5.0}, coefficients);
  const Eigen::VectorXd three_bound = variance_along(three, phi_bound).cwiseSqrt();

  for (const Estimator& estimator : estimators) {
    std::vector<Trial> trials(repeats);
    tbb::parallel_for(0, repeats, [&](int r) {
      const Recording recording = simulate(scene, seed_from(setting.name, {static_cast<std::uint64_t>(r)}));
      const JointProblem problem = make_joint_problem({&recording, 1});
      Trial& trial = trials[r];
      const auto begin = std::chrono::steady_clock::now();
      trial.found = estimator.solve(problem, scene.noise.law);
      trial.milliseconds =
          std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
      const Estimated& found = trial.found;
      if (!found.ok) return;
      trial.phi.resize(phi_count);
      trial.phi.head(coefficients) = found.alpha;
      for (int l = 0; l < landmarks; ++l) trial.phi.segment<2>(coefficients + 2 * l) = found.landmarks[l];
      if (!found.alpha_covariance) return;
      const Eigen::VectorXd error = trial.phi - truth;
      trial.z.resize(3 + 2 * landmarks);
      trial.z.head(3) = (three * error.head(coefficients))
                            .cwiseQuotient(variance_along(three, *found.alpha_covariance).cwiseSqrt());
      trial.z.tail(2 * landmarks) =
          error.tail(2 * landmarks).cwiseQuotient(found.landmark_variance.cwiseSqrt());
    });

    int failures = 0, worse = 0;
    double milliseconds = 0;
    std::vector<double> landmark_squares, curve_squares, bias[3], sigma_e, sigma_theta, z_curve, z_landmarks;
    Eigen::VectorXd z_mean = Eigen::VectorXd::Zero(3 + 2 * landmarks);
    double z_count = 0.0;
    for (const Trial& trial : trials)
      if (trial.z.size() > 0) z_mean += trial.z, z_count += 1.0;
    z_mean /= std::max(z_count, 1.0);
    for (const Trial& trial : trials) {
      milliseconds += trial.milliseconds / repeats;
      failures += !trial.found.ok;
      worse += trial.found.worse_than_seed;
      if (!trial.found.ok) continue;
      const Eigen::VectorXd error = trial.phi - truth,
                            at_three = (three * error.head(coefficients)).cwiseQuotient(three_bound);
      landmark_squares.push_back(error.tail(2 * landmarks).squaredNorm());
      curve_squares.push_back((curve * error.head(coefficients)).squaredNorm());
      for (int i = 0; i < 3; ++i) bias[i].push_back(at_three[i]);
      sigma_e.push_back(trial.found.sigma_e / scene.noise.parameters[0]);
      sigma_theta.push_back(trial.found.sigma_theta / scene.sigma_theta_rad);
      if (trial.z.size() == 0) continue;
      const Eigen::VectorXd square = (trial.z - z_mean).cwiseAbs2();
      z_curve.push_back(square.head(3).mean());
      z_landmarks.push_back(square.tail(2 * landmarks).mean());
    }
    const Mean rmse_landmarks = rmse_over(landmark_squares, phi_bound.diagonal().tail(2 * landmarks).sum()),
               rmse_curve = rmse_over(curve_squares, variance_along(curve, phi_bound).sum()),
               e = mean_of(sigma_e), theta = mean_of(sigma_theta), of_curve = mean_of(z_curve),
               of_landmarks = mean_of(z_landmarks);
    const Mean biases[3] = {mean_of(bias[0]), mean_of(bias[1]), mean_of(bias[2])};
    fmt::print(
        " {:<11} {:>9} {:>9}  {:+5.2f} {:+5.2f} {:+5.2f}  {:>9} {:>9}  {:>9} {:>9}  {:>3}/{:<2} {:6.2f}\n",
        estimator.name, text(rmse_landmarks), text(rmse_curve), biases[0].value, biases[1].value,
        biases[2].value, text(theta), text(e), text(of_curve), text(of_landmarks), failures, worse,
        milliseconds);
    std::fflush(stdout);
    if (std::string(estimator.name) != "marginal") continue;
    requirements.repeats += repeats;
    requirements.failures += failures;
    requirements.worse += worse;
    requirements.landmarks.ask(setting.name, rmse_landmarks);
    requirements.curve.ask(setting.name, rmse_curve);
    for (const Mean& mean : biases) requirements.bias.ask(setting.name, mean);
    requirements.theta.ask(setting.name, theta);
    requirements.e.ask(setting.name, e);
    requirements.z_curve.ask(setting.name, of_curve);
    requirements.z_landmarks.ask(setting.name, of_landmarks);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const int repeats = argc > 1 ? std::atoi(argv[1]) : 1000,
            long_repeats = argc > 2 ? std::atoi(argv[2]) : 200;
  const std::string folder = argc > 3 ? argv[3] : "notebooks_data/scenes";
  const std::vector<Estimator> estimators = {
      {"closed-form", closed_form}, {"full", full}, {"marginal", marginal}};
  Requirements requirements;
  fmt::print(" {:<11} {:^19}  {:^17}  {:^19}  {:^19}  {:>6} {:>6}\n", "", "RMSE / bound", "bias of f / std",
             "sigma / true", "variance of z", "no/", "");
  fmt::print(" {:<11} {:>9} {:>9}  {:>5} {:>5} {:>5}  {:>9} {:>9}  {:>9} {:>9}  {:>6} {:>6}\n", "method",
             "landmarks", "curve", "0.5 m", "2 m", "5 m", "theta", "e", "curve", "landmarks", "worse", "ms");
  for (const AccuracySetting& setting : accuracy_settings(folder))
    run(setting, setting.scene.stops.size() > 20 ? long_repeats : repeats, estimators, requirements);
  requirements.print();
  return 0;
}
