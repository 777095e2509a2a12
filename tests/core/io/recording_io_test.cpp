// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/recording_io.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/io/recording_folder.hpp"
#include "rangecal/core/random.hpp"

namespace rangecal {
namespace {

using test::RecordingFolder;
using test::TemporaryFolder;
using ::testing::ElementsAre;
using ::testing::Pair;
using ::testing::UnorderedElementsAre;

const double kNaN = std::numeric_limits<double>::quiet_NaN();

// Equal bit for bit, NaN to NaN.
void expect_same(const std::vector<double>& a, const std::vector<double>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i)
    EXPECT_TRUE(a[i] == b[i] || (std::isnan(a[i]) && std::isnan(b[i])));
}

void expect_same(const Covariates& a, const Covariates& b) {
  ASSERT_EQ(a.size(), b.size());
  for (const auto& [name, values] : a) {
    ASSERT_TRUE(b.contains(name)) << name;
    expect_same(values, b.at(name));
  }
}

void expect_same(const Pose2& a, const Pose2& b) {
  EXPECT_EQ(a.x_m, b.x_m);
  EXPECT_EQ(a.y_m, b.y_m);
  EXPECT_EQ(a.heading_rad, b.heading_rad);
}

void expect_same(const Recording& a, const Recording& b) {
  EXPECT_EQ(a.kind, b.kind);
  EXPECT_EQ(a.sensor.name, b.sensor.name);
  EXPECT_EQ(a.sensor.principle, b.sensor.principle);
  EXPECT_EQ(a.sensor.range_min_m, b.sensor.range_min_m);
  EXPECT_EQ(a.sensor.range_max_m, b.sensor.range_max_m);
  EXPECT_EQ(a.sensor.unit, b.sensor.unit);
  EXPECT_EQ(a.estimate_sigma_xy, b.estimate_sigma_xy);
  if (!a.estimate_sigma_xy) {
    EXPECT_EQ(a.sigma_xy_m, b.sigma_xy_m);
  }
  EXPECT_EQ(a.sigma_heading_rad, b.sigma_heading_rad);
  EXPECT_EQ(a.stop_error, b.stop_error);
  ASSERT_EQ(a.stops.size(), b.stops.size());
  for (std::size_t i = 0; i < a.stops.size(); ++i) {
    EXPECT_EQ(a.stops[i].label, b.stops[i].label);
    expect_same(a.stops[i].commanded, b.stops[i].commanded);
    EXPECT_EQ(a.stops[i].covariance, b.stops[i].covariance);
    EXPECT_EQ(a.stops[i].sigma_xy_m, b.stops[i].sigma_xy_m);
    EXPECT_EQ(a.stops[i].sigma_heading_rad, b.stops[i].sigma_heading_rad);
    EXPECT_EQ(a.stops[i].place, b.stops[i].place);
  }
  ASSERT_EQ(a.landmarks.size(), b.landmarks.size());
  for (std::size_t i = 0; i < a.landmarks.size(); ++i) {
    EXPECT_EQ(a.landmarks[i].label, b.landmarks[i].label);
    EXPECT_EQ(a.landmarks[i].radius_m, b.landmarks[i].radius_m);
    EXPECT_EQ(a.landmarks[i].reflectance, b.landmarks[i].reflectance);
  }
  ASSERT_EQ(a.known_distances.size(), b.known_distances.size());
  for (std::size_t i = 0; i < a.known_distances.size(); ++i) {
    EXPECT_EQ(a.known_distances[i].from, b.known_distances[i].from);
    EXPECT_EQ(a.known_distances[i].to, b.known_distances[i].to);
    EXPECT_EQ(a.known_distances[i].distance_m, b.known_distances[i].distance_m);
    EXPECT_EQ(a.known_distances[i].sigma_m, b.known_distances[i].sigma_m);
  }
  EXPECT_EQ(a.readings.stop, b.readings.stop);
  EXPECT_EQ(a.readings.landmark, b.readings.landmark);
  EXPECT_EQ(a.readings.repeat, b.readings.repeat);
  expect_same(a.readings.time_s, b.readings.time_s);
  expect_same(a.readings.range_m, b.readings.range_m);
  expect_same(a.readings.bearing_rad, b.readings.bearing_rad);
  EXPECT_EQ(a.readings.row, b.readings.row);
  expect_same(a.readings.covariates, b.readings.covariates);
  expect_same(a.pairs.true_m, b.pairs.true_m);
  expect_same(a.pairs.reading_m, b.pairs.reading_m);
  EXPECT_EQ(a.pairs.batch, b.pairs.batch);
  EXPECT_EQ(a.pairs.batch_labels, b.pairs.batch_labels);
  EXPECT_EQ(a.pairs.landmark, b.pairs.landmark);
  expect_same(a.pairs.time_s, b.pairs.time_s);
  expect_same(a.pairs.bearing_rad, b.pairs.bearing_rad);
  EXPECT_EQ(a.pairs.row, b.pairs.row);
  expect_same(a.pairs.covariates, b.pairs.covariates);
  EXPECT_EQ(a.counts.read, b.counts.read);
  EXPECT_EQ(a.counts.used, b.counts.used);
  EXPECT_EQ(a.counts.dropped, b.counts.dropped);
  EXPECT_EQ(a.counts.cells_left_out, b.counts.cells_left_out);
  ASSERT_EQ(a.truth.stops.size(), b.truth.stops.size());
  for (std::size_t i = 0; i < a.truth.stops.size(); ++i) {
    ASSERT_EQ(a.truth.stops[i].has_value(), b.truth.stops[i].has_value());
    if (a.truth.stops[i]) expect_same(*a.truth.stops[i], *b.truth.stops[i]);
  }
  EXPECT_EQ(a.truth.landmarks, b.truth.landmarks);
  EXPECT_EQ(a.extraction, b.extraction);
  EXPECT_EQ(a.groups.by, b.groups.by);
  EXPECT_EQ(a.groups.of, b.groups.of);
  EXPECT_EQ(a.groups.labels, b.groups.labels);
  EXPECT_EQ(a.reference.sigma_m, b.reference.sigma_m);
}

Recording random_landmarks_recording(std::uint64_t seed) {
  Random random(seed_from("random_landmarks_recording", {seed}));
  Recording recording;
  recording.sensor = {"odd: \"name\", #1", "triangulation", 0.1,
                      seed % 2 ? 7.3 : std::numeric_limits<double>::infinity(), seed % 2 ? "V" : ""};
  recording.estimate_sigma_xy = seed % 3 == 0;
  recording.sigma_xy_m = random.uniform();
  recording.sigma_heading_rad = random.uniform();
  recording.stop_error = seed % 2 ? StopErrorModel::random_walk : StopErrorModel::independent;
  for (const char* label : {"0", "stop, with comma", " spaced ", "quote\"d"}) {
    Stop stop;
    stop.label = label;
    stop.commanded = {random.normal(), random.normal() * 1e-9, random.uniform(-3.0, 3.0)};
    if (random.index(2)) stop.sigma_xy_m = random.uniform();
    if (random.index(2)) stop.sigma_heading_rad = random.uniform();
    if (random.index(2)) stop.place = "place 1";
    if (random.index(2)) {  // in place of both sigmas
      stop.sigma_xy_m.reset(), stop.sigma_heading_rad.reset();
      Eigen::Matrix3d root;
      for (double& entry : root.reshaped()) entry = random.normal();
      const Eigen::Matrix3d product = root * root.transpose();
      stop.covariance = 0.5 * (product + product.transpose());  // symmetric to the last bit
    }
    recording.stops.push_back(stop);
    if (random.index(2)) {
      recording.truth.stops.push_back(Pose2{random.normal(), random.normal(), random.uniform(-3.0, 3.0)});
    } else {
      recording.truth.stops.push_back(std::nullopt);
    }
  }
  for (const char* label : {"A", "\xc3\x85ngstr\xc3\xb6m", "never seen"}) {
    recording.landmarks.push_back(
        {label, random.uniform(), random.index(2) ? std::optional(random.uniform()) : std::nullopt});
    recording.truth.landmarks.push_back(Eigen::Vector2d(random.normal(), random.normal()));
  }
  recording.known_distances = {{0, 2, 1.0 / 3.0, 1e-3}};
  Readings& readings = recording.readings;
  for (int i = 0; i < 40; ++i) {
    readings.stop.push_back(i % 4);
    readings.landmark.push_back(i % 2);
    readings.repeat.push_back(i / 4);
    readings.time_s.push_back(random.uniform(0.0, 1e6));
    readings.range_m.push_back(random.uniform(0.2, 7.0));
    readings.bearing_rad.push_back(random.uniform(-3.14, 3.14));
    readings.row.push_back(i + 2);
    readings.covariates["intensity"].push_back(i % 7 == 0 ? kNaN : random.normal());
    readings.covariates["temperature_c"].push_back(random.normal(20.0, 1e-7));
  }
  recording.counts.read = recording.counts.used = 40;
  recording.extraction = {{"arc", "mean"},           {"radius", "[0.04, 0.12]"},
                          {"edge_cut", "0.9"},       {"source", "run: #1.csv"},
                          {"odd", "[half a list"},   {"empty", ""},
                          {"nothing", "null"},       {"mark", "~"},
                          {"two", "a\nline, \"b\""}, {"key: {", " x "}};
  return recording;
}

TEST(RecordingIo, LandmarksReadBackAsWritten) {
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    const TemporaryFolder folder;
    const Recording recording = random_landmarks_recording(seed);
    save_recording(recording, folder.path());
    SCOPED_TRACE(seed);
    expect_same(recording, load_recording(folder.path()));
  }
}

