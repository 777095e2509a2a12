// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <string>
#include <thread>

#include "apps/run_binary.hpp"
#include "rangecal/core/random.hpp"

namespace {

using rangecal::test::count_of;
using rangecal::test::run;
using rangecal::test::RunResult;
using rangecal::test::slurp;
using rangecal::test::TemporaryFolder;

/// A study of 2 points in pieces of 7 repeats, the last piece shorter.
std::string study_text(int repeats,
                       const std::string& estimators = "[closed-form, approximate, full, marginal]",
                       const std::string& name = "test") {
  return "format: rangecal-study/1\nname: " + name + "\nscene: " + RANGECAL_SOURCE_DIR +
         "/notebooks_data/studies/scenes/2021.yaml\ngrid:\n"
         "  - {parameter: landmarks, values: [5]}\n"
         "  - {parameter: sigma_theta_deg, values: [0.5, 2]}\n"
         "repeats: " +
         std::to_string(repeats) + "\npiece: 7\nestimators: " + estimators +
         "\nmeasures: [bias, variance, rmse, rmse_over_bound, mse_ratio, sigmas, coverage, order, failures]\n";
}

/// The study's results.csv when run to its end at once.
std::string whole_run(const TemporaryFolder& folder, const std::string& options = "--threads 1") {
  const std::string out = folder.file("whole" + std::to_string(std::hash<std::string>{}(options)));
  const RunResult result = run("study " + folder.file("study.yaml") + " -o " + out + " " + options);
  EXPECT_EQ(result.code, 0) << result.err;
  return slurp(out + "/results.csv");
}

/// The units that the journals of a folder hold, as "point piece"; every line must be whole but torn ones.
std::multiset<std::string> units(const std::string& folder) {
  std::multiset<std::string> found;
  std::ifstream stream(folder + "/journal.txt");
  for (std::string line; std::getline(stream, line);) {
    std::istringstream words(line);
    std::string mark, point, piece;
    if (words >> mark >> point >> piece && mark == "u" && !stream.eof()) found.insert(point + " " + piece);
  }
  return found;
}

/// Starts `rangecal study` in a process group of its own and kills it after the delay, whatever it is doing.
void run_and_kill(const std::string& study, const std::string& out, std::chrono::microseconds delay) {
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    if (!std::freopen("/dev/null", "w", stdout)) ::_exit(9);
    ::execl(RANGECAL_BINARY, RANGECAL_BINARY, "study", study.c_str(), "-o", out.c_str(), "--resume",
            "--threads", "2", nullptr);
    ::_exit(9);
  }
  std::this_thread::sleep_for(delay);
  ::kill(child, SIGKILL);
  int status = 0;
  ::waitpid(child, &status, 0);
}

TEST(StudyCommand, APageMayNotBeNamedAsAJournal) {
  const TemporaryFolder folder;
  std::ofstream(folder.file("study.yaml")) << study_text(7);
  for (const char* page : {"journal.txt", "journal-2-of-4.txt"}) {
    const RunResult result = run("study " + folder.file("study.yaml") + " -o " + folder.file("out") +
                                 " --report " + folder.file(std::string("out/") + page));
    EXPECT_EQ(result.code, 2) << page;
    EXPECT_EQ(count_of(result.err, "\n"), 1) << result.err;
    EXPECT_FALSE(std::filesystem::exists(folder.file("out"))) << page;
  }
}

TEST(Study, OneThreadEightThreadsAndShardsGiveTheSameBytes) {
  const TemporaryFolder folder;
  folder.write("study.yaml", study_text(30));
  const std::string one = whole_run(folder);
  EXPECT_EQ(count_of(one, "\n"), 1 + 2 * 4);
  EXPECT_EQ(whole_run(folder, "--threads 8"), one);

  const std::string shared = folder.file("shared");
  for (const char* shard : {"3/3", "1/3", "2/3"}) {
    const RunResult part = run("study " + folder.file("study.yaml") + " -o " + shared + " --shard " + shard);
    ASSERT_EQ(part.code, 0) << part.err;
    ASSERT_EQ(run("study " + folder.file("study.yaml") + " -o " + folder.file(std::string("own") + shard[0]) +
                  " --shard " + shard)
                  .code,
              0);
  }
  const RunResult joined = run("study " + folder.file("study.yaml") + " -o " + shared + " --resume");
  EXPECT_NE(joined.out.find("(0 run, 60 known before)"), std::string::npos) << joined.out << joined.err;
  EXPECT_EQ(slurp(shared + "/results.csv"), one);

  // A shard is missing: what it would have done is run now.
  const RunResult merged = run("study " + folder.file("study.yaml") + " -o " + folder.file("merged") +
                               " --merge " + folder.file("own1") + " " + folder.file("own3"));
  EXPECT_EQ(merged.code, 0) << merged.err;
  EXPECT_EQ(slurp(folder.file("merged") + "/results.csv"), one);
}

