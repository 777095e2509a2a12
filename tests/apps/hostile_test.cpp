// SPDX-License-Identifier: BSD-3-Clause
// Hostile names, files that are none, folders that may not be written, disks that are full, two programs on one file, clocks that go
// back, locales with decimal commas: the right answer, or one line and exit code 2 or 1, and nothing half-written.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <clocale>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <locale>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "apps/run_binary.hpp"
#include "rangecal/core/calibration_io.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/solvers/calibrate.hpp"

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

TEST(HostileFiles, AFullDeviceEndsEveryCommandWithOneLine) {
  const TemporaryFolder folder;
  const std::string pairs = shipped("pairs-2016"), cal = folder.file("cal.json");
  ASSERT_EQ(run("calibrate " + pairs + " --json " + cal).code, 0);
  for (const std::string& command :
       {"calibrate " + pairs, "compare " + pairs, "correct " + cal + " " + pairs + "/pairs.csv",
        "track " + pairs + "/pairs.csv", "diagnose " + pairs, std::string("effects tilt"),
        std::string("--help")}) {
    SCOPED_TRACE(command);
    const std::string err = folder.file("err");
    const int status = std::system(
        (std::string(RANGECAL_BINARY) + " " + command + " > /dev/full 2> " + err + " < /dev/null").c_str());
    ASSERT_TRUE(WIFEXITED(status));
    EXPECT_TRUE(WEXITSTATUS(status) == 1 || WEXITSTATUS(status) == 2) << WEXITSTATUS(status);
    EXPECT_EQ(count_of(slurp(err), "\n"), 1) << slurp(err);
  }
  for (const std::string& option : {"calibrate " + pairs + " --json ", "diagnose " + pairs + " --json ",
                                    "track " + pairs + "/pairs.csv -o "})
    expect_refused(run(option + "/dev/full"), "/dev/full");
}

// A file system of 64 kB, by a user namespace: nothing else runs out of space (ENOSPC) for those who are not root.
TEST(HostileFiles, AFullFileSystemLeavesWhatWasThere) {
  const TemporaryFolder folder;
  const auto inside = [&](const std::string& commands) {
    folder.write("inside.sh", "mount -t tmpfs -o size=64k none " + folder.file("small") + " || exit 77\ncd " +
                                  folder.file("small") + "\nrangecal=" + RANGECAL_BINARY + "\n" + commands);
    return std::system(("unshare -rm sh " + folder.file("inside.sh") + " > " + folder.file("out") + " 2> " +
                        folder.file("err"))
                           .c_str());
  };
  fs::create_directory(folder.file("small"));
  if (inside("exit 0\n") != 0) GTEST_SKIP() << "no file system can be mounted in a user namespace here";
  const std::string pairs = shipped("pairs-2016"), field = shipped("field-layout");
  const int status = inside(
      "echo kept > cal.json; echo kept > page.html; echo kept > t.csv; before=$(ls)\n"
      "dd if=/dev/zero of=filler bs=1k count=52 2> /dev/null\n"
      "$rangecal calibrate " +
      field + " --json cal.json; echo code $?\n" + "$rangecal calibrate " + pairs +
      " --report page.html; echo code $?\n" + "$rangecal simulate " + shipped("scenes/field-layout.yaml") +
      " -o rec; echo code $?\n" + "$rangecal track " + pairs +
      "/pairs.csv -o t.csv --every 1; echo code $?\n" + "rm filler; cat cal.json page.html; ls -A . rec\n");
  EXPECT_EQ(status, 0);
  const std::string out = slurp(folder.file("out")), err = slurp(folder.file("err"));
  SCOPED_TRACE(out + err);
  EXPECT_EQ(count_of(out, "code 2\n"), 4);
  EXPECT_EQ(count_of(err, "\n"), 4);
  EXPECT_EQ(count_of(err, "cannot be written: No space left on device"), 4);
  EXPECT_EQ(count_of(out, "\nkept\n"), 2);
  EXPECT_EQ(count_of(out, ".partial"), 0);
  EXPECT_TRUE(out.ends_with("\nrec:\n")) << "rec holds something";
}

