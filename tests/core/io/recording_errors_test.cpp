// SPDX-License-Identifier: BSD-3-Clause
// "What goes wrong with input", line by line: the whole message, since file, row and column are the promise.
#include <gtest/gtest.h>

#include "core/io/recording_folder.hpp"

namespace rangecal {
namespace {

using test::RecordingFolder;

const std::string kObservations = "stop,landmark,repeat,range_m,bearing_rad\n";
const std::string kStops = "stop,x_m,y_m,heading_rad\n";

TEST(RecordingErrors, TheFolderItselfLoads) { EXPECT_EQ(RecordingFolder().error(), "no error"); }

TEST(RecordingErrors, MissingFolderOrFile) {
  EXPECT_THROW(load_recording("/nowhere/at/all"), InputError);
  for (const char* name : {"recording.yaml", "stops.csv", "observations.csv"}) {
    RecordingFolder folder;
    std::filesystem::remove(folder.file(name));
    EXPECT_EQ(folder.error(), std::string(name) + ": no such file");
    std::filesystem::create_directory(folder.file(name));
    EXPECT_EQ(folder.error(), std::string(name) + ": is a folder, not a file");
  }
  RecordingFolder folder;
  folder.make_pairs("");
  std::filesystem::remove(folder.file("pairs.csv"));
  EXPECT_EQ(folder.error(), "pairs.csv: no such file");
}

TEST(RecordingErrors, EmptyOrHeaderOnly) {
  const RecordingFolder folder;
  for (const std::string name : {"observations.csv", "stops.csv"}) {
    EXPECT_EQ(folder.error_with(name, ""), name + ": is empty: a header row is expected");
  }
  EXPECT_EQ(folder.error_with("observations.csv", kObservations),
            "observations.csv: holds a header and no rows");
  EXPECT_EQ(folder.error_with("stops.csv", kStops), "stops.csv: holds a header and no rows");
  EXPECT_EQ(folder.error_with("recording.yaml", ""), "recording.yaml, row 1: is not a map of keys to values");
  RecordingFolder pairs;
  pairs.make_pairs("true_m,reading_m\n");
  EXPECT_EQ(pairs.error(), "pairs.csv: holds a header and no rows");
}

TEST(RecordingErrors, BinaryJunk) {
  const RecordingFolder folder;
  const std::string junk(
      "\x7f"
      "ELF\x02\x01\x00\x00\xff\xd8",
      10);
  EXPECT_EQ(folder.error_with("observations.csv", junk), "observations.csv, row 1: is not UTF-8 text");
  EXPECT_EQ(folder.error_with("stops.csv", junk), "stops.csv, row 1: is not UTF-8 text");
  EXPECT_EQ(folder.error_with("recording.yaml", junk).rfind("recording.yaml", 0), 0u);
  EXPECT_NE(folder.error_with("recording.yaml", std::string(100000, '[')), "no error");
}

TEST(RecordingErrors, MalformedNumber) {
  const RecordingFolder folder;
  EXPECT_EQ(folder.error_with("observations.csv", kObservations + "0,A,0,1.0,0.5\n1,B,0,1.2x,0.1\n"),
            "observations.csv, row 3, column 'range_m': '1.2x' is not a number");
  EXPECT_EQ(folder.error_with("observations.csv", kObservations + "0,A,0,1.0,east\n"),
            "observations.csv, row 2, column 'bearing_rad': 'east' is not a number");
  EXPECT_EQ(folder.error_with("observations.csv", kObservations + "0,A,0.5,1.0,0.5\n"),
            "observations.csv, row 2, column 'repeat': '0.5' is not a whole number of at least 0");
  EXPECT_EQ(folder.error_with("stops.csv", kStops + "0,0,0,0\n1,?,0,0\n"),
            "stops.csv, row 3, column 'x_m': '?' is not a number");
  EXPECT_EQ(folder.error_with("stops.csv", kStops + "0,0,nan,0\n"),
            "stops.csv, row 2, column 'y_m': 'nan' is not finite");
  EXPECT_EQ(folder.error_with("observations.csv", "stop,landmark,time_s,range_m,bearing_rad\n0,A,,1.0,0.5\n"),
            "observations.csv, row 2, column 'time_s': is empty");
  RecordingFolder pairs;
  pairs.make_pairs("true_m,reading_m\n1.0,1.1\n1.0,1,1\n");
  EXPECT_EQ(pairs.error(), "pairs.csv, row 3: has 3 fields, the header names 2");
}

TEST(RecordingErrors, MissingAndDoubledColumns) {
  const RecordingFolder folder;
  EXPECT_EQ(folder.error_with("observations.csv", "stop,landmark,bearing_rad\n0,A,1.0\n"),
            "observations.csv, row 1, column 'range_m': the column is missing");
  EXPECT_EQ(folder.error_with("observations.csv", "stop,landmark,range_m,bearing_deg\n0,A,1.0,90\n"),
            "observations.csv, row 1, column 'bearing_deg': is not read; 'bearing_rad' is");
  EXPECT_EQ(folder.error_with("stops.csv", "stop,x_m,heading_rad\n0,0,0\n"),
            "stops.csv, row 1, column 'y_m': the column is missing");
  EXPECT_EQ(folder.error_with("observations.csv", "stop,landmark,range_m,range_m,bearing_rad\n0,A,1,1,0\n"),
            "observations.csv, row 1, column 'range_m': the column is named twice");
  RecordingFolder pairs;
  pairs.make_pairs("true,reading_m\n1,1\n");
  EXPECT_EQ(pairs.error(), "pairs.csv, row 1, column 'true_m': the column is missing; there is 'true'");
  EXPECT_EQ(
      folder.error_with("stops.csv", "stop;x_m;y_m;heading_rad\n0;0;0;0\n"),
      "stops.csv, row 1, column 'stop': the column is missing: the row is one field, 'stop;x_m;y_m;heading_rad'; columns "
      "are separated by commas");
  EXPECT_EQ(folder.error_with("stops.csv", "Stop,x_m,y_m,heading_rad\n0,0,0,0\n"),
            "stops.csv, row 1, column 'stop': the column is missing; there is 'Stop'");
}

TEST(RecordingErrors, ColumnsThatWouldBeLeftOutUnsaid) {
  const RecordingFolder folder;
  EXPECT_EQ(folder.error_with("landmarks.csv", "landmark,radius_mm\nA,100\nB,100\n"),
            "landmarks.csv, row 1, column 'radius_mm': is not read; 'radius_m' is");
  EXPECT_EQ(folder.error_with("landmarks.csv", "landmark,Radius\nA,0.1\nB,0.1\n"),
            "landmarks.csv, row 1, column 'Radius': is not read; 'radius_m' is");
  EXPECT_EQ(folder.error_with("stops.csv", "stop,x_m,y_m,heading_rad,sigma_xy_cm\n0,0,0,0,1\n"),
            "stops.csv, row 1, column 'sigma_xy_cm': is not read; 'sigma_xy_m' is");
  EXPECT_EQ(folder.error_with("stops.csv", "stop,x_m,y_m,heading_deg\n0,0,0,0\n"),
            "stops.csv, row 1, column 'heading_rad': the column is missing; there is 'heading_deg'");
  // Beside the column that is read another of its kind, or a note, is the user's own.
  EXPECT_EQ(
      folder.error_with("landmarks.csv", "landmark,radius_m,radius_mm,note\nA,0.1,100,x\nB,0.1,100,y\n"),
      "no error");
}

TEST(RecordingErrors, DuplicateAndUnknownStop) {
  const RecordingFolder folder;
  EXPECT_EQ(folder.error_with("stops.csv", kStops + "0,0,0,0\n1,1,0,0\n0,2,0,0\n"),
            "stops.csv, row 4, column 'stop': stop '0' is listed twice");
  EXPECT_EQ(folder.error_with("observations.csv", kObservations + "7,A,0,1.0,0.5\n"),
            "observations.csv, row 2, column 'stop': unknown stop '7': stops.csv does not list it");
  EXPECT_EQ(folder.error_with("observations.csv", kObservations + ",A,0,1.0,0.5\n"),
            "observations.csv, row 2, column 'stop': is empty");
  EXPECT_EQ(folder.error_with("truth_stops.csv", kStops + "9,0,0,0\n"),
            "truth_stops.csv, row 2, column 'stop': unknown stop '9': stops.csv does not list it");
}

TEST(RecordingErrors, UnknownLandmark) {
  const RecordingFolder folder;
  EXPECT_EQ(
      folder.error_with("landmarks.csv", "landmark\nA\n"),
      "observations.csv, row 3, column 'landmark': unknown landmark 'B': landmarks.csv does not list it");
  EXPECT_EQ(folder.error_with("landmarks.csv", "landmark,radius_m\nA,0.1\nB,0.1\nA,0.1\n"),
            "landmarks.csv, row 4, column 'landmark': landmark 'A' is listed twice");
  EXPECT_EQ(folder.error_with("landmarks.csv", "landmark,radius_m\nA,-0.1\nB,0.1\n"),
            "landmarks.csv, row 2, column 'radius_m': is negative");
  const std::string taped =
      "format: rangecal/1\nknown_distances:\n  - {from: A, to: Z, distance_m: 1, sigma_m: 0.01}\n";
  EXPECT_EQ(folder.error_with("recording.yaml", taped),
            "recording.yaml, row 3: field 'known_distances[0].to': unknown landmark 'Z'");
  // Where no landmarks.csv says what there is, a true landmark that was never seen is no mistake.
  EXPECT_EQ(folder.error_with("truth_landmarks.csv", "landmark,x_m,y_m\nZ,0,0\n"), "no error");
  folder.write("landmarks.csv", "landmark\nA\nB\n");
  EXPECT_EQ(
      folder.error_with("truth_landmarks.csv", "landmark,x_m,y_m\nA,0,0\nZ,0,0\n"),
      "truth_landmarks.csv, row 3, column 'landmark': unknown landmark 'Z': landmarks.csv does not list it");
}

TEST(RecordingErrors, DuplicateReading) {
  EXPECT_EQ(RecordingFolder().error_with("observations.csv",
                                         kObservations + "0,A,0,1.0,0.5\n0,A,1,1.0,0.5\n0,A,0,1.1,0.5\n"),
            "observations.csv, row 4, column 'repeat': stop, landmark and repeat are those of row 2");
}

TEST(RecordingErrors, BearingInDegrees) {
  const std::string advice = "' is beyond +-2 pi rad: degrees, most likely; convert to radians";
  const RecordingFolder folder;
  EXPECT_EQ(folder.error_with("observations.csv", kObservations + "0,A,0,1.0,45\n"),
            "observations.csv, row 2, column 'bearing_rad': '45" + advice);
  EXPECT_EQ(folder.error_with("stops.csv", kStops + "0,0,0,90\n"),
            "stops.csv, row 2, column 'heading_rad': '90" + advice);
  RecordingFolder pairs;
  pairs.make_pairs("true_m,reading_m,bearing_rad\n1,1,-6.3\n");
  EXPECT_EQ(pairs.error(), "pairs.csv, row 2, column 'bearing_rad': '-6.3" + advice);
}

TEST(RecordingErrors, HeaderFile) {
  const RecordingFolder folder;
  const auto error = [&](const std::string& yaml) { return folder.error_with("recording.yaml", yaml); };
  EXPECT_EQ(error("kind: pairs\n"), "recording.yaml, row 1: field 'format': is missing");
  EXPECT_EQ(error("format: rangecal/2\n"),
            "recording.yaml, row 1: field 'format': 'rangecal/2' is not rangecal/1");
  EXPECT_EQ(error("format: rangecal/1\nkind: scans\n"),
            "recording.yaml, row 2: field 'kind': 'scans' is neither landmarks nor pairs");
  EXPECT_EQ(
      error("format: rangecal/1\nsensor:\n  range_max: 6\n"),
      "recording.yaml, row 3: field 'sensor.range_max': unknown key; known here: name, principle, range_min_m, "
      "range_max_m, unit");
  EXPECT_EQ(error("format: rangecal/1\nsensor: {range_min_m: 2, range_max_m: 1}\n"),
            "recording.yaml, row 2: field 'sensor.range_max_m': is not above range_min_m");
  EXPECT_EQ(error("format: rangecal/1\nstops: {sigma_xy_m: guess}\n"),
            "recording.yaml, row 2: field 'stops.sigma_xy_m': 'guess' is not a number");
  EXPECT_EQ(error("format: rangecal/1\nstops: {sigma_xy_m: -1}\n"),
            "recording.yaml, row 2: field 'stops.sigma_xy_m': '-1' is not a number of at least 0");
  EXPECT_EQ(error("format: rangecal/1\nformat: rangecal/1\n"),
            "recording.yaml, row 2: field 'format': the key stands twice");
  EXPECT_EQ(error("format: [\n").rfind("recording.yaml, row 2: is not YAML", 0), 0u);
}

TEST(RecordingErrors, TrueDistanceOfAPairMustBePositive) {
  RecordingFolder pairs;
  pairs.make_pairs("true_m,reading_m\n1,1\n-1,1\n");
  EXPECT_EQ(pairs.error(), "pairs.csv, row 3, column 'true_m': the true distance is not positive");
}

TEST(RecordingErrors, GroupsAndReference) {
  RecordingFolder pairs;
  pairs.make_pairs("true_m,reading_m\n1.0,1.1\n");
  const auto with = [&](const std::string& line) {
    return pairs.error_with("recording.yaml", "format: rangecal/1\nkind: pairs\n" + line + "\n");
  };
  EXPECT_EQ(with("group_by: [trial]"), "pairs.csv, row 1, column 'trial': the column is missing");
  EXPECT_EQ(with("group_by: [reading_m, reading_m]"),
            "recording.yaml, row 3: field 'group_by[1]': column 'reading_m' stands twice");
  EXPECT_EQ(with("reference: {sigma_m: -1}"),
            "recording.yaml, row 3: field 'reference.sigma_m': '-1' is not a number of at least 0");
  EXPECT_EQ(
      with("reference: {time_offset_s: 0.1}"),
      "recording.yaml, row 3: field 'reference.time_offset_s': needs times (a column time_s of pairs.csv)");
  const RecordingFolder landmarks;
  EXPECT_EQ(
      landmarks.error_with("recording.yaml", "format: rangecal/1\nreference: {sigma_m: 0.01}\n"),
      "recording.yaml, row 2: field 'reference': is how well true_m is known: it has no meaning in a recording of "
      "kind landmarks");
}

}  // namespace
}  // namespace rangecal
