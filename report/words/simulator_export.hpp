// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal::app {

/// What a simulator is to be told of a sensor.
struct SimulatorExport {
  std::string source;         ///< what the calibration is called, for the head of the file
  double tolerance_m = 1e-3;  ///< of tables: how far mean and standard deviation may be off [m]
};

struct ExportedText {
  std::string text;  ///< the file
  std::vector<std::string>
      notes;  ///< how exact it is, and what the format cannot hold, with its size; also in the file's head, but of CSV
};

/// A Webots DistanceSensor of one ray: the lookup table of fewest rows (solvers/correction/lookup_table.hpp) whose linear
/// interpolation reads as the calibration says, curve and noise, from the nearest to the farthest distance of the fit.
ExportedText webots_sensor(const Calibration& calibration, const SimulatorExport& options);

/// The same table as CSV: distance_m, reading_m, relative_std.
ExportedText table_csv(const Calibration& calibration, const SimulatorExport& options);

/// A Gazebo lidar (SDF): its noise has one mean and one standard deviation for all distances. The best constants over the range of the
/// fit, every distance counting alike: the mean of f(d) - d, and the root of the mean of s(d)^2. Its pose is sensor_pose().
ExportedText gazebo_sensor(const Calibration& calibration, const SimulatorExport& options);

/// Where the sensor sits in the robot's frame: the effects lever_arm and bearing_offset, T_robot_sensor = (q_x, q_y, -b0), since a
/// sensor that is turned by yaw sees everything at a bearing less by yaw. Zero for what the calibration does not hold.
Pose2 sensor_pose(const Calibration& calibration);

/// The origin of the sensor as a fixed joint of URDF. Throws NoAnswerError where the calibration holds neither effect.
ExportedText urdf_joint(const Calibration& calibration, const SimulatorExport& options);

/// What was found to differ from a simulation, as files to patch it with, names and texts: DistanceSensor.txt, sensor.csv, sensor.sdf, where
/// the place differs sensor.urdf, and check.txt. That says how well readings that were held out are predicted by the simulation as it is and with the causes
/// found, by what the tables are off, and which causes are in none of the files. Empty where nothing was found.
std::vector<std::pair<std::string, std::string>> simulator_patch(const Diagnosis& diagnosis,
                                                                 const SimulatorExport& options);

}  // namespace rangecal::app
