// SPDX-License-Identifier: BSD-3-Clause
// Tables as spreadsheets, loggers and data frames write them, and what a person or a broken program would try.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <numbers>
#include <string>
#include <tuple>
#include <vector>

#include "apps/run_binary.hpp"
#include "rangecal/core/recording_io.hpp"

namespace rangecal::test {
namespace {

using ::testing::AllOf;
using ::testing::DoubleEq;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

class ImportCsv : public ::testing::Test {
 protected:
  RunResult import(const std::string& table, const std::string& options = "--true truth --reading sonar") {
    folder.write("t.csv", table);
    return run("import csv " + folder.file("t.csv") + " " + options + " -o " + rec());
  }
  std::string rec() const { return folder.file("rec"); }
  Recording loaded() const { return load_recording(rec()); }
  /// Refused in one line with all of the parts, and nothing written.
  void expect_refused(const std::string& table, const std::string& options,
                      const std::vector<std::string>& parts) {
    const RunResult result = import(table, options);
    EXPECT_EQ(result.code, 2) << table.substr(0, 200);
    EXPECT_EQ(result.out, "");
    EXPECT_EQ(count_of(result.err, "\n"), 1) << result.err;
    for (const std::string& part : parts) EXPECT_THAT(result.err, HasSubstr(part));
    EXPECT_FALSE(std::filesystem::exists(rec()));
  }
  TemporaryFolder folder;
};

TEST_F(ImportCsv, GermanExcel) {
  // byte order mark, semicolons, decimal commas, CRLF, quotes, a header cell of two lines, an empty row at the end; rows are
  // lines of the file, the first behind the header is 3
  const RunResult result = import(
      "\xef\xbb\xbf"
      "Nr.;Abstand\xc3\xa4 [cm];\"Messwert\n[mm]\";Temperatur (\xc2\xb0"
      "C);Notiz\r\n"
      "1;57,0;571,5;20,5;\"gut; sehr\"\r\n2;100;1003;21;\r\n3;;1003;21;x\r\n4;150,5;;21,25;x\r\n;;;;\r\n",
      "--true 'Abstand\xc3\xa4 [cm]' --reading 'Messwert [mm]' --name lidar");
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(result.err, "");
  const Recording recording = loaded();
  EXPECT_EQ(recording.kind, RecordingKind::pairs);
  EXPECT_EQ(recording.sensor.name, "lidar");
  // 57 cm is the number 0.57, not 57 * 0.01 = 0.57000000000000006
  EXPECT_THAT(recording.pairs.true_m, ElementsAre(0.57, 1.0));
  EXPECT_THAT(recording.pairs.reading_m, ElementsAre(0.5715, 1.003));
  EXPECT_EQ(recording.pairs.covariates.size(), 2u);
  EXPECT_THAT(recording.pairs.covariates.at("Temperatur (\xc2\xb0"
                                            "C)"),
              ElementsAre(20.5, 21.0));
  EXPECT_THAT(recording.pairs.covariates.at("Nr."), ElementsAre(1.0, 2.0));
  for (const char* part :
       {"5 rows, 5 columns separated by semicolons, decimal commas", "in cm, by its name: 0.57 to 1 m",
        "in mm, by its name: 0.5715 to 1.003 m", "'Notiz': row 3: 'gut; sehr' is not a number",
        "4 read, 2 used; left out:", "1 without a true distance (row 5)", "1 without a reading (row 6)",
        "1 with nothing in them (row 7)", "rangecal calibrate ", "rangecal diagnose "})
    EXPECT_THAT(result.out, HasSubstr(part));
}

TEST_F(ImportCsv, PandasWithIndexTimesAndLabels) {
  // an unnamed index, a time of ISO 8601 in another zone, texts as labels, NaN, no end of the last line
  const RunResult result = import(
      ",truth,sonar,when,surface,ok\n"
      "0,1.0,1.01,2024-05-01T12:00:00.250+02:00,wall,True\n"
      "1,2.0,NaN,2024-05-01T12:00:01+02:00,wall,True\n"
      "2,2.0,2.03,2024-05-01T10:01:00.25Z,foam,False",
      "--true truth --reading sonar --time when --landmark surface");
  ASSERT_EQ(result.code, 0) << result.err;
  const Recording recording = loaded();
  EXPECT_THAT(recording.pairs.time_s, ElementsAre(0.0, 60.0));  // 12:00:00.25+02:00 is 10:00:00.25Z
  ASSERT_EQ(recording.landmarks.size(), 2u);
  EXPECT_EQ(recording.landmarks[1].label, "foam");
  EXPECT_THAT(recording.pairs.landmark, ElementsAre(0, 1));
  EXPECT_TRUE(recording.pairs.covariates.empty());
  EXPECT_THAT(result.out,
              AllOf(HasSubstr("column 1 has no name"),
                    HasSubstr("'ok': row 2: 'True' is not a number; --landmark or --batch takes its texts "
                              "(False, True) as labels"),
                    HasSubstr("1 without a reading (row 3)"), HasSubstr("taken to be in m (--unit)"),
                    HasSubstr("2 labels: wall, foam"), HasSubstr("date and time")));
}

TEST_F(ImportCsv, UnitsOfLengths) {
  // 10 in = 0.254 m, 1 ft = 0.3048 m, 2 yd = 1.8288 m
  for (const auto& [unit, value, metres] :
       std::vector<std::tuple<std::string, std::string, double>>{{"in", "10", 0.254},
                                                                 {"ft", "1", 0.3048},
                                                                 {"yd", "2", 1.8288},
                                                                 {"mm", "1234.5", 1.2345},
                                                                 {"cm", "57", 0.57},
                                                                 {"um", "1500000", 1.5},
                                                                 {"km", "0.002", 2.0},
                                                                 {"M", "3", 3.0}}) {
    ASSERT_EQ(
        import("truth,sonar\n" + value + "," + value + "\n", "--true truth --reading sonar --unit " + unit)
            .code,
        0);
    EXPECT_THAT(loaded().pairs.true_m, ElementsAre(DoubleEq(metres))) << unit;
    EXPECT_THAT(loaded().pairs.reading_m, ElementsAre(DoubleEq(metres))) << unit;
  }
  const RunResult both =
      import("truth_mm,sonar\n1000,100.5\n", "--true truth_mm --reading sonar --reading-unit cm");
  EXPECT_THAT(loaded().pairs.reading_m, ElementsAre(1.005));
  EXPECT_EQ(both.err, "");
  // an option stands against a name: it is followed, and said
  const RunResult against =
      import("truth [cm],sonar\n1,1.01\n", "--true 'truth [cm]' --reading sonar --unit m");
  EXPECT_THAT(against.err,
              HasSubstr("column 'truth [cm]' is taken to be in m, by --unit, though its name says cm"));
  EXPECT_THAT(loaded().pairs.true_m, ElementsAre(1.0));
  const RunResult warned = import("truth,sonar\n1,1010\n2,2020\n");
  EXPECT_EQ(warned.code, 0);
  EXPECT_THAT(warned.err, HasSubstr("in another unit?"));
  EXPECT_THAT(import("truth,sonar\n1000,1010\n2000,2020\n").err,
              HasSubstr("if the table is in mm or cm, say --unit"));
  std::filesystem::remove_all(rec());
  expect_refused("truth,sonar\n1,2\n", "--true truth --reading sonar --unit furlong",
                 {"'furlong' is none of m, mm, cm, um, km, in, ft, yd"});
  expect_refused("truth,sonar\n1,2\n", "--true truth --reading sonar --true-unit V",
                 {"--true-unit: 'V' is none of m"});
}

// Someone who notes readings by hand slips from metres into millimetres or centimetres; a sensor without an echo says 65535.
TEST_F(ImportCsv, RowsInAnotherUnitAndMarksForNoReadingAreSaid) {
  const std::string head = "truth,sonar\n", plain = "1,1.01\n2,2.02\n3,3.03\n4,4.02\n0.5,0.52\n1.5,1.51\n";
  EXPECT_EQ(import(head + plain + "1,1.7\n").err, "");    // an outlier is a matter of the diagnosis
  EXPECT_EQ(import(head + plain + "0.2,3.9\n").err, "");  // and so is a late echo, twenty times as far
  EXPECT_THAT(
      import(head + "2,2020\n" + plain + "3,3030\n").err,
      HasSubstr(
          "rows 2, 9: the reading is 1000 times what others are at such a distance: is it in another unit?"));
  EXPECT_THAT(import(head + plain + "3,0.0303\n").err,
              HasSubstr("row 8: the reading is a 100th of what others are at such a distance"));
  const RunResult marked = import(head + plain + "1,65535\n2,65535\n");
  EXPECT_THAT(marked.err,
              HasSubstr("rows 8-9 read 65535, far beyond the farthest distance of 4 m: if that stands for no "
                        "reading, give its text to --missing"));
  EXPECT_THAT(marked.err, Not(HasSubstr("another unit")));
  EXPECT_THAT(import(head + plain + "1,1e20\n").err, HasSubstr("row 8 reads 1e+20, far beyond"));
  const RunResult missing =
      import(head + plain + "1,65535\n2,65535\n", "--true truth --reading sonar --missing 65535");
  EXPECT_EQ(missing.err, "");
  EXPECT_EQ(loaded().pairs.size(), 6u);
}

TEST_F(ImportCsv, ReadingsThatAreNoLengthsStayAsTheyAre) {
  std::string table = "truth cm,ir [V]\n";
  for (int i = 0; i < 40; ++i)
    table += fmt::format("{},{:.4f}\n", 20 + 2 * i, 24.0 / (20 + 2 * i) + 0.002 * (i % 3));
  const RunResult result = import(table, "--true 'truth cm' --reading 'ir [V]'");
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("in V, by its name: 0.2449 to 1.2 V; no length: left as they are"));
  EXPECT_EQ(loaded().sensor.unit, "V");
  EXPECT_EQ(loaded().pairs.reading_m[0], 1.2);
  EXPECT_EQ(loaded().pairs.true_m[0], 0.2);
  ASSERT_EQ(loaded().notes.size(), 2u);
  EXPECT_THAT(loaded().notes[0], HasSubstr("the readings are in V, no lengths"));
  EXPECT_EQ(import(table, "--true 'truth cm' --reading 'ir [V]' --reading-unit counts").code, 0);
  EXPECT_EQ(loaded().sensor.unit, "counts");
}

TEST_F(ImportCsv, TimesInUnits) {
  const auto times = [&](const std::string& name, const std::string& first, const std::string& second,
                         const std::string& options = "") {
    const RunResult result = import("truth,sonar," + name + "\n1,1.01," + first + "\n2,2.02," + second + "\n",
                                    "--true truth --reading sonar --time '" + name + "' " + options);
    EXPECT_EQ(result.code, 0) << result.err;
    return loaded().pairs.time_s;
  };
  EXPECT_THAT(times("t", "5.5", "7"), ElementsAre(0.0, 1.5));
  EXPECT_THAT(times("t [ms]", "5500", "7000"), ElementsAre(0.0, 1.5));
  EXPECT_THAT(times("t_us", "5500000", "7000000"), ElementsAre(0.0, 1.5));
  EXPECT_THAT(times("t", "0", "2", "--time-unit min"), ElementsAre(0.0, 120.0));
  // since 1970, by their size: s, ms, ns
  EXPECT_THAT(times("stamp", "1714550400.5", "1714550402"), ElementsAre(0.0, 1.5));
  EXPECT_THAT(times("stamp", "1714550400500", "1714550402000"), ElementsAre(0.0, 1.5));
  EXPECT_THAT(times("stamp", "1714550400500000000", "1714550402000000000"), ElementsAre(0.0, 1.5));
  EXPECT_THAT(times("stamp", "2024/02/29 23:59:59", "\"2024-03-01 00:00:00,5\""), ElementsAre(0.0, 1.5));
  EXPECT_THAT(times("stamp", "23:59:59", "00:00:00.5"), ElementsAre(0.0, 1.5));  // past midnight
  EXPECT_THAT(times("stamp", "2024-05-01T12:00", "2024-05-01T11:59:58.5"), ElementsAre(1.5, 0.0));
  std::filesystem::remove_all(rec());
  for (const std::string bad : {"01.05.2024 12:00", "2024-02-30T12:00:00", "2024-05-01T25:00:00", "soon"})
    expect_refused("truth,sonar,t\n1,1,2024-05-01T12:00:00\n2,2," + bad + "\n",
                   "--true truth --reading sonar --time t", {"row 3, column 't'", bad, "ISO 8601"});
  expect_refused("truth,sonar,t\n1,1,5\n2,2,2024-05-01T12:00:00\n", "--true truth --reading sonar --time t",
                 {"row 3, column 't': '2024-05-01T12:00:00' is not a number"});
  expect_refused("truth;sonar;t\n1;1;2,5\n2;2;2.5\n", "--true truth --reading sonar --time t",
                 {"row 2, column 't': '2,5' has a comma, while row 3 has a decimal point"});
}

TEST_F(ImportCsv, BearingsInDegreesOrRadians) {
  const auto bearings = [&](const std::string& name, const std::string& value,
                            const std::string& options = "") {
    const RunResult result = import("truth,sonar," + name + "\n1,1.01," + value + "\n",
                                    "--true truth --reading sonar --bearing '" + name + "' " + options);
    EXPECT_EQ(result.code, 0) << result.err;
    return loaded().pairs.bearing_rad[0];
  };
  EXPECT_DOUBLE_EQ(bearings("b", "1.5"), 1.5);
  EXPECT_NEAR(bearings("b", "270"), -std::numbers::pi / 2.0, 1e-15);  // beyond a turn in radians
  EXPECT_DOUBLE_EQ(bearings("b [deg]", "1.8"), std::numbers::pi / 100.0);
  EXPECT_DOUBLE_EQ(bearings("b", "1.8", "--bearing-unit deg"), std::numbers::pi / 100.0);
  std::filesystem::remove_all(rec());
  expect_refused("truth,sonar,b\n1,1,0.1\n1,1,90\n",
                 "--true truth --reading sonar --bearing b --bearing-unit rad",
                 {"row 3, column 'b': 90 rad is beyond a turn"});
}

TEST_F(ImportCsv, ColumnsThatAreNotThere) {
  const std::string table = "True distance [cm],sonar,temp\n1,2,3\n";
  expect_refused(
      table, "--true 'true distance' --reading sonar",
      {"t.csv, row 1: --true: there is no column 'true distance', did you mean 'True distance [cm]'?",
       "the columns are 'True distance [cm]', 'sonar', 'temp'"});
  expect_refused(table, "--true 'True distance [cm]' --reading sonra", {"did you mean 'sonar'?"});
  expect_refused(table, "--true 'True distance [cm]' --reading elephant", {"'elephant'; the columns are"});
  expect_refused(table, "--true sonar --reading sonar",
                 {"column 'sonar': is given as --true and as --reading"});
  expect_refused(table, "--reading sonar --time when", {"--time: there is no column 'when'"});
  expect_refused("a,b,c\n1,2,3\n", "", {"say --true COLUMN --reading COLUMN; the columns are 'a', 'b', 'c'"});
  expect_refused("a,b,c\n1,2,3\n", "--true a", {"which column is the reading? say --reading COLUMN"});
  expect_refused("true,reference,reading\n1,2,3\n", "",
                 {"which column is the true distance?"});  // two may be meant
  expect_refused("a,a\n1,2\n", "", {"column 'a': the column is named twice"});
}

TEST_F(ImportCsv, UnmistakableNamesAreTakenAndSaid) {
  const RunResult result =
      import("time_s,ground truth (m),measured distance (m),temperature_c\n5,1,1.1,20\n6,2,2.1,21\n", "");
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out,
              AllOf(HasSubstr("Truth      column 'ground truth (m)', taken for its name"),
                    HasSubstr("Reading    column 'measured distance (m)', taken for its name"),
                    HasSubstr("Time       column 'time_s'"), HasSubstr("Covariates 'temperature_c'")));
  EXPECT_THAT(loaded().pairs.time_s, ElementsAre(0.0, 1.0));
  // what is taken for its name alone is given up where rows would be lost for it
  const RunResult gap = import("true_m,reading_m,time,landmark,batch\n1,1.1,0,A,x\n2,2.1,,,\n", "");
  ASSERT_EQ(gap.code, 0) << gap.err;
  EXPECT_THAT(gap.err, AllOf(HasSubstr("column 'time' is not taken as --time: row 3"),
                             HasSubstr("column 'landmark' is not taken as --landmark: row 3 is empty")));
  EXPECT_EQ(loaded().pairs.size(), 2u);
  EXPECT_TRUE(loaded().pairs.time_s.empty());
  EXPECT_THAT(loaded().pairs.batch, ElementsAre(0, -1));
  // asked for, rows without it are left out and counted
  const RunResult asked = import("true_m,reading_m,time,landmark\n1,1.1,0,A\n2,2.1,,A\n3,3.1,5,\n",
                                 "--time time --landmark landmark");
  EXPECT_THAT(asked.out,
              AllOf(HasSubstr("1 without a time (row 3)"), HasSubstr("1 without a landmark (row 4)")));
}

