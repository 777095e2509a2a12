// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/projector.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "calibrate/smoothing_spline.hpp"
#include "diagnosis/working.hpp"
#include "solvers/diagnosis/state_of_pairs.hpp"
#include "support/pairs_of.hpp"

namespace rangecal::diagnosis {
namespace {

/// What a sensor that gives a voltage reads, at distances known to 2 cm.
Recording voltages() {
  std::vector<double> d, y;
  for (int i = 0; i < 30; ++i) {
    d.push_back(0.3 + 0.1 * i);
    y.push_back(0.4 + 3.0 / (d.back() + 0.2) + 0.01 * std::sin(7.0 * i));
  }
  Recording recording = testing::pairs_of(std::move(d), std::move(y));
  recording.reference.sigma_m = 0.02;
  return recording;
}

class ProjectorOfPairs : public ::testing::TestWithParam<CurveFamily> {};

TEST_P(ProjectorOfPairs, KnowsWhatReadingsChangeByWhereAnUncertainDistanceMoves) {
  const Recording recording = voltages();
  CurveScale scale{GetParam(), 0.2, {}};
  if (GetParam() == CurveFamily::spline)
    scale = smoothing_spline(recording.pairs.true_m, recording.pairs.reading_m)->scale;
  const Rows rows = make_rows({&recording, 1}, {scale, 1});
  const JointState state =
      testing::state_of_pairs(rows, Eigen::Vector2d(0.4, GetParam() == CurveFamily::reciprocal ? 3.0 : 0.7),
                              NoiseLaw::constant, 0.01);
  const Projector projector(rows, working_problem(rows, {}, state), state);
  const Eigen::Index stops = projector.system().layout().coordinates;
  ASSERT_EQ(stops, 2 * rows.cell_count);  // x, y of each
  const double h = 1e-6;
  Eigen::VectorXd moved = Eigen::VectorXd::Zero(stops);
  for (Eigen::Index i = 0; i < stops; i += 2) moved[i] = h;
  JointState away = state;
  for (Pose2& stop : away.stops) stop.x_m += h;
  const std::vector<double> before = cell_geometry(rows, state).f, after = cell_geometry(rows, away).f;
  const Signature change = projector.of_calibration(Eigen::VectorXd::Zero(4), moved);
  for (std::size_t c = 0; c < before.size(); ++c)
    EXPECT_NEAR(change.range[static_cast<Eigen::Index>(c)], after[c] - before[c],
                1e-5 * std::abs(after[c] - before[c]))
        << "cell " << c;
}

INSTANTIATE_TEST_SUITE_P(OnEveryScale, ProjectorOfPairs,
                         ::testing::Values(CurveFamily::polynomial, CurveFamily::reciprocal,
                                           CurveFamily::spline),
                         [](const auto& info) { return std::string(to_string(info.param)); });

}  // namespace
}  // namespace rangecal::diagnosis
