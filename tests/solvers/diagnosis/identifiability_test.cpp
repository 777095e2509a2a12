// SPDX-License-Identifier: BSD-3-Clause
// A usual design: 11 stops 0.3 m apart, five landmarks of 12 cm at 0.9 to 3.4 m, 20 repeats, sigma_r = 2 mm + 3 mm d^2,
// sigma_b = 0.5 degrees, stops to 1 cm, headings to 0.3 degrees.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "diagnosis/extended_design.hpp"
#include "diagnosis/unseen.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double degree = std::numbers::pi / 180.0;

struct TableDesign {
  Rows rows;
  JointState state;

  TableDesign() {
    Recording recording;
    state.alpha = Eigen::Vector3d(0.0525, 0.8838, 0.0584);
    state.noise.law = NoiseLaw::polynomial;
    state.noise.parameters = Eigen::Vector3d(0.002, 0.0, 0.003);
    state.sigma_theta_rad = 0.5 * degree;
    state.landmarks = {{-0.6, 1.1}, {0.8, -1.0}, {1.7, 1.4}, {2.9, -1.2}, {3.9, 0.9}};
    for (int l = 0; l < 5; ++l) recording.landmarks.push_back({std::to_string(l), 0.12, {}});
    recording.sigma_heading_rad = 0.3 * degree;
    for (int k = 0; k < 11; ++k) {
      Stop stop;
      stop.label = std::to_string(k);
      stop.commanded = {0.3 * k, 0.0, 0.0};
      recording.stops.push_back(stop);
      state.stops.push_back(stop.commanded);
      for (int l = 0; l < 5; ++l)
        for (int j = 0; j < 20; ++j) {
          const Eigen::Vector2d line =
              state.landmarks[static_cast<std::size_t>(l)] - Eigen::Vector2d(0.3 * k, 0.0);
          recording.readings.stop.push_back(k);
          recording.readings.landmark.push_back(l);
          recording.readings.repeat.push_back(j);
          recording.readings.time_s.push_back(30.0 * k + j);
          recording.readings.range_m.push_back(line.norm());
          recording.readings.bearing_rad.push_back(std::atan2(line.y(), line.x()));
        }
    }
    rows = make_rows({&recording, 1});
  }
};

double visibility(const Space& space, const char* id) {
  return std::sqrt(typical_effect(space, *find_effect(id))->noncentrality);
}

/// The same from the equations of a reading alone, by dense algebra: a change x of the cell means is seen at
///   lambda = x^T W x - x^T W J (J^T W J + prior)^-1 J^T W x,
/// J by central differences in alpha, landmarks, places and headings, W the cells' counts over their variances.
class ByHand {
 public:
  ByHand(const Rows& rows, const JointState& state) : rows_(rows), state_(state) {
    const Cells& c = rows.problem.cells;
    const Eigen::Index cells = static_cast<Eigen::Index>(c.size());
    const auto tapes = static_cast<Eigen::Index>(rows.problem.known_distances.size());
    weight_.resize(2 * cells + tapes);
    for (Eigen::Index i = 0; i < cells; ++i) {
      const auto cell = static_cast<std::size_t>(i);
      const double d = distance(state, cell), s = 0.002 + 0.003 * d * d;
      weight_[i] = c.count[cell] / (s * s);
      weight_[cells + i] = c.count[cell] / (state.sigma_theta_rad * state.sigma_theta_rad);
    }
    for (Eigen::Index t = 0; t < tapes; ++t)
      weight_[2 * cells + t] =
          std::pow(rows.problem.known_distances[static_cast<std::size_t>(t)].sigma_m, -2.0);
    for (Eigen::Index a = 0; a < state.alpha.size(); ++a)
      add([a](JointState& at, double h) { at.alpha[a] += h; }, 0.0);
    for (std::size_t l = 0; l < state.landmarks.size(); ++l)
      for (Eigen::Index axis : {0, 1})
        add([=](JointState& at, double h) { at.landmarks[l][axis] += h; }, 0.0);
    const std::vector<StopPrior>& stops = rows.problem.stops;
    for (std::size_t k = 0; k < stops.size(); ++k) {
      const auto together = [&stops, place = stops[k].place](JointState& at, double x, double y) {
        for (std::size_t j = 0; j < stops.size(); ++j)
          if (stops[j].place == place) at.stops[j].x_m += x, at.stops[j].y_m += y;
      };
      const double xy = 1.0 / (stops[k].sigma_xy_m * stops[k].sigma_xy_m);
      if (stops[k].opens_place) {
        add([=](JointState& at, double h) { together(at, h, 0.0); }, xy);
        add([=](JointState& at, double h) { together(at, 0.0, h); }, xy);
      }
      add([=](JointState& at, double h) { at.stops[k].heading_rad += h; },
          1.0 / (stops[k].sigma_heading_rad * stops[k].sigma_heading_rad));
    }
  }