TEST_F(ImportCsv, NamesWithAMeaningOfTheirOwnAreChanged) {
  const RunResult result = import("true_m,truth,sonar\n7,1,1.1\n8,2,2.1\n");
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(loaded().pairs.true_m, ElementsAre(1.0, 2.0));
  EXPECT_THAT(loaded().pairs.covariates.at("column_true_m"), ElementsAre(7.0, 8.0));
  EXPECT_THAT(result.out, HasSubstr("'true_m' as 'column_true_m'"));
}

TEST_F(ImportCsv, RowsThatCannotBeUsedAreCountedWithTheirReason) {
  const RunResult result = import(
      "truth,sonar\n1,1.1\n0,1.1\n-1,1.1\n1,0\n1,-2\n1,inf\n#N/A,1\n1,#DIV/0!\n1,null\n1,ERR\n1,ERR\n1,1.2\n",
      "--true truth --reading sonar --missing ERR --missing none-such");
  ASSERT_EQ(result.code, 0) << result.err;
  for (const char* part :
       {"12 read, 2 used", "2 whose true distance is not above 0 (rows 3-4)", "1 whose reading is 0 (row 5)",
        "1 whose reading is negative (row 6)", "1 whose reading is infinite (row 7)",
        "1 without a true distance (row 8)", "4 without a reading (rows 9-12)"})
    EXPECT_THAT(result.out, HasSubstr(part));
  EXPECT_THAT(loaded().pairs.reading_m, ElementsAre(1.1, 1.2));
}

