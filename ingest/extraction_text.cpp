// SPDX-License-Identifier: BSD-3-Clause
#include "extraction_text.hpp"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "text.hpp"

namespace rangecal::ingest {
namespace {

/// "216000 all: 24041 fitted, 2734 no return, ...": the total first, then the largest.
std::string tally_line(const Tally& tally, const std::string& total) {
  std::vector<std::pair<std::string, long>> parts;
  for (const auto& part : tally)
    if (part.first != total && part.second > 0) parts.push_back(part);
  std::stable_sort(parts.begin(), parts.end(),
                   [](const auto& a, const auto& b) { return a.second > b.second; });
  std::vector<std::string> words;
  for (const auto& [what, count] : parts) words.push_back(fmt::format("{} {}", count, what));
  const auto all = tally.find(total);
  return fmt::format("{}{}", all == tally.end() ? 0 : all->second, words.empty() ? "" : ": ") +
         fmt::format("{}", fmt::join(words, ", "));
}

/// What the recording holds of one landmark.
struct LandmarkSummary {
  std::set<int> stops;
  int readings = 0;
  double nearest_m = INFINITY, farthest_m = 0.0, range_sd_m = 0.0, bearing_sd_rad = 0.0, beams = 0.0;
};

std::vector<LandmarkSummary> summarise(const Recording& recording) {
  std::vector<LandmarkSummary> out(recording.landmarks.size());
  const Readings& readings = recording.readings;
  for (std::size_t i = 0; i < readings.size(); ++i) {
    LandmarkSummary& one = out[static_cast<std::size_t>(readings.landmark[i])];
    one.stops.insert(readings.stop[i]), ++one.readings;
    one.nearest_m = std::min(one.nearest_m, readings.range_m[i]);
    one.farthest_m = std::max(one.farthest_m, readings.range_m[i]);
    one.beams += readings.covariates.at("beams")[i];
    one.range_sd_m += readings.covariates.at(range_sd_column)[i];
    one.bearing_sd_rad += readings.covariates.at(bearing_sd_column)[i];
  }
  for (LandmarkSummary& one : out)
    for (double* sum : {&one.beams, &one.range_sd_m, &one.bearing_sd_rad}) *sum /= std::max(1, one.readings);
  return out;
}

std::string line(const char* what, const std::string& text) {
  return fmt::format("{:<11}{}\n", what, app::wrapped(text, 11, 100));
}

const char* arc_in_words(ArcRule arc) {
  switch (arc) {
    case ArcRule::mean:
      return "the mean of the hits, about 0.2 R behind the nearest point";
    case ArcRule::smallest:
      return "the smallest of the hits, nearer than the surface by the noise";
    case ArcRule::nearest:
      break;
  }
  return "the nearest point of the fitted circle";
}

/// "  60.0 mm", or "  59.8 +-  0.4 mm" where it was estimated.
std::string radius_text(const Extraction& extraction, std::size_t landmark) {
  const double radius = extraction.recording.landmarks[landmark].radius_m,
               sd = extraction.radius_sd_m[landmark];
  return sd > 0.0 ? fmt::format("{:6.1f} +- {:4.1f} mm", 1e3 * radius, 1e3 * sd)
                  : fmt::format("{:6.1f} mm", 1e3 * radius);
}

/// How far the estimated radii may be off in the mean [m]; 0 where none was estimated.
double mean_radius_sd_m(const Extraction& extraction) {
  double variance = 0.0;
  for (const double sd : extraction.radius_sd_m) variance += sd * sd;
  return std::sqrt(variance) / static_cast<double>(std::max<std::size_t>(1, extraction.radius_sd_m.size()));
}

}  // namespace

std::string describe(const Extraction& extraction, const ExtractOptions& options) {
  const ScanNoise& noise = extraction.noise;
  const Recording& recording = extraction.recording;
  std::string out;
  out +=
      fmt::format("stops      {}, told apart by {}\n", recording.stops.size(),
                  extraction.split == StopSplit::standing ? "standing still" : to_string(extraction.split));
  out += line("scans", tally_line(extraction.scans, "read"));
  out += fmt::format("noise      of a beam at r: sqrt(({:.2f} mm)^2 + ({:.2f} mm/m^2 r^2)^2), {}\n",
                     1e3 * noise.floor_m, 1e3 * noise.quadratic_per_m, extraction.noise_origin);
  out += line("beams", tally_line(extraction.beams, "all"));
  out += line("segments", tally_line(extraction.segments, "all"));
  out += line("cylinders", tally_line(extraction.cylinders, "found"));
  if (recording.landmarks.empty()) return out;
  out += fmt::format("range      {}\n\n", arc_in_words(options.arc));
  const double radii_sd_m = mean_radius_sd_m(extraction);
  const std::size_t wide = radii_sd_m > 0.0 ? 17 : 9;
  out += fmt::format("landmark   {:<{}} stops  readings       ranges  beams  sd range  sd bearing\n",
                     "radius", wide);
  const std::vector<LandmarkSummary> landmarks = summarise(recording);
  std::string once;
  for (std::size_t j = 0; j < landmarks.size(); ++j) {
    const LandmarkSummary& one = landmarks[j];
    if (one.stops.size() == 1) once += (once.empty() ? "" : ", ") + recording.landmarks[j].label;
    out += fmt::format("{:<10} {:<{}} {:6} {:9} {:5.2f}-{:5.2f} m {:6.1f} {:6.2f} mm {:7.3f} deg\n",
                       recording.landmarks[j].label, radius_text(extraction, j), wide, one.stops.size(),
                       one.readings, one.nearest_m, one.farthest_m, one.beams, 1e3 * one.range_sd_m,
                       one.bearing_sd_rad * 180.0 / M_PI);
  }
  if (radii_sd_m > 0.0)
    out += "\n" +
           line("radii",
                fmt::format("estimated, in the mean to {:.2g} mm (one standard deviation): alpha_0 is off by "
                            "about as much as they are, which its own standard deviation does not count; "
                            "--radius states them",
                            1e3 * radii_sd_m));
  if (!once.empty())
    out +=
        "\n" +
        line(
            "doubtful",
            once +
                ": seen from one stop, where width and bow alone say that it is a cylinder; a second stop would tell");
  return out;
}

std::string extraction_json(const Extraction& extraction, const ExtractOptions& options) {
  nlohmann::ordered_json json;
  json["format"] = "rangecal-extraction/1";
  json["arc"] = to_string(options.arc);
  json["split"] = to_string(extraction.split);
  json["noise"] = {{"floor_m", extraction.noise.floor_m},
                   {"quadratic_per_m", extraction.noise.quadratic_per_m},
                   {"origin", extraction.noise_origin}};
  json["scans"] = extraction.scans;
  json["beams"] = extraction.beams;
  json["segments"] = extraction.segments;
  json["cylinders"] = extraction.cylinders;
  json["runs_clockwise"] = extraction.runs_clockwise;
  json["landmarks"] = nlohmann::ordered_json::array();
  const std::vector<LandmarkSummary> landmarks = summarise(extraction.recording);
  for (std::size_t j = 0; j < landmarks.size(); ++j) {
    const Landmark& landmark = extraction.recording.landmarks[j];
    const Eigen::Vector2d& position = extraction.landmark_positions[j];
    json["landmarks"].push_back({{"landmark", landmark.label},
                                 {"radius_m", landmark.radius_m},
                                 {"radius_sd_m", nullptr},
                                 {"x_m", position.x()},
                                 {"y_m", position.y()},
                                 {"stops", landmarks[j].stops.size()},
                                 {"readings", landmarks[j].readings}});
    if (extraction.radius_sd_m[j] > 0.0) json["landmarks"].back()["radius_sd_m"] = extraction.radius_sd_m[j];
  }
  return json.dump(2) + "\n";
}

void note_extraction(Extraction& extraction, const ExtractOptions& options, const std::string& source) {
  const CylinderOptions& cylinder = options.cylinder;
  std::string radius = "estimated";
  if (!cylinder.radii_m.empty()) radius = fmt::format("[{}]", fmt::join(cylinder.radii_m, ", "));
  extraction.recording.extraction = {{"source", source},
                                     {"arc", to_string(options.arc)},
                                     {"radius", radius},
                                     {"edge_cut", fmt::format("{}", cylinder.edge_cut)}};
  if (mean_radius_sd_m(extraction) > 0.0) {
    std::vector<std::string> sds;
    for (const double sd : extraction.radius_sd_m) sds.push_back(fmt::format("{:.2g}", sd));
    extraction.recording.extraction["radius_sd_m"] = fmt::format("[{}]", fmt::join(sds, ", "));
  }
}

}  // namespace rangecal::ingest
