// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "apps/run_binary.hpp"
#include "rangecal/core/calibration_io.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/problems/world/physical/designs.hpp"
#include "rangecal/problems/world/physical/plants.hpp"
#include "rangecal/problems/world/physical/simulate.hpp"
#include "support/outside_programs.hpp"

namespace rangecal::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using Json = nlohmann::json;

class DiagnoseCommand : public ::testing::Test {
 protected:
  /// A line design with a cover 7.5 mm off the spin axis, as a folder.
  std::string eccentric() {
    Random random(seed_from("diagnose command"));
    world::World w = world::vary(world::make_line_design(), random);
    w = world::apply(w, "range_eccentricity", 0.0075, random);
    save_recording(world::simulate(w, seed_from("diagnose command run")), folder.file("rec"));
    return folder.file("rec");
  }
  TemporaryFolder folder;
};

TEST_F(DiagnoseCommand, TheShippedRecordingIsClean) {
  const RunResult result = run("diagnose " + shipped("field-layout") + " --json " + folder.file("d.json"));
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out,
              AllOf(HasSubstr("No mismatch"), HasSubstr("Could be hidden"), HasSubstr("Do next")));
  EXPECT_EQ(result.err, "");
  const Json json = Json::parse(slurp(folder.file("d.json")));
  EXPECT_EQ(json.at("verdict"), "no_mismatch");
  EXPECT_TRUE(json.at("location").empty());
  EXPECT_TRUE(json.at("final").at("effects").empty());
}

TEST_F(DiagnoseCommand, NamesAPlantedEffectAndShowsTheFit) {
  const RunResult result = run("diagnose " + eccentric());
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, AllOf(HasSubstr("Explained by range_eccentricity"), HasSubstr("held-out NLL"),
                                HasSubstr("chi-square / dof"), HasSubstr("along sensor_bearing"),
                                HasSubstr("range_eccentricity.amplitude"), HasSubstr(" mm")));
  for (std::size_t at = 0, end = 0; at < result.out.size(); at = end + 1) {
    end = std::min(result.out.find('\n', at), result.out.size());
    int columns = 0;  // a character begins at every byte that continues none
    for (std::size_t i = at; i < end; ++i)
      columns += (static_cast<unsigned char>(result.out[i]) & 0xC0) != 0x80;
    if (at == 0) continue;  // the first line holds the folder's name
    EXPECT_LE(columns, 100) << result.out.substr(at, end - at);
  }
}

TEST_F(DiagnoseCommand, TheCorrectedCalibrationUndoesTheEffect) {
  const std::string rec = eccentric(), calibration = folder.file("cal.json");
  ASSERT_EQ(run("diagnose " + rec + " --calibration " + calibration).code, 0);
  const Calibration loaded = load_calibration(calibration);
  ASSERT_EQ(loaded.effects.count("range_eccentricity"), 1u);
  // Forward, at d = 1.2 m and bearing 0: y = f(d) + cosine; correct must lead back to 1.2 m.
  const double d = 1.2;
  double y = 0.0;
  for (Eigen::Index i = loaded.alpha.size(); i-- > 0;) y = y * d + loaded.alpha[i];
  y += loaded.effects.at("range_eccentricity").at("cosine_m");
  folder.write("r.csv", "range_m,bearing_rad\n" + std::to_string(y) + ",0\n");
  const RunResult result = run("correct " + calibration + " " + folder.file("r.csv"));
  ASSERT_EQ(result.code, 0) << result.err;
  const std::size_t begin = result.out.find('\n') + 1, comma = result.out.find(',', begin) + 1;
  EXPECT_NEAR(std::stod(result.out.substr(comma)), d, 3e-6)
      << result.out;  // both sides are written with six decimals
  const RunResult without = run("correct " + calibration, "1.2\n");
  EXPECT_EQ(without.code, 2);
  EXPECT_THAT(without.err, AllOf(HasSubstr("bearing_rad"), HasSubstr("range_eccentricity")));
  EXPECT_EQ(count_of(without.err, "\n"), 1);
}

TEST_F(DiagnoseCommand, ACurveThatIsNotDeterminedIsNotDelivered) {
  // Twenty readings at one distance: no slope, whatever they are.
  folder.write("recording.yaml",
               "format: rangecal/1\nkind: pairs\nsensor: {name: s, range_min_m: 0.1, range_max_m: 10}\n");
  std::string table = "true_m,reading_m\n";
  Random random(seed_from("diagnose one distance"));
  for (int i = 0; i < 20; ++i) table += "2," + std::to_string(random.normal(2.05, 0.01)) + "\n";
  folder.write("pairs.csv", table);
  const std::string json = folder.file("d.json"), calibration = folder.file("cal.json");
  EXPECT_EQ(run("calibrate " + folder.path()).code, 1);
  const RunResult result =
      run("diagnose " + folder.path() + " --json " + json + " --calibration " + calibration);
  EXPECT_EQ(result.code, 1) << result.err;
  EXPECT_EQ(result.err, "");
  EXPECT_THAT(result.out,
              AllOf(HasSubstr("Unobservable: this recording does not determine the calibration"),
                    ::testing::Not(HasSubstr("No mismatch")), ::testing::Not(HasSubstr("Could be hidden"))));
  const Json written = Json::parse(slurp(json));
  EXPECT_EQ(written.at("verdict"), "unobservable");
  EXPECT_FALSE(written.at("final").at("weakest_direction").get<std::string>().empty());
  const Calibration loaded = load_calibration(calibration);
  EXPECT_EQ(loaded.outcome, Outcome::unobservable);
  EXPECT_FALSE(loaded.alpha_covariance);
}

