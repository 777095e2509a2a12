// SPDX-License-Identifier: BSD-3-Clause
// What `track` refuses, and how it ends where it cannot do what was asked.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <functional>
#include <regex>
#include <sstream>
#include <string>
#include <thread>

#include "apps/run_binary.hpp"
#include "rangecal/core/calibration_io.hpp"
#include "rangecal/core/random.hpp"

namespace rangecal::test {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;

/// Rows of true_m,reading_m or the other way round: f(d) = 0.1 + 0.9 d, s = 0.01 f^2.
std::string pair_rows(int count, bool as_true_first = true, const char* day = "Monday") {
  std::string text;
  for (int i = 0; i < count; ++i) {
    Random random(seed_from(day, {static_cast<std::uint64_t>(i)}));
    const double d = random.uniform(0.5, 4.0), f = 0.1 + 0.9 * d, y = random.normal(f, 0.01 * f * f);
    text += fmt::format("{:.5f},{:.5f}\n", as_true_first ? d : y, as_true_first ? y : d);
  }
  return text;
}
const std::string true_first = "true_m,reading_m\n", reading_first = "reading_m,true_m\n";

void expect_refused_stream(const RunResult& result, const std::string& why) {
  EXPECT_EQ(result.code, 2) << result.err;
  EXPECT_EQ(count_of(result.err, "\n"), 1) << result.err;
  EXPECT_THAT(result.err, AllOf(HasSubstr("is another stream than the state's ("), HasSubstr(why)));
}

void expect_refusal(const std::string& arguments, const std::string& input, const std::string& why) {
  SCOPED_TRACE(arguments + " < " + input.substr(0, 60));
  const RunResult result = run("track " + arguments, input);
  EXPECT_EQ(result.code, 2);
  EXPECT_EQ(result.out, "");
  EXPECT_EQ(count_of(result.err, "\n"), 1) << result.err;
  EXPECT_THAT(result.err, HasSubstr(why));
}

TEST(TrackRefusals, AFileThatIsNotTheStates) {
  const TemporaryFolder folder;
  folder.write("in.csv", true_first + pair_rows(300));
  const std::string command = "track " + folder.file("in.csv") + " --order 1 --state " +
                              folder.file("state.json") + " -o " + folder.file("out.csv");
  ASSERT_EQ(run(command).code, 0);
  const std::string state = slurp(folder.file("state.json")), out = slurp(folder.file("out.csv"));
  const auto refused = [&](const std::string& text, const std::string& why) {
    SCOPED_TRACE(why);
    folder.write("in.csv", text);
    expect_refused_stream(run(command), why);
    EXPECT_EQ(slurp(folder.file("state.json")), state);
    EXPECT_EQ(slurp(folder.file("out.csv")), out);
  };
  refused(reading_first + pair_rows(400, false), "its header is 'reading_m,true_m', not 'true_m,reading_m'");
  refused(true_first + pair_rows(400, true, "Tuesday"), "are not those that were read");
  refused(true_first + pair_rows(100), "it has less than the");
  std::string touched = true_first + pair_rows(400);
  touched[touched.find('\n') + 1] ^= 1;  // another digit in the first row
  refused(touched, "are not those that were read");

  // A state of 0.1.0 tells by the header alone, and goes on with its file.
  std::string old = std::regex_replace(state, std::regex("\"fingerprint\":\"[0-9a-f]{16}\","), "");
  old = std::regex_replace(old, std::regex("\"asked\":\\{[^}]*\\},\"stops\":null,"), "");
  ASSERT_LT(old.size() + 100, state.size());
  folder.write("state.json", old);
  folder.write("in.csv", reading_first + pair_rows(400, false));
  expect_refused_stream(run(command), "its header is");
  folder.write("in.csv", true_first + pair_rows(400));
  EXPECT_EQ(run(command).code, 0);
  EXPECT_EQ(count_of(slurp(folder.file("out.csv")), "\n"), 401);
}

TEST(TrackRefusals, AHeaderOfStdinThatIsNotTheStates) {
  const TemporaryFolder folder;
  const std::string arguments = "--order 1 --state " + folder.file("state.json");
  ASSERT_EQ(run("track " + arguments, true_first + pair_rows(200)).code, 0);
  const std::string state = slurp(folder.file("state.json"));
  expect_refused_stream(run("track " + arguments, reading_first + pair_rows(50, false)),
                        "its header is 'reading_m,true_m'");
  EXPECT_EQ(slurp(folder.file("state.json")), state);
  for (const std::string& header : {std::string(), true_first, std::string(" true_m ,reading_m\n")}) {
    const RunResult more = run("track " + arguments, header + pair_rows(50));
    EXPECT_EQ(more.code, 0) << more.err;
    EXPECT_EQ(count_of(more.out, "\n"), 51);  // with the header of the output
  }
  EXPECT_THAT(slurp(folder.file("state.json")), HasSubstr("\"rows\":350,"));
  // nor does one stream change its columns on the way
  expect_refusal("-o " + folder.file("out.csv"),
                 true_first + pair_rows(50) + reading_first + pair_rows(50, false),
                 "stdin, row 52: names other columns");
}

TEST(TrackRefusals, ARecordingOfStopsThatHasChanged) {
  const TemporaryFolder folder;
  const std::string rec = folder.file("rec"), field = shipped("field-layout");
  fs::copy(field, rec, fs::copy_options::recursive);
  const std::string observations = slurp(field + "/observations.csv"), stops = slurp(rec + "/stops.csv"),
                    landmarks = slurp(rec + "/landmarks.csv");
  const std::string command = "track " + folder.file("in.csv") + " --stops " + rec + " --state " +
                              folder.file("state.json") + " -o " + folder.file("out.csv");
  folder.write("in.csv", observations.substr(0, observations.find("\n8,") + 1));
  ASSERT_EQ(run(command).code, 0);
  const auto changed = [](std::string text, const std::string& what, const std::string& by) {
    const std::size_t at = text.find(what);
    EXPECT_NE(at, std::string::npos) << what;
    return text.replace(at, what.size(), by);
  };
  folder.write("in.csv", observations);
  folder.write("rec/stops.csv", changed(stops, "\n1,0.3,", "\n1,0.4,"));
  expect_refused_stream(run(command), "what it used of " + rec + " has changed");
  folder.write("rec/stops.csv", stops);
  folder.write("rec/landmarks.csv", changed(landmarks, "B,0.12", "B,0.05"));
  expect_refused_stream(run(command), "what it used of");
  folder.write("rec/landmarks.csv", landmarks);
  // the last stop was not come to yet
  folder.write("rec/stops.csv", stops.substr(0, stops.rfind("\n9,") + 1) + "9,2.71,0,0\n");
  EXPECT_EQ(run(command).code, 0);
  const RunResult without = run("track " + folder.file("in.csv") + " --state " + folder.file("state.json"));
  EXPECT_EQ(without.code, 2);
  EXPECT_THAT(without.err, HasSubstr("was made with another --stops"));
}

TEST(TrackRefusals, OtherOptionsThanTheStates) {
  const TemporaryFolder folder;
  for (const auto& [name, slope] : {std::pair{"a.json", 0.9}, {"same.json", 0.9}, {"b.json", 0.8}}) {
    Calibration line;
    line.outcome = Outcome::converged;
    line.alpha = Eigen::Vector2d(0.1, slope);
    line.noise = {NoiseLaw::f_squared, Eigen::VectorXd::Constant(1, 0.01)};
    line.range_min_m = 0.5;
    line.range_max_m = 4.0;
    save_calibrations({line}, folder.file(name));
  }
  folder.write("in.csv", true_first + pair_rows(200));
  const std::string command = "track " + folder.file("in.csv") + " --order 1 --state " +
                              folder.file("state.json") + " -o " + folder.file("out.csv") + " --from ";
  ASSERT_EQ(run(command + folder.file("a.json") + " --watch 1000").code, 0);
  EXPECT_EQ(run(command + folder.file("same.json") + " --watch 1000").code, 0);
  for (const auto& [options, name] : {std::pair{"b.json --watch 1000", "--from"},
                                      {"a.json --watch 2000", "--watch"},
                                      {"a.json", "--watch"}}) {
    const RunResult other = run(command + folder.file(options));
    EXPECT_EQ(other.code, 2) << options;
    EXPECT_THAT(other.err, HasSubstr(std::string("state.json: was made with another ") + name));
  }
}

TEST(TrackRefusals, TwoResultsOfOneNameAndResultsOverInputs) {
  const TemporaryFolder folder;
  folder.write("in.csv", true_first + pair_rows(50));
  folder.write("cal.json", "{}");
  const std::string x = folder.file("x"), in = folder.file("in.csv"), cal = folder.file("cal.json");
  for (const std::string& two : {"-o " + x + " --json " + x, "--state " + x + " --json " + x,
                                 "--state " + x + " -o " + folder.path() + "/./x",
                                 "--from " + cal + " --watch 1000 -o " + x + " --changes " + x}) {
    expect_refusal(in + " " + two, "", "x: is named as the file of two results");
    EXPECT_FALSE(fs::exists(x));
  }
  for (const std::string option : {"-o ", "--json ", "--state "})
    expect_refusal(in + " " + option + in, "", "in.csv: is read, and would be lost: name another file");
  expect_refusal("-o /dev/stdin", true_first + pair_rows(50), "stdin: is read, and would be lost");
  EXPECT_EQ(slurp(in), true_first + pair_rows(50));
  for (const std::string option : {"-o ", "--json ", "--state "})
    expect_refusal(in + " --from " + cal + " " + option + cal, "", "cal.json: is read, and would be lost");
}

TEST(TrackRefusals, ColumnsThatAreNamedTwiceOrInOtherUnits) {
  expect_refusal("", "reading_m,true_m,reading_m\n1,1,2\n", "column 'reading_m': the column is named twice");
  expect_refusal("", "reading_m,true_m,note,note\n", "column 'note': the column is named twice");
  expect_refusal("", "reading_m,true_m,time_ms\n1,1,2\n", "column 'time_ms': is not read; 'time_s' is");
  expect_refusal("", "reading_m,true_mm\n1,1000\n", "column 'true_mm': is not read; 'true_m' is");
  expect_refusal("", "reading_mm,true_m\n1000,1\n", "column 'reading_mm': is not read; 'reading_m' is");
  expect_refusal("", "range_mm\n1000\n", "column 'range_mm': is not read; 'range_m' is");
  expect_refusal("", "reading_m,true_m,bearing_deg\n1,1,90\n", "'bearing_rad' is");
  const std::string landmarks = "stop,landmark,range_m,bearing_rad,x_m,y_m,";
  expect_refusal("", landmarks + "heading_deg\n", "'heading_deg': is not read; 'heading_rad' is");
  expect_refusal("", landmarks + "heading_rad,radius_mm\n", "'radius_mm': is not read; 'radius_m' is");
  // what a stream of pairs has no use for may be called as it likes
  EXPECT_EQ(run("track --order 1", "true_m,reading_m,heading_deg\n1,1,9\n").code, 1);
}

TEST(TrackRefusals, OptionsThatTheStreamHasNoUseFor) {
  const std::string landmarks = "stop,landmark,range_m,bearing_rad,x_m,y_m,heading_rad\n";
  expect_refusal("--range 0.5 3", landmarks, "--range limits true distances");
  for (const std::string option : {"--random-walk", "--sigma-xy 0.02", "--sigma-heading 0.1", "--radius 0.1"})
    expect_refusal(option, true_first, option.substr(0, option.find(' ')) + " is for landmarks");
  const std::string stops = "--stops " + shipped("field-layout");
  expect_refusal(stops, "stop,landmark,range_m,bearing_rad,true_m\n",
                 "the stream has true_m: its rows are pairs");
  expect_refusal(stops, "reading_m\n", "no columns stop and landmark");
}

TEST(TrackRefusals, SaysWhatForgettingLeaves) {
  std::string nanoseconds = "time_s,true_m,reading_m\n";
  std::istringstream rows(pair_rows(600));
  std::string row;
  for (int i = 0; std::getline(rows, row); ++i) nanoseconds += fmt::format("{}0000000,{}\n", i, row);
  const RunResult timed = run("track --forget 3600", nanoseconds);
  EXPECT_EQ(timed.code, 1);
  EXPECT_THAT(timed.err, HasSubstr("with --forget 3600 (seconds of time_s) they count as 1\n"));
  const RunResult counted = run("track --forget 1e-9", true_first + pair_rows(600));
  EXPECT_EQ(counted.code, 1);
  EXPECT_THAT(counted.err, HasSubstr("with --forget 1e-09 (readings) they count as 1\n"));
}

TEST(TrackRefusals, IsNoAnswerWhereMostRowsWereNotUnderstood) {
  std::string broken;
  for (int i = 0; i < 101; ++i) broken += "1.0;1.0\n";
  const RunResult most = run("track --order 1", true_first + pair_rows(100) + broken);
  EXPECT_EQ(most.code, 1);
  EXPECT_THAT(most.err, HasSubstr("stdin: 101 of 201 rows were not understood"));
  EXPECT_EQ(run("track --order 1", true_first + pair_rows(101) + broken).code, 0);
}

/// `track ARGUMENTS` in the background, its words in `err`.
pid_t started(const std::string& arguments, const TemporaryFolder& folder) {
  const std::string command = std::string("exec ") + RANGECAL_BINARY + " track " + arguments +
                              " > /dev/null 2> " + folder.file("err");
  const pid_t child = ::fork();
  if (child == 0) {
    ::execl("/bin/sh", "sh", "-c", command.c_str(), nullptr);
    ::_exit(99);
  }
  return child;
}

/// Waits until it is so; a minute at most.
bool comes(const std::function<bool()>& so) {
  for (int i = 0; i < 1200; ++i) {
    if (so()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  return false;
}

/// What waitpid says of its end; killed where it does not come.
int end_of(
    pid_t child, const std::function<void()>& meanwhile = [] {}) {
  int status = 0;
  const bool ended = comes([&] {
    if (::waitpid(child, &status, WNOHANG) == child) return true;
    meanwhile();
    return false;
  });
  if (!ended) {
    ::kill(child, SIGKILL);
    ::waitpid(child, &status, 0);
  }
  return status;
}

TEST(TrackRefusals, DiesByTheSignalThatStopsIt) {
  const TemporaryFolder folder;
  const std::string pipe = folder.file("pipe"), state = folder.file("state.json");
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  std::ofstream rows(pipe, std::ios::in | std::ios::out);  // at both ends: nobody waits, and it does not end
  rows << true_first + pair_rows(200) << std::flush;
  const pid_t child = started(pipe + " --order 1 --every 50 --state " + state + " -o " +
                                  folder.file("out.csv") + " --json " + folder.file("cal.json"),
                              folder);
  EXPECT_TRUE(comes([&] { return count_of(slurp(state), "\"rows\":200,") > 0; }));
  // A signal that comes just before the wait for more does not end the wait: it is sent until it is heeded.
  const int status = end_of(child, [&] { ::kill(child, SIGTERM); });
  EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGTERM) << status;
  EXPECT_THAT(slurp(folder.file("err")), HasSubstr("pipe: stopped by SIGTERM after 200 rows"));
  EXPECT_EQ(count_of(slurp(folder.file("out.csv")), "\n"), 201);
  EXPECT_EQ(load_calibration(folder.file("cal.json")).outcome, Outcome::converged);
}

TEST(TrackRefusals, FollowsNoFileThatIsCutBackOrReplaced) {
  for (const bool replaced : {false, true}) {
    SCOPED_TRACE(replaced);
    const TemporaryFolder folder;
    const std::string in = folder.file("in.csv"), state = folder.file("state.json");
    folder.write("in.csv", true_first + pair_rows(200));
    const pid_t child =
        started(in + " --follow --order 1 --state " + state + " -o " + folder.file("out.csv"), folder);
    EXPECT_TRUE(comes([&] { return count_of(slurp(state), "\"rows\":200,") > 0; }));
    if (replaced) {
      fs::rename(in, in + ".1");
      std::ofstream(in + ".1", std::ios::app) << pair_rows(10);  // the writer's last words are still read
      folder.write("in.csv", true_first);
    } else {
      fs::resize_file(in, 100);
    }
    const int status = end_of(child);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 1) << status;
    EXPECT_THAT(slurp(folder.file("err")),
                HasSubstr(replaced ? "in.csv: was replaced by another file; the stream ends after 210 rows"
                                   : "in.csv: was cut back to 100 bytes after"));
  }
}

TEST(TrackRefusals, AWalkThatItsSumsNoLongerTellEndsWithoutAnAnswer) {
  // Steps of 2 cm that are off by 1 cm and 0.01 rad: the map drifts faster than 64 stops show it.
  const TemporaryFolder folder;
  folder.write(
      "walk.yaml",
      "format: rangecal-scene/1\n"
      "sensor: {alpha: [0.0525, 0.8838, 0.0584], noise: {law: f2, sigma: 0.01}, sigma_theta_rad: 0.009, "
      "range_min_m: 0.1, range_max_m: 10}\n"
      "stops: {line: {count: 90, step_m: 0.02}, sigma_xy_m: 0.01, sigma_heading_rad: 0.01, "
      "error: random_walk}\n"
      "landmarks: {radius_m: 0.1, random: {count: 5, x_m: [0, 6], y_m: [-3, 3]}}\nrepeats: 5\n");
  const std::string walk = folder.file("walk");
  ASSERT_EQ(run("simulate " + folder.file("walk.yaml") + " -o " + walk + " --seed 2").code, 0);
  const RunResult result =
      run("track " + walk + "/observations.csv --stops " + walk + " -o " + folder.file("out.csv"));
  EXPECT_EQ(result.code, 1);
  EXPECT_THAT(result.out + result.err, HasSubstr("calibrate it as a whole"));
  EXPECT_THAT(result.out, HasSubstr("Curve f    not determined: what can change unseen is "));
  EXPECT_THAT(result.out, HasSubstr("landmark R"));
  EXPECT_EQ(result.out.find("reading ="), std::string::npos) << result.out;  // no numbers beside no answer
}

}  // namespace
}  // namespace rangecal::test
