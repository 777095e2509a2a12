// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <map>
#include <sstream>
#include <string>
#include <thread>

#include "apps/fleet_recordings.hpp"
#include "apps/ranks.hpp"
#include "apps/run_binary.hpp"
#include "fleet/database.hpp"

namespace rangecal::test {
namespace {

using ::testing::HasSubstr;

/// What is said of each odd unit, all its oddities together.
std::map<std::string, std::string> explanations_in(const std::string& file) {
  app::Database database(file);
  app::Statement rows = database.prepare("SELECT name, explanation FROM oddities ORDER BY name, what");
  std::map<std::string, std::string> said;
  while (rows.step()) {
    std::string& text = said[rows.text(0)];
    text += (text.empty() ? "" : "\n") + rows.text(1);
  }
  return said;
}

TEST(FleetCommand, FindsThePopulationAndTheOddUnits) {
  const TemporaryFolder folder;
  write_fleet(folder, 60, 200);
  const std::string fleet = folder.file("fleet"), order = " --order 1 -o ";
  const RunResult result = run("fleet " + fleet + order + folder.file("a.db") + " --csv " +
                               folder.file("a.csv") + " --threads 1 --diagnose 2");
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("60 in"));
  EXPECT_THAT(result.out, HasSubstr("58 fitted, 1 unreadable, 1 with too few readings"));
  EXPECT_THAT(result.out, HasSubstr("1 unit has too few"));
  EXPECT_THAT(result.out, HasSubstr("Odd units    1;"));
  const std::string csv = slurp(folder.file("a.csv"));
  EXPECT_EQ(count_of(csv, "\n"), 61);
  EXPECT_EQ(count_of(csv, "few readings and population"), 1);
  EXPECT_THAT(csv, HasSubstr("pairs.csv, row 202"));
  // u007 is 0.4 m off where the fleet scatters by 0.02 m
  const auto odd = explanations_in(folder.file("a.db"));
  ASSERT_EQ(odd.size(), 1u);
  const std::string said = odd.at(folder.file("fleet/u007"));
  const std::string start = "calibration differs from the population's: alpha_0 +";
  const std::size_t at = said.find(start);
  ASSERT_NE(at, std::string::npos) << said;
  EXPECT_NEAR(std::stod(said.substr(at + start.size())), 400.0, 100.0);  // mm; 5 times the scatter
  EXPECT_THAT(said, ::testing::ContainsRegex(" mm \\(\\+[0-9.]+ sd\\)"));