TEST_F(DiagnoseCommand, TheLoopCloses) {
  const std::string rec = eccentric(), d = folder.file("d.json");
  ASSERT_EQ(run("diagnose " + rec + " --json " + d).code, 0);
  const RunResult made = run("simulate --from " + d + " -o " + folder.file("sim") + " --seed 4");
  ASSERT_EQ(made.code, 0) << made.err;
  const RunResult alike = run("diagnose " + rec + " --simulation " + folder.file("sim"));
  ASSERT_EQ(alike.code, 0) << alike.err;
  EXPECT_THAT(alike.out, HasSubstr("No mismatch"));
}

TEST_F(DiagnoseCommand, ARecordingIsNotHeldAgainstItself) {
  const std::string rec = eccentric(), links = folder.file("links"), copy = folder.file("copy");
  std::filesystem::create_directory_symlink("rec", folder.file("link"));
  std::filesystem::create_directory(links);
  for (const auto& entry : std::filesystem::directory_iterator(rec))
    std::filesystem::create_symlink(entry.path(), std::filesystem::path(links) / entry.path().filename());
  for (const std::string& simulation : {rec, folder.file("link"), links, folder.file("./rec")})
    for (const std::string& before : {std::string(), shipped("field-layout") + " "}) {
      const RunResult result = run("diagnose " + before + rec + " --simulation " + simulation);
      EXPECT_EQ(result.code, 2) << simulation;
      EXPECT_EQ(result.out, "");
      EXPECT_EQ(result.err, "rangecal: --simulation " + simulation + ": holds the readings of " + rec +
                                " themselves, which it would account for whatever they are\n");
    }
  std::filesystem::copy(rec, copy);  // another recording, as far as files tell
  EXPECT_NE(run("diagnose " + rec + " --simulation " + copy).code, 2);
}

TEST_F(DiagnoseCommand, WrongInputIsOneLineAndNoFile) {
  const std::string rec = shipped("field-layout"), out = folder.file("d.json");
  for (const std::string& arguments :
       {std::string("diagnose"), "diagnose " + folder.file("missing"), "diagnose " + rec + " --alarm-rate 2",
        "diagnose " + rec + " --force nothing",
        "diagnose " + rec + " --simulation " + folder.file("missing.json"),
        "diagnose " + rec + " --simulation " + shipped("pairs-2016"), std::string("simulate -o x"),
        "simulate --from " + rec + "/recording.yaml -o " + folder.file("x")}) {
    const RunResult result = run(arguments + (arguments.rfind("diagnose ", 0) == 0 ? " --json " + out : ""));
    EXPECT_EQ(result.code, 2) << arguments;
    EXPECT_EQ(count_of(result.err, "\n"), 1) << result.err;
    EXPECT_FALSE(std::filesystem::exists(out)) << arguments;
  }
  EXPECT_EQ(run("diagnose " + rec + " --json " + folder.file("no/such/folder/d.json")).code, 2);
}

// A viewer looks for what its own schemas have; every message has to be as its schema in the file says.
TEST_F(DiagnoseCommand, TheOutsideReaderAcceptsItsMcap) {
  RANGECAL_REQUIRE_OUTSIDE();
  const std::string rec = eccentric(), file = folder.file("d.mcap");
  for (const std::string& recording : {rec, shipped("pairs-2016")}) {
    SCOPED_TRACE(recording);
    ASSERT_EQ(run("diagnose " + recording + " --mcap " + file).code, 0);
    const Json read = Json::parse(run_outside("read.mjs", file));
    EXPECT_EQ(read["topics"], read["streamed"]);  // by the index as from start to end
    EXPECT_EQ(read["counts"]["/finding"], 1);
    EXPECT_GT(read["dataSectionCrc"], 0);
    const Json held = Json::parse(run_outside("schemas.mjs", file));
    EXPECT_EQ(held["complaints"], Json::array());
    EXPECT_EQ(held["seen"], read["counts"]);
    EXPECT_EQ(held["seen"].contains("/scan"), recording == rec);
  }
}

TEST_F(DiagnoseCommand, AnMcapGoesIntoAFileOnly) {
  const RunResult result = run("diagnose " + shipped("field-layout") + " --mcap /dev/null");
  EXPECT_EQ(result.code, 2);
  EXPECT_EQ(result.err, "rangecal: /dev/null: cannot be written: it is written to a file only\n");
  EXPECT_EQ(run("diagnose " + shipped("field-layout") + " --mcap " + shipped("field-layout/stops.csv")).code,
            2);
}

}  // namespace
}  // namespace rangecal::test