TEST_F(ImportCsv, CommasThatMayMeanTwoThings) {
  const std::string quoted = "truth,sonar,c\n\"1,234\",\"1,240\",\"3,456\"\n";
  expect_refused(quoted, "--true truth --reading sonar",
                 {"row 2, column 'truth'", "'1,234' may have a decimal comma or one between thousands",
                  "--decimal comma"});
  ASSERT_EQ(import(quoted, "--true truth --reading sonar --decimal comma").code, 0);
  EXPECT_THAT(loaded().pairs.true_m, ElementsAre(1.234));
  std::filesystem::remove_all(rec());
  expect_refused(quoted, "--true truth --reading sonar --decimal point", {"'1,234' is not a number"});
  // no thousands have two digits behind the comma, or begin with 0
  ASSERT_EQ(import("truth,sonar\n\"1,23\",\"0,123\"\n\"1,234\",\"1,234\"\n").code, 0);
  EXPECT_THAT(loaded().pairs.true_m, ElementsAre(1.23, 1.234));
  // semicolons are there since commas are decimal ones
  ASSERT_EQ(import("truth;sonar\n1,234;1,240\n").code, 0);
  EXPECT_THAT(loaded().pairs.reading_m, ElementsAre(1.24));
  std::filesystem::remove_all(rec());
  expect_refused("truth;sonar\n1,5;1\n1.5;1\n", "--true truth --reading sonar",
                 {"row 2", "while row 3 has a decimal point"});
  expect_refused("truth;sonar\n1.234,5;1\n", "--true truth --reading sonar", {"'1.234,5' is not a number"});
}

