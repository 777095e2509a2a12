// SPDX-License-Identifier: BSD-3-Clause
// What outliers do to `calibrate` as it is by default. Worlds of the field layout and of five drawn designs, each
// simulated clean and then with a share of its readings made wrong: gross ranges (one to three metres off, either way),
// gross bearings (anywhere), both, or labels of another landmark. Figures by kind and share: RMS error of curve and
// landmarks over that of the same worlds without outliers (medians would hide a few bad worlds: these are root mean
// squares), 95 % intervals of curve and landmarks, and of clean worlds RMS error and time over those of the
// Gaussian fit. Pairs: 8 % of the readings late by an exponential of 0.3 m. Worlds with a range effect that the model lacks:
// intervals by stops of the curve that endless recordings of such stops would give. Worlds in which a curve cannot help, and in
// which it halves the error: whether `usable` is false.
//
//   robust_study WORLDS SCENE.yaml [THREADS [PART...]]      notebooks_data/scenes/field-layout.yaml
//
// PART journal=FILE: worlds of designs with outliers are written to FILE as they are done, and are not done again; of one
// scene and one build.
//
// THREADS 0: as many as there are cores. PART: echoes, missing, usable, speed, clean (designs without outliers), designs, or one of these:
// design-0 to design-5; without any, all but `clean`.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <mutex>
#include <numbers>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "bent_path.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/diagnosis/scene_simulation.hpp"
#include "rangecal/solvers/statistics/median.hpp"
#include "study.hpp"
#include "threads.hpp"

