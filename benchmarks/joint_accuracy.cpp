// SPDX-License-Identifier: BSD-3-Clause
// Monte-Carlo accuracy of the estimators of the 2021 problem against the hybrid Cramer-Rao bound at the truth.
//
// usage: joint_accuracy [repeats = 1000] [repeats at K = 200 = 200] [scene folder = notebooks_data/scenes]
//
// Per setting and method: RMSE of landmarks and of the curve f over 0.5 ... 5 m as multiples of the bound, bias of f
// at 0.5, 2 and 5 m in standard deviations of the bound, mean of sigma over its true value, variance of z-scores
// (error over the method's own standard deviation), failures, milliseconds per solve.
#include <fmt/core.h>
#include <tbb/parallel_for.h>

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <numbers>
#include <string>
#include <vector>

#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/covariance/cramer_rao.hpp"
#include "rangecal/solvers/joint_ml/joint_ml.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"

namespace {

using namespace rangecal;

struct Setting {
  std::string name;
  Scene scene;
  int repeats;
};

struct Trial {
  bool ok = false, worse_than_seed = false;
  Eigen::VectorXd phi, z;
  double sigma_e = 0.0, sigma_theta = 0.0, milliseconds = 0.0;
};

struct Method {
  const char* name;
  std::function<JointFit(const JointProblem&, const JointState& seed)> solve;
};

const std::vector<double> curve_points = {0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0};

Eigen::MatrixXd curve_rows(const std::vector<double>& at, int coefficients) {
  Eigen::MatrixXd rows(at.size(), coefficients);
  for (std::size_t i = 0; i < at.size(); ++i)
    for (int a = 0; a < coefficients; ++a) rows(i, a) = std::pow(at[i], a);
  return rows;
}

Scene with_sigmas(Scene scene, double sigma_theta_deg, double sigma_s) {
  scene.sigma_theta_rad = sigma_theta_deg * std::numbers::pi / 180.0;
  scene.sigma_xy_m = sigma_s;
  return scene;
}

/// K stops over the same path.
Scene with_stops(Scene scene, int count) {
  const Pose2 first = scene.stops.front().commanded, last = scene.stops.back().commanded;
  const Stop pattern = scene.stops.front();
  scene.stops.assign(count, pattern);
  for (int k = 0; k < count; ++k) {
    const double share = static_cast<double>(k) / (count - 1);
    scene.stops[k].label = std::to_string(k);
    scene.stops[k].commanded.x_m = first.x_m + share * (last.x_m - first.x_m);
    scene.stops[k].commanded.y_m = first.y_m + share * (last.y_m - first.y_m);
  }
  return scene;
}

void run(const Setting& setting, const std::vector<Method>& methods) {
  const Scene& scene = setting.scene;
  const int coefficients = static_cast<int>(scene.alpha.size());
  const int landmarks = static_cast<int>(scene.positions.size()), phi_count = coefficients + 2 * landmarks;
  Eigen::VectorXd truth(phi_count);
  truth.head(coefficients) = scene.alpha;
  for (int l = 0; l < landmarks; ++l) truth.segment<2>(coefficients + 2 * l) = scene.positions[l];

  // The bound, at the truth.
  const Recording first = simulate(scene, seed_from(setting.name, {0}));
  const JointProblem pattern = make_joint_problem({&first, 1});
  JointState at;
  at.alpha = scene.alpha;
  at.noise = scene.noise;
  at.sigma_theta_rad = scene.sigma_theta_rad;
  at.landmarks = scene.positions;
  for (const StopPrior& prior : pattern.stops) at.stops.push_back(prior.commanded);
  const auto bound = hybrid_cramer_rao_bound(pattern, at, 400, 1);
  if (!bound) {
    fmt::print("{:<34} no bound: singular information\n", setting.name);
    return;
  }
  const Eigen::MatrixXd phi_bound = bound->topLeftCorner(phi_count, phi_count);
  const Eigen::MatrixXd curve = curve_rows(curve_points, coefficients), three = curve_rows({0.5, 2.0, 5.0}, coefficients);
  const auto curve_variance = [&](const Eigen::MatrixXd& rows, const Eigen::MatrixXd& covariance) {
    return Eigen::VectorXd((rows * covariance.topLeftCorner(coefficients, coefficients) * rows.transpose()).diagonal());
  };

  for (const Method& method : methods) {
    std::vector<Trial> trials(setting.repeats);
    tbb::parallel_for(0, setting.repeats, [&](int r) {
      const Recording recording = simulate(scene, seed_from(setting.name, {static_cast<std::uint64_t>(r)}));
      const JointProblem problem = make_joint_problem({&recording, 1});
      const auto begin = std::chrono::steady_clock::now();
      const JointState seed = position_seed(problem, coefficients - 1, scene.noise.law);
      const JointFit fit = method.solve(problem, seed);
      Trial& trial = trials[r];
      trial.milliseconds = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
      trial.ok = fit.outcome == Outcome::converged && fit.covariance;
      if (!trial.ok) return;
      trial.phi.resize(phi_count);
      trial.phi.head(coefficients) = fit.state.alpha;
      for (int l = 0; l < landmarks; ++l) trial.phi.segment<2>(coefficients + 2 * l) = fit.state.landmarks[l];
      trial.sigma_e = fit.state.noise.parameters[0] / scene.noise.parameters[0];
      trial.sigma_theta = fit.state.sigma_theta_rad / scene.sigma_theta_rad;
      const Eigen::VectorXd error = trial.phi - truth;
      trial.z.resize(3 + 2 * landmarks);
      trial.z.head(3) = (three * error.head(coefficients)).cwiseQuotient(curve_variance(three, *fit.covariance).cwiseSqrt());
      trial.z.tail(2 * landmarks) = error.tail(2 * landmarks)
                                        .cwiseQuotient(fit.covariance->diagonal().segment(coefficients, 2 * landmarks).cwiseSqrt());
    });

    int used = 0;
    double sigma_e = 0, sigma_theta = 0, milliseconds = 0;
    Eigen::VectorXd mean = Eigen::VectorXd::Zero(phi_count), z_sum = Eigen::VectorXd::Zero(3 + 2 * landmarks), z_square = z_sum;
    double landmark_square = 0, curve_square = 0;
    for (const Trial& trial : trials) {
      milliseconds += trial.milliseconds / setting.repeats;
      if (!trial.ok) continue;
      ++used;
      const Eigen::VectorXd error = trial.phi - truth;
      mean += error;
      landmark_square += error.tail(2 * landmarks).squaredNorm();
      curve_square += (curve * error.head(coefficients)).squaredNorm();
      sigma_e += trial.sigma_e;
      sigma_theta += trial.sigma_theta;
      z_sum += trial.z;
      z_square += trial.z.cwiseAbs2();
    }
    const double n = std::max(used, 1);
    mean /= n;
    const Eigen::VectorXd bias = (three * mean.head(coefficients)).cwiseQuotient(curve_variance(three, phi_bound).cwiseSqrt());
    const Eigen::VectorXd z_mean = z_sum / n, z_variance = z_square / n - z_mean.cwiseAbs2();
    fmt::print("{:<34} {:<12} {:6.3f} {:6.3f}   {:+6.2f} {:+6.2f} {:+6.2f}   {:6.3f} {:6.3f}   {:6.3f} {:6.3f}   {:4d} {:8.3f}\n", setting.name,
               method.name, std::sqrt(landmark_square / n / phi_bound.diagonal().tail(2 * landmarks).sum()),
               std::sqrt(curve_square / n / curve_variance(curve, phi_bound).sum()), bias[0], bias[1], bias[2], sigma_theta / n,
               sigma_e / n, z_variance.head(3).mean(), z_variance.tail(2 * landmarks).mean(), setting.repeats - used, milliseconds);
    std::fflush(stdout);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const int repeats = argc > 1 ? std::atoi(argv[1]) : 1000, long_repeats = argc > 2 ? std::atoi(argv[2]) : 200;
  const std::string folder = argc > 3 ? argv[3] : "notebooks_data/scenes";
  const std::vector<Method> methods = {
      {"full", [](const JointProblem& p, const JointState& s) { return solve_joint_block(p, s); }},
      {"marginal", [](const JointProblem& p, const JointState& s) -> JointFit {
         const JointFit full = solve_joint_block(p, s);
         return solve_marginal(p, full.outcome == Outcome::converged ? full.state : s);
       }}};
  Noise linear, square;
  linear.law = NoiseLaw::f;
  linear.parameters = Eigen::VectorXd::Constant(1, 0.05);
  square.law = NoiseLaw::f_squared;
  square.parameters = Eigen::VectorXd::Constant(1, 0.01);
  fmt::print("{:<34} {:<12} {:>13}   {:>20}   {:>13}   {:>13}   {:>4} {:>8}\n", "setting", "method", "RMSE / bound",
             "bias of f / std", "sigma / true", "var z", "fail", "ms");
  fmt::print("{:<34} {:<12} {:>6} {:>6}   {:>6} {:>6} {:>6}   {:>6} {:>6}   {:>6} {:>6}\n", "", "", "lmark", "curve", "0.5 m",
             "2 m", "5 m", "theta", "e", "curve", "lmark");
  for (const Noise& noise : {linear, square})
    for (int stops : {20, 200})
      for (double sigma_theta_deg : {0.5, 2.0})
        for (double sigma_s : {0.01, 0.05}) {
          Scene scene = with_stops(load_scene(folder + "/2021-setting.yaml"), stops);
          scene.noise = noise;
          const std::string name = fmt::format("K={} s={} theta={:.1f}deg s_s={:.0f}cm", stops, noise.law == NoiseLaw::f ? "0.05f" : "0.01f2",
                                               sigma_theta_deg, 100 * sigma_s);
          run({name, with_sigmas(scene, sigma_theta_deg, sigma_s), stops == 20 ? repeats : long_repeats}, methods);
        }
  const Scene field = load_scene(folder + "/field-layout.yaml");
  run({"field layout", field, repeats}, methods);
  return 0;
}
