// SPDX-License-Identifier: BSD-3-Clause
// How often the 95 % intervals of `marginal` hold the truth. Worlds of ten designs, their curve, noise,
// landmarks and stops drawn anew each time, and redrawn where the expected information leaves a variance
// fewer than 20 degrees of freedom (1 / (2 var log sigma)). Intervals: estimate +- 1.96 standard deviations,
// and +- the quantile of Student's t with Satterthwaite's degrees of freedom, for curve, landmarks and stops;
// +- 1.96 standard deviations, and by the profile of the REML criterion, for the sigmas.
//
//   coverage_study WORLDS [THREADS]
#include <tbb/parallel_for.h>

#include <algorithm>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <cstdio>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "bent_path.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/covariance/cramer_rao.hpp"
#include "rangecal/solvers/diagnosis/scene_covariance.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"
#include "rangecal/solvers/marginal/profile_interval.hpp"
#include "threads.hpp"

namespace {

using namespace rangecal;

constexpr double z95 = 1.959963984540054;

struct Design {
  const char* name;
  int stops, landmarks, repeats;
  bool turns = false, walk = false, headings = false, estimate = false;
  NoiseLaw law = NoiseLaw::f_squared;
};
const Design designs[] = {
    {"20 stops, 5 landmarks", 20, 5, 1},
    {"8 stops, 5 landmarks, 3 repeats", 8, 5, 3},
    {"60 stops, 3 landmarks", 60, 3, 1},
    {"6 stops, 6 landmarks, 5 repeats", 6, 6, 5},
    {"20 stops, 5 landmarks, headings", 20, 5, 1, true, false, true},
    {"20 stops, 5 landmarks, random walk", 20, 5, 1, true, true, true},
    {"30 stops, 5 landmarks, sigma_xy", 30, 5, 2, false, false, false, true},
    {"20 stops, 5 landmarks, noise f", 20, 5, 1, false, false, false, false, NoiseLaw::f},
    {"20 stops, 5 landmarks, constant", 20, 5, 1, false, false, false, false, NoiseLaw::constant},
    {"100 stops, 8 landmarks", 100, 8, 1},
};
constexpr int design_count = static_cast<int>(std::size(designs));

double log_uniform(Random& r, double low, double high) { return low * std::pow(high / low, r.uniform()); }

Scene draw_scene(const Design& design, Random& r) {
  Scene scene;
  scene.alpha = Eigen::Vector3d(r.uniform(-0.05, 0.1), r.uniform(0.8, 1.1), r.uniform(0.0, 0.08));
  scene.noise.law = design.law;
  const double f = evaluate_polynomial(scene.alpha, 2.0), spread = log_uniform(r, 0.005, 0.06) * f;
  scene.noise.parameters = Eigen::VectorXd::Constant(1, spread / std::pow(f, scene.noise.power_of_f()));
  scene.sigma_theta_rad = log_uniform(r, 0.005, 0.04);
  scene.sigma_xy_m = log_uniform(r, 0.005, 0.03);
  if (design.estimate) scene.sigma_xy_m = log_uniform(r, 0.02, 0.06);
  if (design.headings) scene.sigma_heading_rad = log_uniform(r, 0.003, 0.03);
  if (design.walk) scene.stop_error = StopErrorModel::random_walk;
  add_bent_path(scene, design.stops, design.landmarks, 0.5, design.turns, r);
  scene.repeats = design.repeats;
  return scene;
}

/// Degrees of freedom of the variances by the expected information at the truth: the fewest.
double fewest_degrees(const Recording& recording, const Scene& scene) {
  const JointProblem problem = make_joint_problem({&recording, 1});
  JointState truth;
  truth.alpha = scene.alpha;
  truth.noise = scene.noise;
  truth.sigma_theta_rad = scene.sigma_theta_rad;
  if (problem.estimate_sigma_s) truth.sigma_s_m = scene.sigma_xy_m;
  for (const auto& stop : recording.truth.stops) truth.stops.push_back(*stop);
  for (const auto& landmark : recording.truth.landmarks) truth.landmarks.push_back(*landmark);
  JointSystem system(problem, 3, 1, problem.estimate_sigma_s);
  system.assemble(truth, HessianKind::fisher);
  if (!system.eliminate()) return 0.0;
  const JointLayout& layout = system.layout();
  // What the stops take from the information of the sigmas stands in their log-determinant alone.
  const int n = layout.sigma_count();
  system.assemble(truth, HessianKind::exact);
  if (!system.eliminate()) return 0.0;
  Eigen::MatrixXd H = system.schur();
  H.bottomRightCorner(n, n) += system.log_det_sigma_hessian(truth);
  const Eigen::LLT<Eigen::MatrixXd> factor(H);
  if (factor.info() != Eigen::Success) return 0.0;
  const Eigen::MatrixXd covariance = factor.solve(Eigen::MatrixXd::Identity(H.rows(), H.cols()));
  return 1.0 / (2.0 * covariance.diagonal().tail(n).maxCoeff());
}

struct Tally {
  long asked = 0, by_normal = 0, by_better = 0, below = 0, above = 0;  ///< below, above: of the better one
  void add(double truth, double estimate, double half, double low, double high) {
    ++asked;
    by_normal += std::abs(truth - estimate) <= half;
    by_better += low <= truth && truth <= high;
    below += truth < low;
    above += truth > high;
  }
};
using Tallies = std::map<std::string, Tally>;

struct WorldResult {
  std::string outcome;
  Tallies tallies;
};

WorldResult run_world(int index, std::uint64_t number) {
  const Design& design = designs[index];
  WorldResult result;
  Scene scene;
  Recording recording;
  bool enough = false;
  for (std::uint64_t attempt = 0; attempt < 100 && !enough; ++attempt) {
    Random r(seed_from("coverage study", {static_cast<std::uint64_t>(index), number, attempt}));
    scene = draw_scene(design, r);
    recording = simulate(scene, r.bits());
    recording.estimate_sigma_xy = design.estimate;
    enough = fewest_degrees(recording, scene) >= 20.0;
  }
  if (!enough) {
    result.outcome = "with too few degrees of freedom";
    return result;
  }
  if (design.estimate) recording.sigma_xy_m = 0.01;
  CalibrateOptions options;
  options.order = 2;
  options.noise = design.law;
  options.noise_shape = NoiseShape::gaussian;
  options.methods = {Method::marginal};
  const Calibration c = calibrate({&recording, 1}, options)[0];
  result.outcome = to_string(c.outcome);
  if (c.outcome != Outcome::converged || !c.alpha_covariance) return result;

  const JointProblem problem = make_joint_problem({&recording, 1});
  MarginalFit fit;
  fit.state.alpha = c.alpha;
  fit.state.noise = c.noise;
  fit.state.sigma_theta_rad = c.sigma_theta_rad->value;
  if (c.sigma_s_m) fit.state.sigma_s_m = c.sigma_s_m->value;
  for (const StopEstimate& stop : c.stops) fit.state.stops.push_back(stop.pose);
  for (const LandmarkEstimate& landmark : c.landmarks) fit.state.landmarks.push_back(landmark.position_m);

  const auto location = [&](const std::string& name, double truth, double estimate, double std_dev,
                            double degrees) {
    const double t =
        degrees < 1e4 ? boost::math::quantile(boost::math::students_t(std::max(degrees, 1.0)), 0.975) : z95;
    result.tallies[name].add(truth, estimate, z95 * std_dev, estimate - t * std_dev, estimate + t * std_dev);
  };
  const std::optional<SigmaSlopes> slopes = sigma_slopes(problem, fit.state);
  const auto degrees = [&](const Eigen::VectorXd& contrast) {
    return slopes ? slopes->degrees_of_freedom(contrast) : 1e9;
  };
  const int phis = 3 + 2 * problem.landmark_count();
  const auto unit = [&](int i) { return Eigen::VectorXd::Unit(phis, i).eval(); };
  for (int i = 0; i < 3; ++i)
    location("alpha_" + std::to_string(i), scene.alpha[i], c.alpha[i], std::sqrt((*c.alpha_covariance)(i, i)),
             degrees(unit(i)));
  for (int i = 0; i < 5; ++i) {
    const double d = c.range_min_m + (c.range_max_m - c.range_min_m) * i / 4.0;
    Eigen::VectorXd contrast = Eigen::VectorXd::Zero(phis);
    contrast.head(3) << 1.0, d, d * d;
    const Eigen::Vector3d powers = contrast.head(3);
    location("f at " + std::to_string(25 * i) + " % of range", evaluate_polynomial(scene.alpha, d),
             powers.dot(c.alpha), std::sqrt(powers.dot(*c.alpha_covariance * powers)), degrees(contrast));
  }
  for (std::size_t l = 0; l < c.landmarks.size(); ++l)
    for (int axis = 0; axis < 2; ++axis)
      location(axis ? "landmark y" : "landmark x", (*recording.truth.landmarks[l])[axis],
               c.landmarks[l].position_m[axis], std::sqrt((*c.landmarks[l].covariance)(axis, axis)),
               degrees(unit(3 + 2 * static_cast<int>(l) + axis)));
  const SceneCovariance places = scene_covariance({&recording, 1}, c);
  for (std::size_t k = 0; k < c.stops.size(); ++k) {
    if (k >= places.stops.size() || !places.stops[k]) continue;
    const Pose2 &truth = *recording.truth.stops[k], &pose = c.stops[k].pose;
    location("stop x", truth.x_m, pose.x_m, std::sqrt((*places.stops[k])(0, 0)), 1e9);
    location("stop y", truth.y_m, pose.y_m, std::sqrt((*places.stops[k])(1, 1)), 1e9);
  }
  const auto spread = [&](const std::string& name, Sigma which, double truth, const Estimate& estimate) {
    const std::optional<ProfileInterval> profile =
        profile_interval(problem, fit.state, which, estimate.std_dev.value_or(0.0) / estimate.value);
    const double half = z95 * estimate.std_dev.value_or(0.0);
    result.tallies[name].add(truth, estimate.value, half, profile ? profile->low : 0.0,
                             profile ? profile->high : -1.0);
  };
  spread("sigma_e", Sigma::noise, scene.noise.parameters[0], c.noise_estimates[0]);
  spread("sigma_theta", Sigma::theta, scene.sigma_theta_rad, *c.sigma_theta_rad);
  if (c.sigma_s_m) spread("sigma_xy", Sigma::stops, scene.sigma_xy_m, *c.sigma_s_m);
  return result;
}

void print(const char* title, const Tallies& tallies) {
  std::printf("%s\n  %-20s %9s %12s %12s %8s %8s\n", title, "parameter", "intervals", "+- 1.96 std",
              "t, profile", "below", "above");
  for (const auto& [name, t] : tallies) {
    const double n = static_cast<double>(t.asked);
    std::printf("  %-20s %9ld %10.2f %% %10.2f %% %6.2f %% %6.2f %%\n", name.c_str(), t.asked,
                100.0 * t.by_normal / n, 100.0 * t.by_better / n, 100.0 * t.below / n, 100.0 * t.above / n);
  }
  std::fflush(stdout);
}

}  // namespace

