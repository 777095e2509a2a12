// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>

#include "apps/documented_members.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/proportion.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/problems/world/physical/designs.hpp"
#include "rangecal/problems/world/physical/scans.hpp"
#include "support/recordings.hpp"

namespace rangecal::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::recordings;

/// Scans and stops of a world as files; the scans carry labels or not.
void write_scans(const TemporaryFolder& folder, bool labels) {
  world::World world = world::make_line_design();
  world.robot.stops.resize(6);
  world.noise.speckle_per_m = 0.001, world.noise.floor_m = 0.002;
  world::ScanScene scene;
  scene.walls = {{-4, -4, 6, -4}, {6, -4, 6, 5}, {6, 5, -4, 5}, {-4, 5, -4, -4}};
  scene.step_rad = 0.00872664626, scene.beams = 720;
  const auto scans = simulate_scans(world, scene, seed_from("ExtractCommand"));
  std::string csv = labels ? "stop,stamp,angle_min,angle_increment,n,ranges...\n"
                           : "stamp,angle_min,angle_increment,n,ranges...\n";
  for (const Scan& scan : scans.log.scans) {
    if (labels) csv += scan.stop + ",";
    csv += std::to_string(scan.stamp_s) + "," + std::to_string(scan.bearing_rad[0]) + ",0.00872664626," +
           std::to_string(scan.size());
    for (const double range : scan.range_m) csv += "," + std::to_string(range);
    csv += "\n";
  }
  folder.write("scans.csv", csv);
  std::string stops = "stop,x_m,y_m,heading_rad\n";
  for (const Stop& stop : world.robot.stops)
    stops += stop.label + "," + std::to_string(stop.commanded.x_m) + "," +
             std::to_string(stop.commanded.y_m) + ",0\n";
  folder.write("stops.csv", stops);
}

TEST(ExtractCommand, FromScansToACalibration) {
  const TemporaryFolder folder;
  write_scans(folder, true);
  const std::string rec = folder.file("rec");
  const RunResult result =
      run("extract " + folder.file("scans.csv") + " --stops " + folder.file("stops.csv") +
          " --radius 0.12 --sigma-xy 0.01 --sigma-heading 0 --arc mean -o " + rec);
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out,
              AllOf(HasSubstr("told apart by label"), HasSubstr("wall"),
                    HasSubstr("dropped at a cylinder's edge"), HasSubstr("6 stops, 5 landmarks")));
  EXPECT_THAT(slurp(rec + "/recording.yaml"), AllOf(HasSubstr("arc: mean"), HasSubstr("source: scans.csv")));
  const Recording recording = load_recording(rec);
  EXPECT_EQ(recording.landmarks.size(), 5u);
  EXPECT_EQ(recording.extraction.at("arc"), "mean");
  EXPECT_DOUBLE_EQ(recording.landmarks[0].radius_m, 0.12);
  EXPECT_EQ(recording.readings.covariates.count("beams"), 1u);
  const auto json = nlohmann::json::parse(slurp(rec + "/extraction.json"));
  EXPECT_EQ(json["arc"], "mean");
  EXPECT_EQ(json["cylinders"]["used"], recording.readings.size());
  expect_documented("An extraction", {json});
  EXPECT_EQ(run("calibrate " + rec + " --method closed-form --order 2 --noise f2").code, 0);
}

TEST(ExtractCommand, WrongInputLeavesNothingBehind) {
  const TemporaryFolder folder;
  write_scans(folder, false);
  const std::string scans = folder.file("scans.csv"), out = " -o " + folder.file("rec");
  const auto refused = [&](const std::string& arguments, const std::string& word) {
    const RunResult result = run("extract " + arguments + out);
    EXPECT_EQ(result.code, 2) << arguments;
    EXPECT_THAT(result.err, HasSubstr(word)) << arguments;
    EXPECT_EQ(count_of(result.err, "\n"), 1) << result.err;
    EXPECT_FALSE(std::filesystem::exists(folder.file("rec")));
  };
  refused(scans, "stops file");
  refused(scans + " --radius wide", "--radius");
  refused(scans + " --radius 12", "metres");
  refused(scans + " --arc far", "not one of nearest, mean, smallest");
  refused(scans + " --split often", "standing");
  refused(scans + " --noise 0.1", "FLOOR,QUADRATIC");
  refused(folder.file("none.csv"), "no such file");
  refused(folder.file("stops.csv"), "no file of scans");
  refused(scans + " --stops " + folder.file("scans.csv"), "row 2");
  folder.write("map.csv", "landmark,x_m,y_m,radius_mm\nA,1,1,120\n");
  refused(scans + " --map " + folder.file("map.csv"), "column 'radius_mm': is not read; 'radius_m' is");
}

// A room without a cylinder: walls and clutter are called so, whatever radius is looked for; no recording is made, exit
// code 1.
class RoomsWithoutCylinders : public ::testing::TestWithParam<const char*> {};

TEST_P(RoomsWithoutCylinders, HaveNone) {
  const std::string scans = recordings() + "/" + GetParam();
  RANGECAL_REQUIRE_RECORDING(scans);
  const TemporaryFolder folder;
  for (const std::string radius : {"free", "0.04", "0.08", "0.12"}) {
    SCOPED_TRACE(radius);
    const RunResult result = run("extract " + scans + " --radius " + radius + " -o " + folder.file("rec") +
                                 " --json " + folder.file("found.json"));
    EXPECT_EQ(result.code, 1) << result.err;
    EXPECT_THAT(result.err, HasSubstr("no landmark was found"));
    EXPECT_FALSE(std::filesystem::exists(folder.file("rec")));
    const auto json = nlohmann::json::parse(slurp(folder.file("found.json")));
    EXPECT_GT(json["segments"]["wall"], 100);
    EXPECT_TRUE(json["landmarks"].empty());
  }
}

