// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "io/recording_parts.hpp"
#include "rangecal/core/csv_rows.hpp"
#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/core/stops_io.hpp"
#include "rangecal/core/write_lock.hpp"

namespace rangecal {
namespace {

// The shortest text that reads back as exactly this number (at most 17 significant digits).
std::string text_of(double value) { return std::isnan(value) ? "nan" : fmt::format("{}", value); }

std::string text_of(const std::optional<double>& value) { return value ? text_of(*value) : ""; }

class CsvText {
 public:
  explicit CsvText(const std::vector<std::string>& columns) { add(columns); }
  void add(const std::vector<std::string>& fields) {
    for (std::size_t i = 0; i < fields.size(); ++i) {
      if (i > 0) text_ += ',';
      text_ += csv_label(fields[i]);
    }
    text_ += '\n';
  }
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

/// A field of `extraction` as its node: a list or map where the text is one, else the text.
YAML::Node field_node(const std::string& text) {
  if (text.starts_with('[') || text.starts_with('{')) {
    try {
      return YAML::Load(text);
    } catch (const YAML::Exception&) {  // a text that begins like a list
    }
  }
  return YAML::Node(text);
}

std::string header_text(const Recording& recording) {
  const bool landmarks = recording.kind == RecordingKind::landmarks;
  YAML::Emitter out;
  out.SetDoublePrecision(17);
  out << YAML::BeginMap << YAML::Key << "format" << YAML::Value << "rangecal/1";
  out << YAML::Key << "kind" << YAML::Value << (landmarks ? "landmarks" : "pairs");
  const Sensor& sensor = recording.sensor;
  out << YAML::Key << "sensor" << YAML::Value << YAML::Flow << YAML::BeginMap;
  if (!sensor.name.empty()) out << YAML::Key << "name" << YAML::Value << YAML::DoubleQuoted << sensor.name;
  if (!sensor.principle.empty()) {
    out << YAML::Key << "principle" << YAML::Value << YAML::DoubleQuoted << sensor.principle;
  }
  if (!sensor.unit.empty()) out << YAML::Key << "unit" << YAML::Value << YAML::DoubleQuoted << sensor.unit;
  out << YAML::Key << "range_min_m" << YAML::Value << text_of(sensor.range_min_m);
  if (std::isfinite(sensor.range_max_m)) {
    out << YAML::Key << "range_max_m" << YAML::Value << text_of(sensor.range_max_m);
  }
  out << YAML::EndMap;
  if (landmarks) {
    out << YAML::Key << "stops" << YAML::Value << YAML::Flow << YAML::BeginMap;
    out << YAML::Key << "sigma_xy_m" << YAML::Value
        << (recording.estimate_sigma_xy ? "estimate" : text_of(recording.sigma_xy_m));
    out << YAML::Key << "sigma_heading_rad" << YAML::Value << text_of(recording.sigma_heading_rad);
    out << YAML::Key << "error" << YAML::Value
        << (recording.stop_error == StopErrorModel::random_walk ? "random_walk" : "independent")
        << YAML::EndMap;
    if (!recording.known_distances.empty()) {
      out << YAML::Key << "known_distances" << YAML::Value << YAML::BeginSeq;
      for (const KnownDistance& known : recording.known_distances) {
        const auto label = [&](int i) { return recording.landmarks[static_cast<std::size_t>(i)].label; };
        out << YAML::Flow << YAML::BeginMap;
        out << YAML::Key << "from" << YAML::Value << YAML::DoubleQuoted << label(known.from);
        out << YAML::Key << "to" << YAML::Value << YAML::DoubleQuoted << label(known.to);
        out << YAML::Key << "distance_m" << YAML::Value << text_of(known.distance_m);
        out << YAML::Key << "sigma_m" << YAML::Value << text_of(known.sigma_m) << YAML::EndMap;
      }
      out << YAML::EndSeq;
    }
  }
  if (!recording.columns.empty()) {
    out << YAML::Key << "columns" << YAML::Value << YAML::BeginMap;
    for (const auto& [name, column] : recording.columns) {
      out << YAML::Key << YAML::DoubleQuoted << name << YAML::Value << YAML::Flow << YAML::BeginMap;
      out << YAML::Key << "role" << YAML::Value << to_string(column.role);
      if (!column.unit.empty())
        out << YAML::Key << "unit" << YAML::Value << YAML::DoubleQuoted << column.unit;
      out << YAML::EndMap;
    }
    out << YAML::EndMap;
  }
  if (recording.groups.stated())
    out << YAML::Key << "group_by" << YAML::Value << YAML::Flow << recording.groups.by;
  if (recording.reference.sigma_m > 0.0)
    out << YAML::Key << "reference" << YAML::Value << YAML::Flow << YAML::BeginMap << YAML::Key << "sigma_m"
        << YAML::Value << text_of(recording.reference.sigma_m) << YAML::EndMap;
  if (!recording.extraction.empty()) {
    out << YAML::Key << "extraction" << YAML::Value << YAML::Flow << YAML::BeginMap;
    for (const auto& [field, text] : recording.extraction)
      out << YAML::Key << field << YAML::Value << field_node(text);
    out << YAML::EndMap;
  }
  out << YAML::EndMap;
  return std::string(out.c_str()) + "\n";
}

std::string stops_text(const Recording& recording) {
  bool sigma_xy = false, sigma_heading = false, place = false, covariance = false;
  for (const Stop& stop : recording.stops) {
    sigma_xy = sigma_xy || stop.sigma_xy_m;
    sigma_heading = sigma_heading || stop.sigma_heading_rad;
    place = place || !stop.place.empty();
    covariance = covariance || stop.covariance;
  }
  std::vector<std::string> columns{"stop", "x_m", "y_m", "heading_rad"};
  if (sigma_xy) columns.push_back("sigma_xy_m");
  if (sigma_heading) columns.push_back("sigma_heading_rad");
  if (place) columns.push_back("place");
  if (covariance) columns.insert(columns.end(), covariance_columns.begin(), covariance_columns.end());
  CsvText csv(columns);
  for (const Stop& stop : recording.stops) {
    std::vector<std::string> fields{stop.label, text_of(stop.commanded.x_m), text_of(stop.commanded.y_m),
                                    text_of(stop.commanded.heading_rad)};
    // A covariance stands for both sigmas; where it is set they are not.
    if (sigma_xy) fields.push_back(stop.covariance ? "" : text_of(stop.sigma_xy_m));
    if (sigma_heading) fields.push_back(stop.covariance ? "" : text_of(stop.sigma_heading_rad));
    if (place) fields.push_back(stop.place);
    if (covariance)
      for (const auto& entry : stop.covariance ? covariance_entries(*stop.covariance) : CovarianceEntries{})
        fields.push_back(text_of(entry));
    csv.add(fields);
  }
  return csv.text();
}

std::string landmarks_text(const Recording& recording) {
  bool reflectance = false;
  for (const Landmark& landmark : recording.landmarks) reflectance = reflectance || landmark.reflectance;
  CsvText csv(reflectance ? std::vector<std::string>{"landmark", "radius_m", "reflectance"}
                          : std::vector<std::string>{"landmark", "radius_m"});
  for (const Landmark& landmark : recording.landmarks) {
    std::vector<std::string> fields{landmark.label, text_of(landmark.radius_m)};
    if (reflectance) fields.push_back(text_of(landmark.reflectance));
    csv.add(fields);
  }
  return csv.text();
}

/// The columns of texts that state groups, which no other field of the recording holds.
class GroupTexts {
 public:
  GroupTexts(const Groups& groups, std::vector<std::string>& columns) : groups_(groups) {
    for (std::size_t i = 0; i < groups.by.size(); ++i) {
      if (std::find(columns.begin(), columns.end(), groups.by[i]) != columns.end()) continue;
      columns.push_back(groups.by[i]);
      written_.push_back(i);
    }
  }
  void add(std::size_t reading, std::vector<std::string>& fields) const {
    for (const std::size_t i : written_)
      fields.push_back(groups_.labels[static_cast<std::size_t>(groups_.of[reading])][i]);
  }

