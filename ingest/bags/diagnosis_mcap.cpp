// SPDX-License-Identifier: BSD-3-Clause
#include "bags/diagnosis_mcap.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>
#include <set>
#include <tuple>
#include <vector>

#include "bags/mcap_writer.hpp"
#include "diagnosis_words.hpp"
#include "rangecal/core/version.hpp"
#include "rangecal/solvers/diagnosis/model_residuals.hpp"
#include "text.hpp"

namespace rangecal::ingest {
namespace {

using Json = nlohmann::ordered_json;

// Schemas. Viewers read a subset of JSON Schema: every member has one type, lists are of one, and objects list their members.

Json member(const char* type, const std::string& words) { return {{"type", type}, {"description", words}}; }
Json number(const std::string& words) { return member("number", words); }
Json integer(const std::string& words) { return member("integer", words); }
Json text(const std::string& words) { return member("string", words); }
Json object(const std::string& title, const std::string& words, Json properties) {
  return {
      {"title", title}, {"description", words}, {"type", "object"}, {"properties", std::move(properties)}};
}
Json list(const std::string& words, Json items) {
  return {{"type", "array"}, {"description", words}, {"items", std::move(items)}};
}
Json choice(const std::string& words, const std::vector<std::string>& names) {
  Json values = Json::array();
  for (std::size_t i = 0; i < names.size(); ++i) values.push_back({{"title", names[i]}, {"const", i}});
  return {{"description", words}, {"oneOf", values}};
}

Json clock_schema(const char* title, const std::string& words) {
  return object(title, words,
                {{"sec", integer("whole seconds")}, {"nsec", integer("nanoseconds beyond them")}});
}
Json stamp_schema() { return clock_schema("time", "when it was, as the log time of the message"); }
Json xyz_schema(const std::string& words, const char* unit = "m") {
  Json members;
  for (const char* axis : {"x", "y", "z"}) members[axis] = number(fmt::format("along {} [{}]", axis, unit));
  return object("foxglove.Vector3", words, members);
}
Json quaternion_schema() {
  Json members;
  for (const char* part : {"x", "y", "z", "w"}) members[part] = number("part of a quaternion of length 1");
  return object("foxglove.Quaternion", "how it is turned", members);
}
Json pose_schema(const std::string& words) {
  return object("foxglove.Pose", words,
                {{"position", xyz_schema("where it is")}, {"orientation", quaternion_schema()}});
}
Json colour_schema() {
  Json members;
  for (const char* part : {"r", "g", "b", "a"}) members[part] = number("red, green, blue or opacity, 0 to 1");
  return object("foxglove.Color", "its colour", members);
}
Json none_schema(const char* what) {
  return list(fmt::format("no {} are drawn", what), object(what, "not used", Json::object()));
}

Json scene_schema() {
  const Json arrow = object("foxglove.ArrowPrimitive", "an arrow along x of its pose",
                            {{"pose", pose_schema("of its tail")},
                             {"shaft_length", number("[m]")},
                             {"shaft_diameter", number("[m]")},
                             {"head_length", number("[m]")},
                             {"head_diameter", number("[m]")},
                             {"color", colour_schema()}});
  const Json cylinder = object("foxglove.CylinderPrimitive", "a cylinder about z of its pose",
                               {{"pose", pose_schema("of its middle")},
                                {"size", xyz_schema("both diameters and the height")},
                                {"bottom_scale", number("diameter below, of the stated")},
                                {"top_scale", number("diameter above, of the stated")},
                                {"color", colour_schema()}});
  const Json words = object("foxglove.TextPrimitive", "a label",
                            {{"pose", pose_schema("of its middle")},
                             {"billboard", member("boolean", "turned to who looks")},
                             {"font_size", number("[m], or pixels where scale_invariant")},
                             {"scale_invariant", member("boolean", "of one size on the screen")},
                             {"color", colour_schema()},
                             {"text", text("what it says")}});
  const Json pair = object("foxglove.KeyValuePair", "a note",
                           {{"key", text("what is said")}, {"value", text("what of it")}});
  const Json entity = object("foxglove.SceneEntity", "one landmark or stop",
                             {{"timestamp", stamp_schema()},
                              {"frame_id", text("frame in which it is drawn")},
                              {"id", text("landmark or stop with its label")},
                              {"lifetime", clock_schema("duration", "how long it is shown; 0: always")},
                              {"frame_locked", member("boolean", "moves with its frame")},
                              {"metadata", list("what a click tells", pair)},
                              {"arrows", list("poses of a stop", arrow)},
                              {"cubes", none_schema("cubes")},
                              {"spheres", none_schema("spheres")},
                              {"cylinders", list("a landmark", cylinder)},
                              {"lines", none_schema("lines")},
                              {"triangles", none_schema("triangles")},
                              {"texts", list("labels", words)},
                              {"models", none_schema("models")}});
  return object("foxglove.SceneUpdate", "landmarks and stops",
                {{"deletions", none_schema("deletions")}, {"entities", list("what is drawn", entity)}});
}

Json transform_schema() {
  return object("foxglove.FrameTransform", "where the sensor stood, as it was estimated",
                {{"timestamp", stamp_schema()},
                 {"parent_frame_id", text("frame of the recording")},
                 {"child_frame_id", text("frame of the sensor")},
                 {"translation", xyz_schema("of the sensor in the frame of the recording")},
                 {"rotation", quaternion_schema()}});
}

Json cloud_schema() {
  const Json field = object(
      "foxglove.PackedElementField", "a number that every point has",
      {{"name", text("what it is")},
       {"offset", integer("byte of the point at which it begins")},
       {"type", choice("how it is written, little endian", {"UNKNOWN", "UINT8", "INT8", "UINT16", "INT16",
                                                            "UINT32", "INT32", "FLOAT32", "FLOAT64"})}});
  Json data = text("the points, in base64");
  data["contentEncoding"] = "base64";
  return object("foxglove.PointCloud", "the readings of one stop",
                {{"timestamp", stamp_schema()},
                 {"frame_id", text("frame of the sensor")},
                 {"pose", pose_schema("of the points in that frame")},
                 {"point_stride", integer("bytes of a point")},
                 {"fields", list("what a point holds", field)},
                 {"data", data}});
}

Json log_schema() {
  return object(
      "foxglove.Log", "a line in words",
      {{"timestamp", stamp_schema()},
       {"level", choice("how grave it is", {"UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"})},
       {"message", text("the line")},
       {"name", text("who says it")},
       {"file", text("empty")},
       {"line", integer("0")}});
}

Json heading_schema(const std::string& words) {
  return object("rangecal.Pose2", words,
                {{"x_m", number("[m]")},
                 {"y_m", number("[m]")},
                 {"heading_rad", number("counter-clockwise from x [rad]")}});
}
Json stop_schema() {
  return object("rangecal.Stop",
                "where the robot was commanded to be, and where it is estimated to have been",
                {{"timestamp", stamp_schema()},
                 {"recording", integer("number of the recording, from 1")},
                 {"stop", text("its label")},
                 {"readings", integer("taken there")},
                 {"commanded", heading_schema("as recording.yaml and stops.csv have it")},
                 {"estimated", heading_schema("by the final model")},
                 {"moved", heading_schema("estimated less commanded")}});
}

Json residual_schema(const std::set<std::string>& covariates) {
  const auto fit = [](const std::string& words) {
    return object("rangecal.ResidualOfModel", words,
                  {{"range_m", number("reading less the model's mean [m]")},
                   {"range_std_m", number("standard deviation of one reading, as modelled [m]")},
                   {"range_z", number("the one over the other")},
                   {"bearing_rad", number("bearing less the model's mean [rad]")},
                   {"bearing_std_rad", number("standard deviation of one bearing, as modelled [rad]")},
                   {"bearing_z", number("the one over the other")}});
  };
  Json columns = Json::object();
  for (const std::string& name : covariates) columns[name] = number("column of the recording");
  return object("rangecal.Residual", "one reading, and what the models leave of it",
                {{"timestamp", stamp_schema()},
                 {"recording", integer("number of the recording, from 1")},
                 {"row", integer("line of its file, the header is 1")},
                 {"stop", text("label of the stop; empty: known distances")},
                 {"landmark", text("label of the landmark that the final model reads; may be empty")},
                 {"repeat", integer("within one stop and landmark, or one distance")},
                 {"time_s", number("as the recording has it [s]")},
                 {"range_m", number("as read [m]")},
                 {"bearing_rad", number("as read, in the sensor's frame [rad]")},
                 {"distance_m", number("true distance, known or by the final model [m]")},
                 {"corrected_m", number("what the final model makes of the reading [m]")},
                 {"before", fit("of the seed model: a curve, noise, nothing else")},
                 {"after", fit("of the final model, with what was found; missing where nothing was")},
                 {"covariates", object("rangecal.Covariates", "columns of the recording", columns)}});
}

Json finding_schema() {
  const auto fit = [](const std::string& words) {
    return object("rangecal.Fit", words,
                  {{"nll", number("negative log likelihood, stops integrated out [nats]")},
                   {"heldout_nll", number("of blocks that were left out, by the others [nats]")},
                   {"heldout_rms_range_m", number("of the means of known distances, left out [m]")},
                   {"rms_range_m", number("of the means of repeats [m]")},
                   {"rms_bearing_rad", number("of the means of repeats [rad]")},
                   {"chi_sq_per_dof", number("of the means of repeats")}});
  };
  const Json parameter = object("rangecal.Parameter", "of an effect",
                                {{"name", text("EFFECT.PARAMETER_UNIT")},
                                 {"estimate", number("in that unit")},
                                 {"std", number("standard deviation")},
                                 {"low95", number("of the 95 % interval")},
                                 {"high95", number("of the 95 % interval")},
                                 {"note", text("what is to be known of it; may be empty")}});
  const Json explanation = object("rangecal.Explanation", "a set of causes that was compared",
                                  {{"effects", list("their ids", text("id"))},
                                   {"probability", number("over the sets compared")},
                                   {"nll", number("[nats]")},
                                   {"heldout_nll", number("[nats]")},
                                   {"physics", text("what they are")},
                                   {"parameters", list("what they were estimated to be", parameter)}});
  const Json place = object("rangecal.Place", "where the seed model and the recording differ",
                            {{"channel", text("what differs")},
                             {"covariate", text("along what")},
                             {"shape", text("how")},
                             {"size", number("how much")},
                             {"unit", text("of the size")},
                             {"p_value", number("that chance makes any question look as bad")},
                             {"words", text("all of it in one line")}});
  return object("rangecal.Finding", "what rangecal diagnose found",
                {{"timestamp", stamp_schema()},
                 {"verdict", text("no_mismatch, explained, partly_explained, unexplained or unobservable")},
                 {"sentence", text("the verdict in one sentence")},
                 {"effects", list("of the final model", text("id; generic: a curve without a name"))},
                 {"explanations", list("the likeliest first", explanation)},
                 {"places", list("the clearest first", place)},
                 {"before", fit("the seed model")},
                 {"after", fit("the final model")},
                 {"heldout_gain_std", number("standard error of the held-out difference [nats]")},
                 {"notes", list("what could not be modelled, and why", text("a note"))}});
}

// Messages.

Json stamp(double time_s) {
  const double whole = std::floor(time_s);
  const auto nanoseconds = std::min(std::lround(1e9 * (time_s - whole)), 999'999'999L);
  return {{"sec", static_cast<std::int64_t>(whole)}, {"nsec", nanoseconds}};
}
void put(Json& into, const char* name, double value) {
  if (std::isfinite(value)) into[name] = value;
}
void put(Json& into, const char* name, const std::optional<double>& value) {
  if (value) put(into, name, *value);
}
Json xyz(double x, double y, double z) { return {{"x", x}, {"y", y}, {"z", z}}; }
Json turned_by(double heading_rad) {
  return {{"x", 0.0}, {"y", 0.0}, {"z", std::sin(heading_rad / 2)}, {"w", std::cos(heading_rad / 2)}};
}
Json pose_of(const Pose2& pose, double z = 0.0) {
  return {{"position", xyz(pose.x_m, pose.y_m, z)}, {"orientation", turned_by(pose.heading_rad)}};
}
Json plain_pose(const Pose2& pose) {
  return {{"x_m", pose.x_m}, {"y_m", pose.y_m}, {"heading_rad", pose.heading_rad}};
}
Json colour(double r, double g, double b, double opacity = 1.0) {
  return {{"r", r}, {"g", g}, {"b", b}, {"a", opacity}};
}

std::string base64(const std::string& bytes) {
  static constexpr char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t at = 0; at < bytes.size(); at += 3) {
    const std::size_t there = std::min<std::size_t>(3, bytes.size() - at);
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k)
      group = group << 8 | (k < there ? static_cast<unsigned char>(bytes[at + k]) : 0u);
    for (std::size_t k = 0; k < 4; ++k) out += k <= there ? digits[group >> (18 - 6 * k) & 63] : '=';
  }
  return out;
}

