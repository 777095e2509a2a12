// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace rangecal::ingest {

/// A topic of a bag, what all of its publishers sent together.
struct BagTopic {
  std::string name;
  std::string type;      ///< "sensor_msgs/LaserScan", as ROS 1 writes it: without the "msg/" of ROS 2
  std::string encoding;  ///< of its messages: "cdr", "ros1", or what else the file says
  std::uint64_t messages = 0;
};

struct BagMessage {
  const BagTopic& topic;
  std::int64_t log_time_ns;          ///< when it was recorded
  std::span<const std::byte> bytes;  ///< as encoded; valid until the next message
};

/// The messages of a recorded file, whatever its container: a ROS 1 bag, MCAP, SQLite, or a folder of these. Memory is that of one
/// chunk or message, however long the file. Throws InputError where nothing can be read; what is lost of a damaged or truncated
/// file is said by losses().
class MessageSource {
 public:
  using Take = std::function<void(const BagMessage&)>;
  using Progress = std::function<void(double share)>;  ///< of the file, 0 to 1

  virtual ~MessageSource() = default;
  /// The topics with the number of their messages, in the order of their names. Reads the whole file once where it has no index.
  virtual std::vector<BagTopic> topics() = 0;
  /// Gives every readable message of the topics of these names to `take`, in the order of the file. Messages that fail
  /// a checksum of the container are none of them. `progress` may be empty.
  virtual void read(const std::vector<std::string>& names, const Take& take, const Progress& progress) = 0;
  /// What the last topics() or read() could not read, in words for one line; empty if nothing.
  virtual std::string losses() const = 0;
  /// The container in words, and whether checksums stand behind what the last read() gave.
  virtual std::string format() const = 0;
};

/// True for a file that begins as one of the containers, or is called so (.mcap, .db3), and for any folder.
bool is_bag(const std::string& path);

/// Opens a bag by what its first bytes say. Throws InputError with one line for what is none.
std::unique_ptr<MessageSource> open_bag(const std::string& path);

/// "sensor_msgs/LaserScan" of "sensor_msgs/msg/LaserScan".
std::string type_without_msg(std::string type);

/// The topics by name; those of the same name, type and encoding as one.
std::vector<BagTopic> merged(std::vector<BagTopic> topics);

}  // namespace rangecal::ingest
