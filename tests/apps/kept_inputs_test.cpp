// SPDX-License-Identifier: BSD-3-Clause
// What a command reads is there, and as it was, when it has ended: no result takes its place, under whatever name.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "apps/run_binary.hpp"

namespace rangecal::test {
namespace {

namespace fs = std::filesystem;
using ::testing::AnyOf;
using ::testing::HasSubstr;

class KeptInputs : public ::testing::Test {
 protected:
  KeptInputs() {
    fs::copy_file(shipped("scenes/field-layout.yaml"), folder.file("sk.yaml"));
    fs::create_symlink("sk.yaml", folder.file("link.yaml"));
    fs::create_hard_link(folder.file("sk.yaml"), folder.file("hard.yaml"));
    fs::copy(shipped("pairs-2016"), folder.file("rec"));
    fs::create_symlink("rec/pairs.csv", folder.file("table"));
  }

  /// Refused in one line, and the file is what it was.
  void expect_kept(const std::string& arguments, const std::string& file) const {
    SCOPED_TRACE(arguments);
    const std::string before = slurp(folder.file(file));
    ASSERT_FALSE(before.empty());
    const RunResult result = run(arguments, "", "cd " + folder.path() + ";");
    EXPECT_EQ(result.code, 2);
    EXPECT_THAT(result.err, AnyOf(HasSubstr("would be lost: name another f"),
                                  HasSubstr("which is read: name another f")));
    EXPECT_EQ(count_of(result.err, "\n"), 1) << result.err;
    EXPECT_EQ(slurp(folder.file(file)), before);
  }