/// Points of so many float32 each.
class Cloud {
 public:
  explicit Cloud(std::vector<std::string> names) : names_(std::move(names)) {}
  void add(const std::vector<double>& values) {
    for (const double value : values) {
      const auto bits = std::bit_cast<std::uint32_t>(static_cast<float>(value));
      for (int k = 0; k < 4; ++k) bytes_ += static_cast<char>(bits >> 8 * k & 0xff);
    }
  }
  Json message(double time_s, const std::string& frame) const {
    constexpr int float32 = 7;
    Json fields = Json::array();
    for (std::size_t i = 0; i < names_.size(); ++i)
      fields.push_back({{"name", names_[i]}, {"offset", 4 * i}, {"type", float32}});
    return {{"timestamp", stamp(time_s)},        {"frame_id", frame}, {"pose", pose_of({})},
            {"point_stride", 4 * names_.size()}, {"fields", fields},  {"data", base64(bytes_)}};
  }

 private:
  std::vector<std::string> names_;
  std::string bytes_;
};

class DiagnosisMcap {
 public:
  DiagnosisMcap(std::span<const Recording> recordings, const Diagnosis& diagnosis, PartialFile& file)
      : diagnosis_(diagnosis),
        recordings_(relabelled(recordings, diagnosis.simulation)),
        completed_(!diagnosis.final_effects.empty()),
        model_(completed_ ? diagnosis.simulation.calibration : diagnosis.baseline),
        before_(model_residuals(recordings_, diagnosis.baseline)),
        after_(completed_ ? model_residuals(recordings_, model_, {}, diagnosis.simulation.added) : before_),
        writer_(file, "", "rangecal " + std::string(version()), "zstd") {
    for (Recording& recording : recordings_)  // whoever gets the file need not know where it was kept
      recording.path = (std::filesystem::path(recording.path) / "").parent_path().filename().string();
    set_times();
  }