TEST(RecordingIo, RangesAloneReadBackAsWritten) {
  const RecordingFolder folder;
  folder.write("observations.csv", "stop,landmark,range_m\n0,A,1.0\n0,A,\n1,B,2.5\n");
  const Recording read = load_recording(folder.path());
  EXPECT_FALSE(read.readings.has_bearings());
  EXPECT_EQ(read.readings.range_m, (std::vector<double>{1.0, 2.5}));
  EXPECT_EQ(read.counts.dropped.at("missing"), 1);
  ASSERT_EQ(read.notes.size(), 1u);
  EXPECT_EQ(read.notes[0], "no column bearing_rad in observations.csv: ranges alone");
  const TemporaryFolder written;
  save_recording(read, written.path());
  const Recording again = load_recording(written.path());
  EXPECT_FALSE(again.readings.has_bearings());
  EXPECT_EQ(again.readings.range_m, read.readings.range_m);
}

TEST(RecordingIo, TextsInMemoryAreARecording) {
  const std::map<std::string, std::string> files{
      {"recording.yaml", R"({"format": "rangecal/1", "stops": {"sigma_xy_m": 0.02}})"},
      {"stops.csv", "stop,x_m,y_m,heading_rad\n0,0,0,0\n"},
      {"observations.csv", "stop,landmark,range_m,bearing_rad\n0,A,1.5,0.1\n0,A,,0.1\n"}};
  const Recording recording = parse_recording(files);
  EXPECT_EQ(recording.sigma_xy_m, 0.02);
  EXPECT_EQ(recording.readings.range_m, std::vector<double>{1.5});
  EXPECT_EQ(recording.counts.dropped.at("missing"), 1);
  try {
    parse_recording({{"recording.yaml", "format: rangecal/1"}});
    FAIL() << "no stops.csv";
  } catch (const InputError& error) {
    EXPECT_STREQ(error.what(), "stops.csv: is missing");
  }
}

