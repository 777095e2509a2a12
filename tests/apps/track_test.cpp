// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <chrono>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "apps/run_binary.hpp"
#include "rangecal/core/calibration_io.hpp"
#include "rangecal/core/random.hpp"

namespace rangecal::test {
namespace {

using ::testing::HasSubstr;

/// Rows of reading_m,true_m,time_s: f(d) = 0.1 + 0.9 d, s = 0.01 f^2; every fifth row without a true distance.
std::string rows(int first, int count) {
  std::string text;
  for (int i = first; i < first + count; ++i) {
    Random random(seed_from("track stream", {static_cast<std::uint64_t>(i)}));
    const double d = random.uniform(0.5, 4.0), f = 0.1 + 0.9 * d;
    text += fmt::format("{:.5f},{},{}\n", random.normal(f, 0.01 * f * f),
                        i % 5 == 4 ? "" : fmt::format("{:.5f}", d), 0.1 * i);
  }
  return text;
}
const std::string header = "reading_m,true_m,time_s\n";

/// cal.json: y = 0.1 m + slope d, of a spread of 0.01 by the law, from 0.5 to 4 m.
void save_line(const TemporaryFolder& folder, double slope, NoiseLaw law) {
  Calibration line;
  line.outcome = Outcome::converged;
  line.alpha = Eigen::Vector2d(0.1, slope);
  line.noise = {law, Eigen::VectorXd::Constant(1, 0.01)};
  line.range_min_m = 0.5;
  line.range_max_m = 4.0;
  save_calibrations({line}, folder.file("cal.json"));
}

TEST(TrackCommand, TeachesAndCorrectsAsReadingsCome) {
  const TemporaryFolder folder;
  folder.write("in.csv", header + rows(0, 2000));
  const RunResult result = run("track " + folder.file("in.csv") + " --order 1 -o " + folder.file("out.csv") +
                               " --json " + folder.file("cal.json"));
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("Curve f"));
  const Calibration tracked = load_calibration(folder.file("cal.json"));
  // 1600 pairs: alpha known to about 1 mm
  EXPECT_NEAR(tracked.alpha[0], 0.1, 0.005);
  EXPECT_NEAR(tracked.alpha[1], 0.9, 0.005);
  EXPECT_NEAR(tracked.noise.parameters[0], 0.01, 0.001);
  const std::string out = slurp(folder.file("out.csv"));
  EXPECT_EQ(count_of(out, "\n"), 2001);
  EXPECT_THAT(out, HasSubstr("no_calibration_yet"));
  EXPECT_EQ(count_of(out, ",ok,") + count_of(out, "no_calibration_yet") + count_of(out, "out_of_range") +
                count_of(out, "extrapolated"),
            2000);
}

TEST(TrackCommand, AWrongFileLeavesWhatWasThere) {
  const TemporaryFolder folder;
  folder.write("wrong.csv", "speed,colour\n1,2\n");
  folder.write("empty.csv", "");
  folder.write("now.csv", "of an earlier run\n");
  for (const char* input : {"wrong.csv", "empty.csv", "none.csv"}) {
    SCOPED_TRACE(input);
    const RunResult shown = run("track " + folder.file(input));
    EXPECT_EQ(shown.code, 2);
    EXPECT_EQ(shown.out, "");
    EXPECT_EQ(count_of(shown.err, "\n"), 1) << shown.err;
    EXPECT_EQ(run("track " + folder.file(input) + " -o " + folder.file("now.csv")).code, 2);
    EXPECT_EQ(slurp(folder.file("now.csv")), "of an earlier run\n");
  }
}

TEST(TrackCommand, BadRowsAreNamedAndNothingElseIsLost) {
  const RunResult result =
      run("track --order 1",
          header + rows(0, 50) + "far,1.0,5\n1.0,2.0\n\"1.0,2.0,3\n1.2,1.2,\n,,6\n0,,7\n" + rows(60, 50));
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(count_of(result.out, "malformed"), 4);
  EXPECT_EQ(count_of(result.out, "missing"), 1);
  EXPECT_EQ(count_of(result.out, "zero"), 1);
  EXPECT_EQ(count_of(result.out, "\n"), 1 + 106);
  EXPECT_THAT(result.err, HasSubstr("stdin, row 52, column 'reading_m': 'far' is not a number"));
  EXPECT_EQ(run("track", "").code, 2);
  EXPECT_EQ(run("track", "distance\n1.0\n").code, 2);
  EXPECT_EQ(run("track", "1.0\n2.0\n").code, 1);  // nothing to learn from, nothing given
  EXPECT_EQ(run("track --order 9", header).code, 2);
  EXPECT_EQ(run("track /nowhere.csv").code, 2);
}

TEST(TrackCommand, ATextInAColumnThatIsReadIsNamedAndTheRowTeachesNothing) {
  for (const std::string column : {"true_m", "time_s", "bearing_rad"}) {
    std::string table = "reading_m,true_m,time_s,bearing_rad,by\n";
    for (int i = 0; i < 12; ++i) {
      const auto field = [&](const std::string& name, double value) {
        return i == 6 && name == column ? std::string("left") : std::to_string(value);
      };
      table += std::to_string(1.1 + 0.2 * i + 0.003 * (i % 3)) + "," + field("true_m", 1.0 + 0.2 * i) + "," +
               field("time_s", i) + "," + field("bearing_rad", 0.1 * i) + ",me\n";
    }
    const RunResult result = run("track --order 1", table);
    EXPECT_EQ(result.code, 0) << column << result.err;
    EXPECT_EQ(count_of(result.out, "malformed"), 1) << column;
    EXPECT_THAT(result.err, HasSubstr("stdin, row 8, column '" + column + "': 'left' is not a number"));
  }
}

TEST(TrackCommand, CorrectsByACalibrationGiven) {
  const TemporaryFolder folder;
  save_line(folder, 0.5, NoiseLaw::constant);
  const RunResult result = run("track --from " + folder.file("cal.json"), "1.1\n0.6\n");
  ASSERT_EQ(result.code, 0) << result.err;  // d = (y - 0.1) / 0.5
  EXPECT_EQ(
      result.out,
      "reading_m,distance_m,std_m,flag,outlier\n1.1,2.000000,0.020000,ok,\n0.6,1.000000,0.020000,ok,\n");
}

TEST(TrackCommand, CountsRowsOutOfRangeApart) {
  // f(d) = 0.1 + 0.5 d known from 0.5 to 4 m, readings of 0.35 to 2.1 m: 1.1 and 0.6 are corrected, 60 has the flag.
  const TemporaryFolder folder;
  save_line(folder, 0.5, NoiseLaw::constant);
  folder.write("in.csv", "reading_m\n1.1\n60\n0.6\n61\n\nfar\n");
  const std::string command = "track " + folder.file("in.csv") + " --from " + folder.file("cal.json") +
                              " -o " + folder.file("out.csv");
  const RunResult result = run(command);
  ASSERT_EQ(result.code, 0) << result.err;
  const std::string out = slurp(folder.file("out.csv"));
  EXPECT_EQ(count_of(out, "out_of_range"), 2) << out;
  EXPECT_THAT(result.out, HasSubstr("5 rows, 2 corrected, 2 out of range, 1 not understood"));
}

TEST(TrackCommand, TakesPolynomialNoiseThroughItsState) {
  const TemporaryFolder folder;
  const std::string whole = header + rows(0, 1200), arguments = " --order 1 --noise polynomial ";
  folder.write("whole.csv", whole);
  const RunResult result = run("track " + folder.file("whole.csv") + arguments + "-o " +
                               folder.file("a.csv") + " --json " + folder.file("cal.json"));
  ASSERT_EQ(result.code, 0) << result.err;
  const Calibration tracked = load_calibration(folder.file("cal.json"));
  EXPECT_EQ(tracked.noise.law, NoiseLaw::polynomial);
  ASSERT_EQ(tracked.noise.parameters.size(), 2);
  // s = 0.01 (0.1 + 0.9 d)^2 at 2.25 m: 0.045 m; the line that fits best from 0.5 to 4 m is near there
  EXPECT_NEAR(tracked.noise.parameters[0] + 2.25 * tracked.noise.parameters[1], 0.045, 0.01);
  for (const std::size_t length : {whole.size() / 2, whole.size()}) {
    folder.write("part.csv", whole.substr(0, length));
    ASSERT_EQ(run("track " + folder.file("part.csv") + arguments + "-o " + folder.file("b.csv") +
                  " --state " + folder.file("b.json"))
                  .code,
              0);
  }
  EXPECT_EQ(slurp(folder.file("a.csv")), slurp(folder.file("b.csv")));
}

TEST(TrackCommand, TellsOutliersAndIsNotMovedByThem) {
  // f = 0.05 + 0.95 d, s = 0.01; every twentieth reading is late by 0.2 m and more.
  const TemporaryFolder folder;
  Random random(seed_from("track outliers"));
  std::string table = "true_m,reading_m\n";
  for (int i = 0; i < 2000; ++i) {
    const double d = random.uniform(0.5, 4.0), late = i % 20 == 7 ? 0.2 + random.uniform(0.0, 0.5) : 0.0;
    table += fmt::format("{:.6f},{:.6f}\n", d, random.normal(0.05 + 0.95 * d, 0.01) + late);
  }
  folder.write("in.csv", table);
  const std::string command = "track " + folder.file("in.csv") + " --order 1 --noise constant -o " +
                              folder.file("out.csv") + " --json " + folder.file("cal.json");
  const RunResult result = run(command);
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("Outliers   1"));  // some hundred
  const Calibration tracked = load_calibration(folder.file("cal.json"));
  EXPECT_NEAR(tracked.outlier_count, 100, 3);
  EXPECT_NEAR(tracked.alpha[0], 0.05, 0.003);
  EXPECT_EQ(tracked.noise_shapes.count("range"), 1u);
  std::istringstream lines(slurp(folder.file("out.csv")));
  std::string line;
  std::getline(lines, line);
  EXPECT_EQ(line, "reading_m,distance_m,std_m,flag,outlier");
  int late = 0, wrong = 0;
  for (int i = 0; std::getline(lines, line); ++i) {
    if (i < 300) continue;
    const double outlier = std::stod(line.substr(line.rfind(',') + 1));
    late += i % 20 == 7 && outlier > 0.99;
    wrong += i % 20 != 7 && outlier > 0.5;
  }
  EXPECT_EQ(late, 85);
  EXPECT_LE(wrong, 2);
  ASSERT_EQ(run(command + " --noise-shape gaussian").code, 0);
  EXPECT_GT(load_calibration(folder.file("cal.json")).alpha[0], 0.06);
}