  void write() {
    const bool pairs = recordings_.front().kind == RecordingKind::pairs;
    std::set<std::string> covariates;
    for (const Recording& recording : recordings_)
      for (const auto& [name, values] : covariates_of(recording)) covariates.insert(name);
    if (!pairs) {
      scene_ = topic("/scene", scene_schema());
      transforms_ = topic("/tf", transform_schema());
      scans_ = topic("/scan", cloud_schema());
      corrected_ = topic("/scan_corrected", cloud_schema());
      stops_ = topic("/stops", stop_schema());
    }
    residuals_ = topic("/residuals", residual_schema(covariates));
    finding_ = topic("/finding", finding_schema());
    log_ = topic("/log", log_schema());

    const double begin = order_.empty() ? 0.0 : times_[order_.front()];
    if (!pairs) write_scene(begin);
    write_finding(begin);
    const std::vector<LogLine> lines = log_lines();
    std::size_t said = 0;  // a millisecond apart: of several at one time a viewer shows the last
    const auto say_until = [&](double time_s) {
      for (; said < lines.size(); ++said) {
        const double at = begin + 1e-3 * static_cast<double>(said + 1);
        if (at > time_s) return;
        write_log(lines[said], at);
      }
    };
    for (const std::size_t i : order_) {
      say_until(times_[i]);
      const ReadingResidual& x = after_.readings[i];
      if (const auto stop = at_stop_.find({x.recording, x.stop}); stop != at_stop_.end()) {
        write_stop(x.recording, x.stop, stop->second, times_[i]);
        at_stop_.erase(stop);
      }
      write_residual(i);
    }
    say_until(std::numeric_limits<double>::infinity());
    writer_.finish();
  }