 private:
  const Groups& groups_;
  std::vector<std::size_t> written_;
};

std::string observations_text(const Recording& recording) {
  const Readings& readings = recording.readings;
  const bool time = !readings.time_s.empty();
  std::vector<std::string> columns{"stop", "landmark", "repeat"};
  if (time) columns.push_back("time_s");
  columns.push_back("range_m");
  const bool bearings = readings.has_bearings();
  if (bearings) columns.push_back("bearing_rad");
  for (const auto& covariate : readings.covariates) columns.push_back(covariate.first);
  const GroupTexts groups(recording.groups, columns);
  CsvText csv(columns);
  std::vector<std::string> fields;
  for (std::size_t i = 0; i < readings.size(); ++i) {
    fields = {recording.stops[static_cast<std::size_t>(readings.stop[i])].label,
              recording.landmarks[static_cast<std::size_t>(readings.landmark[i])].label,
              std::to_string(readings.repeat[i])};
    if (time) fields.push_back(text_of(readings.time_s[i]));
    fields.push_back(text_of(readings.range_m[i]));
    if (bearings) fields.push_back(text_of(readings.bearing_rad[i]));
    for (const auto& covariate : readings.covariates) fields.push_back(text_of(covariate.second[i]));
    groups.add(i, fields);
    csv.add(fields);
  }
  return csv.text();
}

std::string pairs_text(const Recording& recording) {
  const Pairs& pairs = recording.pairs;
  const bool batch = !pairs.batch.empty(), landmark = !pairs.landmark.empty();
  const bool time = !pairs.time_s.empty(), bearing = !pairs.bearing_rad.empty();
  std::vector<std::string> columns;
  if (batch) columns.push_back("batch");
  if (landmark) columns.push_back("landmark");
  if (time) columns.push_back("time_s");
  columns.insert(columns.end(), {"true_m", "reading_m"});
  if (bearing) columns.push_back("bearing_rad");
  for (const auto& covariate : pairs.covariates) columns.push_back(covariate.first);
  const GroupTexts groups(recording.groups, columns);
  CsvText csv(columns);
  std::vector<std::string> fields;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    fields.clear();
    if (batch)
      fields.push_back(pairs.batch[i] < 0 ? ""
                                          : pairs.batch_labels[static_cast<std::size_t>(pairs.batch[i])]);
    if (landmark) fields.push_back(recording.landmarks[static_cast<std::size_t>(pairs.landmark[i])].label);
    if (time) fields.push_back(text_of(pairs.time_s[i]));
    fields.push_back(text_of(pairs.true_m[i]));
    fields.push_back(text_of(pairs.reading_m[i]));
    if (bearing) fields.push_back(text_of(pairs.bearing_rad[i]));
    for (const auto& covariate : pairs.covariates) fields.push_back(text_of(covariate.second[i]));
    groups.add(i, fields);
    csv.add(fields);
  }
  return csv.text();
}

std::string truth_stops_text(const Recording& recording) {
  CsvText csv({"stop", "x_m", "y_m", "heading_rad"});
  for (std::size_t i = 0; i < recording.truth.stops.size(); ++i) {
    const auto& pose = recording.truth.stops[i];
    if (!pose) continue;
    csv.add({recording.stops[i].label, text_of(pose->x_m), text_of(pose->y_m), text_of(pose->heading_rad)});
  }
  return csv.text();
}

std::string truth_landmarks_text(const Recording& recording) {
  CsvText csv({"landmark", "x_m", "y_m"});
  for (std::size_t i = 0; i < recording.truth.landmarks.size(); ++i) {
    const auto& position = recording.truth.landmarks[i];
    if (position) csv.add({recording.landmarks[i].label, text_of(position->x()), text_of(position->y())});
  }
  return csv.text();
}

const std::string made_by = "# made by ";

}  // namespace

std::vector<std::string> recording_files(const std::vector<std::string>& folders) {
  std::vector<std::string> files;
  for (const std::string& folder : folders) {
    for (const char* name : measured_files) files.push_back(io::path_in(folder, name));
    for (const char* name : truth_files) files.push_back(io::path_in(folder, name));
  }
  return files;
}

void require_replaceable(const std::string& folder) {
  const auto has = [&](const char* name) { return file_exists(io::path_in(folder, name)); };
  if (std::none_of(measured_files.begin(), measured_files.end(), has) &&
      std::none_of(truth_files.begin(), truth_files.end(), has))
    return;
  if (has("extraction.json")) return;
  if (has("recording.yaml") && read_file(io::path_in(folder, "recording.yaml")).rfind(made_by, 0) == 0)
    return;
  throw InputError(
      folder, 0, "",
      "holds a recording that is not a simulated or extracted one, and would be lost: name another folder");
}

void save_recording(const Recording& recording, const std::string& folder, const std::string& maker) {
  make_folder(folder);
  const WriteLock lock(io::path_in(folder, ""));
  std::vector<std::pair<std::string, std::string>> files;
  std::vector<std::string> unused;  // of the format: load would take them for this recording's
  const auto put = [&](const char* name, bool wanted, std::string (*text)(const Recording&)) {
    if (wanted)
      files.emplace_back(name, text(recording));
    else
      unused.push_back(io::path_in(folder, name));
  };
  const bool landmarks = recording.kind == RecordingKind::landmarks;
  put("landmarks.csv", !recording.landmarks.empty(), landmarks_text);
  put("stops.csv", landmarks, stops_text);
  put("observations.csv", landmarks, observations_text);
  put("pairs.csv", !landmarks, pairs_text);
  const auto any = [](const auto& truths) {
    return std::any_of(truths.begin(), truths.end(), [](const auto& truth) { return truth.has_value(); });
  };
  put("truth_stops.csv", landmarks && any(recording.truth.stops), truth_stops_text);
  put("truth_landmarks.csv", landmarks && any(recording.truth.landmarks), truth_landmarks_text);
  files.emplace_back("recording.yaml",
                     (maker.empty() ? std::string() : made_by + maker + "\n") + header_text(recording));
  write_files(folder, files);
  std::error_code ignored;
  for (const std::string& path : unused) std::filesystem::remove(path, ignored);
}

}  // namespace rangecal
