// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/recording_io.hpp"
#include "support/temporary_folder.hpp"

namespace rangecal::test {

/// A small valid recording on disk whose files a test replaces one at a time.
struct RecordingFolder : TemporaryFolder {
  RecordingFolder() {
    write("recording.yaml",
          "format: rangecal/1\n"
          "kind: landmarks\n"
          "sensor: {name: s, range_min_m: 0.2, range_max_m: 6.0}\n"
          "stops: {sigma_xy_m: 0.01}\n"
          "landmarks: {radius_m: 0.1}\n");
    write("stops.csv", "stop,x_m,y_m,heading_rad\n0,0,0,0\n1,0.3,0,0\n");
    write("observations.csv", "stop,landmark,repeat,range_m,bearing_rad\n0,A,0,1.0,0.5\n1,B,0,2.0,-0.5\n");
  }
  void make_pairs(const std::string& rows) {
    write("recording.yaml",
          "format: rangecal/1\nkind: pairs\nsensor: {range_min_m: 0.2, range_max_m: 6.0}\n");
    write("pairs.csv", rows);
  }
  /// The message of loading it, with the folder's own path taken off.
  std::string error() const {
    try {
      load_recording(path());
    } catch (const InputError& caught) {
      std::string message = caught.what();
      const std::string prefix = path() + "/";
      for (std::size_t at; (at = message.find(prefix)) != std::string::npos;)
        message.erase(at, prefix.size());
      return message;
    }
    return "no error";
  }
  /// The message where, in a copy of this folder, `name` is replaced by `text`.
  std::string error_with(const std::string& name, const std::string& text) const {
    RecordingFolder other;
    using std::filesystem::copy_options;
    std::filesystem::copy(path(), other.path(), copy_options::overwrite_existing | copy_options::recursive);
    other.write(name, text);
    return other.error();
  }
};

}  // namespace rangecal::test