 private:
  static const std::vector<double>& clock_of(const Recording& recording) {
    return recording.kind == RecordingKind::pairs ? recording.pairs.time_s : recording.readings.time_s;
  }
  const Recording& recording_of(const ReadingResidual& x) const {
    return recordings_[static_cast<std::size_t>(x.recording)];
  }
  std::string frame(int recording) const {
    return recordings_.size() == 1 ? "map" : fmt::format("recording_{}", recording + 1);
  }

  /// The time of every reading, their order by it, and which readings belong to a stop.
  void set_times() {
    constexpr double apart_s = 0.1;  // readings without a time
    std::vector<double> first(recordings_.size(), HUGE_VAL), last(recordings_.size(), -HUGE_VAL);
    for (const ReadingResidual& x : after_.readings) {
      const std::vector<double>& clock = clock_of(recording_of(x));
      times_.push_back(clock.empty() ? apart_s * x.reading : clock[static_cast<std::size_t>(x.reading)]);
      const auto r = static_cast<std::size_t>(x.recording);
      first[r] = std::min(first[r], times_.back()), last[r] = std::max(last[r], times_.back());
      if (x.stop >= 0) at_stop_[{x.recording, x.stop}].push_back(times_.size() - 1);
    }
    std::vector<double> moved(recordings_.size(), 0.0);
    double end = -1.0;
    for (std::size_t r = 0; r < recordings_.size(); ++r) {
      if (first[r] > last[r]) continue;  // no readings
      if (first[r] < 0.0 || first[r] <= end) moved[r] = end + 1.0 - first[r];
      end = last[r] + moved[r];
    }
    for (std::size_t i = 0; i < times_.size(); ++i)
      times_[i] += moved[static_cast<std::size_t>(after_.readings[i].recording)];
    order_.resize(times_.size());
    std::iota(order_.begin(), order_.end(), std::size_t{0});
    std::sort(order_.begin(), order_.end(), [&](std::size_t a, std::size_t b) {
      const auto key = [&](std::size_t i) {
        return std::tuple(times_[i], after_.readings[i].recording, after_.readings[i].reading);
      };
      return key(a) < key(b);
    });
  }

