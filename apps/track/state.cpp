// SPDX-License-Identifier: BSD-3-Clause
#include "track/state.hpp"

#include "rangecal/core/errors.hpp"
#include "rangecal/core/json_fields.hpp"
#include "rangecal/core/json_numbers.hpp"
#include "track/saved_calibration.hpp"

namespace rangecal::app {
namespace {

using Json = nlohmann::ordered_json;

/// The state as JSON. What is nested deeper than any state would overrun the stack when it is handed on.
JsonFields::Read shallow_json(const std::string& text) {
  constexpr int deepest = 16;
  return JsonFields::Read::parse(text, [](int depth, JsonFields::Read::parse_event_t, JsonFields::Read&) {
    if (depth > deepest) throw InputError("is no state of 'rangecal track': it is nested too deeply");
    return true;
  });
}

Json json_of_alarm(const ChangeAlarm& c) {
  Json alarm{c.reading, c.since, c.named, static_cast<int>(c.kind), c.probability, c.size, c.std_dev};
  if (c.phase_rad) {
    alarm.push_back(c.phase_rad->value);
    alarm.push_back(c.phase_rad->std_dev.value_or(0.0));
  }
  return alarm;
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

static void fields(JsonFields& json, TrackState& s) {
  json.format({"rangecal-track/1"});
  json.required("header", s.header);
  json.whole("offset", s.offset);
  json.optional("fingerprint", s.fingerprint);  // states of 0.1.0 lack it and what else is optional
  json.whole("line", s.line);
  json.whole("output_bytes", s.output_bytes);
  json.whole("rows", s.rows);
  json.whole("corrected", s.corrected);
  json.optional("out_of_range", s.out_of_range);
  json.check(s.out_of_range >= 0, "out_of_range", "is negative");
  json.whole("malformed", s.malformed);
  json.whole("next_estimate", s.next_estimate);
  if (json.reading()) s.tells_outliers = false;
  json.optional("tells_outliers", s.tells_outliers);
  json.optional("asked", s.asked);
  json.optional("stops", s.stops);
  std::optional<SavedCalibration> saved;
  if (s.calibration) saved = SavedCalibration{*s.calibration};
  json.required("calibration", saved);
  if (saved) s.calibration = saved->calibration;
  json.required("watch", s.watch);
  std::vector<Json> changes;
  for (const ChangeAlarm& alarm : s.changes) changes.push_back(json_of_alarm(alarm));
  json.required("changes", changes);
  if (json.reading())
    for (const Json& alarm : changes) s.changes.push_back(alarm_in(alarm));
  json.required("calibrator", s.calibrator);
}

std::string to_json(const TrackState& state) { return json_of(state).dump() + "\n"; }

TrackState state_in(const std::string& text) {
  TrackState state;
  read_json(shallow_json(text), state);
  return state;
}

}  // namespace rangecal::app