TEST_F(ImportCsv, SeparatorsAreToldApart) {
  for (const std::string table :
       {"truth\tsonar\n1.5\t1.6\n", "truth|sonar\n1.5|1.6\n", "sep=;\r\ntruth;sonar\r\n1,5;1,6\r\n",
        "\"truth\";\"sonar\"\n\"1,5\";\"1,6\"\n", "\n\ntruth , sonar\n 1.5 , 1.6 \n",
        "# truth,sonar\r1.5,1.6\r"}) {
    ASSERT_EQ(import(table).code, 0) << table;
    EXPECT_THAT(loaded().pairs.true_m, ElementsAre(1.5)) << table;
    EXPECT_THAT(loaded().pairs.reading_m, ElementsAre(1.6)) << table;
  }
  // a comma in each name and in each number, yet semicolons between them
  ASSERT_EQ(import("truth, m;sonar, m\n1,5;1,6\n", "--true 'truth, m' --reading 'sonar, m'").code, 0);
  ASSERT_EQ(
      import("Device X\nfirmware 2\ntruth,sonar\n1.5,\n1.5,1.6\n", "--true truth --reading sonar --skip 2")
          .code,
      0);
  EXPECT_THAT(
      run("import csv " + folder.file("t.csv") + " --true truth --reading sonar --skip 2 -o " + rec()).out,
      HasSubstr("1 without a reading (row 4)"));  // rows keep the numbers of the file
  ASSERT_EQ(import("a;b,truth,sonar\n1;2,1.5,1.6\n", "--true truth --reading sonar --separator comma").code,
            0);
  std::filesystem::remove_all(rec());
  expect_refused("truth sonar\n1 2\n", "", {"the header is one field, 'truth sonar'", "--separator"});
  expect_refused("truth,sonar\n1,2\n", "--separator x", {"none of comma, semicolon, tab, bar"});
}

