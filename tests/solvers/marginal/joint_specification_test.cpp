// SPDX-License-Identifier: BSD-3-Clause
// The joint likelihood, Laplace's and the restricted one, values and slopes, against an executable specification that differentiates by
// itself: tests/data/joint_specification/README.md.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <fstream>
#include <map>
#include <string>
#include <vector>

#include "marginal/laplace.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"

namespace rangecal {
namespace {

const std::string folder = std::string(RANGECAL_SOURCE_DIR) + "/tests/data/joint_specification/";

/// What the specification says of one recording, whose name begins with its noise law: "marginal_slope alpha" -> numbers; of a single number the name is empty.
using Told = std::map<std::string, std::vector<double>>;

std::map<std::string, Told> told_of_cases() {
  std::map<std::string, Told> cases;
  std::ifstream file(folder + "values.csv");
  std::string name, what, parameter, index, value;
  std::getline(file, name);
  while (std::getline(file, name, ',') && std::getline(file, what, ',') &&
         std::getline(file, parameter, ',') && std::getline(file, index, ',') && std::getline(file, value))
    cases[name][parameter.empty() ? what : what + " " + parameter].push_back(std::stod(value));
  return cases;
}

class JointSpecification : public ::testing::TestWithParam<std::string> {
 protected:
  JointSpecification()
      : told_(told_of_cases().at(GetParam())),
        recording_(load_recording(folder + GetParam())),
        problem_(make_joint_problem({&recording_, 1})) {
    problem_.estimate_sigma_s = true;
    problem_.sigma_s_shared.assign(problem_.stops.size(), 1);
    const auto numbers = [&](const char* name) { return told_.at(std::string("at ") + name); };
    const auto vector = [](const std::vector<double>& x) {
      return Eigen::VectorXd(Eigen::VectorXd::Map(x.data(), static_cast<Eigen::Index>(x.size())));
    };
    at_.alpha = vector(numbers("alpha"));
    at_.noise.law = noise_law_from_string(GetParam().substr(0, GetParam().find('_')));
    at_.noise.parameters = vector(numbers("tau"));
    if (has_sigma(at_.noise.law)) at_.noise.parameters = at_.noise.parameters.array().exp();
    at_.sigma_theta_rad =
        problem_.reads_bearings ? std::exp(numbers("log_sigma_theta")[0]) : SilentBearing::sigma_theta_rad;
    at_.sigma_s_m = std::exp(numbers("log_sigma_s")[0]);
    const std::vector<double> axes = numbers("landmark_axis"), places = numbers("place_position"),
                              headings = numbers("heading");
    for (std::size_t l = 0; l < axes.size(); l += 2) at_.landmarks.emplace_back(axes[l], axes[l + 1]);
    for (std::size_t k = 0; k < headings.size(); ++k) {
      const auto place = static_cast<std::size_t>(2 * problem_.stops[k].place);
      at_.stops.push_back({places[place], places[place + 1], headings[k]});
    }
  }

  JointSystem system() const {
    return {problem_, static_cast<int>(at_.alpha.size()), static_cast<int>(at_.noise.parameters.size()),
            true};
  }

  double nll(const char* what) const { return told_.at(what)[0]; }

  /// The slopes that the specification has of some parameters, 0 where it has none, in the library's order of them.
  Eigen::VectorXd slopes_of_globals(const std::string& what, const JointLayout& layout) const {
    Eigen::VectorXd slopes = Eigen::VectorXd::Zero(layout.global_count);
    const auto put = [&](const char* name, int begin) {
      const auto found = told_.find(what + " " + name);
      for (std::size_t j = 0; found != told_.end() && j < found->second.size(); ++j)
        slopes[begin + static_cast<int>(j)] = found->second[j];
    };
    put("alpha", 0);
    put("landmark_axis", layout.landmark_begin);
    put("tau", layout.tau_begin);
    put("log_sigma_theta", layout.sigma_theta);
    put("log_sigma_s", layout.sigma_s);
    return slopes;
  }

  static void expect_near(const Eigen::VectorXd& own, const Eigen::VectorXd& specified, double share) {
    ASSERT_EQ(own.size(), specified.size());
    for (Eigen::Index i = 0; i < own.size(); ++i)
      EXPECT_NEAR(own[i], specified[i], share * (1.0 + std::abs(specified[i]))) << "slope " << i;
  }

