// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "bags/message_source.hpp"

namespace rangecal::ingest {

/// How a copy of a bag differs from it.
struct BagChange {
  std::string topic;     ///< whose messages are changed; every other message is copied byte for byte
  std::string keep_raw;  ///< topic for them as they were; empty: they are not kept
  /// The bytes that take the place of a message's, valid until the next call; nothing: it is left out.
  std::function<std::optional<std::span<const std::byte>>(const BagMessage&)> change;
  /// What is written of the change behind the messages, asked for when they are all copied.
  std::function<std::vector<std::pair<std::string, std::string>>()> note;
};

/// The name under which a note stands: a metadata record of MCAP, or a table of SQLite.
inline constexpr const char* kNoteName = "rangecal correct";
inline constexpr const char* kNoteTable = "rangecal_correct";

struct BagCopied {
  std::string losses;  ///< what could not be read, in words for one line; empty if nothing
  std::string format;  ///< the container in words, and whether checksums stand behind what was copied
};

/// Copies an MCAP file: chunks stay what they were, in the order of the file, by the same compression (where nothing in one
/// changed, its very bytes); messages outside of chunks come into uncompressed ones. Attachments, metadata and records of opcodes that are
/// left to others are copied byte for byte; indexes, statistics and checksums are made anew. `to` is there whole or not
/// at all. Returns what could not be read, in words for one line; empty if nothing. Throws InputError where `from` cannot be read, holds a note on
/// the same topic, or `to` cannot be written.
BagCopied copy_mcap(const std::string& from, const std::string& to, const BagChange& change,
                    const MessageSource::Progress& progress);

/// The same of an SQLite file of rosbag2: every table with its rows, as far as they can be read. Messages that are kept as they were
/// stand behind all others, with their times, by which rosbag2 plays them.
BagCopied copy_sqlite_bag(const std::string& from, const std::string& to, const BagChange& change,
                          const MessageSource::Progress& progress);

}  // namespace rangecal::ingest