TEST_F(ImportCsv, HostileTables) {
  const std::string options = "--true truth --reading sonar";
  expect_refused("", options, {"is empty"});
  expect_refused("\xef\xbb\xbf", options, {"is empty"});
  expect_refused("truth,sonar\n", options, {"holds a header and no rows"});
  expect_refused("truth,sonar\n,\n,\n", options, {"holds a header and empty rows"});
  expect_refused(
      "truth,sonar\n,1\n0,1\n", options,
      {"no row can be used: 1 without a true distance (row 2), 1 whose true distance is not above 0 (row 3)"});
  expect_refused(std::string("truth,sonar\n1,\0"
                             "2\n",
                             16),
                 options, {"row 2: holds a NUL byte"});
  expect_refused(std::string("\xff\xfet\0r\0", 6), options, {"UTF-16"});
  expect_refused(
      "truth,sonar,\xb0"
      "C\n1,2,3\n",
      options, {"row 1: is not UTF-8 text: save it as 'CSV UTF-8'"});
  expect_refused("PK\x03\x04 and so on", options, {"is a workbook"});
  expect_refused("truth,sonar\n1,2,3\n", options, {"row 2: has 3 fields, the header names 2"});
  expect_refused("truth,sonar\n1,\"2\n", options, {"row 2: a quote is opened and never closed"});
  expect_refused("truth,sonar\n1," + std::string(1 << 20, '7') + "\n", options, {"longer than 4096"});
  expect_refused("truth,sonar\n1," + std::string(5 << 20, '7'), options, {"longer than 4 MB"});
  expect_refused("1.0,1.1\n2.0,2.1\n", options, {"holds numbers where the columns' names are expected"});
  expect_refused("truth,sonar\n1,1e999\n", options, {"row 2, column 'sonar'", "'1e999' is not a number"});
  expect_refused("truth,sonar\n1,2\n1,1.5 m\n", options,
                 {"row 3, column 'sonar': '1.5 m' is not a number", "--missing"});
  std::string wide = "truth";
  for (int i = 0; i < 3000; ++i) wide += fmt::format(",{}{}", std::string(100, 'x'), i);
  expect_refused(wide + "\n", options, {"'sonar'", "and 2971 more"});
  EXPECT_EQ(run("import csv " + folder.path() + " -o " + rec()).code, 2);
  EXPECT_EQ(run("import csv /no/such.csv -o " + rec()).code, 2);
}

