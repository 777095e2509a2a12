// SPDX-License-Identifier: BSD-3-Clause
// docs/formats.md names every member and column that the programs write, and none that they do not.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "apps/documented_members.hpp"
#include "rangecal/solvers/diagnosis/simulation_model.hpp"

namespace rangecal::test {
namespace {

using nlohmann::json;

/// The file that a command ending in its option wrote.
json written(const TemporaryFolder& folder, const std::string& command) {
  const RunResult result = run(command + " " + folder.file("out.json"));
  EXPECT_EQ(result.code, 0) << command << "\n" << result.err;
  return json::parse(slurp(folder.file("out.json")));
}

TEST(Formats, NameEveryMemberOfACalibration) {
  const TemporaryFolder folder;
  // One reading without return is dropped under its reason.
  std::filesystem::copy(shipped("field-layout"), folder.file("field"),
                        std::filesystem::copy_options::recursive);
  std::string table = slurp(folder.file("field/observations.csv"));
  const std::size_t row = table.find('\n') + 1;
  std::string first = table.substr(row, table.find('\n', row) + 1 - row);
  std::vector<std::string> names;
  std::istringstream head(table.substr(0, row - 1));
  for (std::string name; std::getline(head, name, ',');) names.push_back(name);
  std::istringstream fields(first.substr(0, first.size() - 1));
  std::string without;
  for (std::size_t i = 0; i < names.size(); ++i) {
    std::string field;
    std::getline(fields, field, ',');
    without += (i ? "," : "") + (names[i] == "range_m" ? std::string("0") : field);
  }
  folder.write("field/observations.csv", table.replace(row, first.size(), without + "\n"));

  const json all =
      written(folder, "calibrate " + folder.file("field") + " --order 2 --noise f2 --method all --json");
  EXPECT_EQ(all.size(), 2u) << "with --method all the file holds 'format' and 'methods'";
  std::vector<json> files = all.at("methods").get<std::vector<json>>();
  EXPECT_EQ(files.size(), 4u);
  for (const std::string shape : {"student-t", "contaminated", "one-sided"})
    files.push_back(written(folder, "calibrate " + shipped("field-layout") +
                                        " --order 2 --noise f2 --noise-shape " + shape + " --json"));
  files.push_back(written(folder, "calibrate " + shipped("pairs-2016") + " --order 2 --noise f2 --json"));
  std::string echo = "true_m,reading_m\n";
  for (int i = 0; i < 200; ++i)
    echo += std::to_string(1.0 + 0.01 * i) + "," +
            std::to_string(1.01 + 0.01 * i + 0.003 * ((7 * i) % 11 - 5) + (i == 77 ? 1.0 : 0.0)) + "\n";
  std::filesystem::create_directory(folder.file("echo"));
  folder.write("echo/recording.yaml", "format: rangecal/1\nkind: pairs\n");
  folder.write("echo/pairs.csv", echo);  // one late echo, which is listed
  files.push_back(written(folder, "calibrate " + folder.file("echo") + " --json"));
  EXPECT_EQ(files.back().at("outliers").size(), 1u);
  files.push_back(written(folder, "calibrate " + shipped("everyday/reciprocal") + " --json"));
  EXPECT_EQ(files.back().at("curve").at("family"), "reciprocal");
  files.push_back(written(folder, "calibrate --curve spline " + shipped("everyday/reciprocal") + " --json"));
  EXPECT_EQ(files.back().at("curve").at("family"), "spline");
  std::filesystem::create_directory(folder.file("noted"));
  folder.write("noted/recording.yaml", "format: rangecal/1\nkind: pairs\n");
  std::string pairs = "true_m,reading_m,by\n";
  for (int i = 0; i < 30; ++i)
    pairs += std::to_string(1.0 + 0.1 * i) + "," + std::to_string(1.01 + 0.1 * i + 0.003 * (i % 3)) + ",me\n";
  folder.write("noted/pairs.csv", pairs);  // a column of texts: there are notes
  files.push_back(
      written(folder, "calibrate " + folder.file("noted") + " --order 1 --noise constant --json"));
  files.push_back(written(folder, "diagnose " + shipped("concealed/world-02") + " --calibration"));
  files.push_back(written(
      folder, "track " + shipped("pairs-2016/pairs.csv") + " -o " + folder.file("now.csv") + " --json"));
  expect_documented("A calibration", files);
}

/// A model with everything that one can hold; no recording at hand has all of it.
SimulationModel full_model() {
  SimulationModel model;
  model.calibration.alpha = Eigen::Vector2d(0.0, 1.0);
  model.calibration.noise.parameters = Eigen::VectorXd::Constant(1, 0.01);
  model.calibration.effects["tilt"]["angle_rad"] = 0.1;
  model.calibration.landmarks.push_back({0, "A", {1.0, 2.0}, std::nullopt});
  Recording recording;
  recording.stops.resize(1);
  recording.stops[0].sigma_xy_m = recording.stops[0].sigma_heading_rad = 0.01;
  recording.stops[0].place = "here";
  recording.stops[0].covariance = Eigen::Matrix3d::Identity();
  recording.landmarks.resize(2);
  recording.landmarks[0].label = "A";
  recording.landmarks[0].reflectance = 0.5;
  recording.known_distances.push_back({0, 1, 1.0, 0.01});
  recording.readings.stop = recording.readings.landmark = recording.readings.repeat = {0};
  recording.readings.time_s = {0.0};
  recording.readings.covariates["intensity"] = {1.0};
  model.recordings = {recording};
  model.landmark_read = {{1}};
  model.added = {{{0.1}, {0.1}, {0.1}, {0.1}}};
  return model;
}

TEST(Formats, NameEveryMemberOfADiagnosis) {
  const TemporaryFolder folder;
  std::vector<json> files;
  for (const char* recording : {"field-layout", "pairs-2016", "concealed/world-01", "concealed/world-11"})
    files.push_back(written(folder, "diagnose " + shipped(recording) + " --json"));
  files.push_back(written(
      folder, "diagnose " + shipped("concealed/world-11") + " --laws " + folder.file("laws") + " --json"));
  EXPECT_FALSE(files.back().at("laws").empty());
  const std::string second = folder.file("second");
  ASSERT_EQ(run("simulate " + shipped("scenes/pairs-2016.yaml") + " --seed 5 -o " + second).code, 0);
  files.push_back(written(folder, "diagnose " + shipped("pairs-2016") + " " + second + " --json"));
  files.push_back({{"simulation", json::parse(simulation_model_to_json(full_model()))}});
  expect_documented("A diagnosis", files);
}

TEST(Formats, NameEveryMemberOfAPrediction) {
  const TemporaryFolder folder;
  folder.write("law.yaml",
               "effect: law_1\nphysics: p\nsettled_by: s\nchannel: range\nformula: a*cos(3*b)\n"
               "parameters: {a: {unit: m, typical: 0.01, from: -1, to: 1, value: 0.02, std: 0.002}}\n");
  expect_documented("A prediction", {written(folder, "predict " + folder.file("law.yaml") + " " +
                                                         shipped("concealed/world-11") + " --json")});
}

TEST(Formats, NameEveryMemberOfATrace) {
  const TemporaryFolder folder;
  expect_documented("A trace", {written(folder, "diagnose " + shipped("concealed/world-01") + " --trace")});
}

TEST(Formats, NameEveryMemberOfAPlan) {
  const TemporaryFolder folder;
  expect_documented("A plan", {written(folder, "plan " + shipped("scenes/field-layout.yaml") +
                                                   " --accuracy 20 --effects tilt -o")});
}

std::string first_line(const std::string& text) { return text.substr(0, text.find('\n')); }

/// The columns of a row of the table "written by | columns"; "the same and" takes those of the row before.
std::string documented_columns(const std::string& command) {
  std::istringstream lines(section_of_formats("Tables that come out"));
  std::string before;
  for (std::string line; std::getline(lines, line);) {
    if (!line.starts_with("| `")) continue;
    std::string columns = line.find("| the same and ") != std::string::npos ? before : "";
    const std::vector<std::string> codes = code_in(line);
    for (std::size_t i = 1; i < codes.size(); ++i)
      if (!codes[i].starts_with("docs/")) columns += (columns.empty() ? "" : ",") + codes[i];
    if (codes[0] == command) return columns;
    before = columns;
  }
  return "docs/formats.md does not name " + command;
}

TEST(Formats, NameTheColumnsOfTables) {
  const TemporaryFolder folder;
  const std::string calibration = folder.file("cal.json");
  ASSERT_EQ(run("track " + shipped("pairs-2016/pairs.csv") + " -o " + folder.file("now.csv") + " --json " +
                calibration)
                .code,
            0);
  ASSERT_EQ(run("track " + shipped("pairs-2016/pairs.csv") + " -o " + folder.file("again.csv") + " --from " +
                calibration + " --watch 100000 --changes " + folder.file("changes.csv"))
                .code,
            0);
  EXPECT_EQ(first_line(run("correct " + calibration, "1.2\n").out), documented_columns("correct"));
  EXPECT_EQ(first_line(run("correct " + calibration + " --prior uniform", "1.2\n").out),
            documented_columns("correct --prior"));
  EXPECT_EQ(first_line(slurp(folder.file("now.csv"))), documented_columns("track"));
  EXPECT_EQ(first_line(slurp(folder.file("changes.csv"))), documented_columns("track --changes"));
  const std::string rec = shipped("field-layout");
  ASSERT_EQ(run("calibrate " + rec + " --method marginal --json " + calibration).code, 0);
  ASSERT_EQ(run("track " + rec + "/observations.csv --stops " + rec + " -o " + folder.file("again.csv") +
                " --from " + calibration + " --watch 100000 --changes " + folder.file("changes.csv"))
                .code,
            0);
  EXPECT_EQ(first_line(slurp(folder.file("changes.csv"))), documented_columns("track --stops --changes"));
}

}  // namespace
}  // namespace rangecal::test
