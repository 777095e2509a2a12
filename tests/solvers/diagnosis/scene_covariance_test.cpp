// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/diagnosis/scene_covariance.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "rangecal/core/recording_io.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {
namespace {

class SceneCovarianceTest : public ::testing::Test {
 protected:
  static Calibration calibrated(const Recording& recording) {
    CalibrateOptions options;
    options.methods = {Method::marginal};
    options.order = 2;
    options.noise = NoiseLaw::f_squared;
    return calibrate({&recording, 1}, options).front();
  }
  const std::string data = RANGECAL_SOURCE_DIR "/notebooks_data/";
};

TEST_F(SceneCovarianceTest, IsTheInverseOfTheWholeInformation) {
  const Recording recording = load_recording(data + "field-layout");
  const Calibration c = calibrated(recording);
  const SceneCovariance scene = scene_covariance({&recording, 1}, c);

  const JointProblem problem = make_joint_problem({&recording, 1});
  JointState state;
  state.alpha = c.alpha;
  state.noise = c.noise;
  state.sigma_theta_rad = c.sigma_theta_rad->value;
  for (const StopEstimate& s : c.stops) state.stops.push_back(s.pose);
  for (const LandmarkEstimate& l : c.landmarks) state.landmarks.push_back(l.position_m);
  JointSystem system(problem, 3, 1);
  system.assemble(state, HessianKind::fisher);
  const Eigen::MatrixXd inverse = system.dense_hessian().inverse();
  const JointLayout& layout = system.layout();
  // Relative: both invert the same matrix, whose condition number is some 1e6.
  for (std::size_t l = 0; l < scene.landmarks.size(); ++l) {
    ASSERT_TRUE(scene.landmarks[l]);
    const Eigen::Index at = layout.landmark_begin + 2 * static_cast<Eigen::Index>(l);
    EXPECT_TRUE(scene.landmarks[l]->isApprox(inverse.block<2, 2>(at, at), 1e-7)) << l;
  }
  for (std::size_t k = 0; k < scene.stops.size(); ++k) {
    ASSERT_TRUE(scene.stops[k]);
    const JointLayout::Node& node = layout.nodes[static_cast<std::size_t>(layout.node_of_stop[k])];
    const Eigen::Index at = layout.global_count + static_cast<Eigen::Index>(node.coordinate);
    EXPECT_TRUE(scene.stops[k]->isApprox(inverse.block<2, 2>(at, at), 1e-7)) << k;
  }
}

TEST_F(SceneCovarianceTest, ExactStopsAndPairsHaveNone) {
  Recording recording = load_recording(data + "field-layout");
  recording.sigma_xy_m = 0.0;
  const SceneCovariance scene = scene_covariance({&recording, 1}, calibrated(recording));
  EXPECT_FALSE(scene.stops.front());
  EXPECT_TRUE(scene.landmarks.front());
  const Recording pairs = load_recording(data + "pairs-2016");
  EXPECT_TRUE(scene_covariance({&pairs, 1}, calibrated(pairs)).landmarks.empty());
}

}  // namespace
}  // namespace rangecal