  /// sqrt(lambda) of changes of every cell's range and bearing by its distance, axis distance and bearing.
  template <typename Change>
  double of_readings(const Change& change) const {
    const std::size_t cells = rows_.problem.cells.size();
    const Eigen::VectorXd f = predicted(state_);
    Eigen::VectorXd x = Eigen::VectorXd::Zero(f.size());
    for (std::size_t i = 0; i < cells; ++i) {
      const auto at = static_cast<Eigen::Index>(i);
      const double radius = rows_.problem.cells.radius_m[i], d = distance(state_, i);
      const auto [range, bearing] = change(d, d + radius, f[at + static_cast<Eigen::Index>(cells)], radius);
      x[at] = range;
      x[at + static_cast<Eigen::Index>(cells)] = bearing;
    }
    return seen(x);
  }
  /// sqrt(lambda) of stops that are moved and turned.
  double of_stops(const std::vector<Pose2>& moved) const {
    return seen(slope([&](JointState& at, double h) {
      for (std::size_t k = 0; k < moved.size(); ++k) {
        at.stops[k].x_m += h * moved[k].x_m;
        at.stops[k].y_m += h * moved[k].y_m;
        at.stops[k].heading_rad += h * moved[k].heading_rad;
      }
    }));
  }

 private:
  double distance(const JointState& at, std::size_t i) const {
    const Cells& c = rows_.problem.cells;
    const Pose2& pose = at.stops[static_cast<std::size_t>(c.stop[i])];
    return (at.landmarks[static_cast<std::size_t>(c.landmark[i])] - Eigen::Vector2d(pose.x_m, pose.y_m))
               .norm() -
           c.radius_m[i];
  }
  Eigen::VectorXd predicted(const JointState& at) const {
    const Cells& c = rows_.problem.cells;
    const auto cells = static_cast<Eigen::Index>(c.size());
    Eigen::VectorXd f(weight_.size());
    for (Eigen::Index i = 0; i < cells; ++i) {
      const auto cell = static_cast<std::size_t>(i);
      const Pose2& pose = at.stops[static_cast<std::size_t>(c.stop[cell])];
      const Eigen::Vector2d way =
          at.landmarks[static_cast<std::size_t>(c.landmark[cell])] - Eigen::Vector2d(pose.x_m, pose.y_m);
      const double d = distance(at, cell);
      f[i] = at.alpha[0] + d * (at.alpha[1] + d * at.alpha[2]);
      f[cells + i] = std::atan2(way.y(), way.x()) - pose.heading_rad;
    }
    for (std::size_t t = 0; t < rows_.problem.known_distances.size(); ++t) {
      const KnownDistance& tape = rows_.problem.known_distances[t];
      f[2 * cells + static_cast<Eigen::Index>(t)] = (at.landmarks[static_cast<std::size_t>(tape.from)] -
                                                     at.landmarks[static_cast<std::size_t>(tape.to)])
                                                        .norm();
    }
    return f;
  }
  template <typename Move>
  Eigen::VectorXd slope(const Move& move) const {
    constexpr double h = 1e-5;  // rounding 1e-11, truncation 1e-10
    JointState up = state_, down = state_;
    move(up, h);
    move(down, -h);
    return (predicted(up) - predicted(down)) / (2.0 * h);
  }
  template <typename Move>
  void add(const Move& move, double prior) {
    columns_.push_back(slope(move));
    prior_.push_back(prior);
  }
  double seen(const Eigen::VectorXd& x) const {
    const auto unknowns = static_cast<Eigen::Index>(columns_.size());
    Eigen::MatrixXd J(x.size(), unknowns);
    for (Eigen::Index j = 0; j < unknowns; ++j) J.col(j) = columns_[static_cast<std::size_t>(j)];
    const Eigen::MatrixXd WJ = weight_.asDiagonal() * J;
    Eigen::MatrixXd H = J.transpose() * WJ;
    H.diagonal() += Eigen::Map<const Eigen::VectorXd>(prior_.data(), unknowns);
    const Eigen::VectorXd pull = WJ.transpose() * x, unit = H.diagonal().cwiseSqrt().cwiseInverse();
    const Eigen::MatrixXd scaled = unit.asDiagonal() * H * unit.asDiagonal();
    const Eigen::VectorXd taken = unit.asDiagonal() * scaled.ldlt().solve(unit.asDiagonal() * pull);
    return std::sqrt(x.dot(weight_.cwiseProduct(x)) - pull.dot(taken));
  }

