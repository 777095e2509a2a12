// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/scan_io.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "rangecal/core/errors.hpp"
#include "support/temporary_folder.hpp"

namespace rangecal {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

ScanLog read_text(const std::string& text) {
  const test::TemporaryFolder folder;
  folder.write("scans", text);
  return read_scans(folder.file("scans"));
}

std::string complaint(const std::string& text) {
  try {
    read_text(text);
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(ScanCsv, OneScanALine) {
  const ScanLog log = read_text(
      "\xef\xbb\xbfstamp, angle_min,angle_increment,n,ranges...\r\n"
      "1.5,-0.02,0.01,3,1,inf,2.5\r\n"
      "\r\n"
      "1.75,0,0.02,2,nan,\r\n");
  ASSERT_EQ(log.scans.size(), 2u);
  EXPECT_EQ(log.scans[0].stamp_s, 1.5);
  EXPECT_THAT(log.scans[0].bearing_rad, ::testing::ElementsAre(-0.02, -0.01, 0.0));
  EXPECT_EQ(log.scans[0].range_m[2], 2.5);
  EXPECT_TRUE(std::isinf(log.scans[0].range_m[1]));
  EXPECT_TRUE(std::isnan(log.scans[1].range_m[0]) && std::isnan(log.scans[1].range_m[1]));
  EXPECT_EQ(log.scans[1].row, 4);
}

TEST(ScanCsv, DecreasingAnglesAreTurnedRoundAndStopsAreKept) {
  const ScanLog log = read_text("stop,stamp,angle_min,angle_increment,r0,r1\nA,0,0.1,-0.1,1,2\n");
  EXPECT_EQ(log.scans[0].stop, "A");
  EXPECT_THAT(log.scans[0].bearing_rad, ::testing::ElementsAre(0.0, 0.1));
  EXPECT_THAT(log.scans[0].range_m, ::testing::ElementsAre(2.0, 1.0));
}

TEST(ScanCsv, OneBeamALine) {
  const ScanLog log = read_text(
      "range_m,stamp,angle_rad,stop\n"
      "2,0.1,0.2,A\n1,0.1,0.1,A\n,0.1,0.3,A\n"
      "4,0.2,0.1,A\n"
      "5,0.2,0.1,B\n");
  ASSERT_EQ(log.scans.size(), 3u);
  EXPECT_THAT(log.scans[0].bearing_rad, ::testing::ElementsAre(0.1, 0.2, 0.3));
  EXPECT_EQ(log.scans[0].range_m[0], 1.0);
  EXPECT_TRUE(std::isnan(log.scans[0].range_m[2]));
  EXPECT_EQ(log.scans[2].stop, "B");
}

TEST(ScanCsv, ComplainsWithRowAndColumn) {
  const std::string head = "stamp,angle_min,angle_increment,n,ranges...\n";
  EXPECT_THAT(complaint(head + "0,0,0.01,2,1,x\n"),
              AllOf(HasSubstr("row 2"), HasSubstr("range 1"), HasSubstr("'x'")));
  EXPECT_THAT(complaint(head + "0,0,0.01,3,1,2\n"),
              AllOf(HasSubstr("row 2"), HasSubstr("'n'"), HasSubstr("2")));
  EXPECT_THAT(complaint(head + "0,0,0.01\n"), HasSubstr("no range"));
  EXPECT_THAT(complaint(head + "0,0,1,2,1,2\n"), HasSubstr("degrees"));
  EXPECT_THAT(complaint(head + "0,0,0,2,1,2\n"), HasSubstr("angle_increment"));
  EXPECT_THAT(complaint(head + "nan,0,0.01,2,1,2\n"), HasSubstr("stamp"));
  EXPECT_THAT(complaint(head), HasSubstr("no scan"));
  EXPECT_THAT(complaint("a,b\n1,2\n"), HasSubstr("no file of scans"));
  EXPECT_THAT(complaint(""), HasSubstr("empty"));
  EXPECT_THAT(complaint("stamp,angle_rad,range_m\n0,90,1\n"), HasSubstr("degrees"));
}

const std::string kWideHead = "stamp,angle_min,angle_increment,";
const std::string kWideScans = "1.5,-0.02,0.01,3,1.25,inf,2.5\n1.75,-0.02,0.01,3,1.25,1.5,2.5\n";

// Wherever the last line is cut: its scan is there if and only if all of its beams have begun.
TEST(ScanCsv, ATornLastLineIsLeftOutWithAWarning) {
  for (const bool counted : {true, false}) {
    const std::string count = counted ? "3," : "",
                      head = kWideHead + (counted ? "n," : "") + "ranges...\n1.5,-0.02,0.01," + count +
                             "1.25,inf,2.5\n1.75,-0.02,0.01," + count + "1.25,1.5,2.5\n",
                      third = "2.25,-0.02,0.01," + count + "1.75,1.5,2.75";
    for (std::size_t cut = 1; cut <= third.size(); ++cut) {
      SCOPED_TRACE(third.substr(0, cut));
      const ScanLog log = read_text(head + third.substr(0, cut));
      const bool whole = cut > third.rfind(',');
      ASSERT_EQ(log.scans.size(), whole ? 3u : 2u);
      EXPECT_EQ(log.scans[1].stamp_s, 1.75);
      if (whole)
        EXPECT_EQ(log.warning, "");
      else
        EXPECT_THAT(log.warning,
                    HasSubstr("scans, row 4: the last line is torn, as where a recording was cut "
                              "off, and is left out"));
    }
  }
}

TEST(ScanCsv, ATornLineElsewhereIsAnError) {
  const std::string head = kWideHead + "n,ranges...\n" + kWideScans;
  EXPECT_THAT(complaint(head + "2.25,-0.02,0.01,3,1.75\n"),  // it has its end
              AllOf(HasSubstr("row 4"), HasSubstr("says 3 beams, the line holds 1")));
  EXPECT_THAT(complaint(head + "2.25,-0.02,0.01,3,1.75\n2.5,-0.02,0.01,3,1,1,1"), HasSubstr("row 4"));
  EXPECT_THAT(complaint(kWideHead + "n,ranges...\n2.25,-0.02,0.01,3,1.75"),  // no scan stands before it
              AllOf(HasSubstr("row 2"), HasSubstr("says 3 beams, the line holds 1")));
  // a field that is wrong, and not the last one, was not torn; nor is a line that holds more than it says
  EXPECT_THAT(complaint(head + "2.25,-0.02,0.01,3,x,1.5"), AllOf(HasSubstr("row 4"), HasSubstr("'x'")));
  EXPECT_THAT(complaint(head + "2.25,-0.02,0.01,2,1,1,1"), HasSubstr("says 2 beams, the line holds 3"));
  // where scans differ in length, a short one is not torn for being short
  const std::string differing = kWideHead + "ranges...\n0,0,0.01,1,1,1\n1,0,0.01,1\n2,0,0.01,1,1";
  EXPECT_EQ(read_text(differing).scans.size(), 3u);
  EXPECT_EQ(read_text(differing).warning, "");
}

const std::string kBeams =
    "stamp,stop,angle_rad,range_m\n0.1,A,0.1,1\n0.1,A,0.2,2\n0.2,B,0.1,1\n0.2,B,0.2,2\n";

// Beam by beam: a line whose last field has not begun is torn, and its scan, which lacks beams, goes with it.
TEST(ScanCsv, ATornLastBeamIsLeftOutWithItsScan) {
  const std::string last = "0.2,B,0.3,2.25", other = "0.3,B,0.1,2.25";
  for (std::size_t cut = 1; cut <= last.size(); ++cut) {
    SCOPED_TRACE(last.substr(0, cut));
    const ScanLog log = read_text(kBeams + last.substr(0, cut));
    if (cut > last.rfind(',')) {
      ASSERT_EQ(log.scans.size(), 2u);
      EXPECT_EQ(log.scans[1].size(), 3u);
      EXPECT_EQ(log.warning, "");
      continue;
    }
    ASSERT_EQ(log.scans.size(), 1u);
    EXPECT_EQ(log.scans[0].size(), 2u);
    EXPECT_THAT(log.warning,
                HasSubstr("scans, row 6: the last line is torn, as where a recording was cut off, and is "
                          "left out with the scan that it is of"));
  }
  for (std::size_t cut = other.find(',') + 1; cut <= other.size(); ++cut) {  // that of another scan
    SCOPED_TRACE(other.substr(0, cut));
    const ScanLog log = read_text(kBeams + other.substr(0, cut));
    ASSERT_EQ(log.scans.size(), 2u);
    EXPECT_EQ(log.scans[1].size(), 2u);
    EXPECT_THAT(log.warning, AllOf(HasSubstr("is torn"), Not(HasSubstr("with the scan"))));
  }
  // a label that was cut short names no stop of its own
  const std::string labelled =
      "range_m,stamp,angle_rad,stop\n1,1,0.1,A\n1,2,0.1,hall\n1,2,0.2,hall\n1,2,0.3,ha";
  ASSERT_EQ(read_text(labelled).scans.size(), 1u);
  EXPECT_THAT(read_text(labelled).warning, HasSubstr("row 5: the last line is torn"));
  EXPECT_EQ(read_text(labelled + "ll\n").scans.size(), 2u);
}

TEST(ScanCsv, ABeamThatIsWrongIsAnError) {
  EXPECT_THAT(complaint(kBeams + "0.2,B,0.3\n"), HasSubstr("row 6"));  // it has its end
  EXPECT_THAT(complaint(kBeams + "0.2,B,x,2.25"),
              AllOf(HasSubstr("row 6"), HasSubstr("'angle_rad'"), HasSubstr("'x'")));
  EXPECT_THAT(complaint(kBeams + "0.2,B,90,2.25"), AllOf(HasSubstr("row 6"), HasSubstr("degrees")));
  EXPECT_THAT(complaint(kBeams + "0.2,B,0.3,2.25,7"), HasSubstr("row 6"));
  EXPECT_THAT(complaint(kBeams.substr(0, kBeams.find("0.2,B")) + "0.1,A,0.3"),
              HasSubstr("row 4"));  // the first scan
  EXPECT_THAT(complaint(kBeams + "0.2,B\n0.2,B,0.3"), HasSubstr("row 6"));
}

TEST(CarmenLog, OldAndNewMessagesWithOdometry) {
  const ScanLog log = read_text(
      "# CARMEN Logfile\n"
      "PARAM robot_width 0.4\n"
      "ODOM 0 0 0 0 0 0 1.0 host 1.0\n"
      "FLASER 4 1.0 2.0 81.9 4.0 0.1 0.2 0.3 1.1 1.2 1.3 10.5 host 0.5\n"
      "ROBOTLASER1 0 -0.5 1.0 0.5 10.0 0.01 0 3 1.0 12.0 3.0 0 5 6 0.7 5.5 6.5 0.8 0 0 0 0 0 11.5 host 1.5\n"
      "RAWLASER1 0 -0.5 1.0 0.25 10.0 0.01 0 2 1.0 2.0 2 7 8 12.5 host 2.5\n");
  ASSERT_EQ(log.scans.size(), 3u);
  EXPECT_EQ(log.lines_skipped, 2);
  // Four beams over half a circle from -90 degrees: step 180 / 4 = 45 degrees.
  EXPECT_NEAR(log.scans[0].bearing_rad[3], 0.25 * std::numbers::pi, 1e-12);
  EXPECT_FALSE(std::isfinite(log.scans[0].range_m[2]));
  EXPECT_EQ(log.scans[0].stamp_s, 10.5);
  ASSERT_TRUE(log.scans[0].odometry);
  EXPECT_EQ(log.scans[0].odometry->y_m, 1.2);
  EXPECT_THAT(log.scans[1].bearing_rad, ::testing::ElementsAre(-0.5, 0.0, 0.5));
  EXPECT_FALSE(std::isfinite(log.scans[1].range_m[1]));  // at or beyond the maximum: no return
  EXPECT_EQ(log.scans[1].odometry->heading_rad, 0.8);
  EXPECT_EQ(log.scans[2].stamp_s, 12.5);
  EXPECT_FALSE(log.scans[2].odometry);
}

TEST(CarmenLog, ComplainsAboutAShortLine) {
  EXPECT_THAT(complaint("FLASER 4 1.0 2.0 3.0\n"), AllOf(HasSubstr("row 1"), HasSubstr("the line ends")));
  EXPECT_THAT(complaint("FLASER 1.5 1.0\n"), HasSubstr("number of beams"));
}

const std::string kTwoScans =
    "FLASER 4 1.0 2.0 81.9 4.0 0.1 0.2 0.3 1.1 1.2 1.3 10.5 host 0.5\n"
    "ROBOTLASER1 0 -0.5 1.0 0.5 10.0 0.01 0 3 1.0 12.0 3.0 0 5 6 0.7 5.5 6.5 0.8 0 0 0 0 0 11.5 host 1.5\n";
const std::string kThird = "FLASER 4 1.5 2.5 3.5 4.5 0.1 0.2 0.3 1.1 1.2 1.3 12.5 host 2.5";

// Wherever the last line is cut, in its name, in front of a word, in a word or behind one: its scan is there if and only if
// all of its 15 words have begun, the last of which says nothing that is used.
TEST(CarmenLog, ATornLastLineIsLeftOutWithAWarning) {
  for (std::size_t cut = 1; cut <= kThird.size(); ++cut) {
    SCOPED_TRACE(kThird.substr(0, cut));
    const bool whole = cut > kThird.rfind(' ') + 1;
    for (const char* end : {"", "\n"}) {
      // with its end, a line may do without host and time, and is of another kind where its name is another
      if (*end != '\0' && (cut > kThird.find(" 12.5") || cut < kThird.find(' '))) continue;
      const ScanLog log = read_text(kTwoScans + kThird.substr(0, cut) + end);
      ASSERT_EQ(log.scans.size(), whole ? 3u : 2u);
      EXPECT_EQ(log.scans[1].stamp_s, 11.5);
      if (whole) {
        EXPECT_EQ(log.scans[2].stamp_s, 12.5);
        EXPECT_EQ(log.warning, "");
      } else {
        EXPECT_THAT(log.warning,
                    AllOf(HasSubstr("scans, row 3: the last line is torn"), Not(HasSubstr("\n"))));
      }
    }
  }
}

TEST(CarmenLog, ATornLineElsewhereIsAnError) {
  const std::string torn = kThird.substr(0, 20) + "\n";
  EXPECT_THAT(complaint(kTwoScans + torn + kThird + "\n"),
              AllOf(HasSubstr("row 3"), HasSubstr("the line ends")));
  EXPECT_THAT(complaint(torn),
              AllOf(HasSubstr("row 1"), HasSubstr("the line ends")));  // no scan stands before it
  // a word that is wrong, and not the last one, was not torn
  EXPECT_THAT(complaint(kTwoScans + "FLASER 4 1.0 x 3.0"),
              AllOf(HasSubstr("row 3"), HasSubstr("not a number")));
  // nor does a short line become one by the messages of other kinds behind it
  EXPECT_THAT(complaint(kTwoScans + torn + "ODOM 0 0 0 0 0 0 1.0 host 1.0\n"), HasSubstr("row 3"));
  // a line with its end was written whole: a last word that is no number is wrong, not torn
  const std::string wrong = "FLASER 4 1.5 2.5 3.5 4.5 0.1 0.2 0.3 1.1 1.2 1.3 abc";
  EXPECT_THAT(complaint(kTwoScans + wrong + "\n"),
              AllOf(HasSubstr("row 3"), HasSubstr("'abc' is not a number")));
  EXPECT_THAT(read_text(kTwoScans + wrong).warning, HasSubstr("is torn"));
}

TEST(CarmenLog, ALastLineWithoutItsEndIsWhole) {
  EXPECT_EQ(read_text(kTwoScans + kThird).warning, "");
  // a log that never names host and time is not torn for the want of them
  const std::string bare = "FLASER 4 1 2 3 4 0 0 0 0 0 0 1";
  EXPECT_EQ(read_text(bare + "2\n" + bare + "3\n").scans.size(), 2u);
  EXPECT_EQ(read_text(bare + "2").scans.size(), 1u);  // there is no other
}

// "1" of "13": nothing says that the number is all there.
TEST(CarmenLog, ATimeThatMayBeCutShortIsNotTaken) {
  const std::string bare = "FLASER 4 1 2 3 4 0 0 0 0 0 0 1";
  for (const std::string& last : std::vector<std::string>{
           bare, bare + "3", "ROBOTLASER1 0 0 1 0.5 9 0 0 2 1 2 0 0 0 0 0 0 0 0 0 0 0 0 1"}) {
    const ScanLog log = read_text(bare + "1\n" + bare + "2\n" + last);
    ASSERT_EQ(log.scans.size(), 2u) << last;
    EXPECT_EQ(log.scans.back().stamp_s, 12.0);
    EXPECT_THAT(log.warning, HasSubstr("row 3: the last line has no end, so that its time may be cut short"));
  }
}

TEST(RosBag, IsNotTakenForText) { EXPECT_THAT(complaint("#ROSBAG V2.0\n"), HasSubstr("ROS 1 bag")); }

}  // namespace
}  // namespace rangecal
