// SPDX-License-Identifier: BSD-3-Clause
// Are the distributions that estimates state right at every level, not only at 95 %? In the 27 settings of accuracy_settings.hpp
// each world's truth has a rank in what `calibrate --method marginal`, `track` and `correct` report,
//
//   u = F((truth - estimate) / standard deviation)      F the normal law, of a spread on its logarithm,
//
// or Student's t with Satterthwaite's degrees of freedom (docs/reliability.md). If the reports are right, u is uniform: simulation-based
// calibration (Talts et al. 2018, arXiv:1804.06788), for a fixed truth and the confidence distribution in the posterior's place. The
// ranks of n worlds lie in the simultaneous 95 % band about the uniform law's where no ordered rank u_(i), Beta(i, n + 1 - i) if they
// are uniform, has a two-sided p below that of 95 % of uniform samples (Saeilynoja, Buerkner, Vehtari 2022, Stat. Comput. 32:32).
//
//   rank_study WORLDS [SCENES = notebooks_data/scenes] [CSV = none]
//
// One landmark, stop and corrected reading of each world count, so that the ranks of a parameter are independent. CSV: the ranks'
// empirical distribution less the uniform one, at 99 levels, which rank_figure.py draws.
#include <fmt/core.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <boost/math/distributions/beta.hpp>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <string>
#include <vector>

#include "accuracy_figures.hpp"
#include "accuracy_settings.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/correction/correct.hpp"
#include "rangecal/solvers/diagnosis/scene_covariance.hpp"
#include "rangecal/solvers/marginal/profile_interval.hpp"
#include "rangecal/solvers/recursive/recursive_landmarks.hpp"

