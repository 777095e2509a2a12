// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <vector>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/noise.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/core/recording.hpp"

namespace rangecal::hard {

/// How one world is made. Every kind of hardness changes some of it.
struct Setting {
  int stops = 12, landmarks = 5, repeats = 1;
  Eigen::VectorXd alpha = Eigen::Vector3d(0.05, 0.9, 0.05);  ///< f [m]
  double ripple_m = 0.0;  ///< of a sine of d on top of f, which no order fits
  int fitted_order = 2;
  NoiseLaw law = NoiseLaw::f_squared, fitted_law = NoiseLaw::f_squared;
  double spread = 0.01;  ///< s(d) / f(d) at 2 m
  double sigma_theta_rad = 0.01;
  double sigma_s_m = 0.01, sigma_h_rad = 0.0;  ///< true, per axis
  double claimed_s = 1.0, claimed_h = 1.0;     ///< what the recording claims of them, over the true
  bool estimate_sigma_s = false;
  StopErrorModel error = StopErrorModel::independent;
  int path = 0;                      ///< 0: a line, 1: a ring, 2: anywhere, 3: within 5 cm of one spot
  double thickness_m = -1.0;         ///< of the strip that path and landmarks lie in; negative: none
  double near_m = 0.4, far_m = 4.0;  ///< landmarks lie between these distances of some stop
  bool log_distances = false, one_distance = false;
  double radius_m = 0.05;
  double seen = 1.0;                    ///< share of the (stop, landmark) that are seen
  double outliers = 0.0;                ///< share of gross outliers, in range and bearing
  int mislabelled = 0;                  ///< stops whose readings bear the label of another one
  double grid_m = 0.0, grid_rad = 0.0;  ///< readings are rounded to these
  double taped_wrong = -1.0;  ///< a taped distance is wrong by so many of its sigmas; negative: none
};

struct Kind {
  const char* name;
  void (*apply)(Setting&, Random&);
};

inline double log_uniform(Random& r, double low, double high) {
  return low * std::pow(high / low, r.uniform());
}

inline const std::array<Kind, 20> kinds{{
    {"plain", [](Setting&, Random&) {}},
    {"few stops", [](Setting& s, Random& r) { s.stops = 3 + static_cast<int>(r.index(3)); }},
    {"few landmarks", [](Setting& s, Random& r) { s.landmarks = 1 + static_cast<int>(r.index(2)); }},
    {"few readings",
     [](Setting& s, Random& r) {
       s.stops = 3 + static_cast<int>(r.index(2));
       s.landmarks = 1 + static_cast<int>(r.index(3));
       s.repeats = 1;
       s.fitted_order = 1 + static_cast<int>(r.index(4));
     }},
    {"nearly collinear",
     [](Setting& s, Random& r) {
       s.path = 0;
       s.thickness_m = log_uniform(r, 1e-6, 0.1);
     }},
    {"one distance",
     [](Setting& s, Random&) {
       s.path = 3;
       s.one_distance = true;
     }},
    {"near and far",
     [](Setting& s, Random& r) {
       s.log_distances = true;
       s.near_m = log_uniform(r, 0.01, 0.3);
       s.far_m = log_uniform(r, 10.0, 300.0);
       s.radius_m = 0.0;
     }},
    {"tiny noise",
     [](Setting& s, Random& r) {
       s.spread = log_uniform(r, 1e-9, 1e-5);
       s.sigma_theta_rad = log_uniform(r, 1e-9, 1e-5);
     }},
    {"huge noise",
     [](Setting& s, Random& r) {
       s.spread = r.uniform(0.2, 1.0);
       s.sigma_theta_rad = r.uniform(0.3, 1.5);
     }},
    {"prior off by 10 sigma", [](Setting& s, Random&) { s.claimed_s = s.claimed_h = 0.1; }},
    {"wrong order",
     [](Setting& s, Random& r) {
       s.ripple_m = log_uniform(r, 0.01, 0.5);
       s.fitted_order = 1 + static_cast<int>(r.index(6));
     }},
    {"mislabelled stops", [](Setting& s, Random& r) { s.mislabelled = 1 + static_cast<int>(r.index(6)); }},
    {"gross outliers", [](Setting& s, Random& r) { s.outliers = r.uniform(0.02, 0.2); }},
    {"f not monotone",
     [](Setting& s,
        Random& r) {  // a parabola with its lowest point among the distances, now and then below 0
       const double at = r.uniform(1.0, 3.5), low = r.uniform(-0.2, 1.0), bend = r.uniform(0.1, 0.8);
       s.alpha = Eigen::Vector3d(low + bend * at * at, -2.0 * bend * at, bend);
     }},
    {"sigma off by 100",
     [](Setting& s, Random& r) { s.claimed_s = s.claimed_h = r.index(2) ? 100.0 : 0.01; }},
    {"sigma_xy_m: estimate",
     [](Setting& s, Random& r) {
       s.estimate_sigma_s = true;
       s.sigma_s_m = r.index(4) ? log_uniform(r, 1e-4, 0.3) : 0.0;
     }},
    {"random walk",
     [](Setting& s, Random& r) {
       s.error = StopErrorModel::random_walk;
       s.sigma_s_m = log_uniform(r, 1e-3, 0.1);
       s.sigma_h_rad = log_uniform(r, 1e-3, 0.2);
     }},
    {"rounded readings",
     [](Setting& s, Random& r) {
       s.grid_m = log_uniform(r, 1e-3, 0.1);
       s.grid_rad = log_uniform(r, 1e-3, 0.1);
       s.repeats = 1 + static_cast<int>(r.index(5));
       s.spread = log_uniform(r, 1e-4, 1e-2);
     }},
    {"seen from few stops", [](Setting& s, Random& r) { s.seen = r.uniform(0.15, 0.5); }},
    {"wrong tape", [](Setting& s, Random& r) { s.taped_wrong = log_uniform(r, 1.0, 1e3); }},
}};

/// One recording and how it is to be fitted; everything follows from `id`.
struct World {
  std::uint64_t id = 0;
  std::vector<int> kinds;  ///< indices: the first is the one that it is counted under
  Setting setting;
  Recording recording;
};

namespace detail {

inline std::vector<Pose2> commanded_path(const Setting& s, Random& r) {
  std::vector<Pose2> path;
  const double turn = r.uniform(0.0, 2.0 * std::numbers::pi);
  for (int k = 0; k < s.stops; ++k) {
    const double a = 2.0 * std::numbers::pi * k / s.stops;
    Pose2 pose;
    if (s.path == 0) pose = {0.3 * k, s.thickness_m >= 0.0 ? 0.0 : 0.2 * std::sin(0.7 * k), 0.0};
    if (s.path == 1) pose = {1.5 * std::cos(a), 1.5 * std::sin(a), a};
    if (s.path == 2) pose = {r.uniform(-2.0, 2.0), r.uniform(-2.0, 2.0), r.uniform(-3.0, 3.0)};
    if (s.path == 3) pose = {r.uniform(-0.05, 0.05), r.uniform(-0.05, 0.05), 0.0};
    if (s.thickness_m < 0.0) {  // nothing about the frame is special
      const Eigen::Vector2d at = Eigen::Rotation2Dd(turn) * Eigen::Vector2d(pose.x_m, pose.y_m);
      pose = {at.x(), at.y(), wrap_angle(pose.heading_rad + turn)};
    }
    path.push_back(pose);
  }
  return path;
}

inline Eigen::Vector2d landmark_at(const Setting& s, const std::vector<Pose2>& path, Random& r) {
  Eigen::Vector2d at;
  for (int attempt = 0; attempt < 200; ++attempt) {
    const Pose2& from = path[r.index(path.size())];
    const double d = s.one_distance    ? 2.0
                     : s.log_distances ? log_uniform(r, s.near_m, s.far_m)
                                       : r.uniform(s.near_m, s.far_m);
    double direction = r.uniform(0.0, 2.0 * std::numbers::pi);
    if (s.thickness_m >= 0.0) direction = r.index(2) ? 0.0 : std::numbers::pi;
    at = {from.x_m + d * std::cos(direction), from.y_m + d * std::sin(direction)};
    if (s.thickness_m >= 0.0) at.y() += s.thickness_m * r.normal();
    const bool clear = std::all_of(path.begin(), path.end(), [&](const Pose2& p) {
      return std::hypot(at.x() - p.x_m, at.y() - p.y_m) > s.radius_m + 0.5 * s.near_m;
    });
    if (clear) break;
  }
  return at;
}

/// The true path: errors of the prior's kind, of the true size.
inline std::vector<Pose2> true_path(const Setting& s, const std::vector<Pose2>& commanded, Random& r) {
  std::vector<Pose2> path;
  for (std::size_t k = 0; k < commanded.size(); ++k) {
    const Pose2& c = commanded[k];
    const Eigen::Vector2d slip(r.normal(0.0, s.sigma_s_m), r.normal(0.0, s.sigma_s_m));
    const double turn = r.normal(0.0, s.sigma_h_rad);
    if (s.error == StopErrorModel::independent || k == 0) {
      path.push_back({c.x_m + slip.x(), c.y_m + slip.y(), c.heading_rad + turn});
      continue;
    }
    const Pose2 &before = commanded[k - 1], &from = path[k - 1];
    const Eigen::Vector2d step(c.x_m - before.x_m, c.y_m - before.y_m);
    const double turned = from.heading_rad - before.heading_rad;
    const Eigen::Vector2d at = Eigen::Vector2d(from.x_m, from.y_m) + Eigen::Rotation2Dd(turned) * step +
                               Eigen::Rotation2Dd(from.heading_rad) * slip;
    path.push_back({at.x(), at.y(), c.heading_rad + turned + turn});
  }
  return path;
}

inline double rounded(double value, double grid) {
  return grid > 0.0 ? grid * std::round(value / grid) : value;
}

inline void add_readings(const Setting& s, const std::vector<Pose2>& path,
                         const std::vector<Eigen::Vector2d>& landmarks, Random& r, Recording& recording) {
  Noise noise;
  noise.law = s.law;
  noise.parameters =
      s.law == NoiseLaw::polynomial ? Eigen::VectorXd(Eigen::Vector2d(0.3, 0.35)) : Eigen::VectorXd::Ones(1);
  const double f_at_2 = std::max(evaluate_polynomial(s.alpha, 2.0), 0.1);
  noise.parameters *= s.spread * f_at_2 / noise.spread(2.0, f_at_2);
  std::vector<int> label(path.size());
  for (std::size_t k = 0; k < path.size(); ++k) label[k] = static_cast<int>(k);
  for (int i = 0; i < s.mislabelled; ++i) std::swap(label[r.index(path.size())], label[r.index(path.size())]);
  Readings& readings = recording.readings;
  for (std::size_t k = 0; k < path.size(); ++k)
    for (std::size_t l = 0; l < landmarks.size(); ++l) {
      if (s.seen < 1.0 && r.uniform() > s.seen) continue;
      const Eigen::Vector2d v = landmarks[l] - Eigen::Vector2d(path[k].x_m, path[k].y_m);
      const double d = v.norm() - s.radius_m;
      if (!(d > 0.0)) continue;
      const double f = evaluate_polynomial(s.alpha, d);
      for (int repeat = 0; repeat < s.repeats; ++repeat) {
        double range = f + s.ripple_m * std::sin(2.5 * d) + r.normal(0.0, noise.spread(d, f));
        double bearing = std::atan2(v.y(), v.x()) - path[k].heading_rad + r.normal(0.0, s.sigma_theta_rad);
        if (s.outliers > 0.0 && r.uniform() < s.outliers) {
          range = r.uniform(0.05, 2.0 * s.far_m);
          bearing = r.uniform(-3.1, 3.1);
        }
        range = rounded(range, s.grid_m);
        ++recording.counts.read;
        if (!(range > 0.0)) {
          ++recording.counts.dropped[range < 0.0 ? "negative" : "zero"];
          continue;
        }
        readings.stop.push_back(label[k]);
        readings.landmark.push_back(static_cast<int>(l));
        readings.repeat.push_back(repeat);
        readings.range_m.push_back(range);
        readings.bearing_rad.push_back(wrap_angle(rounded(bearing, s.grid_rad)));
        readings.row.push_back(static_cast<int>(readings.row.size()) + 2);
      }
    }
  recording.counts.used = static_cast<int>(readings.size());
}

}  // namespace detail

/// World `id`: its kind is id modulo the number of kinds; two in five have a second one and some a third.
inline World make_world(std::uint64_t id) {
  Random r(seed_from("hard problems", {id}));
  World world;
  world.id = id;
  Setting& s = world.setting;
  s.stops = 6 + static_cast<int>(r.index(20));
  s.landmarks = 3 + static_cast<int>(r.index(5));
  s.repeats = r.index(3) ? 1 : 2 + static_cast<int>(r.index(4));
  constexpr NoiseLaw laws[] = {NoiseLaw::constant, NoiseLaw::f,         NoiseLaw::f_squared,
                               NoiseLaw::f_cubed,  NoiseLaw::d_squared, NoiseLaw::polynomial};
  s.law = laws[r.index(6)];
  s.spread = log_uniform(r, 2e-3, 0.08);
  s.sigma_theta_rad = log_uniform(r, 2e-3, 0.05);
  s.sigma_s_m = r.index(8) ? log_uniform(r, 1e-3, 0.08) : 0.0;
  s.sigma_h_rad = r.index(3) ? 0.0 : log_uniform(r, 1e-3, 0.05);
  s.path = static_cast<int>(r.index(3));
  s.radius_m = r.index(2) ? 0.0 : r.uniform(0.01, 0.12);
  s.fitted_order = 1 + static_cast<int>(r.index(3));
  world.kinds = {static_cast<int>(id % kinds.size())};
  if (r.uniform() < 0.4) world.kinds.push_back(static_cast<int>(r.index(kinds.size())));
  if (r.uniform() < 0.15) world.kinds.push_back(static_cast<int>(r.index(kinds.size())));
  for (auto kind = world.kinds.rbegin(); kind != world.kinds.rend(); ++kind) kinds[*kind].apply(s, r);
  s.fitted_law = r.index(4) ? s.law : laws[r.index(6)];

  Recording& recording = world.recording;
  recording.path = "world " + std::to_string(id);
  recording.sigma_xy_m = s.claimed_s * s.sigma_s_m;
  recording.estimate_sigma_xy = s.estimate_sigma_s;
  recording.sigma_heading_rad = s.claimed_h * s.sigma_h_rad;
  recording.stop_error = s.error;
  const std::vector<Pose2> commanded = detail::commanded_path(s, r);
  for (std::size_t k = 0; k < commanded.size(); ++k) {
    Stop stop;
    stop.label = std::to_string(k);
    stop.commanded = commanded[k];
    recording.stops.push_back(stop);
  }
  std::vector<Eigen::Vector2d> landmarks;
  for (int l = 0; l < s.landmarks; ++l) {
    landmarks.push_back(detail::landmark_at(s, commanded, r));
    recording.landmarks.push_back({"L" + std::to_string(l), s.radius_m, std::nullopt});
  }
  if (s.taped_wrong >= 0.0 && s.landmarks > 1)
    recording.known_distances.push_back(
        {0, 1, (landmarks[1] - landmarks[0]).norm() + 0.01 * s.taped_wrong, 0.01});
  detail::add_readings(s, detail::true_path(s, commanded, r), landmarks, r, recording);
  return world;
}

}  // namespace rangecal::hard
