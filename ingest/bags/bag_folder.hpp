// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "bags/message_source.hpp"

namespace rangecal::ingest {

/// The files of a folder as rosbag2 records one: those that metadata.yaml lists under rosbag2_bagfile_information,
/// relative_file_paths (rosbag2_storage, BagMetadata), in that order; all *.mcap and *.db3 by the numbers in their names where there is
/// none, as where the recorder was killed. Throws InputError where there are none, and for a file outside of the folder.
std::vector<std::string> files_of_bag_folder(const std::string& folder);

/// These files one after the other. A file that is missing or cannot be read is a loss, unless it is the only one.
std::unique_ptr<MessageSource> open_bag_folder(const std::string& folder);

}  // namespace rangecal::ingest
