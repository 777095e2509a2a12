// SPDX-License-Identifier: BSD-3-Clause
// Hostile names, files that are none, folders that may not be written, disks that are full: one line, exit
// code 2 or 1, and nothing half-written.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <string>

#include "apps/run_binary.hpp"
#include "rangecal/core/recording_io.hpp"

namespace rangecal::test {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::Not;

void expect_refused(const RunResult& result, const std::string& says) {
  EXPECT_TRUE(result.code == 2 || result.code == 1) << result.code;
  EXPECT_EQ(count_of(result.err, "\n"), 1) << result.err;
  EXPECT_THAT(result.err, HasSubstr(says));
}

std::set<std::string> files_in(const std::string& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.insert(entry.path().filename().string());
  return names;
}

const char* const kScene =
    "format: rangecal-scene/1\n"
    "sensor: {name: '<b>s</b>', alpha: [0.05, 0.88, 0.06], noise: {law: f2, sigma: 0.006}, sigma_theta_rad: "
    "0.005}\n"
    "stops: {line: {count: 12, step_m: 0.3}, sigma_xy_m: 0.005}\n"
    "landmarks:\n"
    "  list:\n"
    "    - {landmark: '../../x', x_m: 0.5, y_m: 1.2}\n"
    "    - {landmark: '<script>alert(1)</script>', x_m: 1.6, y_m: -1.4}\n"
    "    - {landmark: '=cmd()', x_m: 2.4, y_m: 1.8}\n"
    "    - {landmark: \"-2+3|\\\"a\\\",'b\", x_m: 3.1, y_m: -0.9}\n"
    "    - {landmark: \"'=1\", x_m: 1.1, y_m: 2.2}\n"
    "repeats: 8\n";

TEST(HostileNames, LabelsAreEscapedWhereverTheyGoAndReadBackAsTheyWere) {
  const TemporaryFolder folder;
  folder.write("scene.yaml", kScene);
  const std::string rec = folder.file("inner/rec");
  ASSERT_EQ(run("simulate " + folder.file("scene.yaml") + " -o " + rec).code, 0);
  const std::string csv = slurp(rec + "/observations.csv");
  EXPECT_THAT(csv, HasSubstr(",'=cmd(),"));
  EXPECT_THAT(csv, Not(HasSubstr(",=cmd(),")));
  EXPECT_THAT(csv, HasSubstr(",\"'-2+3|\"\"a\"\",'b\","));
  std::set<std::string> labels;
  for (const Landmark& landmark : load_recording(rec).landmarks) labels.insert(landmark.label);
  EXPECT_EQ(labels, (std::set<std::string>{"../../x", "<script>alert(1)</script>", "=cmd()", "-2+3|\"a\",'b",
                                           "'=1"}));

  const RunResult result = run("calibrate " + rec + " --json " + folder.file("cal.json") + " --report " +
                               folder.file("page.html"));
  ASSERT_EQ(result.code, 0) << result.err;
  const std::string page = slurp(folder.file("page.html"));
  const auto holds = [&](const char* text) {
    return page.find(text) != std::string::npos;
  };  // the page is too long to be printed
  EXPECT_TRUE(holds("&lt;b&gt;s&lt;/b&gt;"));
  EXPECT_TRUE(holds("\\u003cscript>alert(1)"));
  EXPECT_FALSE(holds("<script>alert("));
  EXPECT_FALSE(holds("<b>s</b>"));
  EXPECT_EQ(nlohmann::json::parse(slurp(folder.file("cal.json"))).at("landmarks").size(), 5u);
  EXPECT_EQ(files_in(folder.path()), (std::set<std::string>{"cal.json", "inner", "page.html", "scene.yaml"}));
  EXPECT_EQ(files_in(folder.file("inner")), std::set<std::string>{"rec"});
}

TEST(HostileFiles, PipesDevicesAndFoldersAreNamed) {
  const TemporaryFolder folder;
  fs::copy(shipped("pairs-2016"), folder.file("rec"));
  for (const std::string name : {"pairs.csv", "recording.yaml"}) {
    const std::string file = folder.file("rec/" + name), kept = folder.file("kept");
    fs::rename(file, kept);
    ASSERT_EQ(::mkfifo(file.c_str(), 0600), 0);
    expect_refused(run("calibrate " + folder.file("rec"), "", "timeout 60"),
                   name + ": is a pipe that nobody writes to");
    fs::remove(file);
    fs::create_symlink("/dev/zero", file);
    expect_refused(run("calibrate " + folder.file("rec"), "", "timeout 60"),
                   name + ": is a device, not a file");
    fs::remove(file);
    fs::create_symlink(name, file);  // itself
    expect_refused(run("calibrate " + folder.file("rec")), name);
    fs::remove(file);
    fs::rename(kept, file);
  }
  ASSERT_EQ(::mkfifo(folder.file("fifo").c_str(), 0600), 0);
  for (const std::string command :
       {"correct ", "simulate -o out ", "study -o out ", "simulate -o out --from ", "extract -o out "})
    expect_refused(run(command + folder.file("fifo"), "", "timeout 60"), "fifo: ");
  // a pipe that somebody writes to is as good as a file
  ASSERT_EQ(run("calibrate " + folder.file("rec") + " --json " + folder.file("cal.json")).code, 0);
  const std::string piped = std::string("bash -c '") + RANGECAL_BINARY + " correct " +
                            folder.file("cal.json") + " <(echo 1.5) > " + folder.file("piped") + "'";
  EXPECT_EQ(std::system(piped.c_str()), 0);
  EXPECT_EQ(count_of(slurp(folder.file("piped")), "\n"), 2);
}

TEST(HostileFiles, WhatCannotBeWrittenIsSaidBeforeTheWork) {
  const TemporaryFolder folder;
  const std::string rec = shipped("field-layout"), json = folder.file("kept.json");
  for (const std::string command : {"diagnose ", "calibrate "})
    for (const std::string& path : {std::string("/nowhere/r.html"), folder.path()}) {
      expect_refused(run(command + rec + " --json " + json + " --report " + path), path);
      EXPECT_TRUE(files_in(folder.path()).empty());
    }
  expect_refused(run("compare " + rec + " --report " + folder.path()), folder.path());
}

TEST(HostileFiles, APipeTakesTheResultAndStaysAPipe) {
  const TemporaryFolder folder;
  const std::string fifo = folder.file("pipe");
  const std::string line = "mkfifo " + fifo + "; cat " + fifo + " > " + folder.file("got") +
                           " & sleep 0.1; timeout 60 " + RANGECAL_BINARY + " calibrate " +
                           shipped("pairs-2016") + " --json " + fifo + " > /dev/null; wait";
  ASSERT_EQ(std::system(("bash -c '" + line + "'").c_str()), 0);
  EXPECT_EQ(slurp(folder.file("got")).substr(0, 1), "{");
  EXPECT_TRUE(fs::is_fifo(fifo));
}

TEST(HostileFiles, FoldersWithoutPermission) {
  const TemporaryFolder folder;
  const std::string nobody = ::geteuid() == 0 ? "setpriv --reuid=65534 --regid=65534 --clear-groups" : "";
  fs::permissions(folder.path(), fs::perms::all);
  fs::create_directory(folder.file("closed"));
  fs::copy(shipped("pairs-2016"), folder.file("closed/rec"));
  fs::permissions(folder.file("closed"), fs::perms::none);
  if (run("--version", "", nobody).code != 0) GTEST_SKIP() << "nobody cannot run " << RANGECAL_BINARY;
  expect_refused(run("calibrate " + folder.file("closed/rec"), "", nobody), "closed/rec");
  const std::string scene = shipped("scenes/pairs-2016.yaml"), rec = shipped("pairs-2016");
  expect_refused(run("simulate " + scene + " -o " + folder.file("closed/new"), "", nobody), "closed/new");
  expect_refused(run("calibrate " + rec + " --json " + folder.file("closed/cal.json"), "", nobody),
                 "closed/cal.json");
  expect_refused(run("fleet " + rec + " -o " + folder.file("closed/fleet.db"), "", nobody),
                 "closed/fleet.db");
  expect_refused(run("track " + rec + "/pairs.csv --state " + folder.file("closed/state.json"), "", nobody),
                 "closed/state.json");
  fs::permissions(folder.file("closed"), fs::perms::all);
  EXPECT_EQ(files_in(folder.file("closed")), std::set<std::string>{"rec"});
}

TEST(HostileFiles, AFullDiskLeavesWhatWasThere) {
  const TemporaryFolder folder;
  const std::string small = "ulimit -f 8;";  // blocks of 512 bytes (dash) or 1024 (bash)
  const std::string scene = shipped("scenes/field-layout.yaml"), rec = folder.file("rec");
  expect_refused(run("simulate " + scene + " -o " + rec, "", small), "cannot be written");
  EXPECT_TRUE(files_in(rec).empty());
  ASSERT_EQ(run("simulate " + scene + " -o " + rec + " --seed 1").code, 0);
  const std::string before = slurp(rec + "/observations.csv"), stops = slurp(rec + "/truth_stops.csv");
  const std::set<std::string> files = files_in(rec);
  expect_refused(run("simulate " + scene + " -o " + rec + " --seed 2", "", small), "cannot be written");
  EXPECT_EQ(slurp(rec + "/observations.csv"), before);
  EXPECT_EQ(slurp(rec + "/truth_stops.csv"), stops);  // nor a file that would still have fitted
  EXPECT_EQ(files_in(rec), files);
  const RunResult json = run("calibrate " + rec + " --json " + folder.file("cal.json"), "", small);
  expect_refused(json, "cal.json: cannot be written");
  EXPECT_EQ(files_in(folder.path()), std::set<std::string>{"rec"});
  const int status =
      std::system((std::string(RANGECAL_BINARY) + " effects > /dev/full 2> /dev/null").c_str());
  EXPECT_EQ(WEXITSTATUS(status), 1);
}

}  // namespace
}  // namespace rangecal::test
