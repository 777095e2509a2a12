// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <string>
#include <utility>

#include "apps/fleet_recordings.hpp"
#include "apps/run_binary.hpp"
#include "fleet/database.hpp"

namespace rangecal::test {
namespace {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

const std::string fleet_options = " --order 1 --diagnose 0 -o ";

RunResult run_fleet_of(const std::string& inputs, const std::string& file, const std::string& csv = "") {
  return run("fleet " + inputs + fleet_options + file + (csv.empty() ? "" : " --csv " + csv));
}

/// As earlier versions left a file: without a word of how its units were fitted.
void forget_version(const std::string& file) {
  app::Database(file).execute("DELETE FROM meta WHERE key = 'fit'");
}

TEST(FleetInputs, ChangedRecordingsAreFittedAnew) {
  const TemporaryFolder folder;
  write_fleet(folder, 10, 60);
  const std::string fleet = folder.file("fleet"), db = folder.file("a.db"), csv = folder.file("a.csv"),
                    pairs = folder.file("fleet/u004/pairs.csv");
  ASSERT_EQ(run_fleet_of(fleet, db, csv).code, 0);
  const std::string before = slurp(csv);
  // another time, the same readings
  fs::last_write_time(pairs, fs::last_write_time(pairs) + std::chrono::hours(1));
  EXPECT_THAT(run_fleet_of(fleet, db, csv).out, HasSubstr("10 were there already\n"));
  EXPECT_EQ(slurp(csv), before);
  // one digit: as many bytes
  std::string text = slurp(pairs);
  text[text.find(',', 20) + 3] ^= 1;
  const auto time = fs::last_write_time(pairs);
  folder.write("fleet/u004/pairs.csv", text);
  fs::last_write_time(pairs, time + std::chrono::seconds(1));
  EXPECT_THAT(run_fleet_of(fleet, db, csv).out, HasSubstr("9 were there already, 1 changed and fitted anew"));
  EXPECT_NE(slurp(csv), before);
  ASSERT_EQ(run_fleet_of(fleet, folder.file("b.db"), folder.file("b.csv")).code, 0);
  EXPECT_EQ(slurp(csv), slurp(folder.file("b.csv")));
  EXPECT_THAT(run_fleet_of(fleet, db).out, HasSubstr("10 were there already\n"));
}

TEST(FleetInputs, WhatAReaderHasToSayStandsWithItsUnit) {
  const TemporaryFolder folder;
  write_fleet(folder, 10, 60);
  const std::string fleet = folder.file("fleet"), db = folder.file("a.db"), csv = folder.file("a.csv");
  std::string text = slurp(folder.file("fleet/u004/pairs.csv")), noted;
  for (std::size_t row = 0, at = 0; at < text.size(); ++row) {
    const std::size_t end = text.find('\n', at);
    noted += text.substr(at, end - at) + (row == 0 ? ",weather" : row % 2 ? ",rain" : ",sun") + "\n";
    at = end + 1;
  }
  folder.write("fleet/u004/pairs.csv", noted);
  ASSERT_EQ(run_fleet_of(fleet, db, csv).code, 0);
  EXPECT_EQ(app::Database(db).count("SELECT count(*) FROM units WHERE notes LIKE '%weather%'"), 1);
  EXPECT_EQ(app::Database(db).count(
                "SELECT count(*) FROM units WHERE name LIKE '%u004' AND notes LIKE '%weather%'"),
            1);
  EXPECT_THAT(slurp(csv), HasSubstr("weather"));
  EXPECT_THAT(slurp(csv).substr(0, slurp(csv).find('\n')), ::testing::EndsWith(",notes"));
}

TEST(FleetInputs, AUnitThatIsGoneKeepsItsRow) {
  const TemporaryFolder folder;
  write_fleet(folder, 10, 60);
  const std::string fleet = folder.file("fleet"), db = folder.file("a.db");
  ASSERT_EQ(run_fleet_of(fleet, db, folder.file("a.csv")).code, 0);
  fs::rename(folder.file("fleet/u004"), folder.file("u004"));
  const RunResult gone = run_fleet_of(fleet, db, folder.file("b.csv"));
  EXPECT_THAT(gone.out, HasSubstr("10 in"));
  EXPECT_THAT(gone.err, HasSubstr("u004 is gone from where it was read: what was found stands"));
  EXPECT_EQ(slurp(folder.file("a.csv")), slurp(folder.file("b.csv")));
}

TEST(FleetInputs, OneSensorUnderTwoPathsIsOne) {
  const TemporaryFolder folder;
  write_fleet(folder, 10, 60);
  fs::create_directories(folder.file("elsewhere"));
  fs::create_directory_symlink(folder.file("fleet"), folder.file("link"));
  const std::string whole = folder.file("fleet"), db = folder.file("a.db"),
                    here = "cd " + folder.path() + " &&", there = "cd " + folder.file("elsewhere") + " &&";
  const RunResult both =
      run("fleet fleet " + whole + " ./fleet/ link fleet/u003" + fleet_options + db, "", here);
  EXPECT_THAT(both.out, HasSubstr("10 in")) << both.err;
  for (const auto& [place, spelling] :
       {std::pair{here, whole}, {there, whole}, {there, std::string("../fleet")}}) {
    const RunResult again = run("fleet " + spelling + fleet_options + db, "", place);
    EXPECT_THAT(again.out, HasSubstr("10 in")) << spelling << again.err;
    EXPECT_THAT(again.out, HasSubstr("10 were there already\n")) << spelling << again.err;
    EXPECT_EQ(again.err, "");
  }
  // another folder of the same relative name holds other sensors
  fs::copy(whole, folder.file("elsewhere/fleet"), fs::copy_options::recursive);
  EXPECT_THAT(run("fleet fleet" + fleet_options + db, "", there).out, HasSubstr("20 in"));
  // shards that spell it differently
  const std::string first = folder.file("1"), second = folder.file("2");
  ASSERT_EQ(run("fleet fleet --shard 1/2" + fleet_options + first, "", here).code, 0);
  ASSERT_EQ(run("fleet " + whole + " --shard 2/2" + fleet_options + second).code, 0);
  const RunResult merged =
      run("fleet --merge " + first + " " + second + fleet_options + folder.file("m"), "", here);
  EXPECT_THAT(merged.out, HasSubstr("10 in")) << merged.err;
  EXPECT_THAT(merged.out, HasSubstr("10 were there already\n"));
}

TEST(FleetInputs, FilesOfEarlierVersionsGoOn) {
  const TemporaryFolder folder;
  write_fleet(folder, 10, 60);
  const std::string fleet = folder.file("fleet"), db = folder.file("a.db"), shard = folder.file("1");
  ASSERT_EQ(run_fleet_of(fleet, db, folder.file("a.csv")).code, 0);
  ASSERT_EQ(run_fleet_of(fleet + " --shard 1/1", shard).code, 0);
  for (const std::string& file : {db, shard})
    app::Database(file).execute(
        "DROP INDEX identities; ALTER TABLE inputs DROP COLUMN identity;"
        "ALTER TABLE units DROP COLUMN stamp; ALTER TABLE units DROP COLUMN contents;"
        "ALTER TABLE units DROP COLUMN notes; ALTER TABLE units DROP COLUMN noise_shape;"
        "DELETE FROM meta WHERE key = 'noise_shape'");
  // what their files were is not known: they are fitted anew, once
  const RunResult once = run_fleet_of(fleet, db, folder.file("b.csv"));
  EXPECT_THAT(once.out, HasSubstr("0 were there already, 10 fitted anew (by another version before)\n"))
      << once.err;
  EXPECT_EQ(slurp(folder.file("a.csv")), slurp(folder.file("b.csv")));
  EXPECT_THAT(run_fleet_of(fleet, db).out, HasSubstr("10 were there already\n"));
  forget_version(db);
  EXPECT_THAT(run_fleet_of(fleet, db).out,
              HasSubstr("0 were there already, 10 fitted anew (by another version before)\n"));
  EXPECT_THAT(run_fleet_of(fleet, db).out, HasSubstr("10 were there already\n"));
  const RunResult merged = run_fleet_of("--merge " + shard, folder.file("m.db"), folder.file("m.csv"));
  EXPECT_THAT(merged.out, HasSubstr("10 in")) << merged.err;
  EXPECT_EQ(slurp(folder.file("m.csv")), slurp(folder.file("b.csv")));
}

TEST(FleetInputs, WhatIsGoneAndOfAnEarlierVersionIsSaid) {
  const TemporaryFolder folder;
  write_fleet(folder, 10, 60);
  const std::string fleet = folder.file("fleet"), db = folder.file("a.db");
  ASSERT_EQ(run_fleet_of(fleet, db).code, 0);
  forget_version(db);
  fs::rename(folder.file("fleet/u004"), folder.file("u004"));
  const std::string unrenewed = " fitted by an earlier version and cannot be fitted anew\n";
  const RunResult one = run_fleet_of(fleet, db);
  EXPECT_THAT(one.out, HasSubstr("1 were there already, 9 fitted anew (by another version before)\n"));
  EXPECT_THAT(one.err,
              HasSubstr("u004 is gone from where it was read: what was found stands; it was" + unrenewed));
  // not only once: its row is still what it was
  fs::rename(folder.file("fleet/u005"), folder.file("u005"));
  const RunResult two = run_fleet_of(fleet, db);
  EXPECT_THAT(two.out, HasSubstr("10 were there already\n"));
  EXPECT_THAT(two.err, HasSubstr("2 units, " + fleet +
                                 "/u004 the first of them, are gone from where they were read: "
                                 "what was found stands; 1 of them was" +
                                 unrenewed));
  forget_version(db);
  EXPECT_THAT(run_fleet_of(fleet, db).err, HasSubstr("; 2 of them were" + unrenewed));
  // back again, it is fitted anew
  fs::rename(folder.file("u004"), folder.file("fleet/u004"));
  fs::rename(folder.file("u005"), folder.file("fleet/u005"));
  const RunResult back = run_fleet_of(fleet, db);
  EXPECT_THAT(back.out, HasSubstr("8 were there already, 2 fitted anew (by another version before)\n"));
  EXPECT_EQ(back.err, "");
}

TEST(FleetInputs, WritesIntoNothingButAFleet) {
  const TemporaryFolder folder;
  write_fleet(folder, 10, 60);
  const std::string fleet = folder.file("fleet"), one = folder.file("one");
  ASSERT_EQ(run_fleet_of(fleet, one).code, 0);
  const std::string before = slurp(one);
  const RunResult twice = run_fleet_of(fleet, one, folder.file("./one"));
  EXPECT_EQ(twice.code, 2);
  EXPECT_THAT(twice.err, HasSubstr("is named as the file of two results"));
  EXPECT_EQ(slurp(one), before);

  // with its tables under other names it is some other program's
  std::string other = before;
  for (std::size_t at = 0; (at = other.find("units", at)) != std::string::npos;)
    other.replace(at, 5, "stock");
  folder.write("other.db", other);
  const RunResult refused = run_fleet_of(fleet, folder.file("other.db"));
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, HasSubstr("is no file of 'rangecal fleet'"));
  EXPECT_EQ(slurp(folder.file("other.db")), other);
  EXPECT_EQ(run_fleet_of("--merge " + folder.file("other.db"), folder.file("b.db")).code, 2);

  folder.write("empty.db", "");
  EXPECT_EQ(run_fleet_of(fleet, folder.file("empty.db")).code, 0);
}

TEST(FleetInputs, EveryUnitIsInOneCount) {
  const TemporaryFolder folder;
  write_fleet(folder, 14, 60);  // u011 has 3 readings, u013 cannot be read
  folder.write("fleet/u012/pairs.csv", "true_m,reading_m\n1,1.1\n2,2.2\n");
  const RunResult some = run_fleet_of(folder.file("fleet"), folder.file("a.db"));
  EXPECT_THAT(some.out, HasSubstr("14 in"));
  EXPECT_THAT(some.out, HasSubstr("11 fitted, 1 unreadable, 2 with too few readings; 0 were there already"));
  // also where there are too few of them for a population
  for (int u = 0; u < 9; ++u) fs::remove_all(folder.file("fleet/u00" + std::to_string(u)));
  const RunResult none = run_fleet_of(folder.file("fleet"), folder.file("b.db"));
  EXPECT_EQ(none.code, 1);
  EXPECT_THAT(none.out, HasSubstr("2 fitted, 1 unreadable, 2 with too few readings; 0 were there already"));
}

}  // namespace
}  // namespace rangecal::test
