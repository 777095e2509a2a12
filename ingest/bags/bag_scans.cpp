// SPDX-License-Identifier: BSD-3-Clause
#include "bags/bag_scans.hpp"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "bags/message_source.hpp"
#include "bags/ros_messages.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/scan_io.hpp"

namespace rangecal::ingest {
namespace {

constexpr const char *kLaserScan = "sensor_msgs/LaserScan", *kRange = "sensor_msgs/Range",
                     *kOdometry = "nav_msgs/Odometry", *kPoseStamped = "geometry_msgs/PoseStamped",
                     *kTransforms = "tf2_msgs/TFMessage", *kTransformsOfRos1 = "tf/tfMessage";
constexpr double kOdometryWithin_s = 1.0;

/// "/odom (nav_msgs/Odometry), /scan (sensor_msgs/LaserScan)"; of many, the first.
std::string listed(const std::vector<BagTopic>& topics) {
  constexpr std::size_t most = 20;
  std::vector<std::string> words;
  for (std::size_t i = 0; i < std::min(topics.size(), most); ++i)
    words.push_back(fmt::format("{} ({}, {} messages)", topics[i].name,
                                topics[i].type.empty() ? "of no known type" : topics[i].type,
                                topics[i].messages));
  if (topics.size() > most) words.push_back(fmt::format("and {} more", topics.size() - most));
  return words.empty() ? "none" : fmt::format("{}", fmt::join(words, ", "));
}

bool is_odometry(const std::string& type) {
  return type == kOdometry || type == kPoseStamped || type == kTransforms || type == kTransformsOfRos1;
}

}  // namespace

class BagScans::Reader {
  /// How many messages could not be used, and why the first one.
  struct LeftOut {
    std::size_t count = 0;
    std::string why;
    void add(const InputError& error) {
      if (count++ == 0) why = error.what();
    }
  };

 public:
  Reader(std::string path, BagChoice choice, std::size_t beams_kept)
      : path_(std::move(path)), choice_(std::move(choice)), beams_kept_(beams_kept) {}

  const ScanLog& log() const { return log_; }

  void survey(const Look& look) {
    log_.path = path_;
    read_messages([&](const BagMessage& message) {
      message.topic.name == topic_ ? survey_scan(message, look) : take_poses(message);
    });
    log_.format = source_->format();
    note(source_->losses());
    if (log_.scans.empty()) fail_without(topic_, scans_left_out_, "--scan");
    note_left_out(scans_left_out_, topic_);
    if (!choice_.odometry.empty()) attach_odometry();
    if (!log_.warning.empty()) log_.warning = InputError(path_, 0, "", log_.warning).what();
    source_.reset();
  }

  void read(const Take& take) {
    std::size_t next = 0;  // of the log's scans
    const auto give = [&](Scan& scan) {
      scan.odometry = log_.scans[next].odometry;
      take(next++, scan);
    };
    const auto is_next = [&](int row) { return next < log_.scans.size() && row == log_.scans[next].row; };
    if (all_kept_) {
      for (Scan& scan : kept_)
        if (is_next(scan.row)) give(scan);
      return;
    }
    number_ = 0;
    read_messages([&](const BagMessage& message) {
      if (message.topic.name != topic_ || !is_next(++number_)) return;
      std::optional<Scan> scan;
      try {
        scan = decoded(message);
      } catch (const InputError&) {
      }
      if (!scan || scan->stamp_s != log_.scans[next].stamp_s) fail("has changed while it was read");
      give(*scan);
    });
    if (next < log_.scans.size()) fail("has changed while it was read");
    source_.reset();
  }

 private:
  /// Opens the bag and reads both topics, each time in the same way, so that the same messages come.
  void read_messages(const MessageSource::Take& take) {
    source_ = open_bag(path_);
    topic_ = choice_.scan.empty() ? only_scan() : choice_.scan;
    std::vector<std::string> names{topic_};
    if (!choice_.odometry.empty() && choice_.odometry != topic_) names.push_back(choice_.odometry);
    source_->read(names, take, choice_.progress);
    if (choice_.progress) choice_.progress(1.0);
  }

  std::string only_scan() {
    std::vector<BagTopic> topics = source_->topics();
    std::vector<std::string> scans;
    for (const BagTopic& topic : topics)
      if (topic.type == kLaserScan && (scans.empty() || scans.back() != topic.name))
        scans.push_back(topic.name);
    if (scans.empty())
      fail(fmt::format("holds no sensor_msgs/LaserScan; its topics: {}{}", listed(topics), loss_clause()));
    if (scans.size() > 1)
      fail(fmt::format("choose one of its topics of scans by --scan: {}", fmt::join(scans, ", ")));
    return scans.front();
  }