TEST(RecordingIo, PairsReadBackAsWrittenOverALandmarksRecording) {
  const TemporaryFolder folder;
  save_recording(random_landmarks_recording(1), folder.path());
  Random random(seed_from("PairsReadBackAsWritten"));
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.landmarks = {{"A", 0.0, std::nullopt}, {"B", 0.1, 0.5}};
  recording.pairs.batch_labels = {"first", "second"};
  for (int i = 0; i < 20; ++i) {
    recording.pairs.true_m.push_back(random.uniform(0.1, 5.0));
    recording.pairs.reading_m.push_back(random.uniform(0.1, 5.0));
    recording.pairs.batch.push_back(i < 8 ? 0 : i < 16 ? 1 : -1);
    recording.pairs.landmark.push_back(i % 2);
    recording.pairs.time_s.push_back(i * 0.1);
    recording.pairs.bearing_rad.push_back(random.uniform(-3.0, 3.0));
    recording.pairs.row.push_back(i + 2);
    recording.pairs.covariates["speed_mps"].push_back(random.normal());
  }
  recording.counts.read = recording.counts.used = 20;
  save_recording(recording, folder.path());
  expect_same(recording, load_recording(folder.path()));
  EXPECT_FALSE(std::filesystem::exists(folder.file("observations.csv")));
  for (const auto& entry : std::filesystem::directory_iterator(folder.path())) {
    EXPECT_EQ(entry.path().string().find(".partial"), std::string::npos);
  }
}