TEST(TrackCommand, WatchesForAChange) {
  // The stream's own curve; from row 1000 on 3 cm are added to every reading.
  const TemporaryFolder folder;
  save_line(folder, 0.9, NoiseLaw::f_squared);
  std::istringstream before(rows(0, 1000)), after(rows(1000, 1000));
  std::string changed = header + before.str(), row;
  while (std::getline(after, row)) {
    const std::size_t comma = row.find(',');
    changed += fmt::format("{:.5f}{}\n", std::stod(row.substr(0, comma)) + 0.03, row.substr(comma));
  }
  folder.write("same.csv", header + before.str());
  folder.write("changed.csv", changed);
  const std::string arguments =
      " --from " + folder.file("cal.json") + " --order 1 --watch 100000 -o " + folder.file("out.csv");
  EXPECT_THAT(run("track " + folder.file("same.csv") + arguments).out, HasSubstr("Changes    none"));
  const RunResult result =
      run("track " + folder.file("changed.csv") + arguments + " --changes " + folder.file("changes.csv"));
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr(": window by 0.03"));
  const std::string table = slurp(folder.file("changes.csv"));
  EXPECT_THAT(
      table,
      HasSubstr(
          "pair,since_pair,kind,probability,size,std,phase_rad,phase_std_rad\n8"));  // of 1600 pairs the change is after 800
  EXPECT_EQ(run("track --watch 1000", "1.0\n").code, 2);
}