  TemporaryFolder folder;
};

TEST_F(KeptInputs, APlanKeepsItsSketch) {
  for (const char* option : {"--scene", "--line-scene", "--json"})
    for (const char* name : {"sk.yaml", "./sk.yaml", "link.yaml", "hard.yaml", "rec/../sk.yaml"})
      expect_kept(std::string("plan sk.yaml ") + option + " " + name, "sk.yaml");
  expect_kept("plan link.yaml --scene sk.yaml", "sk.yaml");
  EXPECT_TRUE(fs::is_symlink(folder.file("link.yaml")));
}

TEST_F(KeptInputs, CalibrationsAndDiagnosesKeepRecordingsAndCalibrations) {
  ASSERT_EQ(run("calibrate " + folder.file("rec") + " --json " + folder.file("cal.json")).code, 0);
  expect_kept("calibrate rec --from cal.json --json cal.json", "cal.json");
  expect_kept("calibrate rec --json table", "rec/pairs.csv");
  expect_kept("compare rec --report table", "rec/pairs.csv");
  expect_kept("diagnose rec --json table", "rec/pairs.csv");
  expect_kept("diagnose rec --simulation cal.json --calibration cal.json", "cal.json");
  // the same command may be run again: its own result is no input
  EXPECT_EQ(run("calibrate " + folder.file("rec") + " --json " + folder.file("cal.json")).code, 0);
}

TEST_F(KeptInputs, ASimulationKeepsItsScene) {
  ASSERT_EQ(run("simulate " + folder.file("sk.yaml") + " -o " + folder.file("sim")).code, 0);
  fs::copy_file(folder.file("sk.yaml"), folder.file("sim/recording.yaml"),
                fs::copy_options::overwrite_existing);
  expect_kept("simulate sim/recording.yaml -o sim", "sim/recording.yaml");
}

TEST_F(KeptInputs, AStudyKeepsItsFiles) {
  folder.write("study.yaml",
               "format: rangecal-study/1\nname: s\nscene: sk.yaml\nrepeats: 2\nfit: {order: 2}\n"
               "estimators: [closed-form]\nmeasures: [rmse]\n");
  expect_kept("study study.yaml -o out --report study.yaml", "study.yaml");
  // nor does a page take the place of a table or a journal; the folder is not begun, and the corrected command runs
  for (const char* page : {"out/results.csv", "out/../out/timing.csv", "out/journal.txt", "nowhere/page.html",
                           "rec/pairs.csv"}) {
    const RunResult refused =
        run(std::string("study study.yaml -o out --report ") + page, "", "cd " + folder.path() + ";");
    EXPECT_EQ(refused.code, 2) << page;
    EXPECT_EQ(count_of(refused.err, "\n"), 1) << refused.err;
    EXPECT_FALSE(fs::exists(folder.file("out"))) << page;
  }
  const RunResult corrected =
      run("study study.yaml -o out --report out/page.html", "", "cd " + folder.path() + ";");
  EXPECT_EQ(corrected.code, 0) << corrected.err;
  EXPECT_TRUE(fs::exists(folder.file("out/page.html")));
  fs::remove_all(folder.file("out"));
  expect_kept("study study.yaml -o out --report link.yaml", "sk.yaml");  // the scene is read, too
  fs::create_directory(folder.file("out"));
  fs::create_hard_link(folder.file("study.yaml"), folder.file("out/results.csv"));
  expect_kept("study study.yaml -o out", "study.yaml");
}

TEST_F(KeptInputs, AProofKeepsRecordingsAndKeys) {
  ASSERT_EQ(run("prove --make 1 --seed 3 -o " + folder.file("sealed")).code, 0);
  expect_kept("prove sealed -o sealed-keys/world-01.json", "sealed-keys/world-01.json");
  expect_kept("prove sealed --csv sealed/world-01/commitment.txt", "sealed/world-01/commitment.txt");
  expect_kept("prove --fresh 1 --seed 3 --csv rec/pairs.csv", "rec/pairs.csv");
  expect_kept("prove --world 0 --row pair --design line --seed 3 --dump rec", "rec/pairs.csv");
}

TEST_F(KeptInputs, CorrectionsAreNotAddedToTheirReadings) {
  ASSERT_EQ(run("calibrate " + folder.file("rec") + " --json " + folder.file("cal.json")).code, 0);
  folder.write("readings", "1.5\n");
  const std::string line =
      "cd " + folder.path() + "; " + RANGECAL_BINARY + " correct cal.json readings >> readings 2> err";
  EXPECT_EQ(WEXITSTATUS(std::system(line.c_str())), 2);
  EXPECT_THAT(slurp(folder.file("err")), HasSubstr("is the same file as readings, which is read"));
  EXPECT_EQ(slurp(folder.file("readings")), "1.5\n");
}

TEST_F(KeptInputs, AFleetKeepsShardsAndRecordings) {
  fs::create_directory(folder.file("make"));
  fs::copy(folder.file("rec"), folder.file("make/rec"));
  fs::create_hard_link(folder.file("make/rec/pairs.csv"), folder.file("units.csv"));
  ASSERT_EQ(run("fleet " + folder.file("rec") + " -o " + folder.file("s1.db") + " --shard 1/2").code, 0);
  expect_kept("fleet --merge s1.db -o all.db --csv s1.db", "s1.db");
  expect_kept("fleet --merge s1.db -o s1.db", "s1.db");
  expect_kept("fleet rec -o all.db --csv table", "rec/pairs.csv");
  expect_kept("fleet rec -o table", "rec/pairs.csv");
  expect_kept("fleet make -o all.db --csv units.csv", "make/rec/pairs.csv");
  EXPECT_FALSE(fs::exists(folder.file("all.db")));
}

TEST_F(KeptInputs, AStreamKeepsItsCalibrationAndItsStops) {
  ASSERT_EQ(run("calibrate " + folder.file("rec") + " --json " + folder.file("cal.json")).code, 0);
  folder.write("in.csv", "reading_m,true_m\n1.5,1.6\n");  // teaches nothing
  for (const char* option : {"--json", "-o", "--state"})
    expect_kept(std::string("track in.csv --from cal.json ") + option + " cal.json", "cal.json");
  expect_kept("track in.csv --json link.csv --state in.csv", "in.csv");
  fs::copy(shipped("field-layout"), folder.file("field"));
  fs::create_symlink("field/stops.csv", folder.file("stops"));
  expect_kept("track field/observations.csv --stops field -o stops", "field/stops.csv");
}

TEST_F(KeptInputs, AnExtractionIsRefusedBeforeItBegins) {
  // scans that are none: what is refused is not read
  folder.write("scans.csv", "no scans\n");
  expect_kept("extract scans.csv -o new --json scans.csv", "scans.csv");
  expect_kept("extract scans.csv -o new --json rec/pairs.csv", "rec/pairs.csv");
  expect_kept("extract scans.csv -o rec", "rec/pairs.csv");
  EXPECT_THAT(run("extract scans.csv -o new --json nowhere/x.json", "", "cd " + folder.path() + ";").err,
              HasSubstr("nowhere/x.json: cannot be written"));
  EXPECT_FALSE(fs::exists(folder.file("new")));
}

}  // namespace
}  // namespace rangecal::test