TEST(RecordingIo, ColumnsInAnyOrderCrlfBomAndCovariates) {
  RecordingFolder folder;
  folder.write("observations.csv",
               "\xef\xbb\xbf"
               "temperature_c,bearing_rad,note,landmark,range_m,stop\r\n"
               "20.5,6.0,fine,A,1.5,0\r\n,0.1,\"so, so\",A,1.6,0\r\n21,0.2,,B,1.7,1\r\n");
  const Recording recording = load_recording(folder.path());
  EXPECT_THAT(recording.readings.range_m, ElementsAre(1.5, 1.6, 1.7));
  EXPECT_THAT(recording.readings.repeat, ElementsAre(0, 1, 0));
  EXPECT_THAT(recording.readings.row, ElementsAre(2, 3, 4));
  EXPECT_NEAR(recording.readings.bearing_rad[0], 6.0 - 2.0 * std::numbers::pi, 1e-15);
  EXPECT_TRUE(recording.readings.time_s.empty());
  ASSERT_EQ(recording.readings.covariates.size(), 1u);  // the text column `note` is kept out
  expect_same(recording.readings.covariates.at("temperature_c"), {20.5, kNaN, 21.0});
  EXPECT_THAT(recording.notes,
              ElementsAre(folder.file("observations.csv") +
                          ", row 2, column 'note': 'fine' is not a number; the column is left out"));
  EXPECT_EQ(recording.landmarks[0].radius_m, 0.1);
  EXPECT_EQ(recording.path, folder.path());
}