int main(int count, char** arguments) {
  const int worlds = count > 1 ? std::atoi(arguments[1]) : 1000,
            threads = count > 2 ? std::atoi(arguments[2]) : 0;
  const tbb::global_control limit = at_most(threads);
  Tallies all;
  std::map<std::string, int> outcomes;
  for (int design = 0; design < design_count; ++design) {
    const int number = worlds / design_count;
    std::vector<WorldResult> results(static_cast<std::size_t>(number));
    tbb::parallel_for(0, number, [&](int i) {
      results[static_cast<std::size_t>(i)] = run_world(design, static_cast<std::uint64_t>(i));
    });
    Tallies own;
    std::map<std::string, int> ends;
    for (const WorldResult& result : results) {
      ++ends[result.outcome];
      ++outcomes[result.outcome];
      for (const auto& [name, tally] : result.tallies)
        for (Tally* sum : {&own[name], &all[name]}) {
          sum->asked += tally.asked;
          sum->by_normal += tally.by_normal;
          sum->by_better += tally.by_better;
          sum->below += tally.below;
          sum->above += tally.above;
        }
    }
    std::string title = designs[design].name;
    for (const auto& [outcome, times] : ends) title += ", " + std::to_string(times) + " " + outcome;
    print(title.c_str(), own);
  }
  std::string title = "all";
  for (const auto& [outcome, times] : outcomes) title += ", " + std::to_string(times) + " " + outcome;
  print(title.c_str(), all);
  return 0;
}