  Wire wire_of(const BagTopic& topic) const {
    if (topic.encoding == "cdr") return Wire::cdr;
    if (topic.encoding == "ros1") return Wire::ros1;
    fail(fmt::format("topic {} is encoded as '{}'; read are cdr (ROS 2) and ros1", topic.name,
                     topic.encoding));
  }

  void survey_scan(const BagMessage& message, const Look& look) {
    if (message.topic.type == kRange)
      fail(fmt::format("topic {} is of {}: single distances, in which there is no cylinder to find",
                       message.topic.name, kRange));
    if (message.topic.type != kLaserScan)
      fail(fmt::format("topic {} is of {}, not of {}", message.topic.name, message.topic.type, kLaserScan));
    ++number_;
    Scan scan;
    try {
      scan = decoded(message);
    } catch (const InputError& error) {
      scans_left_out_.add(error);
      return;
    }
    look(scan);
    log_.scans.push_back(head_of(scan));
    beams_ += scan.size();
    if (beams_ > beams_kept_ && all_kept_) all_kept_ = false, kept_ = {};
    if (all_kept_) kept_.push_back(std::move(scan));
  }

  /// The scan with the number of its message in place of a row.
  Scan decoded(const BagMessage& message) const {
    LaserScanMessage found = read_laser_scan(message.bytes, wire_of(message.topic));
    Scan scan;
    scan.stamp_s = stamp(found.stamp_s, message), scan.row = number_;
    std::vector<double> ranges(found.range_m.begin(), found.range_m.end());
    for (double& range : ranges)
      if (range < found.range_min_m || range > found.range_max_m)
        range = std::numeric_limits<double>::infinity();
    if (!std::isfinite(found.angle_min_rad)) throw InputError("its angle_min is not finite");
    set_beams(scan, found.angle_min_rad, found.angle_increment_rad, std::move(ranges), path_);
    return scan;
  }

  void take_poses(const BagMessage& message) {
    const std::string& type = message.topic.type;
    if (!is_odometry(type))
      fail(fmt::format("topic {} is of {}; odometry is {}, {} or {}", message.topic.name, type, kOdometry,
                       kPoseStamped, kTransforms));
    try {
      const Wire wire = wire_of(message.topic);
      if (type == kOdometry) {
        keep(read_odometry(message.bytes, wire), message);
      } else if (type == kPoseStamped) {
        keep(read_pose_stamped(message.bytes, wire), message);
      } else {
        for (const DatedPose& one : read_transforms(message.bytes, wire)) keep(one, message);
      }
    } catch (const InputError& error) {
      poses_left_out_.add(error);
    }
  }

  void keep(const DatedPose& found, const BagMessage& message) {
    const bool transforms = message.topic.type == kTransforms || message.topic.type == kTransformsOfRos1;
    const std::string frames = transforms ? bare(found.parent) + "," + bare(found.child) : "";
    if (transforms && !choice_.frames.empty() && frames != choice_.frames) {
      others_.emplace(frames, true);
      return;
    }
    poses_[frames].emplace_back(stamp(found.stamp_s, message), found.pose);
  }
  static std::string bare(const std::string& frame) {  // tf of ROS 1 wrote frames with a slash
    return frame.starts_with("/") ? frame.substr(1) : frame;
  }
  static double stamp(double header_s, const BagMessage& message) {
    return header_s != 0.0 ? header_s : 1e-9 * static_cast<double>(message.log_time_ns);
  }

  /// The poses that were chosen, by their time.
  std::vector<std::pair<double, Pose2>> odometry() {
    if (poses_.empty() && others_.empty()) fail_without(choice_.odometry, poses_left_out_, "--odom");
    auto chosen = poses_.size() == 1 ? poses_.begin() : poses_.end();
    for (const char* usual : {"odom,base_footprint", "odom,base_link"})
      if (chosen == poses_.end()) chosen = poses_.find(usual);
    if (chosen == poses_.end()) {
      std::vector<std::string> pairs;
      for (const auto& [frames, found] : poses_) pairs.push_back(frames);
      for (const auto& [frames, found] : others_) pairs.push_back(frames);
      if (pairs.size() > 20) pairs.resize(20);
      fail(fmt::format("topic {}: choose the frames of its transforms by --frames PARENT,CHILD, one of: {}",
                       choice_.odometry, fmt::join(pairs, "  ")));
    }
    auto poses = std::move(chosen->second);
    std::stable_sort(poses.begin(), poses.end(),
                     [](const auto& a, const auto& b) { return a.first < b.first; });
    return poses;
  }