TEST(HostileFiles, ManyProgramsOnOneFileLeaveOneOfTheirs) {
  const TemporaryFolder folder;
  const std::string json = folder.file("cal.json"), page = folder.file("page.html");
  const std::vector<std::string> recordings{shipped("pairs-2016"), shipped("field-layout")};
  std::vector<std::string> theirs;
  for (const std::string& recording : recordings) {
    ASSERT_EQ(run("calibrate " + recording + " --json " + json).code, 0);
    theirs.push_back(nlohmann::json::parse(slurp(json)).at("kind"));
  }
  fs::remove(json);
  std::atomic<bool> done = false;
  std::atomic<int> torn = 0, whole = 0;
  std::thread reader([&] {
    while (!done) {
      const std::string text = slurp(json);
      if (text.empty()) continue;
      ++(nlohmann::json::accept(text) ? whole : torn);
    }
  });
  std::vector<std::thread> programs;
  for (std::size_t i = 0; i < 8; ++i)
    programs.emplace_back([&, i] {
      for (int round = 0; round < 3; ++round)
        EXPECT_EQ(run("calibrate " + recordings[i % 2] + " --json " + json + " --report " + page).code, 0);
    });
  for (std::thread& program : programs) program.join();
  done = true;
  reader.join();
  EXPECT_EQ(torn, 0);
  EXPECT_GT(whole, 0);
  EXPECT_THAT(theirs, ::testing::Contains(nlohmann::json::parse(slurp(json)).at("kind").get<std::string>()));
  EXPECT_TRUE(slurp(page).ends_with("</html>\n"));
  EXPECT_EQ(files_in(folder.path()), (std::set<std::string>{"cal.json", "page.html"}));
}

// No program of ours asks what time it is, except of a clock that only goes forward; times of files tell them apart and are
// not put in order.
TEST(HostileClock, AUnitThatChangedWhileTheClockWentBackIsFittedAgain) {
  const TemporaryFolder folder;
  const auto write = [&](const std::string& unit, double offset) {
    fs::create_directories(folder.file("fleet/" + unit));
    std::ofstream(folder.file("fleet/" + unit + "/recording.yaml")) << "format: rangecal/1\nkind: pairs\n";
    std::ofstream pairs(folder.file("fleet/" + unit + "/pairs.csv"));
    pairs << "true_m,reading_m\n";
    for (int i = 0; i < 40; ++i)
      pairs << 1.0 + 0.1 * i << ',' << 1.0 + 0.1 * i + offset + 0.01 * (i % 3) << '\n';
  };
  for (int unit = 0; unit < 9; ++unit) write(std::string(1, "abcdefghi"[unit]), 0.01 * (unit * unit % 7));
  const std::string fleet = "fleet " + folder.file("fleet") + " --order 1 --diagnose 0 -o ";
  ASSERT_EQ(run(fleet + folder.file("one.db") + " --csv " + folder.file("before.csv")).code, 0);
  using namespace std::chrono_literals;
  const auto now = fs::file_time_type::clock::now();
  write("a", 0.15);
  fs::last_write_time(folder.file("fleet/a/pairs.csv"), now - 24h * 365 * 60);  // before 1970
  write("b", 0.25);
  fs::last_write_time(folder.file("fleet/b/pairs.csv"), now + 24h * 365 * 60);
  ASSERT_EQ(run(fleet + folder.file("one.db") + " --csv " + folder.file("one.csv")).code, 0);
  ASSERT_EQ(run(fleet + folder.file("new.db") + " --csv " + folder.file("new.csv")).code, 0);
  EXPECT_EQ(slurp(folder.file("one.csv")), slurp(folder.file("new.csv")));
  EXPECT_NE(slurp(folder.file("one.csv")), slurp(folder.file("before.csv")));
}

TEST(HostileClock, NoSourceReadsAClockThatCanBeSet) {
  for (const char* module : {"core", "problems", "solvers", "ingest", "report", "apps", "python/src"})
    for (const auto& entry :
         fs::recursive_directory_iterator(std::string(RANGECAL_SOURCE_DIR) + "/" + module)) {
      const std::string name = entry.path().string();
      if (!name.ends_with(".cpp") && !name.ends_with(".hpp")) continue;
      const std::string text = slurp(name);
      for (const char* call : {"system_clock", "high_resolution_clock", "gettimeofday", "CLOCK_REALTIME",
                               "time(nullptr)", "time(NULL)", "std::time("})
        EXPECT_EQ(count_of(text, call), 0) << name << ": " << call;
    }
}