TEST(TrackCommand, WatchesTheEncoderWhereThereAreBearings) {
  // From row 1000 on 3 cm times the cosine of the bearing, once a turn; bearings go round by 0.37 rad a row.
  const TemporaryFolder folder;
  save_line(folder, 0.9, NoiseLaw::f_squared);
  std::istringstream all(rows(0, 2500));
  std::string text = "reading_m,true_m,time_s,bearing_rad\n", row;
  for (int i = 0; std::getline(all, row); ++i) {
    const std::size_t comma = row.find(',');
    const double bearing = std::remainder(0.37 * i, 6.283185307179586);
    text += fmt::format("{:.5f}{},{:.5f}\n",
                        std::stod(row.substr(0, comma)) + (i >= 1000 ? 0.03 * std::cos(bearing) : 0.0),
                        row.substr(comma), bearing);
  }
  folder.write("in.csv", text);
  const std::string arguments = "track " + folder.file("in.csv") + " --order 1 --from " +
                                folder.file("cal.json") + " --watch 100000 -o " + folder.file("out.csv") +
                                " --every 300 --changes " + folder.file("changes.csv");
  const RunResult result = run(arguments + " --state " + folder.file("state.json"));
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr(": encoder by 0.0"));
  EXPECT_THAT(result.out, HasSubstr(" m at a phase of "));
  EXPECT_THAT(result.out, HasSubstr(" rad (probability "));
  // in the table as well: size and phase of the first alarm within 4 of their standard deviations of 3 cm and 0
  std::istringstream table(slurp(folder.file("changes.csv")));
  std::string alarm;
  std::getline(table, alarm);
  std::getline(table, alarm);
  std::vector<std::string> fields;
  std::istringstream columns(alarm);
  for (std::string field; std::getline(columns, field, ',');) fields.push_back(field);
  ASSERT_EQ(fields.size(), 8u) << alarm;
  EXPECT_EQ(fields[2], "encoder");
  EXPECT_NEAR(std::stod(fields[4]), 0.03, 4.0 * std::stod(fields[5]));
  EXPECT_NEAR(std::stod(fields[6]), 0.0, 4.0 * std::stod(fields[7]));
  // the charts of the bearings and the phase are in the state
  const std::string before = slurp(folder.file("changes.csv"));
  EXPECT_EQ(run(arguments + " --state " + folder.file("state.json")).code, 0);
  EXPECT_EQ(slurp(folder.file("changes.csv")), before);
  // a state of version 0.1.0 told none, and none is told
  auto state = nlohmann::ordered_json::parse(slurp(folder.file("state.json")));
  ASSERT_EQ(state.at("changes").at(0).size(), 9u);
  for (auto& change : state.at("changes"))
    while (change.size() > 7) change.erase(change.size() - 1);
  folder.write("state.json", state.dump());
  const RunResult early = run(arguments + " --state " + folder.file("state.json"));
  EXPECT_EQ(early.code, 0) << early.err;
  EXPECT_THAT(early.out, HasSubstr(": encoder by 0.0"));
  EXPECT_THAT(early.out, ::testing::Not(HasSubstr("phase")));
  EXPECT_THAT(slurp(folder.file("changes.csv")), HasSubstr(alarm.substr(0, alarm.find(fields[6])) + ",\n"));
}