  void attach_odometry() {
    const auto poses = odometry();
    note_left_out(poses_left_out_, choice_.odometry);
    std::vector<Scan> kept;
    for (Scan& scan : log_.scans) {
      const double t = scan.stamp_s;
      const auto after = std::lower_bound(poses.begin(), poses.end(), t,
                                          [](const auto& one, double at) { return one.first < at; });
      if (after == poses.end() || after->first - t > kOdometryWithin_s) continue;
      const auto before = after == poses.begin() || after->first == t ? after : std::prev(after);
      if (before->first > t || t - before->first > kOdometryWithin_s) continue;
      const double span = after->first - before->first, share = span > 0.0 ? (t - before->first) / span : 0.0;
      const Pose2 &a = before->second, &b = after->second;
      scan.odometry = Pose2{a.x_m + share * (b.x_m - a.x_m), a.y_m + share * (b.y_m - a.y_m),
                            wrap_angle(a.heading_rad + share * wrap_angle(b.heading_rad - a.heading_rad))};
      kept.push_back(std::move(scan));
    }
    if (kept.empty())
      fail(fmt::format(
          "no scan lies between two messages of {} within {} s of it: the scans run from {:.3f} to {:.3f} s, "
          "the poses from {:.3f} to {:.3f} s",
          choice_.odometry, kOdometryWithin_s, log_.scans.front().stamp_s, log_.scans.back().stamp_s,
          poses.front().first, poses.back().first));
    if (kept.size() < log_.scans.size())
      note(fmt::format(
          "{} of {} scans do not lie between two messages of {} within {} s of them, and are left out",
          log_.scans.size() - kept.size(), log_.scans.size(), choice_.odometry, kOdometryWithin_s));
    log_.scans = std::move(kept);
  }

  void note(const std::string& what) {
    if (!what.empty()) log_.warning += (log_.warning.empty() ? "" : "; ") + what;
  }
  void note_left_out(const LeftOut& left_out, const std::string& topic) {
    if (left_out.count > 0)
      note(fmt::format("{} {} of {} cannot be used and {} left out (the first: {})", left_out.count,
                       left_out.count == 1 ? "message" : "messages", topic,
                       left_out.count == 1 ? "is" : "are", left_out.why));
  }
  /// Nothing of a topic could be used.
  [[noreturn]] void fail_without(const std::string& topic, const LeftOut& left_out, const char* option) {
    if (left_out.count > 0)
      fail(fmt::format("no message of {} can be used ({} of them; the first: {}){}", topic, left_out.count,
                       left_out.why, loss_clause()));
    const std::vector<BagTopic> topics = source_->topics();
    fail(fmt::format("holds no readable message of {} ({}); its topics: {}{}", topic, option, listed(topics),
                     loss_clause()));
  }
  std::string loss_clause() const {
    const std::string lost = source_->losses();
    return lost.empty() ? "" : "; " + lost;
  }
  [[noreturn]] void fail(const std::string& what) const { throw InputError(path_, 0, "", what); }

  std::string path_;
  BagChoice choice_;
  std::size_t beams_kept_;
  std::unique_ptr<MessageSource> source_;
  std::string topic_;       ///< of the scans
  ScanLog log_;             ///< their heads
  std::vector<Scan> kept_;  ///< the scans of the log and of those that had no odometry, if all are
  bool all_kept_ = true;
  std::size_t beams_ = 0;
  int number_ = 0;  ///< of the message, from 1
  std::map<std::string, std::vector<std::pair<double, Pose2>>>
      poses_;                           ///< by "PARENT,CHILD" of transforms, else by ""
  std::map<std::string, bool> others_;  ///< frames that were not chosen
  LeftOut scans_left_out_, poses_left_out_;
};

BagScans::BagScans(std::string path, BagChoice choice, std::size_t beams_kept)
    : reader_(std::make_unique<Reader>(std::move(path), std::move(choice), beams_kept)) {}
BagScans::~BagScans() = default;
void BagScans::survey(const Look& look) { reader_->survey(look); }
const ScanLog& BagScans::log() const { return reader_->log(); }
void BagScans::read(const Take& take) { reader_->read(take); }

std::string describe_topics(const std::string& path) {
  const std::unique_ptr<MessageSource> source = open_bag(path);
  const std::vector<BagTopic> topics = source->topics();
  std::string out;
  for (const BagTopic& topic : topics)  // an InputError's text is one line of UTF-8, whatever the names hold
    out += InputError(topic.name, 0, "", fmt::format("{}, {} messages", topic.type, topic.messages)).what() +
           std::string("\n");
  if (const std::string lost = source->losses(); !lost.empty())
    out += InputError(path, 0, "", lost).what() + std::string("\n");
  return out;
}

}  // namespace rangecal::ingest