  const Rows& rows_;
  const JointState& state_;
  Eigen::VectorXd weight_;
  std::vector<Eigen::VectorXd> columns_;
  std::vector<double> prior_;
};

double range_error_mm(const Space& space, const char* id) {
  return 1e3 * range_error_of(space, *typical_effect(space, *find_effect(id)));
}

TEST(Identifiability, AbsorbedEffectsLeaveNothingAndCostWhatTheTableSays) {
  const TableDesign design;
  const Space space(design.rows, {}, design.state);
  for (const char* id : {"range_offset", "radius_scale", "arc_definition", "odometry_scale", "lever_arm",
                         "range_scale", "laser_pointing"})
    EXPECT_LT(visibility(space, id), 0.2) << id;
  EXPECT_NEAR(range_error_mm(space, "range_offset"), 5.0, 0.75);    // 5 mm
  EXPECT_NEAR(range_error_mm(space, "radius_scale"), 6.0, 0.9);     // 5 % of 12 cm
  EXPECT_NEAR(range_error_mm(space, "odometry_scale"), 26.0, 3.9);  // 1 % of the axis distances
  EXPECT_NEAR(range_error_mm(space, "arc_definition"), 24.0,
              3.6);  // 0.2 of 12 cm; the table's 26 is 0.215 of it
  EXPECT_LT(range_error_mm(space, "range_scale") + range_error_mm(space, "laser_pointing") +
                range_error_mm(space, "lever_arm"),
            0.1);
}

TEST(Identifiability, VisibleEffectsShowAsTheEquationsSay) {
  const TableDesign design;
  const Space space(design.rows, {}, design.state);
  const ByHand hand(design.rows, design.state);
  using Change = std::pair<double, double>;
  constexpr double close = 1e-4;  // of differences in J, and of the Cholesky factors
  const double turned = hand.of_readings([](double, double, double, double) { return Change{0.0, 0.01745}; });
  EXPECT_NEAR(turned, 4.9, 0.74);  // the table's; a constant does not depend on where the landmarks are
  EXPECT_NEAR(visibility(space, "bearing_offset"), turned, close * turned);
  // A squint is a turned zero; a beam 22 mm beside the axis turns by asin(q / D): the table's 11, which like the next two
  // depends on the directions that it leaves open.
  const double beside = hand.of_readings([](double, double D, double, double) {
    return Change{0.0, -std::asin(0.022 / D)};
  });
  EXPECT_NEAR(visibility(space, "beam_offset"), std::max(beside, turned), close * beside);
  const double scaled = hand.of_readings([](double, double, double bearing, double) {
    return Change{0.0, 0.005 * bearing};
  });
  EXPECT_NEAR(visibility(space, "bearing_scale"), scaled, close * scaled);  // the table's 17
  // Steps of 0.3 m, turned by 0.02 / m times the path to their middle; headings by 0.02 / m times the path: 12.
  std::vector<Pose2> moved(11);
  for (std::size_t k = 1; k < moved.size(); ++k) {
    const double path = 0.3 * static_cast<double>(k), turn = 0.02 * (path - 0.15);
    moved[k] = {moved[k - 1].x_m + 0.3 * (std::cos(turn) - 1.0), moved[k - 1].y_m + 0.3 * std::sin(turn),
                0.02 * path};
  }
  const double curved = hand.of_stops(moved);
  EXPECT_NEAR(visibility(space, "path_curvature"), curved, close * curved);
}

TEST(Identifiability, ExactTwinsComeOut) {
  const TableDesign design;
  const Space space(design.rows, {}, design.state);
  const auto twins = find_twins(space, catalogue_of(space));
  const auto listed = [&](const char* a, const char* b) {
    return std::any_of(twins.begin(), twins.end(), [&](const auto& set) {
      return std::find(set.begin(), set.end(), a) != set.end() &&
             std::find(set.begin(), set.end(), b) != set.end();
    });
  };
  EXPECT_TRUE(listed("range_offset", "alpha_0"));
  EXPECT_TRUE(listed("bearing_offset", "heading_zero"));
  EXPECT_TRUE(listed("bearing_drift", "heading_drift"));
  EXPECT_TRUE(listed("radius_scale", "arc_definition"));
  EXPECT_TRUE(listed("odometry_scale", "alpha_1"));
  EXPECT_TRUE(listed("lever_arm", "landmarks"));
  EXPECT_FALSE(listed("bearing_drift", "bearing_offset"));
}

