// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>

#include "bags/message_source.hpp"

struct sqlite3;

namespace rangecal::ingest {

/// A file that is only read, with the habits of open_sqlite_bag below. Throws InputError.
std::unique_ptr<sqlite3, int (*)(sqlite3*)> open_sqlite_to_read(const std::string& path);

/// An SQLite file of rosbag2 (github.com/ros2/rosbag2, rosbag2_storage_sqlite3, README "Storage format"): the tables
///   topics    id, name, type, serialization_format, ...
///   messages  id, topic_id, timestamp (ns), data
/// read in the order of the messages' row numbers, which is that of recording. The file has no checksums. It is not written to:
/// what SQLite would have to put right first (a `-journal` beside it) is refused; a `-wal` beside it is read with it. Views,
/// triggers and values of more than 512 MB are refused.
std::unique_ptr<MessageSource> open_sqlite_bag(const std::string& path);

}  // namespace rangecal::ingest