  std::uint16_t topic(const std::string& name, const Json& schema) {
    return writer_.add_topic({name, "json", schema.at("title"), "jsonschema", schema.dump()});
  }
  void send(std::uint16_t topic, double time_s, const Json& message) {
    writer_.write_message(topic, static_cast<std::uint64_t>(std::llround(1e9 * time_s)), message.dump());
  }

  void write_scene(double time_s) {
    Json entities = Json::array();
    const auto add = [&](int recording, const std::string& id, const Json& metadata, Json arrows,
                         Json cylinders, const Pose2& at, double height, const std::string& label) {
      const Json words = {{"pose", pose_of({at.x_m, at.y_m, 0.0}, height)},
                          {"billboard", true},
                          {"font_size", 14.0},
                          {"scale_invariant", true},
                          {"color", colour(0.9, 0.9, 0.9)},
                          {"text", label}};
      entities.push_back({{"timestamp", stamp(time_s)},
                          {"frame_id", frame(recording)},
                          {"id", id},
                          {"lifetime", stamp(0.0)},
                          {"frame_locked", true},
                          {"metadata", metadata},
                          {"arrows", std::move(arrows)},
                          {"cubes", Json::array()},
                          {"spheres", Json::array()},
                          {"cylinders", std::move(cylinders)},
                          {"lines", Json::array()},
                          {"triangles", Json::array()},
                          {"texts", Json::array({words})},
                          {"models", Json::array()}});
    };
    const auto arrow = [](const Pose2& pose, const Json& color) {
      return Json{{"pose", pose_of(pose)}, {"shaft_length", 0.1},   {"shaft_diameter", 0.01},
                  {"head_length", 0.04},   {"head_diameter", 0.03}, {"color", color}};
    };
    for (int r = 0; r < static_cast<int>(recordings_.size()); ++r) {
      const Recording& recording = recordings_[static_cast<std::size_t>(r)];
      for (const Landmark& landmark : recording.landmarks) {
        const auto place = estimated_place(model_, r, landmark.label);
        if (!place) continue;
        constexpr double height = 0.3, least_diameter = 0.02;  // a point would not be seen
        constexpr double see_through = 0.35;                   // readings lie on the surface and behind it
        const double diameter = std::max(2.0 * landmark.radius_m, least_diameter);
        const Pose2 at{place->x(), place->y(), 0.0};
        const Json cylinder = {{"pose", pose_of(at, height / 2)},
                               {"size", xyz(diameter, diameter, height)},
                               {"bottom_scale", 1.0},
                               {"top_scale", 1.0},
                               {"color", colour(0.3, 0.6, 0.4, see_through)}};
        add(r, fmt::format("{} landmark {}", frame(r), landmark.label),
            Json::array({{{"key", "radius_m"}, {"value", fmt::format("{}", landmark.radius_m)}}}),
            Json::array(), Json::array({cylinder}), at, height + 0.05, landmark.label);
      }
      for (int k = 0; k < static_cast<int>(recording.stops.size()); ++k) {
        const Stop& stop = recording.stops[static_cast<std::size_t>(k)];
        const Pose2 at = estimated_pose(recordings_, model_, r, k);
        const double moved = std::hypot(at.x_m - stop.commanded.x_m, at.y_m - stop.commanded.y_m);
        add(r, fmt::format("{} stop {}", frame(r), stop.label),
            Json::array({{{"key", "moved_mm"}, {"value", fmt::format("{:.1f}", 1e3 * moved)}}}),
            Json::array({arrow(stop.commanded, colour(0.6, 0.6, 0.6)), arrow(at, colour(0.2, 0.5, 0.9))}),
            Json::array(), at, 0.05, stop.label);
      }
    }
    send(scene_, time_s, {{"deletions", Json::array()}, {"entities", entities}});
  }