TEST(Study, MpiRanksGiveTheSameBytes) {
  const std::filesystem::path beside = std::filesystem::path(RANGECAL_BINARY).parent_path() / "rangecal-mpi";
  if (!std::filesystem::exists(beside)) GTEST_SKIP() << "built without MPI: " << beside << " is missing";
  const TemporaryFolder folder;
  folder.write("study.yaml", study_text(30));
  const std::string one = whole_run(folder);
  const std::string mpirun =
      "OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 timeout 200 mpirun --oversubscribe --mca btl self,tcp "
      "--mca btl_tcp_if_include lo -n ";
  for (const std::string ranks : {"2", "4"}) {
    const std::string out = folder.file("ranks" + ranks);
    const RunResult result = run("study " + folder.file("study.yaml") + " -o " + out, "", mpirun + ranks);
    ASSERT_EQ(result.code, 0) << result.err;
    EXPECT_EQ(slurp(out + "/results.csv"), one) << ranks << " ranks";
    EXPECT_EQ(units(out).size(), 10u);  // each of the 2 x 5 pieces by one rank only
  }
  const RunResult wrong =
      run("study " + folder.file("nowhere.yaml") + " -o " + folder.file("x"), "", mpirun + "2");
  EXPECT_EQ(wrong.code, 2);
  EXPECT_EQ(count_of(wrong.err, "rangecal: "), 1) << wrong.err;
}

TEST(Study, KilledTwentyTimesLosesNothingWrittenAndRepeatsNothing) {
  const TemporaryFolder folder;
  folder.write("study.yaml", study_text(1500, "[closed-form, marginal]"));
  const std::string out = folder.file("killed");
  rangecal::Random random(rangecal::seed_from("Study.Killed", {0}));
  std::multiset<std::string> before;
  for (int kill = 0; kill < 20; ++kill) {
    run_and_kill(folder.file("study.yaml"), out, std::chrono::microseconds(1000 + random.index(90000)));
    const std::multiset<std::string> now = units(out);
    EXPECT_TRUE(std::includes(now.begin(), now.end(), before.begin(), before.end())) << "kill " << kill;
    if (std::filesystem::exists(out + "/results.csv")) {
      const std::string table = slurp(out + "/results.csv");
      EXPECT_EQ((count_of(table, "\n") - 1) % 2, 0) << "half a point in the table after kill " << kill;
      EXPECT_EQ(table.back(), '\n');
    }
    before = now;
  }
  const RunResult last = run("study " + folder.file("study.yaml") + " -o " + out + " --resume");
  ASSERT_EQ(last.code, 0) << last.err;
  EXPECT_EQ(slurp(out + "/results.csv"), whole_run(folder, "--threads 2"));
  const std::multiset<std::string> all = units(out);
  EXPECT_EQ(all.size(), 2u * 215u);  // 1500 repeats in pieces of 7
  EXPECT_EQ(std::set<std::string>(all.begin(), all.end()).size(), all.size()) << "a unit ran twice";
  for (const auto& entry : std::filesystem::directory_iterator(out))
    EXPECT_EQ(entry.path().filename().string().find("partial"), std::string::npos) << entry.path();
}

TEST(Study, DamagedLinesAreRunAgain) {
  const TemporaryFolder folder;
  folder.write("study.yaml", study_text(30, "[closed-form]"));
  const std::string one = whole_run(folder), out = folder.file("damaged");
  ASSERT_EQ(run("study " + folder.file("study.yaml") + " -o " + out).code, 0);
  std::string journal = slurp(out + "/journal.txt");
  journal[journal.size() / 2] = journal[journal.size() / 2] == '7' ? '8' : '7';
  std::ofstream(out + "/journal.txt", std::ios::binary) << journal.substr(0, journal.size() - 30);
  const RunResult again = run("study " + folder.file("study.yaml") + " -o " + out + " --resume");
  ASSERT_EQ(again.code, 0) << again.err;
  EXPECT_EQ(again.out.find("(0 run"), std::string::npos) << again.out;
  EXPECT_EQ(slurp(out + "/results.csv"), one);
}

TEST(Study, MoreRepeatsKeepWhatIsThere) {
  const TemporaryFolder folder;
  folder.write("study.yaml", study_text(14, "[closed-form]"));
  const std::string out = folder.file("grown");
  ASSERT_EQ(run("study " + folder.file("study.yaml") + " -o " + out).code, 0);
  folder.write("study.yaml", study_text(30, "[closed-form]"));
  const RunResult more = run("study " + folder.file("study.yaml") + " -o " + out + " --resume");
  EXPECT_NE(more.out.find("(32 run, 28 known before)"), std::string::npos) << more.out << more.err;
  EXPECT_EQ(slurp(out + "/results.csv"), whole_run(folder));
}

TEST(Study, WrongUseIsOneLineAndTouchesNothing) {
  const TemporaryFolder folder;
  folder.write("study.yaml", study_text(14, "[closed-form]"));
  const std::string study = "study " + folder.file("study.yaml"), out = folder.file("out");
  const auto refused = [&](const std::string& arguments, const std::string& says) {
    const RunResult result = run(arguments);
    EXPECT_EQ(result.code, 2) << arguments;
    EXPECT_EQ(count_of(result.err, "\n"), 1) << result.err;
    EXPECT_NE(result.err.find(says), std::string::npos) << result.err;
  };
  refused(study + " -o " + out + " --shard 3/2", "--shard 3/2");
  refused(study + " -o " + out + " --shard two", "--shard two");
  refused(study + " -o " + out + " --merge " + folder.file("none"), "holds no journal");
  refused("study " + folder.file("nowhere.yaml") + " -o " + out, "no such file");
  EXPECT_FALSE(std::filesystem::exists(out));
  ASSERT_EQ(run(study + " -o " + out).code, 0);
  refused(study + " -o " + out, "--resume");
  folder.write("study.yaml", study_text(14, "[approximate]"));
  refused(study + " -o " + out + " --resume", "another study");
}

}  // namespace