namespace {

using namespace rangecal;
using namespace rangecal::benchmark;

/// Ranks of the truth by what is reported, as "who: what".
using Ranks = std::map<std::string, std::vector<double>>;

double normal_rank(double off) { return boost::math::cdf(boost::math::normal(), off); }

double student_rank(double off, double degrees) {
  constexpr double nearly_normal = 1e4;
  return degrees < nearly_normal ? boost::math::cdf(boost::math::students_t(std::max(degrees, 1.0)), off)
                                 : normal_rank(off);
}

/// What one world is asked for, by its number.
struct Chosen {
  std::size_t landmark, stop;
  double distance_m, error;  ///< of a reading to be corrected: its distance, its noise in standard deviations
};

void add_curve_and_spreads(const std::string& who, const Scene& scene, const Calibration& c, Ranks& ranks) {
  for (int i = 0; i < c.alpha.size(); ++i)
    ranks[fmt::format("{}: alpha_{}", who, i)].push_back(
        normal_rank((scene.alpha[i] - c.alpha[i]) / std::sqrt((*c.alpha_covariance)(i, i))));
  const auto spread = [&](const char* name, double truth, const Estimate& estimate) {
    if (!estimate.std_dev) return;
    ranks[who + ": " + name].push_back(
        normal_rank(std::log(truth / estimate.value) / (*estimate.std_dev / estimate.value)));
  };
  if (!c.noise_estimates.empty()) spread("sigma_e", scene.noise.parameters[0], c.noise_estimates[0]);
  if (c.sigma_theta_rad) spread("sigma_theta", scene.sigma_theta_rad, *c.sigma_theta_rad);
}

void add_landmark(const std::string& who, const Eigen::Vector2d& truth, const LandmarkEstimate& landmark,
                  Ranks& ranks) {
  if (!landmark.covariance) return;
  for (int axis = 0; axis < 2; ++axis)
    ranks[who + (axis ? ": landmark y" : ": landmark x")].push_back(normal_rank(
        (truth[axis] - landmark.position_m[axis]) / std::sqrt((*landmark.covariance)(axis, axis))));
}

/// By t in the normal law's place, of the curve, for which it makes the largest difference.
void add_by_student(const Recording& recording, const Scene& scene, const Calibration& c, Ranks& ranks) {
  const JointProblem problem = make_joint_problem({&recording, 1});
  JointState state;
  state.alpha = c.alpha;
  state.noise = c.noise;
  state.sigma_theta_rad = c.sigma_theta_rad->value;
  for (const StopEstimate& stop : c.stops) state.stops.push_back(stop.pose);
  for (const LandmarkEstimate& landmark : c.landmarks) state.landmarks.push_back(landmark.position_m);
  const std::optional<SigmaSlopes> slopes = sigma_slopes(problem, state);
  if (!slopes) return;
  const Eigen::Index phis = c.alpha.size() + 2 * problem.landmark_count();
  for (int i = 0; i < c.alpha.size(); ++i)
    ranks[fmt::format("calibrate, t: alpha_{}", i)].push_back(
        student_rank((scene.alpha[i] - c.alpha[i]) / std::sqrt((*c.alpha_covariance)(i, i)),
                     slopes->degrees_of_freedom(Eigen::VectorXd::Unit(phis, i))));
}

void add_corrected(const Scene& scene, const Calibration& c, const Chosen& chosen, Ranks& ranks) {
  const double d = c.range_min_m + chosen.distance_m * (c.range_max_m - c.range_min_m),
               f = evaluate_polynomial(scene.alpha, d), reading = f + scene.noise.spread(d, f) * chosen.error;
  if (!(reading > 0.0)) return;
  const Correction corrected = correct(c, reading);
  if (corrected.best_least_squares < 0) return;
  const CorrectionRoot& root =
      corrected.least_squares[static_cast<std::size_t>(corrected.best_least_squares)];
  if (root.std_dev_total_m)
    ranks["correct: distance"].push_back(normal_rank((d - root.distance_m) / *root.std_dev_total_m));
}

Calibration tracked(const Recording& recording, const Scene& scene) {
  RecursiveLandmarksOptions options;
  options.law = scene.noise.law;
  options.noise_shape = NoiseShape::gaussian;
  options.sigma_xy_m = scene.sigma_xy_m;
  options.sigma_heading_rad = scene.sigma_heading_rad;
  RecursiveLandmarks stream(options);
  const Readings& readings = recording.readings;
  for (std::size_t i = 0; i < readings.size(); ++i) {
    const Landmark& landmark = recording.landmarks[static_cast<std::size_t>(readings.landmark[i])];
    stream.add({recording.stops[static_cast<std::size_t>(readings.stop[i])], landmark.label,
                landmark.radius_m, readings.range_m[i], readings.bearing_rad[i]});
  }
  return stream.estimate();
}

/// Ranks of one world; `answered`: who had an answer.
Ranks ranks_of(const AccuracySetting& setting, std::uint64_t number) {
  const Scene& scene = setting.scene;
  Random random(seed_from("rank study " + setting.name, {number}));
  const Chosen chosen{number % scene.positions.size(), number % scene.stops.size(), random.uniform(),
                      random.normal()};
  const Recording recording = simulate(scene, random.bits());
  CalibrateOptions options;
  options.order = static_cast<int>(scene.alpha.size()) - 1;
  options.noise = scene.noise.law;
  options.noise_shape = NoiseShape::gaussian;
  options.methods = {Method::marginal};
  Ranks ranks;
  const Calibration c = calibrate({&recording, 1}, options)[0];
  if (c.outcome == Outcome::converged && c.alpha_covariance) {
    add_curve_and_spreads("calibrate", scene, c, ranks);
    add_by_student(recording, scene, c, ranks);
    add_landmark("calibrate", *recording.truth.landmarks[chosen.landmark], c.landmarks[chosen.landmark],
                 ranks);
    const SceneCovariance places = scene_covariance({&recording, 1}, c);
    if (chosen.stop < places.stops.size() && places.stops[chosen.stop]) {
      const Pose2 &truth = *recording.truth.stops[chosen.stop], &pose = c.stops[chosen.stop].pose;
      const Eigen::Matrix2d& covariance = *places.stops[chosen.stop];
      ranks["calibrate: stop x"].push_back(normal_rank((truth.x_m - pose.x_m) / std::sqrt(covariance(0, 0))));
      ranks["calibrate: stop y"].push_back(normal_rank((truth.y_m - pose.y_m) / std::sqrt(covariance(1, 1))));
    }
    add_corrected(scene, c, chosen, ranks);
  }
  const Calibration t = tracked(recording, scene);
  if (t.outcome == Outcome::converged && t.alpha_covariance) {
    add_curve_and_spreads("track", scene, t, ranks);
    const std::string& label = recording.landmarks[chosen.landmark].label;
    for (const LandmarkEstimate& landmark : t.landmarks)
      if (landmark.label == label)
        add_landmark("track", *recording.truth.landmarks[chosen.landmark], landmark, ranks);
  }
  return ranks;
}

/// The least two-sided p of the ordered ranks: how far they are from uniform, at the place where they are farthest.
double least_local_p(std::vector<double> ranks) {
  std::sort(ranks.begin(), ranks.end());
  const double n = static_cast<double>(ranks.size());
  double least = 1.0;
  for (std::size_t i = 0; i < ranks.size(); ++i) {
    const boost::math::beta_distribution<> law(static_cast<double>(i) + 1.0, n - static_cast<double>(i));
    const double below = boost::math::cdf(law, std::clamp(ranks[i], 0.0, 1.0));
    least = std::min(least, 2.0 * std::min(below, 1.0 - below));
  }
  return least;
}

/// That of uniform samples of n, ascending; made once for each n.
const std::vector<double>& of_uniform_samples(std::size_t n) {
  constexpr int samples = 4000;
  static std::map<std::size_t, std::vector<double>> known;
  std::vector<double>& least = known[n];
  if (!least.empty()) return least;
  least.resize(samples);
  tbb::parallel_for(0, samples, [&](int s) {
    Random random(seed_from("uniform ranks", {n, static_cast<std::uint64_t>(s)}));
    std::vector<double> ranks(n);
    for (double& u : ranks) u = random.uniform();
    least[static_cast<std::size_t>(s)] = least_local_p(std::move(ranks));
  });
  std::sort(least.begin(), least.end());
  return least;
}

/// Probability that uniform ranks lie as far from their law somewhere, simulated.
double p_value(const std::vector<double>& ranks) {
  const std::vector<double>& uniform = of_uniform_samples(ranks.size());
  const auto farther =
      std::upper_bound(uniform.begin(), uniform.end(), least_local_p(ranks)) - uniform.begin();
  return (static_cast<double>(farther) + 1.0) / (static_cast<double>(uniform.size()) + 1.0);
}

double share_within(const std::vector<double>& ranks, double level) {
  const auto within =
      std::count_if(ranks.begin(), ranks.end(), [&](double u) { return std::abs(u - 0.5) <= 0.5 * level; });
  return static_cast<double>(within) / static_cast<double>(ranks.size());
}

/// Of one parameter, over the settings.
struct Summary {
  int settings = 0, inside = 0;
  double least_p = 1.0, in_half = 0.0, in_95 = 0.0;
  std::string farthest;