INSTANTIATE_TEST_SUITE_P(Real, RoomsWithoutCylinders,
                         ::testing::Values("rplidar-a2-room/scans.csv", "lds02-wall/g3_0.5m.csv",
                                           "lds02-wall/g3_1.0m.csv", "lds02-wall/g3_2.0m.csv",
                                           "lds02-wall/g4_0.5m.csv", "lds02-wall/g4_1.0m.csv",
                                           "lds02-wall/g4_2.0m.csv"),
                         [](const auto& one) {
                           std::string name = one.param;
                           for (char& c : name)
                             if (!std::isalnum(static_cast<unsigned char>(c))) c = '_';
                           return name;
                         });

/// Rows of observations.csv by stop and landmark.
std::map<std::pair<std::string, std::string>, std::pair<double, double>> rows_of(const std::string& folder) {
  const CsvTable table = CsvTable::read(folder + "/observations.csv");
  std::map<std::pair<std::string, std::string>, std::pair<double, double>> rows;
  for (std::size_t row = 0; row < table.rows(); ++row)
    rows[{table.label(row, table.require("stop")), table.label(row, table.require("landmark"))}] = {
        table.finite(row, table.require("range_m")), table.finite(row, table.require("bearing_rad"))};
  return rows;
}

// Against cylinders cut out and labelled in another way, with the camera's places: 95 % are found again, none is called
// another's name.
TEST(ImportLego, FindsAndLabelsTheCylinders) {
  const std::string source = recordings() + "/brenner-lego", known = recordings() + "/rangecal/brenner-lego";
  RANGECAL_REQUIRE_RECORDING(source);
  const TemporaryFolder folder;
  const RunResult result = run("import lego " + source + " --arc mean -o " + folder.file("rec"));
  ASSERT_EQ(result.code, 0) << result.err;
  const auto ours = rows_of(folder.file("rec")), theirs = rows_of(known);
  std::size_t found = 0, renamed = 0;
  double sum = 0.0, squares = 0.0;
  for (const auto& [cell, reading] : theirs) {
    if (const auto own = ours.find(cell); own != ours.end()) {
      const double off_mm = 1e3 * (own->second.first - reading.first);
      ++found, sum += off_mm, squares += off_mm * off_mm;
    }
    for (const auto& [other, value] : ours)
      renamed += other.first == cell.first && other.second != cell.second &&
                 std::abs(wrap_angle(value.second - reading.second)) < 0.02;
  }
  const double n = static_cast<double>(found), mean = sum / n;
  const auto [low, high] = wilson(n, static_cast<double>(theirs.size()));
  std::cout << fmt::format(
      "{} of {} found and labelled right: {:.1f} % (95 % interval {:.1f} to {:.1f}), {} under another label, "
      "{} more; ranges differ by {:.1f} mm in the mean, spread {:.1f} mm\n",
      found, theirs.size(), 100.0 * n / static_cast<double>(theirs.size()), 100.0 * low, 100.0 * high,
      renamed, ours.size() - found, mean, std::sqrt(squares / n - mean * mean));
  EXPECT_GE(n, 0.95 * static_cast<double>(theirs.size()));
  EXPECT_EQ(renamed, 0u);
}

// Robot 5 as stops: the same rows as the recording made by another program.
TEST(ImportMrclam, GivesTheSameRows) {
  const std::string source = recordings() + "/mrclam6", known = recordings() + "/rangecal/mrclam6-robot";
  RANGECAL_REQUIRE_RECORDING(source);
  const TemporaryFolder folder;
  for (const std::string robot : {"2", "5"}) {
    const std::string stops = folder.file("stops" + robot), pairs = folder.file("pairs" + robot);
    ASSERT_EQ(run("import mrclam " + source + " --robot " + robot + " --stops-max 250 -o " + stops).code, 0);
    ASSERT_EQ(run("import mrclam " + source + " --robot " + robot + " --as pairs -o " + pairs).code, 0);
    const Recording a = load_recording(stops), b = load_recording(known + robot);
    ASSERT_EQ(a.readings.size(), b.readings.size());
    for (std::size_t i = 0; i < a.readings.size(); ++i) {
      EXPECT_EQ(a.readings.range_m[i], b.readings.range_m[i]) << i;
      EXPECT_EQ(a.readings.stop[i], b.readings.stop[i]) << i;
    }
    for (std::size_t k = 0; k < a.stops.size(); ++k)  // theirs are rounded to 1e-5
      EXPECT_NEAR(a.stops[k].commanded.x_m, b.stops[k].commanded.x_m, 2e-5);
    const Recording c = load_recording(pairs), d = load_recording(known + robot + "-pairs");
    ASSERT_EQ(c.pairs.size(), d.pairs.size());
    for (std::size_t i = 0; i < c.pairs.size(); ++i)
      EXPECT_NEAR(c.pairs.true_m[i], d.pairs.true_m[i], 2e-5) << i;
  }
  EXPECT_EQ(run("import mrclam " + source + " --robot 2 --poses odometry -o " + folder.file("odometry")).code,
            0);
  EXPECT_EQ(run("import mrclam " + source + " --robot 4 -o " + folder.file("none")).code, 2);
}

}  // namespace
}  // namespace rangecal::test
