// SPDX-License-Identifier: BSD-3-Clause
#include "track/state.hpp"

#include "rangecal/core/errors.hpp"
#include "rangecal/core/json_numbers.hpp"
#include "track/saved_calibration.hpp"

namespace rangecal::app {
namespace {

using Json = nlohmann::ordered_json;
constexpr const char* format_name = "rangecal-track/1";

/// The state as JSON. What is nested deeper than any state would overrun the stack when it is handed on.
Json shallow_json(const std::string& text) {
  constexpr int deepest = 16;
  return Json::parse(text, [](int depth, Json::parse_event_t, Json&) {
    if (depth > deepest) throw InputError("is no state of 'rangecal track': it is nested too deeply");
    return true;
  });
}

ChangeAlarm alarm_in(const Json& c) {
  const auto number = [&](std::size_t i) { return whole_number<std::int64_t>(c.at(i), "changes"); };
  const int kind = whole_number(c.at(3), "changes", 0, static_cast<int>(ChangeKind::outliers));
  ChangeAlarm alarm{number(0), number(1), c.at(2), static_cast<ChangeKind>(kind), c.at(4), c.at(5), c.at(6)};
  if (alarm.named && alarm.kind == ChangeKind::encoder && c.size() > 7)  // version 0.1.0 told no phase
    alarm.phase_rad = Estimate{c.at(7), c.at(8).get<double>()};
  return alarm;
}

}  // namespace

std::string to_json(const TrackState& s) {
  Json json{{"format", format_name},
            {"header", s.header},
            {"offset", s.offset},
            {"fingerprint", s.fingerprint},
            {"line", s.line},
            {"output_bytes", s.output_bytes},
            {"rows", s.rows},
            {"corrected", s.corrected},
            {"out_of_range", s.out_of_range},
            {"malformed", s.malformed},
            {"next_estimate", s.next_estimate},
            {"tells_outliers", s.tells_outliers},
            {"asked", s.asked},
            {"stops", s.stops},
            {"calibration", s.calibration ? json_of(*s.calibration) : Json(nullptr)},
            {"watch", s.watch},
            {"changes", Json::array()},
            {"calibrator", s.calibrator}};
  for (const ChangeAlarm& c : s.changes) {
    Json alarm{c.reading, c.since, c.named, static_cast<int>(c.kind), c.probability, c.size, c.std_dev};
    if (c.phase_rad) {
      alarm.push_back(c.phase_rad->value);
      alarm.push_back(c.phase_rad->std_dev.value_or(0.0));
    }
    json["changes"].push_back(std::move(alarm));
  }
  return json.dump() + "\n";
}

TrackState state_in(const std::string& text) {
  const Json json = shallow_json(text);
  if (json.at("format") != format_name)
    throw InputError(std::string("field 'format' is not '") + format_name + "'");
  const auto count = [&](const char* key) { return whole_number<std::int64_t>(json.at(key), key); };
  TrackState s;
  s.header = json.at("header").get<std::string>();
  s.fingerprint = json.value("fingerprint", "");
  s.offset = count("offset");
  s.line = count("line");
  s.output_bytes = count("output_bytes");
  s.rows = count("rows");
  s.corrected = count("corrected");
  if (json.contains("out_of_range")) s.out_of_range = count("out_of_range");  // 0.1.0: among `corrected`
  s.malformed = count("malformed");
  s.next_estimate = count("next_estimate");
  s.tells_outliers = json.value("tells_outliers", false);
  s.asked = json.value("asked", Json());
  s.stops = json.value("stops", Json());
  if (json.at("calibration").is_object()) s.calibration = calibration_in(json.at("calibration"));
  s.watch = json.at("watch");
  for (const Json& c : json.at("changes")) s.changes.push_back(alarm_in(c));
  s.calibrator = json.at("calibrator");
  return s;
}

}  // namespace rangecal::app
