// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace rangecal {

/// The bytes of a file. Throws InputError naming the file if it is missing, a folder, or cannot be read.
std::string read_file(const std::string& path);

/// Writes the text to a temporary beside `path` and renames it, so that the file is there whole or not at all.
/// Throws InputError naming the file if it cannot be written.
void write_file(const std::string& path, const std::string& text);

/// Creates the folder (and those above it). Throws InputError if it cannot.
void make_folder(const std::string& path);

/// True if a regular file of that name exists.
bool file_exists(const std::string& path);

}  // namespace rangecal