  // the same rows on other threads, from shards, and in a second run over a file that is there already
  ASSERT_EQ(
      run("fleet " + fleet + order + folder.file("b.db") + " --csv " + folder.file("b.csv") + " --threads 4")
          .code,
      0);
  EXPECT_EQ(slurp(folder.file("b.csv")), csv);
  for (const std::string i : {"1", "2", "3"})
    ASSERT_EQ(run("fleet " + fleet + order + folder.file("s" + i) + " --shard " + i + "/3").code, 0);
  ASSERT_EQ(run("fleet --merge " + folder.file("s3") + " " + folder.file("s1") + " " + folder.file("s2") +
                order + folder.file("c.db") + " --csv " + folder.file("c.csv"))
                .code,
            0);
  EXPECT_EQ(slurp(folder.file("c.csv")), csv);
  const RunResult again =
      run("fleet " + fleet + order + folder.file("b.db") + " --csv " + folder.file("b.csv"));
  EXPECT_THAT(again.out, HasSubstr("60 were there already"));
  EXPECT_EQ(slurp(folder.file("b.csv")), csv);
}

/// Pairs of a curve like the fleet's: offset and slope, noise sigma f^2, errors that follow the one before by `correlation`.
std::string pairs_of(double offset, double slope, double correlation, std::uint64_t seed) {
  Random random(seed_from("fleet odd", {seed}));
  std::string text = "true_m,reading_m\n";
  double error = random.normal();
  for (int i = 0; i < 200; ++i) {
    const double d = random.uniform(0.5, 4.0), f = offset + slope * d;
    text += fmt::format("{:.5f},{:.5f}\n", d, f + 0.01 * f * f * error);
    error = correlation * error + std::sqrt(1.0 - correlation * correlation) * random.normal();
  }
  return text;
}

TEST(FleetCommand, TakesOutliersOfItsUnitsAlong) {
  // Every unit has 5 % of its readings late by 0.1 m and more; u011, of three readings, has one that is 0.6 m late.
  const TemporaryFolder folder;
  write_fleet(folder, 12, 200);
  for (int u = 0; u < 12; ++u) {
    Random random(seed_from("fleet outliers", {static_cast<std::uint64_t>(u)}));
    const std::string path = fmt::format("fleet/u{:03}/pairs.csv", u);
    std::istringstream lines(slurp(folder.file(path)));
    std::string line, table;
    for (int i = -1; std::getline(lines, line); ++i) {
      const std::size_t comma = line.find(',');
      const bool late = u == 11 ? i == 1 : i >= 0 && random.uniform() < 0.05;
      const double by = u == 11 ? 0.6 : 0.1 - 0.3 * std::log(1.0 - random.uniform());
      table += late
                   ? fmt::format("{},{:.5f}\n", line.substr(0, comma), std::stod(line.substr(comma + 1)) + by)
                   : line + "\n";
    }
    folder.write(path, table);
  }
  const std::string db = folder.file("a.db");
  const std::string options = " --order 1 --diagnose 0 -o " + db;
  ASSERT_EQ(run("fleet " + folder.file("fleet") + options).code, 0);
  app::Database database(db);
  EXPECT_GE(database.count("SELECT count(*) FROM units WHERE noise_shape LIKE '%outlier_share%'"), 9);
  EXPECT_EQ(database.count("SELECT count(*) FROM oddities WHERE what LIKE 'tails%'"), 0);
  app::Statement few = database.prepare(
      "SELECT alpha_0, alpha_1, (SELECT mean FROM population WHERE parameter = 'log_sigma') FROM posteriors"
      " WHERE source LIKE 'few%'");
  ASSERT_TRUE(few.step());
  // The late reading does not count: the unit's curve stays within the scatter of the others, log sigma at 0.01.
  EXPECT_NEAR(*few.number(0) + 2.0 * *few.number(1), 0.05 + 2.0 * 0.9, 0.25);
  EXPECT_NEAR(*few.number(2), std::log(0.01), 0.15);
}

TEST(FleetCommand, SaysWhatIsOddWhereTheDiagnosisFindsNothing) {
  const TemporaryFolder folder;
  write_fleet(folder, 40, 200);
  folder.write("fleet/u005/pairs.csv", pairs_of(0.05, 0.9, 0.7, 1));  // neighbours depend on each other
  folder.write("fleet/u006/pairs.csv", pairs_of(0.05, 1.2, 0.0, 2));  // another slope, nothing else
  const std::string db = folder.file("a.db");
  const RunResult result = run("fleet " + folder.file("fleet") + " --order 1 -o " + db);
  ASSERT_EQ(result.code, 0) << result.err;
  auto said = explanations_in(db);
  const std::string follows = said[folder.file("fleet/u005")], steep = said[folder.file("fleet/u006")];
  EXPECT_THAT(follows, HasSubstr("neighbouring readings depend on each other: correlation +0."));
  EXPECT_THAT(follows, HasSubstr("; physics within its own recording: Explained by autocorrelated_noise"));
  EXPECT_THAT(steep, HasSubstr("calibration differs from the population's: alpha_1 +0."));  // 0.3, no unit
  EXPECT_THAT(steep, HasSubstr(" sd)"));
  EXPECT_THAT(steep, HasSubstr("; physics within its own recording: none found"));
  for (const auto& [name, text] : said) EXPECT_THAT(text, ::testing::Not(HasSubstr("No mismatch"))) << name;
}

TEST(FleetCommand, RanksGiveTheRowsOfOneProcess) {
  if (!has_ranks()) GTEST_SKIP() << "built without MPI";
  const TemporaryFolder folder;
  write_fleet(folder, 40, 60);
  const std::string fleet = "fleet " + folder.file("fleet") + " --order 1 --diagnose 0";
  ASSERT_EQ(run(fleet + " -o " + folder.file("one.db") + " --csv " + folder.file("one.csv")).code, 0);
  const std::string one = slurp(folder.file("one.csv"));
  for (const int ranks : {2, 3}) {
    const std::string db = folder.file(fmt::format("{}.db", ranks)),
                      csv = folder.file(fmt::format("{}.csv", ranks));
    if (ranks == 3) {  // as after a kill of four ranks: one had fitted a part
      ASSERT_EQ(run(fleet + " -o " + db + ".part-4 --shard 1/3").code, 0);
      folder.write("3.db.part-4-journal", "");  // killed as it began to keep the next
    }
    const RunResult result = run(fleet + " -o " + db + " --csv " + csv, "", on_ranks(ranks));
    ASSERT_EQ(result.code, 0) << result.err;
    EXPECT_EQ(slurp(csv), one) << ranks << " ranks";
    EXPECT_THAT(result.out, HasSubstr("40 in"));
    EXPECT_EQ(count_of(result.out, "Population"), 1);
    EXPECT_EQ(files_beside(db), 0);
    const RunResult again = run(fleet + " -o " + db + " --csv " + csv, "", on_ranks(ranks));
    EXPECT_THAT(again.out, HasSubstr("40 were there already"));
    EXPECT_EQ(slurp(csv), one);
  }
  const RunResult wrong =
      run("fleet " + folder.file("nowhere") + " -o " + folder.file("x.db"), "", on_ranks(2));
  EXPECT_EQ(wrong.code, 2);
  EXPECT_EQ(count_of(wrong.err, "rangecal: "), 1) << wrong.err;
  EXPECT_FALSE(std::filesystem::exists(folder.file("x.db")));
  EXPECT_EQ(files_beside(folder.file("x.db")), 0);
}

// Two of sixteen ranks are killed while they work, rank 0 one of them: the others take their units.
TEST(FleetCommand, RanksThatDieLoseNothing) {
  if (!has_ranks() || !ranks_may_die()) GTEST_SKIP() << "no MPI here that lets the other ranks live";
  const TemporaryFolder folder;
  write_fleet(folder, 300, 1500);
  const std::string fleet = "fleet " + folder.file("fleet") + " --order 1 --diagnose 0",
                    db = folder.file("a.db"), csv = folder.file("a.csv");
  const RunResult result = run_and_kill_ranks(fleet + " -o " + db + " --csv " + csv, db, 16, {0, 5});
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("300 in"));
  EXPECT_EQ(files_beside(db), 0);
  ASSERT_EQ(run(fleet + " -o " + folder.file("one.db") + " --csv " + folder.file("one.csv")).code, 0);
  EXPECT_EQ(slurp(csv), slurp(folder.file("one.csv")));
}

