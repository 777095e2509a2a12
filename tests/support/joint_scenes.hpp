// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <string_view>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/landmarks/joint_problem.hpp"
#include "rangecal/solvers/covariance/cramer_rao.hpp"

namespace rangecal::testing {

/// A 2021 setting made in memory: a line or turning path of K stops, L landmarks at both sides.
struct SceneOptions {
  int stops = 20, landmarks = 5, repeats = 1;
  NoiseLaw law = NoiseLaw::f_squared;
  double sigma_e = 0.01, sigma_theta = 0.0087, sigma_s = 0.01, sigma_heading = 0.0;
  bool walk = false, places = false, turns = false;
  bool shaped = false;        ///< covariances of their own, of the sigmas above
  bool own_headings = false;  ///< of a walk: headings have errors of their own, which do not add up
};

/// Q of stop k (stop_prior.hpp): from 3 to 1 of the variances in the plane, all three errors correlated.
inline Eigen::Matrix3d stop_shape(int k) {
  const double s = k % 2 ? -1.0 : 1.0;
  Eigen::Matrix3d Q;
  Q << 1.5, 0.3 * s, 0.4 * s, 0.3 * s, 0.5, -0.35, 0.4 * s, -0.35, 1.0;
  return Q;
}

/// What a joint problem can have, each in turn added to a plain scene.
struct SceneVariants {
  explicit SceneVariants(const SceneOptions& base)
      : plain(base),
        headings(base),
        walk(base),
        places(base),
        shapes(base),
        polynomial(base),
        repeats(base),
        d_squared(base),
        f_cubed(base),
        constant(base) {
    headings.sigma_heading = 0.01;
    headings.turns = true;
    walk.walk = true;
    walk_headings = walk;
    walk_headings.turns = true;
    walk_headings.sigma_heading = 0.02;
    walk_positions = walk_headings;
    walk_positions.own_headings = true;
    walk_places = walk_headings;
    walk_places.places = true;
    places.places = places.turns = true;
    places.sigma_heading = 0.01;
    shapes = places;
    shapes.shaped = true;
    walk_shapes = walk_places;
    walk_shapes.shaped = true;
    plane_shapes = walk;
    plane_shapes.turns = plane_shapes.shaped = true;
    polynomial.law = NoiseLaw::polynomial;
    repeats.repeats = 5;
    d_squared.law = NoiseLaw::d_squared;
    f_cubed.law = NoiseLaw::f_cubed;
    constant.law = NoiseLaw::constant;
  }
  /// All of them as cases of a test, `Case{name, options}`.
  template <typename Case>
  std::vector<Case> cases() const {
    return {{"plain", plain},
            {"headings", headings},
            {"walk", walk},
            {"walk_headings", walk_headings},
            {"places", places},
            {"polynomial", polynomial},
            {"repeats", repeats},
            {"walk_places", walk_places},
            {"d_squared", d_squared},
            {"f_cubed", f_cubed},
            {"constant", constant},
            {"shapes", shapes},
            {"walk_shapes", walk_shapes},
            {"plane_shapes", plane_shapes},
            {"walk_positions", walk_positions}};
  }

  SceneOptions plain, headings, walk, walk_headings, walk_places, walk_positions, places, shapes, walk_shapes,
      plane_shapes, polynomial, repeats, d_squared, f_cubed, constant;
};

struct JointScene {
  JointProblem problem;
  JointState truth;
};

/// Cells are drawn directly: one cell per (stop, landmark), mean and mean square of `repeats` readings.
inline JointScene make_scene(std::string_view name, const SceneOptions& o, std::uint64_t repeat = 0) {
  Random random(seed_from(name, {repeat}));
  JointScene scene;
  JointProblem& p = scene.problem;
  JointState& t = scene.truth;
  for (int k = 0; k < o.stops; ++k) {
    StopPrior prior;
    prior.commanded = {0.3 * k, o.turns ? std::sin(0.4 * k) : 0.0, o.turns ? 0.5 * k : 0.0};
    prior.sigma_xy_m = o.sigma_s;
    prior.sigma_heading_rad = o.sigma_heading;
    prior.chained = o.walk && k > 0;
    prior.turns_add_up = !o.own_headings;
    if (o.places && k % 3 == 2) {
      prior.place = p.place_count - 1;
      prior.opens_place = false;
      prior.commanded.x_m = p.stops.back().commanded.x_m;
      prior.commanded.y_m = p.stops.back().commanded.y_m;
    } else {
      prior.place = p.place_count++;
    }
    if (o.shaped && prior.opens_place) prior.shape = std::make_shared<const Eigen::Matrix3d>(stop_shape(k));
    p.stops.push_back(prior);
    p.sigma_s_shared.push_back(0);
  }
  t.alpha = Eigen::Vector3d(0.0525, 0.8838, 0.0584);
  t.noise.law = o.law;
  t.noise.parameters = o.law == NoiseLaw::polynomial ? Eigen::VectorXd(0.05 * t.alpha)
                                                     : Eigen::VectorXd::Constant(1, o.sigma_e);
  t.sigma_theta_rad = o.sigma_theta;
  t.stops = draw_stops(p, t, random.bits());
  for (int l = 0; l < o.landmarks; ++l) {
    p.landmark_radius_m.push_back(0.12);
    p.landmark_recording.push_back(0);
    const double along = 0.3 * o.stops * (l + 0.5) / o.landmarks, side = l % 2 ? -1.0 : 1.0;
    t.landmarks.emplace_back(along + random.uniform(-0.3, 0.3), side * random.uniform(1.4, 2.6));
  }
  Cells& c = p.cells;
  c.stop_begin.push_back(0);
  for (int k = 0; k < o.stops; ++k) {
    for (int l = 0; l < o.landmarks; ++l) {
      const Eigen::Vector2d v = t.landmarks[l] - Eigen::Vector2d(t.stops[k].x_m, t.stops[k].y_m);
      const double d = v.norm() - 0.12, f = evaluate_polynomial(t.alpha, d), s = t.noise.spread(d, f);
      if (d > 5.0) continue;
      double sum = 0, square = 0, turn = 0, turn_square = 0;
      for (int r = 0; r < o.repeats; ++r) {
        const double e = random.normal(0, s), b = random.normal(0, o.sigma_theta);
        sum += e;
        square += e * e;
        turn += b;
        turn_square += b * b;
      }
      const double n = o.repeats;
      c.stop.push_back(k);
      c.landmark.push_back(l);
      c.count.push_back(n);
      c.range_weight.push_back(n);
      c.bearing_weight.push_back(n);
      c.range_mean.push_back(f + sum / n);
      c.range_mean_square.push_back(std::max(0.0, square / n - sum * sum / (n * n)));
      c.bearing_mean.push_back(wrap_angle(std::atan2(v.y(), v.x()) - t.stops[k].heading_rad + turn / n));
      c.bearing_mean_square.push_back(std::max(0.0, turn_square / n - turn * turn / (n * n)));
      c.radius_m.push_back(0.12);
      p.readings += n;
    }
    c.stop_begin.push_back(static_cast<int>(c.stop.size()));
  }
  return scene;
}

}  // namespace rangecal::testing