  Told told_;
  Recording recording_;
  JointProblem problem_;
  JointState at_;
};

TEST_P(JointSpecification, JointNllAndItsSlopes) {
  JointSystem own = system();
  EXPECT_NEAR(own.assemble(at_, HessianKind::exact), nll("joint_nll"), 1e-10 * std::abs(nll("joint_nll")));
  EXPECT_NEAR(joint_nll(problem_, at_), nll("joint_nll"), 1e-10 * std::abs(nll("joint_nll")));
  expect_near(own.global_gradient(), slopes_of_globals("joint_slope", own.layout()), 1e-10);
  Eigen::VectorXd stops = Eigen::VectorXd::Zero(own.layout().coordinates);
  for (const JointLayout::Node& node : own.layout().nodes) {
    const auto k = static_cast<std::size_t>(node.stops.front());
    for (int axis = 0; axis < 2; ++axis)
      stops[node.coordinate + axis] = told_.at(
          "joint_slope place_position")[static_cast<std::size_t>(2 * problem_.stops[k].place + axis)];
    for (std::size_t s = 0; s < node.stops.size(); ++s)
      stops[node.coordinate + node.heading[s]] =
          told_.at("joint_slope heading")[static_cast<std::size_t>(node.stops[s])];
  }
  expect_near(own.stop_gradient(), stops, 1e-10);
}

TEST_P(JointSpecification, LaplaceNllAndItsSlopes) {
  const LaplaceValue value = laplace_marginal(problem_, at_);
  ASSERT_TRUE(value.ok);
  EXPECT_NEAR(value.marginal_nll, nll("marginal_nll"), 1e-10 * std::abs(nll("marginal_nll")));
  JointSystem own = system();
  own.assemble(value.state, HessianKind::exact);
  ASSERT_TRUE(own.eliminate());
  expect_near(own.reduced_gradient() + own.log_det_gradient(value.state),
              slopes_of_globals("marginal_slope", own.layout()), 1e-9);
}

TEST_P(JointSpecification, RestrictedNllAndItsSlopes) {
  // Curve and landmarks integrated out as well, by Laplace's method about their joint optimum given the sigmas:
  //   joint NLL + 1/2 log det H_ss + 1/2 log det A - (number of stop coordinates and phi) / 2 log 2 pi
  JointOptions options;
  options.held.sigmas = true;
  options.gradient_tolerance = 1e-11;
  const JointState best = solve_joint_block(problem_, at_, options).state;
  JointSystem own = system();
  const JointLayout& layout = own.layout();
  const double joint = own.assemble(best, HessianKind::exact);
  ASSERT_TRUE(own.eliminate());
  const int phis = layout.phi_count, sigmas = layout.sigma_count();
  const Eigen::MatrixXd A = own.schur().topLeftCorner(phis, phis);
  const Eigen::LLT<Eigen::MatrixXd> factor(A);
  ASSERT_EQ(factor.info(), Eigen::Success);
  EXPECT_NEAR(
      laplace_nll(own, joint) + factor.matrixLLT().diagonal().array().log().sum() - phis * half_log_two_pi,
      nll("restricted_nll"), 1e-10 * std::abs(nll("restricted_nll")));
  const Eigen::MatrixXd covariance = factor.solve(Eigen::MatrixXd::Identity(phis, phis));
  const Eigen::VectorXd of_determinants =
      own.log_det_gradient(best) + own.log_det_phi_gradient(best, covariance);
  const Eigen::MatrixXd turn = -covariance * own.schur().topRightCorner(phis, sigmas);  // d phi-hat / d sigma
  const Eigen::VectorXd slopes = own.reduced_gradient().tail(sigmas) + of_determinants.tail(sigmas) +
                                 turn.transpose() * of_determinants.head(phis);
  expect_near(slopes, slopes_of_globals("restricted_slope", layout).tail(sigmas), 1e-8);
}

INSTANTIATE_TEST_SUITE_P(OfEveryRecording, JointSpecification,
                         ::testing::Values("f2", "f2_places", "f2_random_walk", "f2_taped", "f2_ranges_alone",
                                           "constant", "f", "f3", "d2", "polynomial"),
                         [](const auto& info) { return info.param; });

}  // namespace
}  // namespace rangecal