/// The rows of a simulated recording with what --stops would tell in columns of their own.
std::string with_poses(const std::string& folder) {
  std::istringstream stops(slurp(folder + "/stops.csv")), observations(slurp(folder + "/observations.csv"));
  std::map<std::string, std::string> pose;
  std::string line, text = "stop,x_m,y_m,heading_rad,landmark,range_m,bearing_rad,radius_m,sigma_xy_m\n";
  std::getline(stops, line);
  EXPECT_EQ(line, "stop,x_m,y_m,heading_rad");
  while (std::getline(stops, line)) pose[line.substr(0, line.find(','))] = line;
  std::getline(observations, line);
  EXPECT_EQ(line, "stop,landmark,repeat,range_m,bearing_rad");
  while (std::getline(observations, line)) {
    std::vector<std::string> fields;
    std::istringstream row(line);
    for (std::string field; std::getline(row, field, ',');) fields.push_back(field);
    text += pose.at(fields[0]) + "," + fields[1] + "," + fields[3] + "," + fields[4] + ",0.12,0.01\n";
  }
  return text;
}

/// Calibrates REC at once, to batch.json, and as its readings come, to a.json: what tracking said.
RunResult calibrated_and_tracked(const std::string& rec, const TemporaryFolder& folder) {
  EXPECT_EQ(
      run("calibrate " + rec + " --method marginal --order 2 --noise f2 --json " + folder.file("batch.json"))
          .code,
      0);
  return run("track " + rec + "/observations.csv --stops " + rec + " -o " + folder.file("a.csv") +
             " --json " + folder.file("a.json"));
}

