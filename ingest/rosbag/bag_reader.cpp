// SPDX-License-Identifier: BSD-3-Clause
#include "rosbag/bag_reader.hpp"

#include <fcntl.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <exception>
#include <map>
#include <type_traits>
#include <utility>

namespace rangecal::bag {
namespace {

constexpr std::size_t kLargest = std::size_t{512} << 20;  ///< message or list

/// What one process says to the other through a pipe: the same fields in the same order.
class Pipe {
 public:
  Pipe(int end, bool writes) : end_(end), writes_(writes) {}
  bool sound() const { return sound_; }

  template <typename Number>
  std::enable_if_t<std::is_arithmetic_v<Number>> take(Number& number) {
    bytes(&number, sizeof number);
  }
  void take(std::string& text) {
    take_size(text);
    bytes(text.data(), text.size());
  }
  void take(std::vector<Topic>& topics) {
    std::uint64_t count = topics.size();
    take(count);
    if (!writes_) topics.clear();
    for (std::uint64_t i = 0; sound_ && i < count; ++i) {
      if (!writes_) topics.emplace_back();
      Topic& topic = topics[i];
      take(topic.name), take(topic.type), take(topic.messages);
    }
  }
  void take(Message& message) {
    take(message.topic), take(message.log_time_ns), take_size(message.bytes);
    bytes(message.bytes.data(), message.bytes.size());
  }

 private:
  void bytes(void* data, std::size_t size) {
    for (std::size_t at = 0; sound_ && at < size;) {
      char* here = static_cast<char*>(data) + at;
      const ssize_t count = writes_ ? ::write(end_, here, size - at) : ::read(end_, here, size - at);
      if (count < 0 && errno == EINTR) continue;
      sound_ = count > 0;
      at += sound_ ? static_cast<std::size_t>(count) : 0;
    }
  }
  template <typename List>
  void take_size(List& list) {
    std::size_t size = list.size();
    take(size);
    sound_ = sound_ && size <= kLargest;
    if (!writes_) list.resize(sound_ ? size : 0);
  }

  int end_;
  bool writes_, sound_ = true;
};

/// The topics of a bag, with the place of each by name and type.
std::map<std::pair<std::string, std::string>, std::uint32_t> list_topics(rosbag::Bag& bag,
                                                                         std::vector<Topic>& topics) {
  std::map<std::pair<std::string, std::string>, std::uint32_t> places;
  rosbag::View all(bag);
  for (const rosbag::ConnectionInfo* connection : all.getConnections())
    if (places.emplace(std::make_pair(connection->topic, connection->datatype), topics.size()).second)
      topics.push_back({connection->topic, connection->datatype, 0});
  for (const rosbag::MessageInstance& message : all)
    ++topics[places.at({message.getTopic(), message.getDataType()})].messages;
  return places;
}

/// Why a bag cannot be read at all, or nothing and its topics; then for each message `true` and the message, then `false` and
/// why it went no further.
void read_here(Pipe& pipe, const std::string& path, const std::vector<std::string>& names) {
  std::string error;
  bool more = true, listed = false;
  try {
    rosbag::Bag bag(path, rosbag::bagmode::Read);
    std::vector<Topic> topics;
    const auto places = list_topics(bag, topics);
    pipe.take(error), pipe.take(topics), listed = true;
    rosbag::View wanted(bag, rosbag::TopicQuery(names));
    Message sent;
    for (const rosbag::MessageInstance& message : wanted) {
      if (names.empty() || !pipe.sound()) break;
      sent.topic = places.at({message.getTopic(), message.getDataType()});
      sent.log_time_ns = static_cast<std::int64_t>(message.getTime().toNSec());
      sent.bytes.resize(message.size());
      ros::serialization::OStream stream(sent.bytes.data(), static_cast<std::uint32_t>(sent.bytes.size()));
      message.write(stream);
      pipe.take(more), pipe.take(sent);
    }
  } catch (const std::exception& failure) {
    error = failure.what();
    if (error.empty()) error = "it is damaged";
  }
  more = false;
  if (listed) pipe.take(more);
  pipe.take(error);
}

[[noreturn]] void read_for_the_other(int end, const std::string& path,
                                     const std::vector<std::string>& names) {
  const int nowhere = ::open("/dev/null", O_WRONLY);
  ::dup2(nowhere, STDOUT_FILENO), ::dup2(nowhere, STDERR_FILENO);  // the library prints
#ifndef RANGECAL_FUZZING
  const rlimit memory{rlim_t{8} << 30, rlim_t{8} << 30}, seconds{600, 600};
  ::setrlimit(RLIMIT_DATA, &memory), ::setrlimit(RLIMIT_CPU, &seconds);
#endif
  Pipe pipe(end, true);
  read_here(pipe, path, names);
  ::_exit(0);
}

/// The other process; it is ended, if it still runs, and waited for.
class Child {
 public:
  explicit Child(pid_t id) : id_(id) {}
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  ~Child() {
    if (id_ > 0) ::kill(id_, SIGKILL), ended_well();
  }
  bool ended_well() {
    int status = 0;
    while (::waitpid(id_, &status, 0) < 0 && errno == EINTR) {
    }
    id_ = 0;
    return WIFEXITED(status) && WEXITSTATUS(status) == 0;
  }

 private:
  pid_t id_;
};

struct End {
  int descriptor;
  ~End() { ::close(descriptor); }
};

}  // namespace

// In a process of its own: the library believes what a bag says about itself, and a damaged one ends it by a
// signal.
std::string read(const std::string& path, const std::vector<std::string>& names, std::vector<Topic>& topics,
                 const std::function<void(const Message&)>& take) {
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) return std::strerror(errno);
  const pid_t id = ::fork();
  if (id == 0) {
    ::close(ends[0]);
    read_for_the_other(ends[1], path, names);
  }
  const std::string why = std::strerror(errno);
  ::close(ends[1]);
  const End end{ends[0]};
  if (id < 0) return "no process could be started: " + why;
  Child child(id);
  Pipe pipe(end.descriptor, false);
  std::string error;
  pipe.take(error);
  if (error.empty()) {
    pipe.take(topics);
    Message message;
    bool more = false;
    while (pipe.take(more), pipe.sound() && more) {
      pipe.take(message);
      if (!pipe.sound() || message.topic >= topics.size()) break;
      take(message);
    }
    pipe.take(error);
  }
  return pipe.sound() && child.ended_well() ? error : "it is damaged";
}

}  // namespace rangecal::bag
