// SPDX-License-Identifier: BSD-3-Clause
// The covariance of a stop or step in stops.csv: what is read, what falls back on the sigmas, what is
// refused.
#include <gtest/gtest.h>

#include "core/io/recording_folder.hpp"

namespace rangecal {
namespace {

using test::RecordingFolder;

const std::string kPlane = "stop,x_m,y_m,heading_rad,cov_xx_m2,cov_xy_m2,cov_yy_m2";
const std::string kWhole = kPlane + ",cov_hh_rad2,cov_xh_m_rad,cov_yh_m_rad";

Recording loaded(const std::string& stops,
                 const std::string& model = "sigma_xy_m: 0.01, sigma_heading_rad: 0.02") {
  RecordingFolder folder;
  folder.write("recording.yaml", "format: rangecal/1\nstops: {" + model + "}\n");
  folder.write("stops.csv", stops);
  return load_recording(folder.path());
}

TEST(StopCovariance, IsReadAsGiven) {
  const Recording recording = loaded(kWhole + "\n0,0,0,0,4e-4,1e-4,1e-4,9e-4,2e-4,-1e-4\n1,1,0,0,,,,,,\n");
  ASSERT_TRUE(recording.stops[0].covariance);
  Eigen::Matrix3d expected;
  expected << 4e-4, 1e-4, 2e-4, 1e-4, 1e-4, -1e-4, 2e-4, -1e-4, 9e-4;
  EXPECT_EQ(*recording.stops[0].covariance, expected);
  // Root mean square of 0.02 and 0.01 m: sqrt(2.5e-4).
  EXPECT_DOUBLE_EQ(sigma_xy_of(recording, recording.stops[0]), std::sqrt(2.5e-4));
  EXPECT_DOUBLE_EQ(sigma_heading_of(recording, recording.stops[0]), 0.03);
  EXPECT_FALSE(recording.stops[1].covariance) << "a row of empty fields has the sigmas";
  EXPECT_EQ(sigma_xy_of(recording, recording.stops[1]), 0.01);
  EXPECT_EQ(sigma_heading_of(recording, recording.stops[1]), 0.02);
}

TEST(StopCovariance, WithoutTheHeadingsVarianceItHasTheSigma) {
  const Recording recording =
      loaded(kPlane + ",sigma_heading_rad\n0,0,0,0,4e-4,1e-4,1e-4,\n1,1,0,0,4e-4,1e-4,1e-4,0.05\n");
  EXPECT_DOUBLE_EQ(sigma_heading_of(recording, recording.stops[0]), 0.02) << "that of recording.yaml";
  EXPECT_DOUBLE_EQ(sigma_heading_of(recording, recording.stops[1]), 0.05) << "that of the row";
  EXPECT_EQ((*recording.stops[0].covariance)(0, 2), 0.0);
  const Recording exact =
      loaded(kPlane + "\n0,0,0,0,4e-4,1e-4,1e-4\n1,1,0,0,4e-4,0,1e-4\n", "sigma_xy_m: 0.01");
  EXPECT_EQ(sigma_heading_of(exact, exact.stops[0]), 0.0);
}

TEST(StopCovariance, WhatNoErrorCanHaveIsRefused) {
  const RecordingFolder folder;
  const auto error = [&](const std::string& stops) { return folder.error_with("stops.csv", stops); };
  const std::string row = "\n0,0,0,0,";
  EXPECT_EQ(error("stop,x_m,y_m,heading_rad,cov_xx_m2,cov_yy_m2" + row + "4e-4,1e-4\n"),
            "stops.csv, row 1, column 'cov_xy_m2': the column is missing");
  EXPECT_EQ(error(kPlane + row + "4e-4,,1e-4\n"),
            "stops.csv, row 2, column 'cov_xy_m2': is missing beside other entries of the covariance");
  EXPECT_EQ(error(kPlane + row + "4e-4,0,-1e-4\n"), "stops.csv, row 2, column 'cov_yy_m2': is not positive");
  // Correlation 2e-4 / (0.02 0.01) = 1.
  EXPECT_EQ(error(kPlane + row + "4e-4,2e-4,1e-4\n"),
            "stops.csv, row 2, column 'cov_xy_m2': makes a covariance that is not positive definite");
  EXPECT_EQ(error(kWhole + row + "4e-4,0,1e-4,,1e-5,\n"),
            "stops.csv, row 2, column 'cov_hh_rad2': is missing beside a covariance with the heading");
  // Correlations 0.8 with x and -0.8 with y at a correlation of 0: 1 - 0.64 - 0.64 < 0.
  EXPECT_EQ(error(kWhole + row + "1e-4,0,1e-4,1e-4,8e-5,-8e-5\n"),
            "stops.csv, row 2, column 'cov_xh_m_rad': makes a covariance that is not positive definite");
  EXPECT_EQ(error(kWhole + row + "1e-4,0,1e-4,0,0,1e-6\n"),
            "stops.csv, row 2, column 'cov_yh_m_rad': makes a covariance that is not positive definite");
  EXPECT_EQ(error(kPlane + ",sigma_xy_m" + row + "4e-4,0,1e-4,0.01\n"),
            "stops.csv, row 2, column 'cov_xx_m2': stands beside a sigma_xy_m: one of them has to go");
  EXPECT_EQ(
      error(kPlane + ",cov_hh_rad2,sigma_heading_rad" + row + "4e-4,0,1e-4,1e-4,0.01\n"),
      "stops.csv, row 2, column 'cov_hh_rad2': stands beside a sigma_heading_rad: one of them has to go");
  EXPECT_EQ(error(kPlane + row + "inf,0,1e-4\n").rfind("stops.csv, row 2, column 'cov_xx_m2'", 0), 0u);
}

}  // namespace
}  // namespace rangecal