  /// The transform, both clouds and the move of a stop, when its first reading was taken.
  void write_stop(int r, int k, const std::vector<std::size_t>& readings, double time_s) {
    const Stop& stop = recordings_[static_cast<std::size_t>(r)].stops[static_cast<std::size_t>(k)];
    const Pose2 at = estimated_pose(recordings_, model_, r, k);
    const std::string sensor = recordings_.size() == 1 ? "sensor" : fmt::format("sensor_{}", r + 1);
    send(transforms_, time_s,
         {{"timestamp", stamp(time_s)},
          {"parent_frame_id", frame(r)},
          {"child_frame_id", sensor},
          {"translation", xyz(at.x_m, at.y_m, 0.0)},
          {"rotation", turned_by(at.heading_rad)}});
    Cloud raw({"x", "y", "z", "range_m", "residual_mm"}), corrected = raw;
    for (const std::size_t i : readings) {
      const ReadingResidual& x = after_.readings[i];
      const double bearing = std::isfinite(x.bearing_rad) ? x.bearing_rad : 0.0;
      const auto add = [&](Cloud& to, double range, double direction, double residual_m) {
        to.add({range * std::cos(direction), range * std::sin(direction), 0.0, range, 1e3 * residual_m});
      };
      add(raw, x.range_m, bearing, before_.readings[i].range_residual_m);
      double direction = bearing;
      if (const auto axis = estimated_place(
              model_, r,
              recordings_[static_cast<std::size_t>(r)].landmarks[static_cast<std::size_t>(x.landmark)].label))
        direction =
            std::atan2(axis->y() - at.y_m, axis->x() - at.x_m) - at.heading_rad + x.bearing_residual_rad;
      add(corrected, x.corrected_m, direction, x.range_residual_m);
    }
    send(scans_, time_s, raw.message(time_s, sensor));
    send(corrected_, time_s, corrected.message(time_s, sensor));
    const Pose2 moved{at.x_m - stop.commanded.x_m, at.y_m - stop.commanded.y_m,
                      std::remainder(at.heading_rad - stop.commanded.heading_rad, 2.0 * std::acos(-1.0))};
    send(stops_, time_s,
         {{"timestamp", stamp(time_s)},
          {"recording", r + 1},
          {"stop", stop.label},
          {"readings", readings.size()},
          {"commanded", plain_pose(stop.commanded)},
          {"estimated", plain_pose(at)},
          {"moved", plain_pose(moved)}});
  }