TEST_F(ImportCsv, TextsOfLabelsReadBack) {
  ASSERT_EQ(import("truth,sonar,which\n1,1.1,\"a,b\"\"c\"\n1,1.2,=1+1\n1,1.3,\"two\nlines\"\n",
                   "--true truth --reading sonar --landmark which")
                .code,
            0);
  const Recording recording = loaded();
  ASSERT_EQ(recording.landmarks.size(), 3u);
  EXPECT_EQ(recording.landmarks[0].label, "a,b\"c");
  EXPECT_EQ(recording.landmarks[1].label, "=1+1");
  EXPECT_EQ(recording.landmarks[2].label, "two\nlines");
}

TEST_F(ImportCsv, DoesNotReplaceWhatWasMeasured) {
  const std::string table = "truth,sonar\n1,1.1\n";
  ASSERT_EQ(import(table).code, 0);
  EXPECT_EQ(import(table).code, 0);  // what import made may be made again
  folder.write("rec/recording.yaml", "format: rangecal/1\nkind: pairs\n");
  folder.write("rec/pairs.csv", "true_m,reading_m\n5,5\n");
  const RunResult result = import(table);
  EXPECT_EQ(result.code, 2);
  EXPECT_THAT(result.err, HasSubstr("would be lost"));
  EXPECT_EQ(slurp(rec() + "/pairs.csv"), "true_m,reading_m\n5,5\n");
  // nor the table that it reads
  folder.write("own/pairs.csv", "");
  std::filesystem::create_directory(folder.file("own"));
  folder.write("own/pairs.csv", table);
  EXPECT_EQ(run("import csv " + folder.file("own/pairs.csv") + " --true truth --reading sonar -o " +
                folder.file("own"))
                .code,
            2);
  EXPECT_EQ(slurp(folder.file("own/pairs.csv")), table);
}

