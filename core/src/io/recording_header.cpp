// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>

#include "io/recording_parts.hpp"
#include "rangecal/core/errors.hpp"

namespace rangecal::io {
namespace {

void read_sensor(const YamlReader& node, Sensor& sensor) {
  node.allow_only({"name", "principle", "range_min_m", "range_max_m", "unit"});
  if (node.has("name")) sensor.name = node.at("name").text();
  if (node.has("principle")) sensor.principle = node.at("principle").text();
  if (node.has("range_min_m")) sensor.range_min_m = node.at("range_min_m").not_negative();
  if (node.has("range_max_m")) {
    const YamlReader limit = node.at("range_max_m");
    sensor.range_max_m = limit.number();
    if (!(sensor.range_max_m > sensor.range_min_m)) limit.fail("is not above range_min_m");
  }
  if (node.has("unit") && node.at("unit").text() != "m") sensor.unit = node.at("unit").text();
}

void read_stop_model(const YamlReader& node, Recording& recording) {
  node.allow_only({"sigma_xy_m", "sigma_heading_rad", "error"});
  if (node.has("sigma_xy_m")) {
    const YamlReader sigma = node.at("sigma_xy_m");
    recording.estimate_sigma_xy = !sigma.is_map() && !sigma.is_list() && sigma.text() == "estimate";
    if (!recording.estimate_sigma_xy) recording.sigma_xy_m = sigma.not_negative();
  }
  if (node.has("sigma_heading_rad"))
    recording.sigma_heading_rad = node.at("sigma_heading_rad").not_negative();
  if (node.has("error")) {
    const YamlReader error = node.at("error");
    if (error.text() == "random_walk") {
      recording.stop_error = StopErrorModel::random_walk;
    } else if (error.text() != "independent") {
      error.fail("'" + error.text().substr(0, 40) + "' is neither independent nor random_walk");
    }
  }
}

TapedDistance read_taped(const YamlReader& node) {
  node.allow_only({"from", "to", "distance_m", "sigma_m"});
  TapedDistance taped;
  taped.from = node.at("from").text();
  taped.to = node.at("to").text();
  taped.distance_m = node.at("distance_m").positive();
  taped.sigma_m = node.at("sigma_m").positive();
  taped.line = node.line();
  taped.field = node.field();
  if (taped.from == taped.to) node.fail("goes from a landmark to itself");
  return taped;
}

Column read_column(const YamlReader& node, const std::string& name) {
  node.allow_only({"role", "unit"});
  Column column = column_by_name(name);
  if (node.has("role")) {
    const YamlReader role = node.at("role");
    try {
      column.role = column_role_from_string(role.text().substr(0, 40));
    } catch (const InputError& error) {
      role.fail(error.what());
    }
  }
  if (node.has("unit")) column.unit = node.at("unit").text();
  return column;
}

/// One column, or a list of them.
std::vector<std::string> read_group_by(const YamlReader& node) {
  std::vector<std::string> columns;
  if (!node.is_list()) return {node.text()};
  for (const YamlReader& item : node.items()) {
    columns.push_back(item.text());
    if (std::count(columns.begin(), columns.end(), columns.back()) > 1)
      item.fail("column '" + columns.back() + "' stands twice");
  }
  return columns;
}

void read_reference(const YamlReader& node, Recording& recording, RecordingHeader& header) {
  node.allow_only({"sigma_m", "time_offset_s"});
  if (recording.kind != RecordingKind::pairs)
    node.fail("is how well true_m is known: it has no meaning in a recording of kind landmarks");
  if (node.has("sigma_m")) recording.reference.sigma_m = node.at("sigma_m").not_negative();
  if (node.has("time_offset_s")) header.reference_offset_s = node.at("time_offset_s").number();
  header.reference_line = node.line();
}

}  // namespace

RecordingHeader read_header(const Files& files, Recording& recording) {
  RecordingHeader header;
  header.file = files.name("recording.yaml");
  const YamlReader top = files.yaml("recording.yaml");
  top.allow_only({"format", "kind", "sensor", "stops", "landmarks", "known_distances", "columns", "group_by",
                  "reference", "extraction"});
  const YamlReader format = top.at("format");
  if (format.text() != "rangecal/1") format.fail("'" + format.text().substr(0, 40) + "' is not rangecal/1");
  if (top.has("kind")) {
    const YamlReader kind = top.at("kind");
    if (kind.text() == "pairs") {
      recording.kind = RecordingKind::pairs;
    } else if (kind.text() != "landmarks") {
      kind.fail("'" + kind.text().substr(0, 40) + "' is neither landmarks nor pairs");
    }
  }
  if (top.has("sensor")) read_sensor(top.at("sensor"), recording.sensor);
  if (top.has("stops")) read_stop_model(top.at("stops"), recording);
  if (top.has("landmarks")) {
    const YamlReader landmarks = top.at("landmarks");
    landmarks.allow_only({"radius_m"});
    if (landmarks.has("radius_m")) header.landmark_radius_m = landmarks.at("radius_m").not_negative();
  }
  if (top.has("columns"))
    for (const auto& [name, node] : top.at("columns").entries())
      recording.columns[name] = read_column(node, name);
  if (top.has("group_by")) recording.groups.by = read_group_by(top.at("group_by"));
  if (top.has("reference")) read_reference(top.at("reference"), recording, header);
  if (top.has("extraction"))
    recording.extraction = top.at("extraction").texts();  // for people: of any fields
  if (top.has("known_distances")) {
    for (const YamlReader& item : top.at("known_distances").items()) header.taped.push_back(read_taped(item));
  }
  return header;
}

}  // namespace rangecal::io