  void write_residual(std::size_t i) {
    const ReadingResidual& x = after_.readings[i];
    const Recording& recording = recording_of(x);
    const auto index = static_cast<std::size_t>(x.reading);
    const auto label = [](const auto& labelled, int at) {
      return at < 0 ? std::string() : labelled[static_cast<std::size_t>(at)].label;
    };
    Json message = {{"timestamp", stamp(times_[i])},
                    {"recording", x.recording + 1},
                    {"row", x.row},
                    {"stop", label(recording.stops, x.stop)},
                    {"landmark", label(recording.landmarks, x.landmark)},
                    {"repeat", x.repeat}};
    if (const std::vector<double>& clock = clock_of(recording); !clock.empty())
      put(message, "time_s", clock[index]);
    put(message, "range_m", x.range_m);
    if (recording.kind == RecordingKind::landmarks || !recording.pairs.bearing_rad.empty())
      put(message, "bearing_rad", x.bearing_rad);
    put(message, "distance_m", x.distance_m);
    put(message, "corrected_m", x.corrected_m);
    message["before"] = residual_of(before_.readings[i]);
    if (completed_) message["after"] = residual_of(x);
    Json columns = Json::object();
    for (const auto& [name, values] : covariates_of(recording)) put(columns, name.c_str(), values[index]);
    message["covariates"] = columns;
    send(residuals_, times_[i], message);
  }
  static Json residual_of(const ReadingResidual& x) {
    Json out = Json::object();
    put(out, "range_m", x.range_residual_m);
    put(out, "range_std_m", x.range_std_m);
    put(out, "range_z", x.range_residual_m / x.range_std_m);
    if (x.stop < 0) return out;  // known distances: bearings are no readings of the model
    put(out, "bearing_rad", x.bearing_residual_rad);
    put(out, "bearing_std_rad", x.bearing_std_rad);
    put(out, "bearing_z", x.bearing_residual_rad / x.bearing_std_rad);
    return out;
  }

  std::string sentence() const {
    return diagnosis_.sentence.empty() ? verdict_sentence(diagnosis_) : diagnosis_.sentence;
  }