TEST(TrackCommand, CalibratesFromLandmarksAsTheyCome) {
  const TemporaryFolder folder;
  const std::string rec = folder.file("rec");
  ASSERT_EQ(
      run("simulate " RANGECAL_SOURCE_DIR "/notebooks_data/scenes/field-layout.yaml -o " + rec + " --seed 3")
          .code,
      0);
  const RunResult result = calibrated_and_tracked(rec, folder);
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("Landmark   A at ("));
  const Calibration batch = load_calibration(folder.file("batch.json")),
                    tracked = load_calibration(folder.file("a.json"));
  ASSERT_EQ(tracked.outcome, Outcome::converged) << tracked.reason;
  for (Eigen::Index i = 0; i < 3;
       ++i)  // all ten stops are held: the same likelihood, solved from another start
    EXPECT_NEAR(tracked.alpha[i], batch.alpha[i], 1e-3 * std::sqrt((*batch.alpha_covariance)(i, i)));
  EXPECT_EQ(tracked.landmarks.size(), batch.landmarks.size());
  const std::string corrected = slurp(folder.file("a.csv"));
  EXPECT_EQ(count_of(corrected, "\n"), 501);
  EXPECT_GT(count_of(corrected, ",ok,"), 200);

  // The same from columns, cut within a line, from the state: byte by byte.
  const std::string whole = with_poses(rec);
  for (const std::size_t length : {whole.size() / 3, whole.size() * 2 / 3, whole.size()}) {
    folder.write("in.csv", whole.substr(0, length));
    const RunResult part = run("track " + folder.file("in.csv") + " --every 40 -o " + folder.file("b.csv") +
                               " --state " + folder.file("b.json"));
    ASSERT_EQ(part.code, 0) << part.err;
  }
  EXPECT_EQ(slurp(folder.file("b.csv")), corrected);
}

TEST(TrackCommand, FollowsARandomWalk) {
  const TemporaryFolder folder;
  const std::string rec = folder.file("rec");
  std::string scene = slurp(RANGECAL_SOURCE_DIR "/notebooks_data/scenes/field-layout.yaml");
  for (const auto& [what, by] : {std::pair<std::string, std::string>{"count: 10", "count: 60"},
                                 {"step_m: 0.3", "step_m: 0.05"},
                                 {"sigma_xy_m: 0.01", "sigma_xy_m: 0.004"},
                                 {"sigma_heading_rad: 0.0", "sigma_heading_rad: 0.003"},
                                 {"error: independent", "error: random_walk"},
                                 {"repeats: 10", "repeats: 3"}})
    scene.replace(scene.find(what), what.size(), by);
  folder.write("scene.yaml", scene);
  ASSERT_EQ(run("simulate " + folder.file("scene.yaml") + " -o " + rec + " --seed 5").code, 0);
  std::istringstream all(slurp(rec + "/observations.csv"));  // nothing was read from stops 40 to 42
  std::string read, line;
  while (std::getline(all, line))
    if (!line.starts_with("40,") && !line.starts_with("41,") && !line.starts_with("42,")) read += line + "\n";
  folder.write("rec/observations.csv", read);
  const RunResult result = calibrated_and_tracked(rec, folder);
  ASSERT_EQ(result.code, 0) << result.err;
  const Calibration batch = load_calibration(folder.file("batch.json")),
                    tracked = load_calibration(folder.file("a.json"));
  ASSERT_EQ(tracked.outcome, Outcome::converged) << tracked.reason;
  for (Eigen::Index i = 0; i < 3; ++i)
    EXPECT_NEAR(tracked.alpha[i], batch.alpha[i], 0.01 * std::sqrt((*batch.alpha_covariance)(i, i)));
  for (const std::size_t length : {read.size() / 3, read.size() * 4 / 5, read.size()}) {
    folder.write("in.csv", read.substr(0, length));
    const RunResult part = run("track " + folder.file("in.csv") + " --stops " + rec + " --every 40 -o " +
                               folder.file("b.csv") + " --state " + folder.file("b.json"));
    ASSERT_EQ(part.code, 0) << part.err;
  }
  EXPECT_EQ(slurp(folder.file("b.csv")), slurp(folder.file("a.csv")));
  // A step is one from the stop before: the recording's order holds, and what is forgotten cannot tell where
  // things are.
  const RunResult back =
      run("track --stops " + rec, "stop,landmark,range_m,bearing_rad\n5,A,1.0,0.1\n3,A,1.0,0.1\n");
  EXPECT_THAT(back.err, HasSubstr("stop '3' comes after stop '5'"));
  EXPECT_THAT(run("track --forget 100 --stops " + rec, read).err, HasSubstr("random walk"));
  EXPECT_EQ(
      run("track --forget 100 --random-walk", "stop,landmark,range_m,bearing_rad,x_m,y_m,heading_rad\n").code,
      2);
}

