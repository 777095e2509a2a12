// SPDX-License-Identifier: BSD-3-Clause
// rangecal diagnose --each
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "apps/fleet_recordings.hpp"
#include "apps/ranks.hpp"
#include "apps/run_binary.hpp"
#include "fleet/database.hpp"

namespace rangecal::test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

/// Every row but what depends on the clock.
std::vector<std::string> diagnosis_rows(const std::string& file) {
  app::Database database(file);
  app::Statement row = database.prepare("SELECT * FROM diagnoses ORDER BY name");
  std::vector<std::string> rows;
  while (row.step()) {
    std::string text;
    for (int c = 0; c < row.columns(); ++c)
      if (row.name(c) != "seconds") text += row.name(c) + "=" + row.text(c) + "\n";
    rows.push_back(text);
  }
  return rows;
}
std::string diagnosis_field(const std::string& file, const std::string& column, const std::string& name) {
  app::Database database(file);
  app::Statement row = database.prepare("SELECT " + column + " FROM diagnoses WHERE name = ?");
  row.bind(1, name);
  return row.step() ? row.text(0) : "there is no such row";
}

class EachCommand : public ::testing::Test {
 protected:
  void SetUp() override {
    std::filesystem::create_directories(folder.file("many"));
    for (const char* world : {"world-03", "world-04"})
      std::filesystem::copy(shipped(std::string("concealed/") + world),
                            folder.file(std::string("many/") + world));
    std::filesystem::create_directories(folder.file("many/broken"));
    folder.write("many/broken/recording.yaml", "format: rangecal/1\nkind: pairs\n");
    folder.write("many/broken/pairs.csv", "true_m,reading_m\n1,two\n");
  }
  RunResult each(const std::string& rest) const {
    return run("diagnose " + folder.file("many") + " --each " + rest);
  }
  std::string name(const std::string& world) const { return folder.file("many/" + world); }
  TemporaryFolder folder;
};

TEST_F(EachCommand, WritesARowForEveryRecordingAndAPage) {
  const std::string db = folder.file("a.db"), page = folder.file("a.html");
  const RunResult result = each(db + " --page " + page);
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(result.err, "");
  EXPECT_THAT(result.out, HasSubstr("3 recordings in " + db + ", 0 were there already"));
  EXPECT_THAT(result.out, HasSubstr("not diagnosed      1"));
  EXPECT_EQ(diagnosis_field(db, "verdict", name("world-03")), "no_mismatch");
  EXPECT_EQ(diagnosis_field(db, "names", name("world-03")), "");
  EXPECT_EQ(diagnosis_field(db, "heldout_change", name("world-03")), "");
  EXPECT_EQ(diagnosis_field(db, "verdict", name("world-04")), "explained");
  EXPECT_THAT(diagnosis_field(db, "names", name("world-04")), HasSubstr("beam_offset"));
  EXPECT_LT(std::stod(diagnosis_field(db, "nll_change", name("world-04"))), -50.0);
  EXPECT_LT(std::stod(diagnosis_field(db, "heldout_change", name("world-04"))), -50.0);
  EXPECT_GT(std::stod(diagnosis_field(db, "heldout_std", name("world-04"))), 0.0);
  const auto estimates = nlohmann::json::parse(diagnosis_field(db, "estimates", name("world-04")));
  EXPECT_LT(estimates.at("beam_offset.offset_m").at("std"), 0.01);
  EXPECT_EQ(diagnosis_field(db, "verdict", name("broken")), "");
  EXPECT_THAT(diagnosis_field(db, "reason", name("broken")),
              HasSubstr("pairs.csv, row 2, column 'reading_m'"));
  const std::string html = slurp(page);
  EXPECT_THAT(html, HasSubstr("beam_offset.offset_m"));
  EXPECT_THAT(html, HasSubstr("row 2, column"));
  EXPECT_LT(html.size(), 50000u);  // no charting library for a table

  // what the diagnosis itself says
  ASSERT_EQ(run("diagnose " + name("world-04") + " --json " + folder.file("d.json")).code, 0);
  const auto json = nlohmann::json::parse(slurp(folder.file("d.json")));
  EXPECT_EQ(diagnosis_field(db, "sentence", name("world-04")), json.at("sentence"));
  EXPECT_DOUBLE_EQ(std::stod(diagnosis_field(db, "nll_before", name("world-04"))),
                   json.at("baseline").at("nll"));
}

