// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <string>

#include "rangecal/core/recording.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal::ingest {

/// Writes a diagnosis of these recordings as an MCAP file for viewers (Foxglove, Lichtblick, PlotJuggler): messages in JSON, each topic with
/// its JSON schema. What a viewer draws has the schemas that it knows by name (`foxglove.`), what it plots or lists those of rangecal:
///
///   /scene           foxglove.SceneUpdate     landmarks with their radii, stops commanded and estimated, in the frame of the recording
///   /tf              foxglove.FrameTransform  where the sensor is estimated to have been, at the first reading of each stop
///   /scan            foxglove.PointCloud      the readings of a stop as read, in the sensor's frame
///   /scan_corrected  foxglove.PointCloud      the same as the final model corrects them
///   /stops           rangecal.Stop            how far each stop was moved
///   /residuals       rangecal.Residual        every reading: residuals of the seed model and of the final one, covariates
///   /finding         rangecal.Finding         verdict, names with probabilities and estimates, both fits, places
///   /log             foxglove.Log             the verdict, what was found where, and the notes, in words
///
/// The first five are of landmarks only. Time is `time_s` of the readings, or a tenth of a second a reading where there is none; a recording that would begin
/// before 0, or before the end of the one before it, is moved to one second behind that end. A frame is called `map`, of several recordings
/// `recording_1`, ... A number that is not known has no member. The file is there whole or not at all. Throws InputError where it cannot be
/// written, and as `model_residuals` does. Memory: that of the residuals, and one chunk. Cost: linear in the
/// readings.
void write_diagnosis_mcap(std::span<const Recording> recordings, const Diagnosis& diagnosis,
                          const std::string& path);

}  // namespace rangecal::ingest