TEST(RecordingIo, AColumnWithATextAmongItsNumbersIsLeftOutAndNoted) {
  const std::string long_text(50, 'x');
  std::map<std::string, std::string> files{
      {"recording.yaml", "format: rangecal/1\n"},
      {"stops.csv", "stop,x_m,y_m,heading_rad\n0,0,0,0\n"},
      {"observations.csv",
       "stop,landmark,range_m,bearing_rad,temperature,level,empty,big\n"
       "0,A,1.5,0.1,20.5,1,,1\n0,A,,0.1, warm ,2,NA,2\n0,A,1.6,0.1,hot,nan,,1e999\n0,A,1.7,0.1,21,3,,3\n"}};
  const Recording recording = parse_recording(files);
  EXPECT_EQ(recording.readings.covariates.size(), 1u);
  expect_same(recording.readings.covariates.at("level"), {1.0, kNaN, 3.0});
  // The first text of a column, also in a row that is dropped; what is empty throughout is no loss.
  EXPECT_THAT(
      recording.notes,
      ElementsAre(
          "observations.csv, row 3, column 'temperature': 'warm' is not a number; the column is left out",
          "observations.csv, row 4, column 'big': '1e999' is beyond what a number can hold; the column "
          "is left out"));
  const TemporaryFolder folder;
  save_recording(recording, folder.path());
  EXPECT_THAT(load_recording(folder.path()).notes,
              ::testing::IsEmpty());  // the column is not written, nor its note

  files["observations.csv"] =
      "stop,landmark,range_m,bearing_rad,said\n0,A,1.5,0.1,\"" + long_text + "\nmore\"\n";
  EXPECT_THAT(parse_recording(files).notes,
              ElementsAre("observations.csv, row 2, column 'said': '" + long_text.substr(0, 40) +
                          "...' is not a number; the column is left out"));

  std::string names, texts;  // ten columns of remarks: eight are named
  for (int i = 0; i < 10; ++i) names += ",c" + std::to_string(i), texts += ",a";
  files["observations.csv"] = "stop,landmark,range_m,bearing_rad" + names + "\n0,A,1.5,0.1" + texts + "\n";
  const std::vector<std::string> notes = parse_recording(files).notes;
  ASSERT_EQ(notes.size(), 8u);
  EXPECT_EQ(
      notes[7],
      "observations.csv, row 2, column 'c7': 'a' is not a number; the column is left out; so are 2 more that hold "
      "texts");
}

TEST(RecordingIo, SigmaMayBeEstimated) {
  RecordingFolder folder;
  folder.write("recording.yaml", "format: rangecal/1\nstops: {sigma_xy_m: estimate, error: random_walk}\n");
  const Recording recording = load_recording(folder.path());
  EXPECT_TRUE(recording.estimate_sigma_xy);
  EXPECT_EQ(recording.stop_error, StopErrorModel::random_walk);
}

// What extract notes about the arc, and whatever else stands there, is the recording's and survives load and save.
TEST(RecordingIo, TheNoteOfTheExtractionIsKept) {
  RecordingFolder folder;
  folder.write("recording.yaml",
               "format: rangecal/1\nextraction:\n  arc: smallest\n  radius:\n  - 0.04\n  - 0.12\n"
               "  by: {who: me, when: [1, 2]}\n  none:\n");
  const Recording recording = load_recording(folder.path());
  EXPECT_THAT(recording.extraction,
              UnorderedElementsAre(Pair("arc", "smallest"), Pair("radius", "[0.04, 0.12]"),
                                   Pair("by", "{who: me, when: [1, 2]}"), Pair("none", "")));
  const TemporaryFolder copy;
  save_recording(recording, copy.path());
  EXPECT_EQ(load_recording(copy.path()).extraction, recording.extraction);
}

TEST(RecordingIo, UnusableReadingsAreDroppedAndCountedByReason) {
  RecordingFolder folder;
  std::string rows =
      "stop,landmark,repeat,range_m,bearing_rad\n0,A,0,,0\n0,A,1,nan,0\n0,A,2,inf,0\n0,A,3,0,0\n"
      "0,A,4,-1,0\n0,A,5,1.0,\n0,A,6,1.0,nan\n0,A,7,1.0,0\n1,B,0,0.1,0\n1,A,0,6.5,0\n";
  folder.write("observations.csv", rows);
  const Recording recording = load_recording(folder.path());
  EXPECT_EQ(recording.counts.read, 10);
  EXPECT_EQ(recording.counts.used, 1);
  EXPECT_THAT(
      recording.counts.dropped,
      UnorderedElementsAre(Pair("missing", 2), Pair("not finite", 3), Pair("zero", 1), Pair("negative", 1),
                           Pair("below range_min_m", 1), Pair("above range_max_m", 1)));
  EXPECT_EQ(recording.counts.cells_left_out, 2);
  EXPECT_THAT(recording.readings.row, ElementsAre(9));
}