TEST_F(EachCommand, GoesOnInItsFile) {
  const std::string db = folder.file("a.db");
  ASSERT_EQ(each(db).code, 0);
  const auto rows = diagnosis_rows(db);
  folder.write("many/broken/pairs.csv", "true_m,reading_m\n1,1.01\n");  // may be read now
  const RunResult again = each(db + " --threads 1");
  EXPECT_THAT(again.out, HasSubstr("3 recordings in " + db + ", 2 were there already"));
  EXPECT_EQ(diagnosis_rows(db)[1], rows[1]);
  EXPECT_EQ(diagnosis_rows(db)[2], rows[2]);
  EXPECT_THAT(diagnosis_field(db, "reason", name("broken")), Not(HasSubstr("row 2")));
  const RunResult other = each(db + " --alarm-rate 0.1");
  EXPECT_EQ(other.code, 2);
  EXPECT_THAT(other.err, HasSubstr("was made with options alarm-rate 0.02"));
}

TEST_F(EachCommand, WrongInputIsOneLineAndLeavesNothingBehind) {
  const auto refused = [&](const std::string& arguments, const std::string& word) {
    const RunResult result = run("diagnose " + arguments);
    EXPECT_EQ(result.code, 2) << arguments;
    EXPECT_THAT(result.err, HasSubstr(word));
    EXPECT_EQ(count_of(result.err, "\n"), 1) << result.err;
    EXPECT_FALSE(std::filesystem::exists(folder.file("a.db")));
  };
  const std::string out = " --each " + folder.file("a.db");
  refused(folder.path() + "/nowhere" + out, "is no folder of a recording");
  refused(folder.file("many") + out + " --json " + folder.file("d.json"), "--json is of one diagnosis");
  refused(folder.file("many") + out + " --force no_such_effect", "no effect is called");
 refused(folder.file("many") + out + " --without label_swap", "found before the search");
  refused(folder.file("many") + " --page " + folder.file("a.html"), "--page and --threads are of --each");
  folder.write("text.db", "this is no data base, but long enough to be looked at as one");
  refused(folder.file("many") + " --each " + folder.file("text.db"), "text.db");
  write_fleet(folder, 3, 30);
  run("fleet " + folder.file("fleet") + " --order 1 --diagnose 0 -o " + folder.file("fleet.db"));
  refused(folder.file("many") + " --each " + folder.file("fleet.db"),
          "is no file of 'rangecal diagnose --each'");
}

// Two of sixteen ranks are killed while they work, rank 0 one of them.
TEST(EachOnRanks, RanksThatDieLoseNothing) {
  if (!has_ranks() || !ranks_may_die()) GTEST_SKIP() << "no MPI here that lets the other ranks live";
  const TemporaryFolder folder;
  write_fleet(folder, 32, 200);
  const std::string command = "diagnose " + folder.file("fleet") + " --each ", db = folder.file("a.db");
  const RunResult result =
      run_and_kill_ranks(command + db + " --page " + folder.file("a.html"), db, 16, {0, 5});
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("32 recordings in " + db));
  EXPECT_EQ(files_beside(db), 0);
  EXPECT_TRUE(std::filesystem::exists(folder.file("a.html")));
  ASSERT_EQ(run(command + folder.file("one.db")).code, 0);
  EXPECT_EQ(diagnosis_rows(db), diagnosis_rows(folder.file("one.db")));
}

}  // namespace
}  // namespace rangecal::test
