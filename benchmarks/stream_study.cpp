// SPDX-License-Identifier: BSD-3-Clause
// What outliers do to a stream: pairs and readings of landmarks with a share of gross or late readings. RMS error of curve
// and landmarks over that of `calibrate` on the whole recording with its noise shapes, 95 % intervals, and readings per
// second over those of a stream of Gaussian noise on the same readings, estimates as `track` makes them included.
//
//   stream_study WORLDS [PAIRS]
//
// PAIRS: readings of a stream of pairs, 5000 unless given; streams of landmarks are left out where it is given.
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/recursive/recursive_calibrator.hpp"
#include "rangecal/solvers/recursive/recursive_landmarks.hpp"

namespace {

using namespace rangecal;

const Eigen::Vector3d true_alpha(0.0525, 0.8838, 0.0584);
constexpr double sigma_e = 0.01, sigma_theta = 0.0087, sigma_xy = 0.01, radius = 0.12;

struct Outliers {
  const char* name;
  double gross, late;
};
const Outliers kinds[] = {{"none", 0.0, 0.0},   {"gross", 0.002, 0.0}, {"gross", 0.01, 0.0},
                          {"gross", 0.05, 0.0}, {"late", 0.0, 0.002},  {"late", 0.0, 0.01},
                          {"late", 0.0, 0.05}};

double read(double d, const Outliers& outliers, Random& random) {
  const double f = evaluate_polynomial(true_alpha, d);
  double y = random.normal(f, sigma_e * f * f);
  if (random.uniform() < outliers.gross) y = random.uniform(0.1, 6.0);
  if (random.uniform() < outliers.late) y -= 0.3 * std::log(1.0 - random.uniform());
  return std::max(y, 0.01);
}

template <typename Work>
double seconds_of(const Work& work) {
  const auto begin = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

/// Sums of squares of both answers, and how many of their 95 % intervals hold.
struct Errors {
  double curve = 0.0, batch_curve = 0.0, landmarks = 0.0, batch_landmarks = 0.0;
  double shaped_s = 0.0, gaussian_s = 0.0;
  int held = 0, asked = 0, failed = 0;

  void take(const Calibration& ours, const Calibration& batch, const std::vector<Eigen::Vector2d>& axes) {
    if (ours.outcome != Outcome::converged || batch.outcome != Outcome::converged) {
      ++failed;
      return;
    }
    for (double d = 0.6; d < 4.5; d += 0.3) {
      const double f = evaluate_polynomial(true_alpha, d), off = evaluate_polynomial(ours.alpha, d) - f;
      curve_add(off, evaluate_polynomial(batch.alpha, d) - f);
      const Eigen::VectorXd powers = powers_of(d, ours.alpha.size());
      ask(off, powers.dot(*ours.alpha_covariance * powers));
    }
    for (std::size_t l = 0; l < axes.size(); ++l) {
      const Eigen::Vector2d off = ours.landmarks[l].position_m - axes[l];
      landmarks += off.squaredNorm();
      batch_landmarks += (batch.landmarks[l].position_m - axes[l]).squaredNorm();
      for (int k = 0; k < 2; ++k) ask(off[k], (*ours.landmarks[l].covariance)(k, k));
    }
  }
  void print(const char* what, const Outliers& outliers, int worlds) const {
    std::printf("%-10s %-6s %5.1f %% %7d %7d %8.3f", what, outliers.name,
                100.0 * (outliers.gross + outliers.late), worlds, failed, std::sqrt(curve / batch_curve));
    if (batch_landmarks > 0.0)
      std::printf(" %9.3f", std::sqrt(landmarks / batch_landmarks));
    else
      std::printf(" %9s", "");
    std::printf(" %8.1f %% %9.2f\n", 100.0 * held / std::max(1, asked), gaussian_s / shaped_s);
    std::fflush(stdout);
  }

 private:
  void curve_add(double off, double off_batch) {
    curve += off * off;
    batch_curve += off_batch * off_batch;
  }
  void ask(double off, double variance) {
    ++asked;
    held += off * off < 1.959964 * 1.959964 * variance;
  }
};

Calibration batch_of(const Recording& recording, Method method) {
  CalibrateOptions options;
  options.methods = {method};
  options.order = 2;
  options.noise = NoiseLaw::f_squared;
  return calibrate({&recording, 1}, options).front();
}

void study_pairs(const Outliers& outliers, int worlds, int count) {
  Errors errors;
  for (int world = 0; world < worlds; ++world) {
    Random random(seed_from("stream study pairs", {static_cast<std::uint64_t>(world)}));
    Recording recording;
    recording.kind = RecordingKind::pairs;
    for (int i = 0; i < count; ++i) {
      recording.pairs.true_m.push_back(random.uniform(0.5, 4.5));
      recording.pairs.reading_m.push_back(read(recording.pairs.true_m.back(), outliers, random));
    }
    const auto track = [&](NoiseShape shape, double& seconds) {
      RecursiveOptions options;
      options.noise_shape = shape;
      RecursiveCalibrator tracked(options);
      Calibration answer;
      seconds += seconds_of([&] {
        std::int64_t next = 5;
        for (int i = 0; i < count; ++i) {
          tracked.add(recording.pairs.true_m[static_cast<std::size_t>(i)],
                      recording.pairs.reading_m[static_cast<std::size_t>(i)]);
          if (tracked.used() < next) continue;
          answer = tracked.full();
          const double growth = answer.noise_shapes.empty() ? 0.02 : 0.05;
          next = tracked.used() +
                 std::max<std::int64_t>(
                     1, static_cast<std::int64_t>(growth * static_cast<double>(tracked.used())));
        }
        answer = tracked.full();
      });
      return answer;
    };
    const Calibration ours = track(NoiseShape::automatic, errors.shaped_s);
    track(NoiseShape::gaussian, errors.gaussian_s);
    errors.take(ours, batch_of(recording, Method::full), {});
  }
  errors.print("pairs", outliers, worlds);
}

void study_landmarks(const Outliers& outliers, int worlds, int stops) {
  const std::vector<Eigen::Vector2d> axes{{-2.6, 0.3}, {2.7, -0.5}, {0.2, 2.3}, {-1.4, -2.4}, {1.6, 2.2}};
  Errors errors;
  for (int world = 0; world < worlds; ++world) {
    Random random(seed_from("stream study landmarks", {static_cast<std::uint64_t>(world)}));
    Recording recording;
    recording.kind = RecordingKind::landmarks;
    recording.sensor.range_min_m = 0.005;
    recording.sensor.range_max_m = 50.0;
    std::vector<LandmarkReading> readings;
    for (std::size_t l = 0; l < axes.size(); ++l) {
      recording.landmarks.emplace_back();
      recording.landmarks.back().label = std::string(1, static_cast<char>('A' + l));
      recording.landmarks.back().radius_m = radius;
    }
    for (int k = 0; k < stops; ++k) {
      Stop stop;
      stop.label = stop.place = std::to_string(k);
      stop.commanded = {2.0 * std::sin(0.37 * k), 1.5 * std::sin(0.53 * k + 0.4), random.uniform(-3.1, 3.1)};
      stop.sigma_xy_m = sigma_xy;
      stop.sigma_heading_rad = 0.0;
      recording.stops.push_back(stop);
      const Eigen::Vector2d at(random.normal(stop.commanded.x_m, sigma_xy),
                               random.normal(stop.commanded.y_m, sigma_xy));
      for (std::size_t l = 0; l < axes.size(); ++l) {
        const Eigen::Vector2d sight = axes[l] - at;
        LandmarkReading one;
        one.stop = stop;
        one.landmark = recording.landmarks[l].label;
        one.radius_m = radius;
        one.range_m = read(sight.norm() - radius, outliers, random);
        one.bearing_rad = wrap_angle(
            random.normal(std::atan2(sight.y(), sight.x()) - stop.commanded.heading_rad, sigma_theta));
        if (random.uniform() < outliers.gross) one.bearing_rad = random.uniform(-3.1, 3.1);
        readings.push_back(one);
        recording.readings.range_m.push_back(one.range_m);
        recording.readings.bearing_rad.push_back(one.bearing_rad);
        recording.readings.stop.push_back(k);
        recording.readings.landmark.push_back(static_cast<int>(l));
      }
    }
    const auto track = [&](NoiseShape shape, double& seconds) {
      RecursiveLandmarksOptions options;
      options.noise_shape = shape;
      RecursiveLandmarks tracked(options);
      Calibration answer;
      seconds += seconds_of([&] {
        std::int64_t next = 6;
        for (const LandmarkReading& one : readings) {
          tracked.add(one);
          if (tracked.used() < next) continue;
          answer = tracked.estimate();
          const auto apart = static_cast<std::int64_t>(axes.size()) + 1;
          next = tracked.used() +
                 std::max(apart, static_cast<std::int64_t>(0.02 * static_cast<double>(tracked.used())));
        }
        answer = tracked.estimate();
      });
      return answer;
    };
    const Calibration ours = track(NoiseShape::automatic, errors.shaped_s);
    track(NoiseShape::gaussian, errors.gaussian_s);
    errors.take(ours, batch_of(recording, Method::marginal), axes);
  }
  errors.print("landmarks", outliers, worlds);
}

}  // namespace

int main(int argc, char** argv) {
  const int worlds = argc > 1 ? std::atoi(argv[1]) : 0, pairs = argc > 2 ? std::atoi(argv[2]) : 5000;
  if (worlds < 1 || pairs < 1) {
    std::fprintf(stderr, "usage: stream_study WORLDS [PAIRS]\n");
    return 2;
  }
  std::printf("stream     outliers share  worlds  failed    curve landmarks  held 95 %%  readings/s\n");
  for (const Outliers& outliers : kinds) study_pairs(outliers, worlds, pairs);
  for (const Outliers& outliers : kinds)
    if (argc <= 2) study_landmarks(outliers, std::max(1, worlds / 2), 400);
}