// `lost` readings above the limit out of `readings` in the cell (0, A); one good reading elsewhere.
Counts counts_of_cell(int readings, int lost) {
  RecordingFolder folder;
  std::string rows = "stop,landmark,range_m,bearing_rad\n1,B,2.0,0\n";
  for (int i = 0; i < readings; ++i) rows += i < lost ? "0,A,6.5,0\n" : "0,A,5.9,0\n";
  folder.write("observations.csv", rows);
  return load_recording(folder.path()).counts;
}

TEST(RecordingIo, ACellCutByALimitIsLeftOutWhole) {
  // 1 of 100 is not more than 1 %; 2 of 100 and 1 of 99 are.
  EXPECT_EQ(counts_of_cell(100, 1).used, 100);
  EXPECT_EQ(counts_of_cell(100, 1).cells_left_out, 0);
  EXPECT_EQ(counts_of_cell(99, 1).used, 1);
  const Counts counts = counts_of_cell(100, 2);
  EXPECT_EQ(counts.used, 1);
  EXPECT_EQ(counts.cells_left_out, 1);
  EXPECT_THAT(counts.dropped,
              UnorderedElementsAre(Pair("above range_max_m", 2), Pair("cell cut by a limit", 98)));
}

TEST(RecordingIo, ABatchCutByALimitIsLeftOutWhole) {
  RecordingFolder folder;
  folder.make_pairs(
      "batch,true_m,reading_m\nfar,6,5.9\nfar,6,6.1\nnear,1,1.0\nnear,1,1.1\n,3,6.1\n,3,3.0\n,,3.0\n");
  const Recording recording = load_recording(folder.path());
  EXPECT_THAT(recording.pairs.batch_labels, ElementsAre("near"));
  EXPECT_THAT(recording.pairs.batch, ElementsAre(0, 0, -1));
  EXPECT_THAT(recording.pairs.row, ElementsAre(4, 5, 7));
  EXPECT_EQ(recording.counts.cells_left_out, 1);
  EXPECT_THAT(recording.counts.dropped, UnorderedElementsAre(Pair("above range_max_m", 2), Pair("missing", 1),
                                                             Pair("cell cut by a limit", 1)));
}

// Without batches a cell is what was read at one distance: here in turns with another one, and 201 readings long.
TEST(RecordingIo, WithoutBatchesADistanceCutByALimitIsLeftOutWhole) {
  for (const int lost : {0, 2, 3}) {  // 2 of 201 are less than 1 %, 3 are more
    RecordingFolder folder;
    std::string rows = "true_m,reading_m\n";
    for (int i = 0; i < 201; ++i)
      rows += std::string(i % 67 == 5 && i / 67 < lost ? "5.9,6.1" : "5.9,5.8") + "\n1,1.1\n";
    folder.make_pairs(rows);
    const Recording recording = load_recording(folder.path());
    const bool cut = lost == 3;
    EXPECT_EQ(recording.counts.cells_left_out, cut ? 1 : 0) << lost;
    EXPECT_EQ(recording.counts.used, cut ? 201 : 402 - lost);
    EXPECT_EQ(std::count(recording.pairs.true_m.begin(), recording.pairs.true_m.end(), 5.9),
              cut ? 0 : 201 - lost);
    EXPECT_EQ(recording.counts.dropped.contains("cell cut by a limit"), cut);
    if (cut) {
      EXPECT_EQ(recording.counts.dropped.at("cell cut by a limit"), 198);
    }
    EXPECT_THAT(recording.notes, ::testing::IsEmpty());
  }
}

TEST(RecordingIo, AReadingLostAtADistanceOfItsOwnLeavesNothingToLeaveOut) {
  RecordingFolder folder;
  folder.make_pairs("true_m,reading_m\n1,1.1\n2,2.1\n3,3.1\n5.9,6.1\n5.95,6.2\n");
  const Recording recording = load_recording(folder.path());
  EXPECT_EQ(recording.counts.used, 3);
  EXPECT_EQ(recording.counts.cells_left_out, 0);
}