TEST(Identifiability, TurningShowsLeverArmAndTapeShowsPathScale) {
  const TableDesign design;
  const auto in = [&](const char* code, const char* id) {
    const ExtendedDesign extended = extend(design.rows, design.state, code);
    const Space space(extended.rows, {}, extended.state);
    return visibility(space, id);
  };
  constexpr double close = 1e-4;
  const ExtendedDesign turned = extend(design.rows, design.state, "E1");
  const ByHand after_turns(turned.rows, turned.state);
  double arm = 0.0;  // 2 cm along x or along y of the sensor, in the world
  for (const Eigen::Vector2d& offset : {Eigen::Vector2d(0.02, 0.0), Eigen::Vector2d(0.0, 0.02)}) {
    std::vector<Pose2> moved;
    for (const Pose2& pose : turned.state.stops) {
      const double c = std::cos(pose.heading_rad), s = std::sin(pose.heading_rad);
      moved.push_back({c * offset.x() - s * offset.y(), s * offset.x() + c * offset.y(), 0.0});
    }
    arm = std::max(arm, after_turns.of_stops(moved));
  }
  EXPECT_NEAR(arm, 118.0, 0.25 * 118.0);  // the table's, along x or y of its landmarks
  EXPECT_NEAR(in("E1", "lever_arm"), arm, close * arm);
  const ExtendedDesign taped = extend(design.rows, design.state, "E3");
  const ByHand with_tape(taped.rows, taped.state);
  std::vector<Pose2> longer;
  for (const Pose2& pose : taped.state.stops)
    longer.push_back({0.01 * (pose.x_m - taped.state.stops[0].x_m), 0.0, 0.0});
  const double scale = with_tape.of_stops(longer);  // the table's 3.1 grows with the taped length
  EXPECT_NEAR(in("E3", "odometry_scale"), scale, close * scale);
  const ExtendedDesign radii = extend(design.rows, design.state, "E4");
  // kappa = 0.2 of the radius before the curve, f' = 0.8838 + 0.1168 d: the table's 5.7.
  const double arc = ByHand(radii.rows, radii.state).of_readings([](double d, double, double, double radius) {
    const double nearer = 0.2 * radius;
    return std::pair{nearer * (0.8838 + 0.1168 * d + 0.0584 * nearer), 0.0};
  });
  EXPECT_NEAR(in("E4", "arc_definition"), arc, close * arc);
  EXPECT_LT(in("E1", "range_offset"), 0.05);  // exact in every design
  EXPECT_LT(in("E2", "odometry_scale"), 0.2);
}

TEST(Identifiability, DetectionThresholdIsThatOfOneTestAtTwoPercent) {
  // One question: z = 2.326 (two-sided 2 %), (2.326 + 0.842)^2 = 10.04.
  EXPECT_NEAR(detection_threshold(0.02, 1.0), 10.04, 0.01);
  EXPECT_NEAR(detection_power(detection_threshold(0.02, 400.0), 0.02, 400.0), 0.8, 1e-6);
}

TEST(Identifiability, WhatTheRepeatsShowIsNoTwinOfAConstant) {
  const TableDesign design;
  const Space space(design.rows, {}, design.state);
  for (const auto& set : find_twins(space, catalogue_of(space)))
    EXPECT_FALSE(std::count(set.begin(), set.end(), "heading_zero") &&
                 std::count(set.begin(), set.end(), "settling"));
}

TEST(Identifiability, ADropoutShowsBelowALimitNotAboveIt) {
  const TableDesign design;  // to 3.4 m
  const Space space(design.rows, {}, design.state);
  const std::optional<TypicalEffect> typical = typical_effect(space, *find_effect("dropout"));
  ASSERT_TRUE(typical);
  Rates rates;
  for (const Unseen& unseen : find_unseen(space, {*typical}, 0.02, rates)) {
    ASSERT_TRUE(unseen.detectable);
    EXPECT_LT(*unseen.detectable, unseen.typical.at("limit_m"));
  }
}

}  // namespace
}  // namespace rangecal::diagnosis