TEST_F(ImportCsv, WhatIsImportedIsCalibratedAndDiagnosed) {
  // the readings of a shipped recording in a table of other units and names give the same curve
  const Recording shipped_one = load_recording(shipped("pairs-2016"));
  std::string table = "tape [mm];Sonar [cm];set\n";
  for (std::size_t i = 0; i < shipped_one.pairs.size(); ++i)
    table += fmt::format("{};{};{}\n", 1000.0 * shipped_one.pairs.true_m[i],
                         100.0 * shipped_one.pairs.reading_m[i],
                         shipped_one.pairs.batch.empty() ? 0 : shipped_one.pairs.batch[i]);
  const RunResult result = import(table, "--true 'tape [mm]' --reading 'Sonar [cm]' --batch set");
  ASSERT_EQ(result.code, 0) << result.err;
  const Recording own = loaded();
  ASSERT_EQ(own.pairs.size(), shipped_one.pairs.size());
  for (std::size_t i = 0; i < own.pairs.size(); ++i) {  // 1000 x / 1000 is x to one rounding in each step
    EXPECT_DOUBLE_EQ(own.pairs.true_m[i], shipped_one.pairs.true_m[i]);
    EXPECT_DOUBLE_EQ(own.pairs.reading_m[i], shipped_one.pairs.reading_m[i]);
  }
  EXPECT_EQ(run("calibrate " + rec()).code, 0);
  EXPECT_EQ(run("diagnose " + rec()).code, 0);
}

TEST_F(ImportCsv, HelpTeaches) {
  const RunResult help = run("import csv --help");
  EXPECT_EQ(help.code, 0);
  for (const char* part :
       {"--true", "--reading-unit", "--missing", "Example", "rangecal import csv readings.csv"})
    EXPECT_THAT(help.out, HasSubstr(part));
  EXPECT_THAT(run("import --help").out,
              AllOf(HasSubstr("csv"), HasSubstr("mrclam"), HasSubstr("rangecal import csv")));
}

}  // namespace
}  // namespace rangecal::test
