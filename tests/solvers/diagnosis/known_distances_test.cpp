// SPDX-License-Identifier: BSD-3-Clause
// Pairs solved by passes over their cells against the same problem solved as landmarks whose stops stand.
#include "diagnosis/known_distances.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>

#include "diagnosis/working.hpp"
#include "rangecal/core/random.hpp"
#include "solvers/diagnosis/state_of_pairs.hpp"

namespace rangecal::diagnosis {
namespace {

/// 300 distances in no order, some of three readings, of f = 0.05 + 0.9 d + 0.05 d^2 with s = 0.01 f^2; `robust`: with
/// weights as a fit with long tails gives.
Rows rows_of(const std::string& name, bool robust) {
  Random random(seed_from(name, {}));
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = name;
  for (int i = 0; i < 300; ++i) {
    recording.pairs.batch_labels.push_back(std::to_string(i));
    const double d = random.uniform(0.3, 5.0), f = 0.05 + d * (0.9 + 0.05 * d);
    for (int r = 0; r < (i % 3 == 0 ? 3 : 1); ++r) {
      recording.pairs.true_m.push_back(d);
      recording.pairs.reading_m.push_back(random.normal(f, 0.01 * f * f));
      recording.pairs.batch.push_back(i);
    }
  }
  Rows rows = make_rows(std::vector{recording});
  Cells& cells = rows.problem.cells;
  if (robust)
    for (std::size_t c = 0; c < cells.size(); ++c) cells.range_weight[c] *= random.uniform(0.2, 1.5);
  return rows;
}

JointState start_of(const Rows& rows, NoiseLaw law) {
  return testing::state_of_pairs(rows, Eigen::Vector3d(0.03, 0.93, 0.045), law, 0.02);
}

class KnownDistances : public ::testing::TestWithParam<NoiseLaw> {};

TEST_P(KnownDistances, AreSolvedAsLandmarksWhoseStopsStand) {
  for (const bool robust : {false, true}) {
    const Rows rows = rows_of("KnownDistances", robust);
    const JointState start = start_of(rows, GetParam());
    const auto fast = solve_at_known_distances(rows.problem, start);
    MarginalOptions options;
    options.held.landmarks = true;
    const MarginalFit general = solve_marginal(rows.problem, start, options);
    ASSERT_TRUE(fast.has_value());
    ASSERT_EQ(general.outcome, Outcome::converged) << general.reason;
    EXPECT_NEAR(fast->marginal_nll, general.marginal_nll, 1e-6);
    ASSERT_TRUE(fast->covariance && general.covariance);
    const Eigen::VectorXd spread = general.covariance->diagonal().cwiseSqrt();
    for (Eigen::Index a = 0; a < 3; ++a)
      EXPECT_NEAR(fast->state.alpha[a], general.state.alpha[a], 1e-4 * spread[a]) << a;
    for (Eigen::Index j = 0; j < start.noise.parameters.size(); ++j)
      EXPECT_NEAR(fast->state.noise.parameters[j] / general.state.noise.parameters[j], 1.0, 1e-5) << j;
    EXPECT_NEAR(fast->state.sigma_theta_rad, general.state.sigma_theta_rad, 1e-6);
    EXPECT_LT((*fast->covariance - *general.covariance).norm(), 1e-4 * general.covariance->norm());
    EXPECT_EQ(fast->weakest_direction.empty(), general.weakest_direction.empty());
  }
}

TEST(KnownDistances, AreProjectedByTheirCurveAlone) {
  Rows rows = rows_of("KnownDistances.Projected", true);
  const JointState state = start_of(rows, NoiseLaw::f_squared);
  const Projector exact(rows, working_problem(rows, {}, state), state);
  const Eigen::Index n = exact.cells();
  Signature shape;
  shape.range.resize(n);
  shape.bearing = Eigen::VectorXd::Zero(n);
  Eigen::MatrixXd X(n, 3);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double d = exact.geometry().d[static_cast<std::size_t>(i)];
    shape.range[i] = std::sin(5.0 * d);
    X.row(i) << 1.0, d, d * d;
  }
  // P = W - W X (X^T W X)^-1 X^T W
  const Eigen::MatrixXd W = exact.range_information.asDiagonal();
  const Eigen::VectorXd expected =
      W * (shape.range - X * (X.transpose() * W * X).ldlt().solve(X.transpose() * W * shape.range));
  EXPECT_LT((exact.project(shape).head(n) - expected).norm(), 1e-9 * expected.norm());
  // Of distances known to a nanometre the same, with every stop an unknown.
  for (StopPrior& stop : rows.problem.stops) stop.sigma_xy_m = 1e-9;
  const Projector nearly(rows, working_problem(rows, {}, state), state);
  EXPECT_LT((nearly.project(shape).head(n) - expected).norm(), 1e-6 * expected.norm());
}

INSTANTIATE_TEST_SUITE_P(Laws, KnownDistances,
                         ::testing::Values(NoiseLaw::constant, NoiseLaw::f, NoiseLaw::f_squared,
                                           NoiseLaw::f_cubed, NoiseLaw::d_squared));

TEST(KnownDistances, OfOneDistanceAreLeftToTheGeneralSolver) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = "one distance";
  Random random(seed_from("KnownDistances.OfOneDistance", {}));
  for (int i = 0; i < 20; ++i) {
    recording.pairs.true_m.push_back(2.0);
    recording.pairs.reading_m.push_back(random.normal(2.0, 0.01));
  }
  const Rows rows = make_rows(std::vector{recording});
  EXPECT_FALSE(solve_at_known_distances(rows.problem, start_of(rows, NoiseLaw::constant)).has_value());
}

}  // namespace
}  // namespace rangecal::diagnosis