  void add(const std::string& setting, const std::vector<double>& ranks) {
    const double p = p_value(ranks);
    ++settings;
    inside += p >= 0.05;
    in_half += share_within(ranks, 0.5);
    in_95 += share_within(ranks, 0.95);
    if (p >= least_p) return;
    least_p = p;
    farthest = short_name(setting);
  }
};

void write_distribution(std::FILE* csv, const std::string& setting, const std::string& parameter,
                        const std::vector<double>& ranks) {
  for (int level = 1; level < 100; ++level) {
    const double z = 0.01 * level;
    const auto below = std::count_if(ranks.begin(), ranks.end(), [&](double u) { return u <= z; });
    fmt::print(csv, "\"{}\",\"{}\",{},{:.2f},{:.4f}\n", setting, parameter, ranks.size(), z,
               static_cast<double>(below) / static_cast<double>(ranks.size()) - z);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const int worlds = argc > 1 ? std::atoi(argv[1]) : 1000;
  const std::string folder = argc > 2 ? argv[2] : "notebooks_data/scenes";
  std::FILE* csv = argc > 3 ? std::fopen(argv[3], "w") : nullptr;
  if (argc > 3 && !csv) {
    fmt::print(stderr, "rank_study: cannot write {}\n", argv[3]);
    return 2;
  }
  if (csv) fmt::print(csv, "setting,parameter,worlds,level,difference\n");
  std::map<std::string, Summary> summaries;
  for (const AccuracySetting& setting : accuracy_settings(folder)) {
    std::vector<Ranks> of_worlds(static_cast<std::size_t>(worlds));
    tbb::parallel_for(0, worlds, [&](int w) {
      of_worlds[static_cast<std::size_t>(w)] = ranks_of(setting, static_cast<std::uint64_t>(w));
    });
    Ranks ranks;
    for (const Ranks& own : of_worlds)
      for (const auto& [name, values] : own)
        ranks[name].insert(ranks[name].end(), values.begin(), values.end());
    for (const auto& [name, values] : ranks) {
      summaries[name].add(setting.name, values);
      if (csv) write_distribution(csv, setting.name, name, values);
    }
    fmt::print(stderr, "{}: {} worlds\n", setting.name, worlds);
  }
  if (csv) std::fclose(csv);
  fmt::print("{:<22} {:>8} {:>15} {:>9} {:>8} {:>8}  {}\n", "reported", "settings", "inside the band",
             "least p", "in 50 %", "in 95 %", "farthest");
  int asked = 0, inside = 0;
  for (const auto& [name, s] : summaries) {
    fmt::print("{:<22} {:>8} {:>15} {:>9.4f} {:>6.1f} % {:>6.1f} %  {}\n", name, s.settings, s.inside,
               s.least_p, 100.0 * s.in_half / s.settings, 100.0 * s.in_95 / s.settings, s.farthest);
    asked += s.settings;
    inside += s.inside;
  }
  fmt::print("{} of {} inside; by chance {:.0f} would be\n", inside, asked, 0.95 * asked);
  return 0;
}