TEST(TrackCommand, WatchesReadingsOfLandmarks) {
  // A calibration of the sensor by one drive, another drive held against it; from stop 60 on every reading is
  // 4 cm long.
  const TemporaryFolder folder;
  std::string scene = slurp(RANGECAL_SOURCE_DIR "/notebooks_data/scenes/field-layout.yaml");
  scene.replace(scene.find("count: 10"), 9, "count: 120");
  scene.replace(scene.find("step_m: 0.3"), 11, "step_m: 0.02");
  scene.replace(scene.find("repeats: 10"), 11, "repeats: 2");
  folder.write("scene.yaml", scene);
  for (const char* seed : {"1", "2"})
    ASSERT_EQ(
        run("simulate " + folder.file("scene.yaml") + " -o " + folder.file(seed) + " --seed " + seed).code,
        0);
  ASSERT_EQ(run("calibrate " + folder.file("1") + " --method marginal --order 2 --noise f2 --json " +
                folder.file("cal.json"))
                .code,
            0);
  std::istringstream same(slurp(folder.file("2") + "/observations.csv"));
  std::string line, changed;
  std::getline(same, line);
  ASSERT_EQ(line, "stop,landmark,repeat,range_m,bearing_rad");
  changed = line + "\n";
  while (std::getline(same, line)) {
    std::vector<std::string> fields;
    std::istringstream row(line);
    for (std::string field; std::getline(row, field, ',');) fields.push_back(field);
    const double range = std::stod(fields[3]) + (std::stoi(fields[0]) >= 60 ? 0.04 : 0.0);
    changed += fmt::format("{},{},{},{:.6f},{}\n", fields[0], fields[1], fields[2], range, fields[4]);
  }
  folder.write("changed.csv", changed);
  const std::string common = " --stops " + folder.file("2") + " --from " + folder.file("cal.json") +
                             " --watch 100000 -o " + folder.file("out.csv");
  const RunResult none = run("track " + folder.file("2") + "/observations.csv" + common);
  ASSERT_EQ(none.code, 0) << none.err;
  EXPECT_THAT(none.out, HasSubstr("Changes    none"));
  const RunResult result =
      run("track " + folder.file("changed.csv") + common + " --changes " + folder.file("changes.csv"));
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("Changes    alarm at reading 6"));  // after the 600th
  EXPECT_THAT(result.out, HasSubstr(": window by 0.0"));
  EXPECT_THAT(slurp(folder.file("changes.csv")),
              HasSubstr("reading,since_reading,kind,probability,size,std,phase_rad,phase_std_rad\n6"));
  // cut within the naming of the change, and gone on from the state
  for (const std::size_t length : {changed.size() * 11 / 20, changed.size() * 2 / 3, changed.size()}) {
    folder.write("in.csv", changed.substr(0, length));
    const RunResult part = run("track " + folder.file("in.csv") + common + " --every 50 --state " +
                               folder.file("state.json") + " --changes " + folder.file("again.csv"));
    ASSERT_EQ(part.code, 0) << part.err;
  }
  EXPECT_EQ(slurp(folder.file("again.csv")), slurp(folder.file("changes.csv")));
  EXPECT_EQ(run("track " + folder.file("in.csv") + " --stops " + folder.file("2") + " --state " +
                folder.file("state.json"))
                .code,
            2);
  // one made of pairs does not know the bearings
  TemporaryFolder of_pairs;
  save_line(of_pairs, 0.9, NoiseLaw::f_squared);
  const RunResult refused = run("track " + folder.file("changed.csv") + " --stops " + folder.file("2") +
                                " --watch 1000 --from " + of_pairs.file("cal.json"));
  EXPECT_EQ(refused.code, 2);
  EXPECT_EQ(count_of(refused.err, "\n"), 1) << refused.err;
  EXPECT_THAT(refused.err, HasSubstr("sigma_theta_rad"));
}