TEST(RecordingIo, PairsWhoseDistancesDoNotRepeatAreNoted) {
  const auto notes_of = [](int alone, int repeated, const std::string& more) {
    std::string rows = "true_m,reading_m\n";
    for (int i = 0; i < alone; ++i) rows += std::to_string(1.0 + 0.01 * i) + ",1.5\n";
    for (int i = 0; i < repeated; ++i) rows += "5,5\n";
    return parse_recording({{"recording.yaml", "format: rangecal/1\nkind: pairs\nsensor: {range_max_m: 6}\n"},
                            {"pairs.csv", rows + more}})
        .notes;
  };
  const std::string head = "pairs.csv: there is no column 'batch', and ",
                    tail =
                        " readings have a true_m that no other has: what only repeats tell cannot be asked";
  EXPECT_THAT(notes_of(18, 2, ""),
              ElementsAre(head + "18 of 20" + tail));  // 90 % is hardly a repeat, 85 % is some
  EXPECT_THAT(notes_of(17, 3, ""), ::testing::IsEmpty());
  EXPECT_THAT(notes_of(1, 0, ""), ::testing::IsEmpty());
  // A distance that lost its only reading is a cell of one, cut whole; who lost one of two leaves the other out.
  EXPECT_THAT(
      notes_of(20, 0, "5.91,6.1\n5.92,6.1\n5.93,6.1\n5.93,5.9\n,7\n"),
      ElementsAre(head + "20 of 20" + tail +
                  "; 2 more were lost at a limit of the sensor, and what is left near it leans inwards"));
  EXPECT_THAT(parse_recording({{"recording.yaml", "format: rangecal/1\nkind: pairs\n"},
                               {"pairs.csv", "true_m,reading_m,batch\n1,1,a\n2,2,b\n"}})
                  .notes,
              ::testing::IsEmpty());
}

TEST(RecordingIo, BatchesAtMoreThanOneDistanceAreNoted) {
  const auto notes_of = [](const std::string& rows) {
    return parse_recording({{"recording.yaml", "format: rangecal/1\nkind: pairs\nsensor: {range_max_m: 6}\n"},
                            {"pairs.csv", "true_m,reading_m,batch\n" + rows}})
        .notes;
  };
  // Both are passed: 4.9 mm at 0.2 m are 2.4 %, 19 mm at 2 m are 0.95 %; without a batch, or not used: not asked.
  EXPECT_THAT(notes_of("0.2,0.2,a\n0.2049,0.2,a\n2,2,b\n2.019,2,b\n1,1,\n3,3,\n4,4,c\n5,7,c\n"),
              ::testing::IsEmpty());
  const std::string head = "pairs.csv, column 'true_m': batch ", tail = ": a batch is read at one distance";
  EXPECT_THAT(notes_of("1,1,x\n2.021,2,b\n1,1,x\n2,2,b\n"),
              ElementsAre(head + "'b' holds true distances from 2 to 2.021 m" + tail));
  EXPECT_THAT(
      notes_of("0.2,0.2,a\n0.2051,0.2,a\n1,1,b\n2,2,b\n"),
      ElementsAre(head + "'a' holds true distances from 0.2 to 0.2051 m" + tail + "; 1 more does as well"));
}

TEST(RecordingIo, AFolderThatCannotBeMadeIsNamed) {
  const TemporaryFolder folder;
  folder.write("file", "x");
  EXPECT_THROW(save_recording(random_landmarks_recording(0), folder.file("file/inside")), InputError);
  EXPECT_THROW(save_recording(random_landmarks_recording(0), folder.file("file")), InputError);
}

constexpr const char* kTrials =
    "true_m,reading_m,trial,dust_g\n1,1.1,mon,0\n2,2.1,mon,0\n1,1.2,\"tue, late\",5\n2,,tue,5\n2,2.2,mon,5\n";

