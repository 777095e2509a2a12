// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <sstream>
#include <string>
#include <vector>

#include "apps/run_binary.hpp"
#include "rangecal/core/calibration_io.hpp"
#include "support/calibration_of.hpp"

namespace rangecal::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

class Export : public ::testing::Test {
 protected:
  /// f = 0.02 + 0.97 d + 0.01 d^2, s = 0.004 d^2, from 0.5 to 4.5 m.
  static Calibration parabola() {
    return rangecal::testing::calibration_of(Eigen::Vector3d(0.02, 0.97, 0.01), NoiseLaw::d_squared, 0.004,
                                             0.5, 4.5);
  }
  RunResult exported(const Calibration& calibration, const std::string& arguments) const {
    save_calibrations({calibration}, folder.file("cal.json"));
    return run("export " + folder.file("cal.json") + " " + arguments);
  }
  TemporaryFolder folder;
};

/// Rows of three numbers between "lookupTable [" and "]".
std::vector<std::vector<double>> rows_of(const std::string& text) {
  std::istringstream stream(text.substr(text.find("lookupTable [") + 13));
  std::vector<std::vector<double>> rows;
  double d = 0.0, value = 0.0, noise = 0.0;
  while (stream >> d >> value >> noise) rows.push_back({d, value, noise});
  return rows;
}

// The table as Webots reads it: value and noise linear between rows, the noise relative to the value.
TEST_F(Export, WebotsReadsTheCalibrationWithinTheTolerance) {
  for (const double tolerance : {0.001, 0.0002}) {
    const RunResult result = exported(parabola(), fmt::format("--to webots --tolerance {}", tolerance));
    ASSERT_EQ(result.code, 0) << result.err;
    EXPECT_THAT(result.out, AllOf(HasSubstr("# Made by rangecal"), HasSubstr("cal.json"),
                                  HasSubstr("DistanceSensor {"), HasSubstr("the mean is off by up to")));
    const auto rows = rows_of(result.out);
    ASSERT_GE(rows.size(), 3u);
    double mean_error = 0.0, noise_error = 0.0;
    for (int i = 0; i <= 10000; ++i) {
      const double d = 0.5 + 4.0 * i / 10000.0;
      std::size_t k = 1;
      while (k + 1 < rows.size() && rows[k][0] < d) ++k;
      const double share = (d - rows[k - 1][0]) / (rows[k][0] - rows[k - 1][0]);
      const double value = rows[k - 1][1] + share * (rows[k][1] - rows[k - 1][1]),
                   noise = rows[k - 1][2] + share * (rows[k][2] - rows[k - 1][2]);
      mean_error = std::max(mean_error, std::abs(value - (0.02 + 0.97 * d + 0.01 * d * d)));
      noise_error = std::max(noise_error, std::abs(value * noise - 0.004 * d * d));
    }
    EXPECT_LE(mean_error, tolerance * 1.01);  // numbers of seven digits
    EXPECT_LE(noise_error, tolerance * 1.01);
    // a chord of h is off by 0.01 h^2 / 4: at 0.2 mm h = 0.283 m, 4 m take 15 chords
    if (tolerance == 0.0002) {
      EXPECT_EQ(rows.size(), 16u);
    }
  }
}

TEST_F(Export, GazeboHasTheBestConstantsAndSaysWhatIsLost) {
  const RunResult result = exported(parabola(), "--to gazebo");
  ASSERT_EQ(result.code, 0) << result.err;
  // mean of 0.02 - 0.03 d + 0.01 d^2 over 0.5 to 4.5 m: 0.02 - 0.03 * 2.5 + 0.01 (4.5^3 - 0.5^3) / 12 = 0.020833
  EXPECT_THAT(result.out, HasSubstr("<mean>0.0208"));
  // root of the mean of (0.004 d^2)^2: 0.004 sqrt((4.5^5 - 0.5^5) / 20) = 0.03842
  EXPECT_THAT(result.out, HasSubstr("<stddev>0.0384"));
  EXPECT_THAT(result.out,
              AllOf(HasSubstr("<min>0.5</min>"), HasSubstr("<max>4.5</max>"), HasSubstr("at 4.5 m")));
  EXPECT_THAT(result.err, AllOf(HasSubstr("Not held: the curve"), HasSubstr("stands for 1 mm to 81 mm")));
  EXPECT_THAT(result.out, HasSubstr("the pose is to be filled in"));
}