TEST(TrackCommand, NamesTheBatchCommandThatEstimatesTheStops) {
  const TemporaryFolder folder;
  const std::string rec = folder.file("rec");
  ASSERT_EQ(
      run("simulate " RANGECAL_SOURCE_DIR "/notebooks_data/scenes/field-layout.yaml -o " + rec + " --seed 3")
          .code,
      0);
  std::string header_text = slurp(rec + "/recording.yaml");
  const std::size_t at = header_text.find("sigma_xy_m: ");
  ASSERT_NE(at, std::string::npos);
  header_text.replace(at, header_text.find_first_of(",\n}", at) - at, "sigma_xy_m: estimate");
  folder.write("rec/recording.yaml", header_text);
  const RunResult result = run("track " + rec + "/observations.csv --stops " + rec);
  EXPECT_EQ(result.code, 2);
  EXPECT_EQ(result.out, "");
  EXPECT_EQ(count_of(result.err, "\n"), 1);
  EXPECT_THAT(result.err, HasSubstr("use 'rangecal calibrate " + rec + " --method marginal'"));
  EXPECT_EQ(run("calibrate " + rec + " --method marginal").code, 0);
}

TEST(TrackCommand, TakesNoReadingBeyondTheSensorOfTheRecordingNamed) {
  const TemporaryFolder folder;
  const std::string field = shipped("field-layout");
  std::string rows = slurp(field + "/observations.csv");
  const std::size_t begin = rows.find('\n', 20000) + 1, end = rows.find('\n', begin);
  std::string far = rows.substr(begin, end - begin);  // stop, landmark, repeat, range, bearing
  std::size_t comma = 0;
  for (int i = 0; i < 3; ++i) comma = far.find(',', comma) + 1;
  far.replace(comma, far.find(',', comma) - comma, "65.535");
  rows.replace(begin, end - begin, far);
  folder.write("stream.csv", rows);
  const RunResult result =
      run("track " + folder.file("stream.csv") + " --stops " + field + " -o " + folder.file("out.csv"));
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("1 above range_max_m"));
  EXPECT_THAT(result.out, HasSubstr("499 used"));
}

TEST(TrackCommand, RefusesLandmarksThatItCannotPlace) {
  const TemporaryFolder folder;
  const std::string header_line = "stop,landmark,range_m,bearing_rad";
  EXPECT_THAT(run("track", header_line + "\n0,A,1.0,0.1\n").err, HasSubstr("x_m, y_m and heading_rad"));
  EXPECT_THAT(run("track", "stop,landmark,range_m,x_m,y_m,heading_rad\n").err, HasSubstr("bearing_rad"));
  const std::string poses = header_line + ",x_m,y_m,heading_rad\n";
  const RunResult bad = run(
      "track",
      poses +
          "0,A,1.0,0.1,0,0,0\n0,B,1.0,90,0,0,0\n1,A,1.1,0.1,,,\n1,A,1.1,0.1,1,0,0\n0,A,1.0,0.1,0,0,0\n,A,1.0,0.1,0,0,0\n");
  EXPECT_EQ(bad.code, 1);  // two stops: nothing is determined
  EXPECT_EQ(count_of(bad.out, "malformed"), 4);
  EXPECT_THAT(bad.err, HasSubstr("comes back after others"));
  EXPECT_THAT(bad.err, HasSubstr("degrees"));
  EXPECT_EQ(run("track --approximate", poses).code, 2);
  EXPECT_THAT(run("track --noise polynomial", poses).err, HasSubstr("is for pairs"));
  EXPECT_EQ(run("track --stops /nowhere", poses).code, 2);
  EXPECT_EQ(run("track --stops /nowhere", "1.0\n").code, 2);
  EXPECT_EQ(run("track --sigma-xy -1", poses).code, 2);
}