namespace {

using namespace rangecal;

constexpr double pi = std::numbers::pi;

struct Design {
  const char* name;
  int stops, landmarks, repeats;
};
/// The first is the scene given.
const Design designs[] = {{"field layout", 0, 0, 0},           {"20 stops, 5 landmarks", 20, 5, 3},
                          {"60 stops, 4 landmarks", 60, 4, 1}, {"12 stops, 8 landmarks", 12, 8, 3},
                          {"30 stops, 6 landmarks", 30, 6, 2}, {"100 stops, 8 landmarks", 100, 8, 1}};
constexpr int design_count = static_cast<int>(std::size(designs));

enum class Wrong { none, ranges, bearings, both, labels };
const char* name_of(Wrong wrong) {
  switch (wrong) {
    case Wrong::none:
      return "clean";
    case Wrong::ranges:
      return "gross ranges";
    case Wrong::bearings:
      return "gross bearings";
    case Wrong::both:
      return "both";
    case Wrong::labels:
      return "wrong labels";
  }
  return "";
}

double log_uniform(Random& r, double low, double high) { return low * std::pow(high / low, r.uniform()); }

/// Curve, noise and stops' spread of a sensor and robot.
Scene draw_sensor(Random& r) {
  Scene scene;
  scene.alpha = Eigen::Vector3d(r.uniform(-0.05, 0.1), r.uniform(0.8, 1.1), r.uniform(0.0, 0.08));
  const double f = evaluate_polynomial(scene.alpha, 2.0), spread = log_uniform(r, 0.005, 0.03) * f;
  scene.noise.parameters = Eigen::VectorXd::Constant(1, spread / (f * f));
  scene.sigma_theta_rad = log_uniform(r, 0.005, 0.02);
  scene.sigma_xy_m = log_uniform(r, 0.005, 0.02);
  return scene;
}

Scene draw_scene(const Design& design, Random& r) {
  Scene scene = draw_sensor(r);
  add_bent_path(scene, design.stops, design.landmarks, 0.5, false, r);
  scene.repeats = design.repeats;
  return scene;
}

void spoil(Recording& recording, Wrong wrong, double share, Random& r) {
  Readings& readings = recording.readings;
  for (std::size_t i = 0; i < readings.size(); ++i) {
    if (!(r.uniform() < share)) continue;
    if (wrong == Wrong::ranges || wrong == Wrong::both) {
      const double off = r.uniform(1.0, 3.0) * (r.uniform() < 0.5 ? -1.0 : 1.0);
      readings.range_m[i] =
          readings.range_m[i] + off > 0.05 ? readings.range_m[i] + off : readings.range_m[i] - off;
    }
    if (wrong == Wrong::bearings || wrong == Wrong::both)
      readings.bearing_rad[i] = r.uniform(-3.1415, 3.1415);
    if (wrong == Wrong::labels) {
      const int count = static_cast<int>(recording.landmarks.size());
      readings.landmark[i] = (readings.landmark[i] + 1 + static_cast<int>(r.uniform() * (count - 1))) % count;
    }
  }
}

struct Tally {
  int worlds = 0, failed = 0, order_right = 0;
  double curve_sq = 0.0, landmark_sq = 0.0, seconds = 0.0;
  long intervals = 0, held = 0;
  double bias = 0.0, bias_square = 0.0;  ///< of f at the middle over its stated deviation
};

struct Answer {
  bool ok = false;
  double curve_sq = 0.0, landmark_sq = 0.0, seconds = 0.0;
  int order = 0;
  long intervals = 0, held = 0;
};

CalibrateOptions of_marginal() {
  CalibrateOptions options;
  options.methods = {Method::marginal};
  return options;
}

Answer judge(const Recording& recording, const Scene& scene, NoiseShape shape) {
  Answer answer;
  CalibrateOptions options = of_marginal();
  options.noise_shape = shape;
  const auto begin = std::chrono::steady_clock::now();
  const Calibration c = calibrate({&recording, 1}, options)[0];
  answer.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  if (c.outcome != Outcome::converged || !c.alpha_covariance) return answer;
  answer.ok = true;
  answer.order = c.order();
  constexpr int points = 9;
  for (int i = 0; i < points; ++i) {
    const double d = c.range_min_m + (c.range_max_m - c.range_min_m) * i / (points - 1.0);
    const double error = evaluate_polynomial(c.alpha, d) - evaluate_polynomial(scene.alpha, d);
    const double noise = scene.noise.spread(d, evaluate_polynomial(scene.alpha, d));
    answer.curve_sq += error * error / (noise * noise) / points;
    ++answer.intervals;
    answer.held += std::abs(error) <= 1.96 * std::sqrt(curve_variance(c, d).value_or(0.0));
  }
  int counted = 0;
  for (const LandmarkEstimate& landmark : c.landmarks)
    for (std::size_t l = 0; l < recording.landmarks.size(); ++l) {
      if (recording.landmarks[l].label != landmark.label || !recording.truth.landmarks[l]) continue;
      const Eigen::Vector2d error = landmark.position_m - *recording.truth.landmarks[l];
      answer.landmark_sq += error.squaredNorm();
      ++counted;
      for (int axis = 0; axis < 2 && landmark.covariance; ++axis) {
        ++answer.intervals;
        answer.held += std::abs(error[axis]) <= 1.96 * std::sqrt((*landmark.covariance)(axis, axis));
      }
    }
  if (counted > 0) answer.landmark_sq /= counted;
  return answer;
}

void add(const Answer& answer, const Scene& scene, Tally& tally) {
  ++tally.worlds;
  tally.seconds += answer.seconds;
  if (!answer.ok) {
    ++tally.failed;
    return;
  }
  tally.order_right += answer.order == static_cast<int>(scene.alpha.size()) - 1;
  tally.curve_sq += answer.curve_sq;
  tally.landmark_sq += answer.landmark_sq;
  tally.intervals += answer.intervals;
  tally.held += answer.held;
}

void print(const char* what, double share, const Tally& tally, const Tally& clean) {
  const int done = std::max(1, tally.worlds - tally.failed),
            clean_done = std::max(1, clean.worlds - clean.failed);
  std::printf("  %-16s %5.1f %%  %7d  %6d   %8.3f  %8.3f   %6.1f %%   %5.1f %%  %8.2f\n", what, 100.0 * share,
              tally.worlds, tally.failed, std::sqrt(tally.curve_sq / done / (clean.curve_sq / clean_done)),
              std::sqrt(tally.landmark_sq / done / (clean.landmark_sq / clean_done)),
              100.0 * static_cast<double>(tally.held) / static_cast<double>(std::max(1L, tally.intervals)),
              100.0 * tally.order_right / done, 1e3 * tally.seconds / tally.worlds);
}

/// One calibration of clean readings without shapes, one with, and one for every kind of outliers; of one world.
using AnswersOfWorld = std::vector<Answer>;

std::string text_of(const AnswersOfWorld& answers) {
  std::ostringstream text;
  text.precision(17);
  for (const Answer& a : answers)
    text << a.ok << ' ' << a.curve_sq << ' ' << a.landmark_sq << ' ' << a.seconds << ' ' << a.order << ' '
         << a.intervals << ' ' << a.held << ' ';
  return text.str();
}

AnswersOfWorld answers_of(const std::string& text) {
  AnswersOfWorld answers;
  std::istringstream fields(text);
  for (Answer a;
       fields >> a.ok >> a.curve_sq >> a.landmark_sq >> a.seconds >> a.order >> a.intervals >> a.held;)
    answers.push_back(a);
  return answers;
}

void study_design(int index, int worlds, const Scene& given, bool with_outliers, StudyJournal& journal) {
  struct Case {
    Wrong wrong;
    double share;
  };
  std::vector<Case> cases;
  for (const Wrong wrong : {Wrong::ranges, Wrong::bearings, Wrong::both, Wrong::labels})
    for (const double share : {0.002, 0.01, 0.05})
      if (with_outliers) cases.push_back({wrong, share});
  std::vector<Tally> tallies(cases.size());
  Tally clean, gaussian;
  std::mutex mutex;
  tbb::parallel_for(0, worlds, [&](int number) {
    Random r(
        seed_from("robust study", {static_cast<std::uint64_t>(index), static_cast<std::uint64_t>(number)}));
    const Scene scene = index == 0 ? given : draw_scene(designs[index], r);
    AnswersOfWorld answers;
    const std::string key = std::to_string(index) + " " + std::to_string(number);
    const std::string* known = with_outliers ? journal.find(key) : nullptr;
    if (known) {
      answers = answers_of(*known);
    } else {
      const Recording recording = simulate(scene, r.bits());
      for (const NoiseShape shape : {NoiseShape::gaussian, NoiseShape::automatic})
        answers.push_back(judge(recording, scene, shape));
      for (const Case& one : cases) {
        Recording spoilt = recording;
        spoil(spoilt, one.wrong, one.share, r);
        answers.push_back(judge(spoilt, scene, NoiseShape::automatic));
      }
    }
    const std::lock_guard lock(mutex);
    if (!known && with_outliers) journal.add(key, text_of(answers));
    add(answers[0], scene, gaussian);
    add(answers[1], scene, clean);
    for (std::size_t i = 0; i < cases.size(); ++i) add(answers[2 + i], scene, tallies[i]);
  });
  std::printf("%s\n  %-16s  share    worlds  failed      curve  landmark   held 95 %%  order ok   ms\n",
              designs[index].name, "outliers");
  print("clean, gaussian", 0.0, gaussian, gaussian);
  print("clean", 0.0, clean, gaussian);
  for (std::size_t i = 0; i < cases.size(); ++i)
    print(name_of(cases[i].wrong), cases[i].share, tallies[i], clean);
  std::fflush(stdout);
}

/// 800 pairs, 8 % of them late.
void study_echoes(int tables) {
  double bias = 0.0, square = 0.0;
  int order_right = 0, failed = 0, one_sided = 0;
  std::mutex mutex;
  tbb::parallel_for(0, tables, [&](int number) {
    Random r(seed_from("robust study, echoes", {static_cast<std::uint64_t>(number)}));
    const Eigen::Vector3d alpha(0.05, 0.95, 0.02);
    Recording recording;
    recording.kind = RecordingKind::pairs;
    for (int i = 0; i < 800; ++i) {
      const double d = r.uniform(0.3, 4.0), f = evaluate_polynomial(alpha, d);
      recording.pairs.true_m.push_back(d);
      double y = f + 0.01 * f * f * r.normal();
      if (r.uniform() < 0.08) y -= 0.3 * std::log(1.0 - r.uniform());
      recording.pairs.reading_m.push_back(y);
    }
    recording.counts.read = recording.counts.used = 800;
    const Calibration c = calibrate({&recording, 1}, of_marginal())[0];
    const std::lock_guard lock(mutex);
    if (c.outcome != Outcome::converged || !c.alpha_covariance) {
      ++failed;
      return;
    }
    const double z = (evaluate_polynomial(c.alpha, 2.0) - evaluate_polynomial(alpha, 2.0)) /
                     std::sqrt(curve_variance(c, 2.0).value_or(1.0));
    bias += z;
    square += z * z;
    order_right += c.order() == 2;
    const auto shape = c.noise_shapes.find("range");
    one_sided += shape != c.noise_shapes.end() && shape->second.family == "one-sided";
  });
  const int done = std::max(1, tables - failed);
  std::printf(
      "800 pairs, 8 %% late by 0.3 m on average: %d tables, %d failed; error of f(2 m) in its stated deviation: mean %.3f, "
      "RMS %.3f; order 2 in %.1f %%, one-sided in %.1f %%\n",
      tables, failed, bias / done, std::sqrt(square / done), 100.0 * order_right / done,
      100.0 * one_sided / done);
}

/// Stops anywhere in a room of 4 by 4 m, headings at random, among landmarks around it.
Scene draw_room(int landmarks, Random& r) {
  Scene scene = draw_sensor(r);
  scene.repeats = 3;
  for (int l = 0; l < landmarks; ++l) {
    const double direction = 2.0 * pi * (l + r.uniform(0.2, 0.8)) / landmarks, away = r.uniform(3.0, 4.5);
    scene.landmarks.push_back({"L" + std::to_string(l), 0.05, {}});
    scene.positions.emplace_back(away * std::cos(direction), away * std::sin(direction));
  }
  return scene;
}

void place_stops(Scene& scene, int stops, Random& r) {
  scene.stops.clear();
  for (int k = 0; k < stops; ++k) {
    Stop stop;
    stop.label = std::to_string(k);
    stop.commanded = {r.uniform(-2.0, 2.0), r.uniform(-2.0, 2.0), r.uniform(-pi, pi)};
    scene.stops.push_back(stop);
  }
}

/// The effect at the size at which the squares of what it adds to readings, in their spreads, sum to 400 over a recording of so
/// many stops: the noncentrality before the calibration takes up its part.
void add_effect(Scene& scene, const char* effect, const char* amplitude) {
  const Recording without = simulate(scene, 1);
  scene.effects = {{effect, scene_effect(scene, effect, {{amplitude, 1e-3}})}};
  const Recording with = simulate_scene(scene, 1);
  double sum = 0.0;
  for (std::size_t i = 0; i < with.readings.size(); ++i) {
    const double y = without.readings.range_m[i], change = with.readings.range_m[i] - y;
    sum += std::pow(change / scene.noise.spread(y, y), 2);
  }
  scene.effects.at(effect).at(amplitude) *= std::sqrt(400.0 / sum);
}

/// Intervals by stops of the curve that a recording of 1500 stops has, in the presence of an effect.
void study_missing_effect(const char* effect, const char* amplitude, int worlds) {
  constexpr int scenes = 10, stops = 40, many = 1500, points = 9;
  long held = 0, by_model = 0, intervals = 0, told = 0;
  int done = 0, failed = 0;
  std::mutex mutex;
  tbb::parallel_for(0, scenes, [&](int number) {
    Random r(seed_from(std::string("robust study, missing ") + effect, {static_cast<std::uint64_t>(number)}));
    Scene scene = draw_room(5, r);
    place_stops(scene, stops, r);
    add_effect(scene, effect, amplitude);
    CalibrateOptions options = of_marginal();
    options.order = 2;
    Scene endless = scene;
    place_stops(endless, many, r);
    const Recording long_recording = simulate_scene(endless, r.bits());
    const Calibration limit = calibrate({&long_recording, 1}, options)[0];
    for (int world = 0; world < worlds / scenes; ++world) {
      place_stops(scene, stops, r);
      const Recording recording = simulate_scene(scene, r.bits());
      const Calibration c = calibrate({&recording, 1}, options)[0];
      const std::lock_guard lock(mutex);
      ++done;
      if (c.outcome != Outcome::converged || !c.alpha_covariance_by_stops || !c.alpha_covariance) {
        ++failed;
        continue;
      }
      told += c.misfit && !c.misfit->holds();
      for (int i = 0; i < points; ++i) {
        const double d = 1.2 + 4.0 * i / (points - 1.0);
        const double off = evaluate_polynomial(c.alpha, d) - evaluate_polynomial(limit.alpha, d);
        const Eigen::Vector3d powers(1.0, d, d * d);
        ++intervals;
        held += std::abs(off) <= 1.96 * std::sqrt(powers.dot(*c.alpha_covariance_by_stops * powers));
        by_model += std::abs(off) <= 1.96 * std::sqrt(powers.dot(*c.alpha_covariance * powers));
      }
    }
  });
  const double all = static_cast<double>(std::max(1L, intervals));
  std::printf(
      "%s that the model lacks, noncentrality 400: %d worlds, %d failed; intervals of the curve by stops hold %.1f %%, the model's "
      "%.1f %%; a misfit is told in %.1f %%\n",
      effect, done, failed, 100.0 * static_cast<double>(held) / all,
      100.0 * static_cast<double>(by_model) / all,
      100.0 * static_cast<double>(told) / std::max(1, done - failed));
  std::fflush(stdout);
}

/// Error of readings that the true curve corrects, over that of raw ones: root mean squares against the true distances.
double left_by_the_true_curve(const Scene& scene, const Recording& recording) {
  double raw = 0.0, left = 0.0;
  for (std::size_t i = 0; i < recording.readings.size(); ++i) {
    const auto l = static_cast<std::size_t>(recording.readings.landmark[i]);
    const auto k = static_cast<std::size_t>(recording.readings.stop[i]);
    const Pose2& pose = *recording.truth.stops[k];
    const Eigen::Vector2d sight = *recording.truth.landmarks[l] - Eigen::Vector2d(pose.x_m, pose.y_m);
    const double d = sight.norm() - recording.landmarks[l].radius_m, y = recording.readings.range_m[i];
    raw += (y - d) * (y - d);
    left += std::pow((y - evaluate_polynomial(scene.alpha, d)) / evaluate_derivative(scene.alpha, d), 2);
  }
  return std::sqrt(left / raw);
}

/// How often `usable` is false where the curve adds a tenth of the noise, and where correcting halves the error.
void study_usable(int worlds) {
  struct Kind {
    const char* what;
    double low, high;   ///< of the bias, in spreads of the noise at 2 m
    double left_below;  ///< worlds count where the true curve leaves so much of the error
  };
  for (const Kind& kind :
       {Kind{"the curve cannot help", 0.0, 0.1, 2.0}, Kind{"the curve halves the error", 1.8, 5.0, 0.5}}) {
    int done = 0, failed = 0, refused = 0, unjudged = 0;
    std::mutex mutex;
    tbb::parallel_for(0, worlds, [&](int number) {
      Random r(
          seed_from(std::string("robust study, usable, ") + kind.what, {static_cast<std::uint64_t>(number)}));
      const Design& design = designs[1 + r.index(design_count - 1)];
      Scene scene = draw_scene(design, r);
      const double spread = log_uniform(r, 0.01, 0.06), bias = spread * r.uniform(kind.low, kind.high);
      scene.noise.parameters = Eigen::VectorXd::Constant(1, spread / 4.0);
      scene.alpha = Eigen::Vector3d(bias * r.uniform(-1.0, 1.0), 1.0, 0.0);
      scene.alpha[1] += (bias * (r.uniform() < 0.5 ? -1.0 : 1.0) - scene.alpha[0]) / 2.0;
      const Recording recording = simulate(scene, r.bits());
      if (!(left_by_the_true_curve(scene, recording) <= kind.left_below)) return;
      const Calibration c = calibrate({&recording, 1}, of_marginal())[0];
      const std::lock_guard lock(mutex);
      ++done;
      failed += c.outcome != Outcome::converged;
      unjudged += c.outcome == Outcome::converged && !c.left_out;
      refused += c.left_out && !c.left_out->usable;
    });
    std::printf("%s: %d worlds, %d failed, %d not judged; `usable` is false in %.1f %%\n", kind.what, done,
                failed, unjudged, 100.0 * refused / std::max(1, done - failed));
    std::fflush(stdout);
  }
}

/// Time of all four methods, order and noise law free, with the noise shapes chosen and with Gaussian noise. One calibration at a
/// time, on the cores there are.
void study_speed(int worlds, const Scene& field) {
  struct Row {
    Design design;
    int share;  ///< one in so many of the worlds asked for
  };
  std::printf("%-24s  worlds   chosen ms   gaussian ms   chosen / gaussian   (medians)\n",
              "all methods, clean");
  for (const Row& row :
       {Row{designs[0], 1}, Row{designs[1], 1}, Row{{"200 stops, 8 landmarks", 200, 8, 1}, 10}}) {
    std::vector<double> chosen, gaussian, ratio;
    for (int number = 0; number < std::max(1, worlds / row.share); ++number) {
      Random r(seed_from(std::string("robust study, speed, ") + row.design.name,
                         {static_cast<std::uint64_t>(number)}));
      const Recording recording =
          simulate(row.design.stops == 0 ? field : draw_scene(row.design, r), r.bits());
      const auto milliseconds = [&](NoiseShape shape) {
        CalibrateOptions options;
        options.noise_shape = shape;
        const auto begin = std::chrono::steady_clock::now();
        calibrate({&recording, 1}, options);
        return 1e3 * std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
      };
      gaussian.push_back(milliseconds(NoiseShape::gaussian));
      chosen.push_back(milliseconds(NoiseShape::automatic));
      ratio.push_back(chosen.back() / gaussian.back());
    }
    std::printf("%-24s  %6zu   %9.2f   %11.2f   %17.2f\n", row.design.name, ratio.size(),
                upper_median(chosen), upper_median(gaussian), upper_median(ratio));
    std::fflush(stdout);
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) {
    std::fprintf(stderr, "usage: robust_study WORLDS SCENE.yaml [THREADS [PART...]]\n");
    return 2;
  }
  const int worlds = std::atoi(argv[1]);
  const auto limit = at_most(argc > 3 ? std::atoi(argv[3]) : 0);
  const Scene field = load_scene(argv[2]);
  const StudyParts parts(argc, argv, 4);
  StudyJournal journal(parts.journal);
  if (parts.wants("echoes")) study_echoes(worlds);
  if (parts.wants("missing")) {
    study_missing_effect("range_eccentricity", "cosine_m", worlds);
    study_missing_effect("cyclic_error", "sine_m", worlds);
  }
  if (parts.wants("usable")) study_usable(worlds);
  if (parts.wants("speed")) study_speed(worlds, field);
  for (int i = 0; i < design_count; ++i)
    if (parts.wants("designs") || parts.wants("design-" + std::to_string(i)))
      study_design(i, worlds, field, true, journal);
  for (int i = 0; !parts.names.empty() && parts.wants("clean") && i < design_count; ++i)
    study_design(i, worlds, field, false, journal);
  return 0;
}
