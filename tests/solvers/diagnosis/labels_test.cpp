// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/labels.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "made_recordings.hpp"
#include "rangecal/core/angles.hpp"

namespace rangecal {
namespace {

using diagnosis::misread_labels;
using diagnosis::MisreadLabel;

Recording five_landmarks(const std::string& name) { return testing::recording_of({.sigma = 0.003}, name, 1); }

/// The readings of a landmark at a stop, turned as if they were those of another.
void read_as(Recording& recording, int stop, int landmark, int instead) {
  Readings& r = recording.readings;
  const Readings before = r;
  for (std::size_t i = 0; i < r.size(); ++i) {
    if (r.stop[i] != stop || r.landmark[i] != landmark) continue;
    for (std::size_t j = 0; j < r.size(); ++j)
      if (before.stop[j] == stop && before.landmark[j] == instead && before.repeat[j] == r.repeat[i]) {
        r.range_m[i] = before.range_m[j];
        r.bearing_rad[i] = before.bearing_rad[j];
      }
  }
}

TEST(MisreadLabels, OneThatStandsWhereAnotherDoesIsFound) {
  Recording recording = five_landmarks("a misread label");
  EXPECT_TRUE(misread_labels(recording).empty());
  read_as(recording, 7, 3, 1);
  const std::vector<MisreadLabel> found = misread_labels(recording);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].stop, 7);
  EXPECT_EQ(found[0].landmark, 3);
  EXPECT_EQ(found[0].seen, 1);
  EXPECT_EQ(found[0].readings.size(), 12u);
  const Recording rest = diagnosis::without_misread(recording, found);
  EXPECT_EQ(rest.readings.size(), recording.readings.size() - 12);
  EXPECT_EQ(rest.readings.row.size(), rest.readings.size());
  EXPECT_TRUE(misread_labels(rest).empty());
}

TEST(MisreadLabels, ALandmarkThatWasMovedIsNone) {
  // From stop 18 of 20 on it stands elsewhere: two cells of a hundred.
  Recording recording = five_landmarks("a moved landmark");
  read_as(recording, 18, 3, 1);
  read_as(recording, 19, 3, 1);
  EXPECT_TRUE(misread_labels(recording).empty());
}

TEST(MisreadLabels, AStopThatIsTurnedAsAWholeIsNone) {
  Recording recording = five_landmarks("a turned stop");
  Readings& r = recording.readings;
  for (std::size_t i = 0; i < r.size(); ++i)
    if (r.stop[i] == 4) r.bearing_rad[i] = wrap_angle(r.bearing_rad[i] + 1.0);
  EXPECT_TRUE(misread_labels(recording).empty());
}

TEST(MisreadLabels, MoreThanAFiftiethIsNoMisreading) {
  Recording recording = five_landmarks("many misread labels");
  for (const int stop : {2, 5, 9}) read_as(recording, stop, 3, 1);
  EXPECT_TRUE(misread_labels(recording).empty());
}

TEST(MisreadLabels, AreLeftOutOfADiagnosisWhichSaysSo) {
  // A single one turned the whole search: it was called a landmark that moved.
  const Recording clean = five_landmarks("diagnosed");
  Recording recording = clean;
  read_as(recording, 19, 3, 1);
  const Diagnosis d = testing::verdict_of(recording);
  EXPECT_EQ(d.verdict, testing::verdict_of(clean).verdict);
  EXPECT_TRUE(std::any_of(d.notes.begin(), d.notes.end(), [](const std::string& note) {
    return note.find("12 reading(s) in a direction in which the landmark is not") != std::string::npos;
  }));
}

}  // namespace
}  // namespace rangecal
