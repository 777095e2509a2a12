// SPDX-License-Identifier: BSD-3-Clause
#include "bags/ros1_source.hpp"

#include <algorithm>
#include <utility>

#include "rangecal/core/errors.hpp"
#ifdef RANGECAL_WITH_ROSBAG
#include "rosbag/bag_reader.hpp"
#endif

namespace rangecal::ingest {

#ifdef RANGECAL_WITH_ROSBAG
namespace {

class Ros1Source : public MessageSource {
 public:
  explicit Ros1Source(const std::string& path) : path_(path) {}

  std::vector<BagTopic> topics() override {
    if (topics_.empty()) receive({}, [](const bag::Message&) {});
    return merged(topics_);
  }

  void read(const std::vector<std::string>& names, const Take& take, const Progress& progress) override {
    std::uint64_t count = 0, all = 0;
    receive(names, [&](const bag::Message& message) {
      if (all == 0)
        for (const BagTopic& topic : topics_)
          if (std::find(names.begin(), names.end(), topic.name) != names.end()) all += topic.messages;
      if (progress) progress(std::min(1.0, static_cast<double>(++count) / static_cast<double>(all)));
      take({topics_.at(message.topic), message.log_time_ns, std::as_bytes(std::span(message.bytes))});
    });
  }

  std::string losses() const override { return ""; }
  std::string format() const override { return "ROS 1 bag"; }

 private:
  void receive(const std::vector<std::string>& names, const std::function<void(const bag::Message&)>& take) {
    std::vector<bag::Topic> found;
    const std::string error = bag::read(path_, names, found, [&](const bag::Message& message) {
      if (topics_.empty()) keep(found);
      take(message);
    });
    if (!error.empty()) throw InputError(path_, 0, "", "cannot be read as a ROS 1 bag: " + error);
    keep(found);
  }
  void keep(const std::vector<bag::Topic>& found) {
    topics_.clear();
    for (const bag::Topic& topic : found) topics_.push_back({topic.name, topic.type, "ros1", topic.messages});
  }

  std::string path_;
  std::vector<BagTopic> topics_;
};

}  // namespace

std::unique_ptr<MessageSource> open_ros1_bag(const std::string& path) {
  return std::make_unique<Ros1Source>(path);
}
#else
std::unique_ptr<MessageSource> open_ros1_bag(const std::string& path) {
  throw InputError(
      path, 0, "",
      "is a ROS 1 bag, which this build does not read: install librosbag-storage-dev and libsensor-msgs-dev and "
      "build again, or convert it to CSV");
}
#endif

}  // namespace rangecal::ingest
