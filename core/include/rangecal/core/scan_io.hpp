// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "rangecal/core/scan.hpp"

namespace rangecal {

/// Reads a file of scans; its form is found from its content:
///   CSV, one scan a line: header `stamp, angle_min, angle_increment`, optionally `n` and `stop`, then the ranges
///     under any name to the end of the line; lines may differ in length. A last line without its end that has
///     fewer beams than its `n`, or than any scan before it, or whose last field is no number, is left out;
///   CSV, one beam a line: header with `stamp`, `angle_rad`, `range_m`, optionally `stop`; rows of one stamp that follow
///     each other are a scan. A last line without its end that lacks fields, whose last field is no number, or
///     that would be a scan of its own is left out, and so is the scan that it is of;
///   CARMEN log: FLASER, RAWLASERn and ROBOTLASERn, with the odometry they carry. A last line that ends in its middle, as
///     where a recording was cut off, is left out.
/// ScanLog::warning says what was left out; the first scan is whole, or an error.
/// Angles in radians, ranges in metres, `inf`, `nan`, 0 or nothing for a beam without a return. Scans whose angles
/// decrease are turned round, so that bearings increase. Throws InputError with file, row and column.
/// `-` is what stands on stdin. Cost: linear in the size of the file.
ScanLog read_scans(const std::string& path);

/// Adds beams from `angle_min` in steps of `increment` to the scan; a negative increment is turned round.
/// Throws InputError for a step that is 0, not finite, or so large that the beams lap a full circle twice.
void set_beams(Scan& scan, double angle_min, double increment, std::vector<double> ranges,
               const std::string& file);

}  // namespace rangecal