TEST(RecordingIo, GroupsByTextsAndNumbers) {
  RecordingFolder folder;
  folder.make_pairs(kTrials);
  folder.write("recording.yaml", "format: rangecal/1\nkind: pairs\ngroup_by: [trial, dust_g]\n");
  const Recording r = load_recording(folder.path());
  EXPECT_THAT(r.groups.of, ElementsAre(0, 0, 1, 2));  // the group of the lost reading is none
  EXPECT_THAT(r.groups.labels,
              ElementsAre(ElementsAre("mon", "0"), ElementsAre("tue, late", "5"), ElementsAre("mon", "5")));
  EXPECT_TRUE(r.notes.empty()) << r.notes[0];  // of the texts of a column that says groups no note is needed
  EXPECT_TRUE(r.pairs.covariates.contains("dust_g"));  // numbers stay a covariate
  EXPECT_FALSE(r.pairs.covariates.contains("trial"));

  const RecordingFolder saved;
  save_recording(r, saved.file("again"));
  const Recording again = load_recording(saved.file("again"));
  EXPECT_EQ(again.groups.of, r.groups.of);
  EXPECT_EQ(again.groups.labels, r.groups.labels);
}

TEST(RecordingIo, GroupsOfTheCallerInPlaceOfTheFiles) {
  RecordingFolder folder;
  folder.make_pairs(kTrials);
  EXPECT_FALSE(load_recording(folder.path()).groups.stated());
  folder.write("recording.yaml", "format: rangecal/1\nkind: pairs\ngroup_by: dust_g\n");
  EXPECT_THAT(load_recording(folder.path()).groups.by, ElementsAre("dust_g"));
  EXPECT_THAT(load_recording(folder.path(), {{"trial"}}).groups.of, ElementsAre(0, 0, 1, 0));
  EXPECT_THROW(load_recording(folder.path(), {{"day"}}), InputError);
}

TEST(RecordingIo, GroupsOfLandmarksKeepTheirText) {
  RecordingFolder folder;
  folder.write("observations.csv",
               "stop,landmark,range_m,bearing_rad,day\n0,A,1,0.5,mon\n1,A,1,0.4,tue\n1,B,2,-0.5,mon\n");
  const Recording r = load_recording(folder.path(), {{"day"}});
  EXPECT_THAT(r.groups.of, ElementsAre(0, 1, 0));
  const RecordingFolder saved;
  save_recording(r, saved.file("again"));
  EXPECT_THAT(load_recording(saved.file("again")).groups.of, ElementsAre(0, 1, 0));
}

TEST(RecordingIo, AReferenceThatIsLateAndUncertain) {
  RecordingFolder folder;
  // The device's true distance runs 1 m a second from 1 m at 10 s; readings belong to half a second later.
  folder.make_pairs("true_m,reading_m,time_s,landmark\n1,1,10,A\n2,2,11,A\n5,5,10,B\n3,3,12,A\n7,7,11,B\n");
  folder.write("recording.yaml",
               "format: rangecal/1\nkind: pairs\nreference: {sigma_m: 0.005, time_offset_s: 0.5}\n");
  const Recording r = load_recording(folder.path());
  EXPECT_EQ(r.reference.sigma_m, 0.005);
  EXPECT_THAT(r.pairs.true_m, ElementsAre(1.5, 2.5, 6.0));
  EXPECT_THAT(r.pairs.reading_m, ElementsAre(1.0, 2.0, 5.0));
  EXPECT_THAT(r.counts.dropped, ElementsAre(Pair("no true distance at its time", 2)));
  EXPECT_EQ(r.counts.used, 3);
  ASSERT_FALSE(r.notes.empty());
  EXPECT_NE(r.notes[0].find("their time + 0.5 s"), std::string::npos) << r.notes[0];
}

}  // namespace
}  // namespace rangecal