TEST(TrackCommand, GoesOnFromItsStateAsIfNothingHadHappened) {
  const TemporaryFolder folder;
  const std::string whole = header + rows(0, 1500);
  folder.write("whole.csv", whole);
  const std::string arguments = " --order auto --forget 100 --every 100 ";
  ASSERT_EQ(run("track " + folder.file("whole.csv") + arguments + "-o " + folder.file("a.csv") + " --state " +
                folder.file("a.json"))
                .code,
            0);
  for (const std::size_t length : {whole.size() / 3, whole.size() / 2, whole.size()}) {  // cut within a line
    folder.write("part.csv", whole.substr(0, length));
    const RunResult result = run("track " + folder.file("part.csv") + arguments + "-o " +
                                 folder.file("b.csv") + " --state " + folder.file("b.json"));
    ASSERT_EQ(result.code, 0) << result.err;
  }
  EXPECT_EQ(slurp(folder.file("a.csv")), slurp(folder.file("b.csv")));
  EXPECT_EQ(run("track " + folder.file("part.csv") + " --order 3 --state " + folder.file("b.json")).code, 2);
  folder.write("part.csv", header);
  EXPECT_EQ(run("track " + folder.file("part.csv") + arguments + " --state " + folder.file("b.json")).code,
            2);
}

TEST(TrackCommand, FollowsAGrowingFileThroughAKill) {
  const TemporaryFolder folder;
  const std::string whole = header + rows(0, 900), out = folder.file("out.csv"),
                    state = folder.file("state.json");
  folder.write("in.csv", "");
  const auto append = [&](const std::string& text) {
    std::ofstream(folder.file("in.csv"), std::ios::app | std::ios::binary) << text;
  };
  const auto start = [&] {
    const pid_t child = ::fork();
    if (child == 0) {
      ::execl(RANGECAL_BINARY, RANGECAL_BINARY, "track", folder.file("in.csv").c_str(), "--follow", "--order",
              "1", "--every", "50", "-o", out.c_str(), "--state", state.c_str(), nullptr);
      ::_exit(99);
    }
    return child;
  };
  const auto wait_for = [&](int lines) {  // until the saved state has come so far; a minute at most
    for (int i = 0; i < 1200; ++i) {
      if (count_of(slurp(state), fmt::format("\"rows\":{},", lines)) > 0) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    return false;
  };
  const std::size_t cut = whole.size() / 2;
  append(whole.substr(0, cut));
  const int complete = count_of(whole.substr(0, cut), "\n") - 1;
  pid_t child = start();
  EXPECT_TRUE(wait_for(complete));
  ::kill(child, SIGKILL);
  int status = 0;
  ::waitpid(child, &status, 0);
  append(whole.substr(cut));
  child = start();
  EXPECT_TRUE(wait_for(900));
  ::kill(child, SIGINT);
  ::waitpid(child, &status, 0);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  const std::string text = slurp(out);
  ASSERT_EQ(count_of(text, "\n"), 901);
  std::istringstream given(whole), made(text);  // every reading once, in order
  std::string a, b;
  std::getline(given, a);
  std::getline(made, b);
  while (std::getline(given, a) && std::getline(made, b)) EXPECT_NEAR(std::stod(a), std::stod(b), 0.0);
}

}  // namespace
}  // namespace rangecal::test