  void write_finding(double time_s) {
    const auto fit = [](const FitSummary& f) {
      Json out = Json::object();
      put(out, "nll", f.nll);
      put(out, "heldout_nll", f.heldout_nll);
      put(out, "heldout_rms_range_m", f.heldout_rms_range_m);
      put(out, "rms_range_m", f.rms_range_m);
      put(out, "rms_bearing_rad", f.rms_bearing_rad);
      put(out, "chi_sq_per_dof", f.chi_sq_per_dof);
      return out;
    };
    Json explanations = Json::array(), places = Json::array();
    for (const Explanation& e : diagnosis_.explanations) {
      Json parameters = Json::array();
      for (const EffectEstimate& p : e.parameters) {
        Json one = {{"name", p.name}};
        put(one, "estimate", p.estimate), put(one, "std", p.std_dev);
        put(one, "low95", p.low95), put(one, "high95", p.high95);
        one["note"] = p.note;
        parameters.push_back(one);
      }
      Json one = {{"effects", e.effects}};
      put(one, "probability", e.probability), put(one, "nll", e.nll), put(one, "heldout_nll", e.heldout_nll);
      one["physics"] = e.physics, one["parameters"] = parameters;
      explanations.push_back(one);
    }
    for (const Finding& f : diagnosis_.location) {
      Json one = {{"channel", f.channel}, {"covariate", f.covariate}, {"shape", f.shape}};
      put(one, "size", f.size);
      one["unit"] = f.unit;
      put(one, "p_value", std::max(f.p_value, Finding::least_p_value));
      one["words"] = app::finding_in_words(f);
      places.push_back(one);
    }
    Json message = {{"timestamp", stamp(time_s)},       {"verdict", to_string(diagnosis_.verdict)},
                    {"sentence", sentence()},           {"effects", diagnosis_.final_effects},
                    {"explanations", explanations},     {"places", places},
                    {"before", fit(diagnosis_.before)}, {"after", fit(diagnosis_.after)}};
    put(message, "heldout_gain_std", diagnosis_.after.heldout_std);
    message["notes"] = diagnosis_.notes;
    send(finding_, time_s, message);
  }

  struct LogLine {
    int level;
    std::string words;
  };
  /// The verdict last: after a jump in time a viewer shows the last line alone.
  std::vector<LogLine> log_lines() const {
    constexpr int info = 2, warning = 3;
    std::vector<LogLine> lines{{info, app::describe(recordings_)}};
    for (const std::string& note : diagnosis_.notes) lines.push_back({info, note});
    for (const Finding& f : diagnosis_.location) lines.push_back({warning, app::finding_in_words(f)});
    lines.push_back({diagnosis_.verdict == Verdict::no_mismatch ? info : warning, sentence()});
    return lines;
  }

  void write_log(const LogLine& line, double time_s) {
    send(log_, time_s,
         {{"timestamp", stamp(time_s)},
          {"level", line.level},
          {"message", line.words},
          {"name", "rangecal diagnose"},
          {"file", ""},
          {"line", 0}});
  }

  const Diagnosis& diagnosis_;
  std::vector<Recording> recordings_;
  bool completed_;
  const Calibration& model_;
  ModelResiduals before_, after_;
  McapWriter writer_;
  std::vector<double> times_;
  std::vector<std::size_t> order_;                                   ///< of the readings by time
  std::map<std::pair<int, int>, std::vector<std::size_t>> at_stop_;  ///< of those not written yet
  std::uint16_t scene_ = 0, transforms_ = 0, scans_ = 0, corrected_ = 0, stops_ = 0, residuals_ = 0,
                finding_ = 0, log_ = 0;
};

}  // namespace

void write_diagnosis_mcap(std::span<const Recording> recordings, const Diagnosis& diagnosis,
                          const std::string& path) {
  PartialFile file(path);
  DiagnosisMcap(recordings, diagnosis, file).write();
  file.put_in_place();
}

}  // namespace rangecal::ingest
