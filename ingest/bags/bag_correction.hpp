// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "rangecal/core/calibration.hpp"

namespace rangecal::ingest {

/// What of a bag is corrected.
struct BagCorrectionOptions {
  std::string topic;     ///< of sensor_msgs/LaserScan or sensor_msgs/Range; empty: the only one
  std::string keep_raw;  ///< topic for the messages as they were; empty: they are not kept
  bool clockwise =
      false;  ///< bearings of the scans run clockwise, as where the calibration's recording was extracted
  std::function<void(double share)> progress;  ///< of the bag that is read, 0 to 1; may be empty
};

/// What became of the readings.
struct BagCorrected {
  std::string topic, type;
  std::uint64_t messages = 0, left_out = 0;  ///< left_out: of messages, those that could not be decoded
  std::uint64_t readings = 0;
  std::uint64_t corrected = 0;  ///< have a distance in their place
  std::uint64_t kept = 0;  ///< are no readings: not finite, not positive, or outside the message's own limits
  std::uint64_t without_distance = 0;  ///< no distance explains them: NaN in their place
  std::uint64_t ambiguous = 0, out_of_range = 0,
                extrapolated = 0;  ///< flags of `correct`; of out_of_range also those without
  std::uint64_t extrapolated_column = 0;
  std::string format;   ///< the container in words, and whether checksums stand behind its messages
  std::string warning;  ///< in one line what was lost of a damaged bag and left out; empty if nothing
};

/// Writes a bag in which every reading y of one topic is the distance that explains it: the first of `correction_candidates`, effects
/// of the calibration undone, as a float32 (the limits of the message stay). What no distance explains becomes NaN; what is no reading
/// stays. The bearing of beam i is angle_min + i angle_increment; time counts from the topic's first message, of
/// a scan's header; a column `intensity` is the beam's. All else is copied (bag_copy.hpp), and a note says what was applied.
/// `out` is there whole or not at all. Throws InputError: an effect that needs what a scan does not hold; the topic's choice is
/// not clear; no message of it can be used; `out` cannot be written. Memory: one chunk. Cost: 10 ns a reading (`CorrectionTable`);
/// with an effect of time or intensity one correction each, 30 us.
BagCorrected correct_bag(const Calibration& calibration, const std::string& name, const std::string& in,
                         const std::string& out, const BagCorrectionOptions& options);

}  // namespace rangecal::ingest
