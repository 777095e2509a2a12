// SPDX-License-Identifier: BSD-3-Clause
// Long work that is killed, interrupted, out of disk, bereft of an input, or begun twice: it says so, and
// goes on to the same result with nothing counted twice.
#include <fcntl.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/file.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "apps/run_binary.hpp"
#include "rangecal/core/random.hpp"

namespace rangecal::test {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

/// Holds the lock that a run on `path` would.
class Held {
 public:
  explicit Held(const std::string& path)
      : file_(::open((path + ".lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644)) {
    EXPECT_EQ(::flock(file_, LOCK_EX | LOCK_NB), 0);
  }
  ~Held() { ::close(file_); }

 private:
  int file_;
};

void write_units(const TemporaryFolder& folder, int units) {
  for (int u = 0; u < units; ++u) {
    Random random(seed_from("faults", {static_cast<std::uint64_t>(u)}));
    const std::string path = fmt::format("{}/fleet/u{:03}", folder.path(), u);
    fs::create_directories(path);
    std::ofstream(path + "/recording.yaml") << "format: rangecal/1\nkind: pairs\n";
    std::ofstream pairs(path + "/pairs.csv");
    pairs << "true_m,reading_m\n";
    const double offset = random.normal(0.05, 0.02), slope = random.normal(0.9, 0.03);
    for (int i = 0; i < (u == 3 ? 3 : 60); ++i) {
      const double d = random.uniform(0.5, 4.0), f = offset + slope * d;
      pairs << fmt::format("{:.5f},{:.5f}\n", d, random.normal(f, 0.01 * f * f));
    }
  }
}

std::string study_file(const TemporaryFolder& folder, int repeats) {
  folder.write("study.yaml", std::string("format: rangecal-study/1\nname: faults\nscene: ") +
                                 RANGECAL_SOURCE_DIR +
                                 "/notebooks_data/studies/scenes/2021.yaml\ngrid:\n  - {parameter: "
                                 "sigma_theta_deg, values: [0.5, 2]}\n"
                                 "repeats: " +
                                 std::to_string(repeats) +
                                 "\npiece: 7\nestimators: [closed-form, marginal]\nmeasures: [bias, rmse]\n");
  return folder.file("study.yaml");
}

const std::string kProof = "prove --fresh 3 --seed 5 --row clean --design line --no-oracle --csv ";

/// The worlds and their answers, without the time they took.
std::string answers_in(const std::string& file) {
  std::istringstream lines(slurp(file));
  std::string all;
  for (std::string line; std::getline(lines, line);) {
    std::vector<std::string> fields;
    std::istringstream stream(line);
    for (std::string field; std::getline(stream, field, ',');) fields.push_back(field);
    if (fields.size() > 22) fields[22] = "";
    for (const std::string& field : fields) all += field + ",";
    all += "\n";
  }
  return all;
}

/// Starts the command in the background and sends it the signal after the delay; what waitpid says of its
/// end.
int run_and_signal(const std::string& arguments, int signal, std::chrono::milliseconds delay) {
  const pid_t child = ::fork();
  if (child == 0) {
    const std::string command =
        std::string("exec ") + RANGECAL_BINARY + " " + arguments + " > /dev/null 2>&1";
    ::execl("/bin/sh", "sh", "-c", command.c_str(), nullptr);
    ::_exit(99);
  }
  std::this_thread::sleep_for(delay);
  ::kill(child, signal);
  int status = 0;
  ::waitpid(child, &status, 0);
  return status;
}

TEST(Faults, ASecondRunIntoTheSamePlaceIsRefused) {
  const TemporaryFolder folder;
  write_units(folder, 3);
  const std::string scene = shipped("scenes/pairs-2016.yaml"), study = study_file(folder, 14),
                    stream = shipped("pairs-2016/pairs.csv");
  fs::create_directories(folder.file("rec"));
  fs::create_directories(folder.file("out"));
  const std::vector<std::pair<std::string, std::string>> commands = {
      {"rec/", "simulate " + scene + " -o " + folder.file("rec")},
      {"out/", "study " + study + " -o " + folder.file("out")},
      {"fleet.db", "fleet " + folder.file("fleet") + " --order 0 -o " + folder.file("fleet.db")},
      {"scores.csv", kProof + folder.file("scores.csv")},
      {"state.json", "track " + stream + " --state " + folder.file("state.json")},
      {"track.csv", "track " + stream + " -o " + folder.file("track.csv")}};
  for (const auto& [place, command] : commands) {
    const Held held(folder.file(place));
    const RunResult refused = run(command);
    EXPECT_EQ(refused.code, 2) << command;
    EXPECT_THAT(refused.err, HasSubstr("another run is writing it")) << command;
    EXPECT_EQ(count_of(refused.err, "\n"), 1) << refused.err;
  }
  EXPECT_TRUE(fs::is_empty(folder.file("rec")) || slurp(folder.file("rec/.lock")).empty());
  EXPECT_FALSE(fs::exists(folder.file("fleet.db")));
  // the lock of a run that was killed is none
  EXPECT_EQ(run(commands[0].second).code, 0);
  EXPECT_EQ(run(commands[1].second).code, 0);
  EXPECT_FALSE(fs::exists(folder.file("rec/.lock")));
  EXPECT_FALSE(fs::exists(folder.file("out/.lock")));
}

TEST(Faults, BadInputLeavesNoFleetBehind) {
  const TemporaryFolder folder;
  write_units(folder, 2);
  fs::create_directories(folder.file("empty"));
  for (const std::string inputs :
       {"nowhere", "empty", "fleet nowhere", "--merge nowhere.db", "--merge fleet/u000/pairs.csv"}) {
    std::istringstream words(inputs);
    std::string command = "fleet ";
    for (std::string word; words >> word;)
      command += (word.starts_with("--") ? word : folder.file(word)) + " ";
    const RunResult refused = run(command + "--order 0 -o " + folder.file("fleet.db"));
    EXPECT_EQ(refused.code, 2) << inputs;
    EXPECT_EQ(count_of(refused.err, "\n"), 1) << refused.err;
    for (const auto& entry : fs::directory_iterator(folder.path()))
      EXPECT_EQ(entry.path().filename().string().find("fleet.db"), std::string::npos)
          << inputs << ": " << entry.path();
  }
}

TEST(Faults, AFleetOutlivesAFullDiskAndUnitsThatVanish) {
  const TemporaryFolder folder;
  write_units(folder, 300);
  const std::string fleet = "fleet " + folder.file("fleet") + " --order 1 --diagnose 0 -o ",
                    a = folder.file("a.db");
  const RunResult full =
      run(fleet + a, "", "ulimit -f 160;");  // 80 or 160 kB: the first transaction, not the second
  EXPECT_TRUE(full.code == 2 || full.code == 1) << full.code;
  EXPECT_EQ(count_of(full.err, "\n"), 1) << full.err;
  ASSERT_EQ(run(fleet + a + " --csv " + folder.file("a.csv")).code, 0);
  ASSERT_EQ(run(fleet + folder.file("b.db") + " --csv " + folder.file("b.csv")).code, 0);
  EXPECT_EQ(slurp(folder.file("a.csv")), slurp(folder.file("b.csv")));

  // u003 has too few readings of its own and is read again for its posterior; u004 never could be read, and
  // now can
  fs::rename(folder.file("fleet/u003"), folder.file("u003"));
  const RunResult gone = run(fleet + a + " --csv " + folder.file("gone.csv"));
  EXPECT_EQ(gone.code, 0);
  EXPECT_THAT(gone.err, HasSubstr("u003 is left out"));
  fs::rename(folder.file("u003"), folder.file("fleet/u003"));
  ASSERT_EQ(run(fleet + a + " --csv " + folder.file("back.csv")).code, 0);
  EXPECT_EQ(slurp(folder.file("back.csv")), slurp(folder.file("b.csv")));

  fs::rename(folder.file("fleet/u004/pairs.csv"), folder.file("pairs.csv"));
  ASSERT_EQ(run(fleet + folder.file("c.db") + " --csv " + folder.file("c.csv")).code, 0);
  EXPECT_THAT(slurp(folder.file("c.csv")), HasSubstr("pairs.csv: no such file"));
  fs::rename(folder.file("pairs.csv"), folder.file("fleet/u004/pairs.csv"));
  ASSERT_EQ(run(fleet + folder.file("c.db") + " --csv " + folder.file("c.csv")).code, 0);
  EXPECT_EQ(slurp(folder.file("c.csv")), slurp(folder.file("b.csv")));
}

TEST(Faults, AStudyOutlivesAFullDiskAndAnInterrupt) {
  const TemporaryFolder folder;
  const std::string study = "study " + study_file(folder, 700) + " -o ", out = folder.file("out");
  const RunResult full = run(study + out, "", "ulimit -f 24;");
  EXPECT_EQ(full.code, 2);
  EXPECT_THAT(full.err, HasSubstr("cannot be written"));
  EXPECT_EQ(count_of(full.err, "\n"), 1) << full.err;
  run_and_signal(study + out + " --resume", SIGINT, std::chrono::milliseconds(150));
  ASSERT_EQ(run(study + out + " --resume").code, 0);
  ASSERT_EQ(run(study + folder.file("whole")).code, 0);
  EXPECT_EQ(slurp(out + "/results.csv"), slurp(folder.file("whole/results.csv")));
}

TEST(Faults, AStreamOutlivesAFullDiskAndAKill) {
  const TemporaryFolder folder;
  std::string stream = "true_m,reading_m\n";
  Random random(seed_from("Faults.AStream"));
  for (int i = 0; i < 20000; ++i) {
    const double d = random.uniform(0.5, 4.0), f = 0.05 + 0.9 * d;
    stream += fmt::format("{:.5f},{:.5f}\n", d, random.normal(f, 0.01 * f * f));
  }
  folder.write("stream.csv", stream);
  const auto track = [&](const std::string& name) {
    return "track " + folder.file("stream.csv") + " --order 1 --every 500 --state " +
           folder.file(name + ".json") + " -o " + folder.file(name + ".csv");
  };
  const RunResult full = run(track("a"), "", "ulimit -f 200;");
  EXPECT_EQ(full.code, 2);
  EXPECT_THAT(full.err, HasSubstr("a.csv: cannot be written"));
  run_and_signal(track("a"), SIGKILL, std::chrono::milliseconds(60));
  run_and_signal(track("a"), SIGINT, std::chrono::milliseconds(60));
  ASSERT_EQ(run(track("a")).code, 0);
  ASSERT_EQ(run(track("b")).code, 0);
  EXPECT_EQ(slurp(folder.file("a.csv")), slurp(folder.file("b.csv")));
  EXPECT_EQ(count_of(slurp(folder.file("a.csv")), "\n"), 20001);
}

TEST(Faults, AProofOutlivesAFullDiskAKillAndAnInterrupt) {
  const TemporaryFolder folder;
  const std::string a = folder.file("a.csv");
  const RunResult full = run(kProof + a, "", "ulimit -f 1;");
  EXPECT_EQ(full.code, 2);
  EXPECT_THAT(full.err, HasSubstr("a.csv: cannot be written"));
  EXPECT_TRUE(!fs::exists(a) || slurp(a).ends_with("\n"));
  run_and_signal(kProof + a + " --resume", SIGKILL, std::chrono::milliseconds(700));
  run_and_signal(kProof + a + " --resume", SIGINT, std::chrono::milliseconds(700));
  ASSERT_EQ(run(kProof + a + " --resume").code, 0);
  ASSERT_EQ(run(kProof + folder.file("b.csv")).code, 0);
  EXPECT_EQ(answers_in(a), answers_in(folder.file("b.csv")));
}

/// Processes that this one started.
std::vector<pid_t> children_of(pid_t parent) {
  std::vector<pid_t> found;
  std::istringstream words(slurp(fmt::format("/proc/{0}/task/{0}/children", parent)));
  for (pid_t child; words >> child;) found.push_back(child);
  return found;
}

TEST(Faults, ALostRankEndsTheStudyAndItGoesOn) {
  const fs::path beside = fs::path(RANGECAL_BINARY).parent_path() / "rangecal-mpi";
  if (!fs::exists(beside)) GTEST_SKIP() << "built without MPI: " << beside << " is missing";
  const TemporaryFolder folder;
  const std::string study = study_file(folder, 1400), out = folder.file("out");
  const pid_t mpirun = ::fork();
  if (mpirun == 0) {
    ::setenv("OMPI_ALLOW_RUN_AS_ROOT", "1", 1);
    ::setenv("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1", 1);
    const std::string command =
        std::string("exec mpirun --oversubscribe --mca btl self,tcp --mca btl_tcp_if_include lo -n 3 ") +
        RANGECAL_BINARY + " study " + study + " -o " + out + " > /dev/null 2>&1";
    ::execl("/bin/sh", "sh", "-c", command.c_str(), nullptr);
    ::_exit(99);
  }
  for (int i = 0; i < 600 && count_of(slurp(out + "/journal.txt"), "\n") < 20; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  const std::vector<pid_t> ranks = children_of(mpirun);
  ASSERT_EQ(ranks.size(), 3u);
  ::kill(ranks.back(), SIGKILL);
  int status = 0;
  ::waitpid(mpirun, &status, 0);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) != 0);
  const RunResult more = run("study " + study + " -o " + out + " --resume");
  ASSERT_EQ(more.code, 0) << more.err;
  ASSERT_EQ(run("study " + study + " -o " + folder.file("whole")).code, 0);
  EXPECT_EQ(slurp(out + "/results.csv"), slurp(folder.file("whole/results.csv")));
}

}  // namespace
}  // namespace rangecal::test