/// A German locale for the C library, where it can be made: LOCPATH and LC_ALL of it in the environment of the object's life.
class GermanLocale {
 public:
  GermanLocale() {
    made_ =
        std::system(("localedef -c -i de_DE -f UTF-8 " + folder_.file("de_DE.UTF-8") + " > /dev/null 2>&1")
                        .c_str()) == 0 ||
        fs::exists(folder_.file("de_DE.UTF-8/LC_NUMERIC"));
    ::setenv("LOCPATH", folder_.path().c_str(), 1);
    ::setenv("LC_ALL", "de_DE.UTF-8", 1);
  }
  ~GermanLocale() {
    std::locale::global(std::locale::classic());
    std::setlocale(LC_ALL, "C");
    ::unsetenv("LOCPATH");
    ::unsetenv("LC_ALL");
  }
  bool made() const { return made_; }

 private:
  TemporaryFolder folder_;
  bool made_ = false;
};

/// Commas for points and points between thousands, in C++ streams.
struct CommaNumbers : std::numpunct<char> {
  char do_decimal_point() const override { return ','; }
  char do_thousands_sep() const override { return '.'; }
  std::string do_grouping() const override { return "\3"; }
};

TEST(HostileLocale, TheProgramWritesPoints) {
  const TemporaryFolder folder;
  const std::string rec = folder.file("rec"), cal = folder.file("cal.json"), table = folder.file("table.csv");
  const auto outputs = [&] {
    std::string all;
    for (const std::string& command :
         {"simulate " + shipped("scenes/field-layout.yaml") + " --seed 3 -o " + rec,
          "calibrate " + rec + " --method full --order 2 --json " + cal, "correct " + cal,
          "track " + shipped("pairs-2016") + "/pairs.csv --order 1 -o " + table}) {
      const RunResult result = run(command, "1.234\n2.5\n");
      EXPECT_EQ(result.code, 0) << command << result.err;
      all += result.out.substr(0, result.out.find(" iterations, "));  // then the time it took
    }
    return all + slurp(rec + "/observations.csv") + slurp(table);
  };
  const std::string plain = outputs();
  const GermanLocale german;
  if (!german.made()) GTEST_SKIP() << "no German locale can be made here (Debian: locales)";
  EXPECT_TRUE(outputs() == plain);
}

TEST(HostileLocale, TheLibraryReadsAndWritesPointsInAProcessThatHasCommas) {
  const TemporaryFolder folder;
  const auto all = [&](const std::string& name) {
    const Recording pairs = load_recording(shipped("pairs-2016")),
                    field = load_recording(shipped("field-layout"));
    std::string text;
    for (const Recording& recording : {pairs, field}) {
      const std::string copy =
          folder.file(name + (recording.kind == RecordingKind::pairs ? "pairs" : "field"));
      save_recording(recording, copy);
      for (const auto& entry : std::set<std::string>(files_in(copy))) text += slurp(copy + "/" + entry);
      CalibrateOptions options;
      options.methods = {Method::closed_form, Method::full};
      options.order = 2;
      for (Calibration& calibration : calibrate(std::vector{load_recording(copy)}, options)) {
        calibration.seconds = 0.0;
        const std::string json = folder.file(name + ".json");
        save_calibrations({calibration}, json);
        text += slurp(json) + calibration.reason + calibrations_to_json({load_calibration(json)});
      }
    }
    return text;
  };
  const std::string plain = all("classic");
  EXPECT_GT(plain.size(), 10000u);
  std::locale::global(std::locale(std::locale::classic(), new CommaNumbers));
  EXPECT_TRUE(all("streams") == plain);
  const GermanLocale german;
  if (!german.made()) GTEST_SKIP() << "no German locale can be made here (Debian: locales)";
  ASSERT_NE(std::setlocale(LC_ALL, "de_DE.UTF-8"), nullptr);
  char comma[8];
  std::snprintf(comma, sizeof comma, "%.1f", 1.5);
  ASSERT_STREQ(comma, "1,5");
  EXPECT_TRUE(all("both") == plain);
}

}  // namespace
}  // namespace rangecal::test