TEST(FleetCommand, GoesOnAfterAKill) {
  const TemporaryFolder folder;
  write_fleet(folder, 600, 60);  // three transactions of units
  const std::string fleet = folder.file("fleet"), file = folder.file("killed.db");
  for (int attempt = 0; attempt < 4; ++attempt) {  // killed wherever it happens to be
    const pid_t child = ::fork();
    if (child == 0) {
      std::freopen("/dev/null", "w", stdout);
      ::execl(RANGECAL_BINARY, RANGECAL_BINARY, "fleet", fleet.c_str(), "--order", "1", "-o", file.c_str(),
              "--diagnose", "0", nullptr);
      ::_exit(99);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(60 * (attempt + 1)));
    ::kill(child, SIGKILL);
    int status = 0;
    ::waitpid(child, &status, 0);
  }
  const std::string csv = folder.file("killed.csv"), whole = folder.file("whole.csv");
  ASSERT_EQ(run("fleet " + fleet + " --order 1 -o " + file + " --csv " + csv + " --diagnose 0").code, 0);
  ASSERT_EQ(
      run("fleet " + fleet + " --order 1 -o " + folder.file("whole.db") + " --csv " + whole + " --diagnose 0")
          .code,
      0);
  EXPECT_EQ(slurp(csv), slurp(whole));
  EXPECT_EQ(count_of(slurp(csv), "\n"), 601);
}

TEST(FleetCommand, RefusesWhatDoesNotFit) {
  const TemporaryFolder folder;
  write_fleet(folder, 3, 30);
  const std::string fleet = folder.file("fleet");
  const RunResult few = run("fleet " + fleet + " --order 1 -o " + folder.file("a.db"));
  EXPECT_EQ(few.code, 1);  // three units make no population of three unknowns
  EXPECT_THAT(few.out, HasSubstr("too_few_data"));
  EXPECT_EQ(run("fleet " + fleet + " --order 2 -o " + folder.file("a.db")).code, 2);  // another order
  EXPECT_EQ(run("fleet " + folder.path() + " -o " + folder.file("b.db")).code, 2);    // no recordings
  EXPECT_EQ(run("fleet -o " + folder.file("b.db")).code, 2);
  EXPECT_EQ(run("fleet " + fleet + " -o " + folder.file("b.db") + " --shard 0/3").code, 2);
  EXPECT_EQ(run("fleet " + fleet + " -o " + folder.file("b.db") + " --shard 4/3").code, 2);
  EXPECT_EQ(run("fleet --merge /nowhere -o " + folder.file("b.db")).code, 2);
  folder.write("text.db", "this is no data base, but long enough to be looked at as one");
  EXPECT_EQ(run("fleet " + fleet + " -o " + folder.file("text.db")).code, 2);
}

}  // namespace
}  // namespace rangecal::test