TEST_F(Export, ThePoseIsThatOfTheEffects) {
  Calibration c = parabola();
  c.effects["lever_arm"] = {{"x_m", 0.031}, {"y_m", -0.012}};
  c.effects["bearing_offset"] = {{"angle_rad", 0.05}};
  c.effects_covariance = EffectsCovariance{{"lever_arm.x_m"}, 1e-6 * Eigen::MatrixXd::Identity(4, 4)};
  const RunResult urdf = exported(c, "--to urdf");
  ASSERT_EQ(urdf.code, 0) << urdf.err;
  EXPECT_THAT(urdf.out, HasSubstr("<origin xyz=\"0.031 -0.012 0\" rpy=\"0 0 -0.05\"/>"));
  EXPECT_THAT(urdf.err, HasSubstr("forward (lever_arm): 31.0 +- 1.0 mm"));
  EXPECT_THAT(exported(c, "--to gazebo").out, HasSubstr("<pose>0.031 -0.012 0 0 0 -0.05</pose>"));
  EXPECT_EQ(exported(parabola(), "--to urdf").code, 1);
}

TEST_F(Export, EffectsOfOtherThanTheDistanceAreNamedWithTheirSize) {
  Calibration c = parabola();
  c.effects["range_eccentricity"] = {{"cosine_m", 0.006}, {"sine_m", 0.0}};
  c.effects["range_offset"] = {{"offset_m", 0.1}};
  const RunResult result = exported(c, "--to csv");
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.err, HasSubstr("Not held: range_eccentricity by bearing_rad, up to 6 mm of the mean"));
  EXPECT_THAT(result.err,
              Not(HasSubstr("range_offset")));  // it acts at every distance alike, and is in the table
  EXPECT_TRUE(result.out.starts_with("distance_m,reading_m,relative_std\n0.5,0.6075,0.001646091\n"))
      << result.out;  // 0.02 + 0.485 + 0.0025 + 0.1; 0.001 of it
}

// A simulation whose sensor reads 4 cm more than the recording's: the patch reads as the recording does.
TEST_F(Export, APatchRepairsTheSimulation) {
  const std::string pairs = shipped("pairs-2016");
  ASSERT_EQ(run("calibrate " + pairs + " --json " + folder.file("true.json")).code, 0);
  Calibration simulation = load_calibration(folder.file("true.json"));
  const double truth = simulation.f(2.0);
  simulation.alpha(0) += 0.04;
  save_calibrations({simulation}, folder.file("sim.json"));
  const std::string against = "diagnose " + pairs + " --simulation " + folder.file("sim.json");
  const RunResult result = run(against + " --patch " + folder.file("patch"));
  ASSERT_EQ(result.code, 0) << result.err;
  const std::string check = slurp(folder.file("patch/check.txt"));
  EXPECT_THAT(check, AllOf(HasSubstr("the simulation as it is"), HasSubstr("with the causes found"),
                           HasSubstr("gain ")));
  const auto rows = rows_of(slurp(folder.file("patch/DistanceSensor.txt")));
  ASSERT_GE(rows.size(), 2u);
  std::size_t k = 1;
  while (k + 1 < rows.size() && rows[k][0] < 2.0) ++k;
  const double share = (2.0 - rows[k - 1][0]) / (rows[k][0] - rows[k - 1][0]);
  EXPECT_NEAR(rows[k - 1][1] + share * (rows[k][1] - rows[k - 1][1]), truth, 0.01);
  EXPECT_THAT(run("diagnose " + pairs + " --patch " + folder.file("none")).err,
              HasSubstr("needs --simulation"));
}

TEST_F(Export, WrongInputIsOneLine) {
  const auto refused = [&](const std::string& arguments, const std::string& word) {
    const RunResult result = exported(parabola(), arguments);
    EXPECT_EQ(result.code, 2) << arguments;
    EXPECT_EQ(result.out, "");
    EXPECT_THAT(result.err, HasSubstr(word));
    EXPECT_EQ(count_of(result.err, "\n"), 1) << result.err;
  };
  refused("--to morse", "not webots, gazebo, csv or urdf");
  refused("", "--to is required");
  refused("--to csv --tolerance 0", "is not a positive number");
  refused("--to csv -o " + folder.file("cal.json"), "would be lost");
  refused("--to csv -o " + folder.file("none/a.csv"), "cannot be written");
}

}  // namespace
}  // namespace rangecal::test
