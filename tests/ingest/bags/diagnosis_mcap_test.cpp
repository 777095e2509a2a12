// SPDX-License-Identifier: BSD-3-Clause
#include "bags/diagnosis_mcap.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "bags/mcap_records.hpp"
#include "bags/mcap_source.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/physical/designs.hpp"
#include "rangecal/problems/world/physical/plants.hpp"
#include "rangecal/problems/world/physical/simulate.hpp"
#include "rangecal/solvers/diagnosis/model_residuals.hpp"
#include "support/temporary_folder.hpp"

namespace rangecal::ingest {
namespace {

using Json = nlohmann::json;
using test::TemporaryFolder;

/// A message, with the time at which it was logged.
struct Sent {
  double time_s = 0.0;
  Json json;
};

/// Messages of every topic, and the schemas by the topics that have them.
class WrittenMcap : public McapSink {
 public:
  explicit WrittenMcap(const std::string& path) {
    open_mcap(path)->copy(*this, {});
    for (const auto& [topic, messages] : messages_)
      for (const Sent& sent : messages) check(sent.json, schema(topic), topic);
  }
  const std::vector<Sent>& messages(const std::string& topic) const { return messages_.at(topic); }
  bool has(const std::string& topic) const { return messages_.contains(topic); }
  const std::vector<double>& times() const { return times_; }  ///< of all messages, in the order of the file

  void known(unsigned opcode, mcap::ByteSpan content) override { declared(opcode, content); }
  void declared(unsigned opcode, mcap::ByteSpan content) override {
    mcap::RecordFields fields(content);
    const std::uint16_t id = fields.id();
    if (opcode == mcap::op_channel) {
      const std::uint16_t schema = fields.id();
      schema_of_[fields.name()] = schema;
      EXPECT_EQ(fields.name(), "json");
      return;
    }
    const std::string name = fields.name();
    EXPECT_EQ(fields.name(), "jsonschema");
    const mcap::ByteSpan text = fields.take(fields.number(4));
    schemas_[id] = Json::parse(std::string(reinterpret_cast<const char*>(text.data()), text.size()));
    EXPECT_EQ(schemas_[id].at("title"), name);
    EXPECT_EQ(schemas_[id].at("type"), "object");
  }
  void message(const BagTopic& topic, mcap::ByteSpan content) override {
    mcap::RecordFields fields(content);
    fields.id();
    EXPECT_EQ(fields.number(4), messages_[topic.name].size());  // the sequence
    const double time = 1e-9 * static_cast<double>(fields.number(8));
    fields.number(8);
    const mcap::ByteSpan data = fields.rest();
    messages_[topic.name].push_back(
        {time, Json::parse(std::string(reinterpret_cast<const char*>(data.data()), data.size()))});
    times_.push_back(time);
  }
  void chunk_begins(const std::string& compression) override { EXPECT_EQ(compression, "zstd"); }
  void chunk_ends(mcap::ByteSpan, mcap::ByteSpan) override {}
  void other(unsigned, std::uint64_t, const Bytes&) override {}

 private:
  const Json& schema(const std::string& topic) const { return schemas_.at(schema_of_.at(topic)); }

  /// That a value is what its schema says, that all its members are described, and that the schema is one that viewers read: of
  /// one type a member.
  static void check(const Json& value, const Json& schema, const std::string& where) {
    if (schema.contains("oneOf")) {
      ASSERT_TRUE(value.is_number_integer()) << where;
      EXPECT_LT(value.get<std::size_t>(), schema["oneOf"].size()) << where;
      return;
    }
    const std::string type = schema.at("type");
    EXPECT_TRUE(schema.contains("description")) << where;
    if (type == "object") {
      ASSERT_TRUE(value.is_object()) << where;
      for (const auto& [name, member] : value.items()) {
        ASSERT_TRUE(schema.at("properties").contains(name)) << where << '.' << name;
        check(member, schema["properties"][name], where + "." + name);
      }
    } else if (type == "array") {
      ASSERT_TRUE(value.is_array()) << where;
      for (const Json& item : value) check(item, schema.at("items"), where + "[]");
    } else if (type == "number") {
      EXPECT_TRUE(value.is_number()) << where;
    } else if (type == "integer") {
      EXPECT_TRUE(value.is_number_integer()) << where;
    } else if (type == "boolean") {
      EXPECT_TRUE(value.is_boolean()) << where;
    } else {
      EXPECT_EQ(type, "string") << where;
      EXPECT_TRUE(value.is_string()) << where;
    }
  }

  std::map<std::uint16_t, Json> schemas_;
  std::map<std::string, std::uint16_t> schema_of_;
  std::map<std::string, std::vector<Sent>> messages_;
  std::vector<double> times_;
};

/// What takes the time and is not in the file.
DiagnoseOptions quick() {
  DiagnoseOptions options;
  options.held_out = options.unseen = options.next_experiments = false;
  return options;
}

/// A line design with a cover 7.5 mm off the spin axis.
Recording eccentric(const std::string& seed) {
  Random random(seed_from("diagnosis mcap"));
  world::World w = world::vary(world::make_line_design(), random);
  w = world::apply(w, "range_eccentricity", 0.0075, random);
  return world::simulate(w, seed_from(seed));
}

/// Every float32 of a cloud, `fields` of them a point.
std::vector<std::vector<double>> points_of(const Json& cloud) {
  static const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  const std::string text = cloud.at("data");
  std::string bytes;
  for (std::size_t at = 0; at < text.size(); at += 4) {
    std::uint32_t group = 0;
    int there = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      group = group << 6 | (text[at + k] == '=' ? 0u : static_cast<std::uint32_t>(digits.find(text[at + k])));
      there += text[at + k] != '=';
    }
    for (int k = 0; k + 1 < there; ++k) bytes += static_cast<char>(group >> (16 - 8 * k) & 0xff);
  }
  const std::size_t fields = cloud.at("fields").size();
  EXPECT_EQ(cloud.at("point_stride"), 4 * fields);
  EXPECT_EQ(bytes.size() % (4 * fields), 0u);
  std::vector<std::vector<double>> points(bytes.size() / 4 / fields);
  for (std::size_t i = 0; i < bytes.size() / 4; ++i) {
    float value = 0.0f;
    std::memcpy(&value, bytes.data() + 4 * i, 4);
    points[i / fields].push_back(value);
  }
  return points;
}

TEST(DiagnosisMcap, HoldsWhatWasFoundAndEveryReading) {
  const TemporaryFolder folder;
  std::vector<Recording> recordings{eccentric("run")};
  recordings[0].path = "/home/somebody/run";
  const Recording& recording = recordings[0];
  const Diagnosis diagnosis = diagnose(recordings, quick());
  ASSERT_EQ(diagnosis.verdict, Verdict::explained);
  write_diagnosis_mcap(recordings, diagnosis, folder.file("d.mcap"));
  const WrittenMcap written(folder.file("d.mcap"));
  EXPECT_TRUE(std::is_sorted(written.times().begin(), written.times().end()));

  const Json& finding = written.messages("/finding").front().json;
  EXPECT_EQ(finding.at("verdict"), "explained");
  EXPECT_EQ(finding.at("effects"), Json(diagnosis.final_effects));
  EXPECT_EQ(finding.at("explanations")[0].at("parameters").size(),
            diagnosis.explanations[0].parameters.size());
  EXPECT_EQ(finding.at("after").at("nll"), diagnosis.after.nll);
  const auto& lines = written.messages("/log");
  EXPECT_EQ(lines.back().json.at("message"), diagnosis.sentence);  // what a viewer shows after a jump
  EXPECT_EQ(lines.back().json.at("level"), 3);
  EXPECT_THAT(lines.front().json.at("message").get<std::string>(), ::testing::StartsWith("run, "));
  for (std::size_t i = 1; i < lines.size(); ++i) EXPECT_GT(lines[i].time_s, lines[i - 1].time_s);

  const ModelResiduals before = model_residuals(recordings, diagnosis.baseline);
  const ModelResiduals after =
      model_residuals(recordings, diagnosis.simulation.calibration, {}, diagnosis.simulation.added);
  std::map<int, std::size_t> of_row;
  for (std::size_t i = 0; i < after.readings.size(); ++i) of_row[after.readings[i].row] = i;
  const auto& residuals = written.messages("/residuals");
  ASSERT_EQ(residuals.size(), recording.readings.size());
  const double begin = *std::min_element(recording.readings.time_s.begin(), recording.readings.time_s.end());
  double squares_before = 0.0, squares_after = 0.0;
  for (const Sent& sent : residuals) {
    const std::size_t i = of_row.at(sent.json.at("row"));
    const auto reading = static_cast<std::size_t>(after.readings[i].reading);
    EXPECT_EQ(sent.json.at("range_m"), recording.readings.range_m[reading]);
    EXPECT_EQ(sent.json.at("time_s"), recording.readings.time_s[reading]);
    EXPECT_EQ(sent.json.at("stop"),
              recording.stops[static_cast<std::size_t>(recording.readings.stop[reading])].label);
    EXPECT_EQ(sent.json.at("before").at("range_m"), before.readings[i].range_residual_m);
    EXPECT_EQ(sent.json.at("after").at("range_m"), after.readings[i].range_residual_m);
    EXPECT_EQ(sent.json.at("after").at("bearing_rad"), after.readings[i].bearing_residual_rad);
    EXPECT_NEAR(sent.time_s - residuals.front().time_s, recording.readings.time_s[reading] - begin, 1e-6);
    squares_before += std::pow(before.readings[i].range_residual_m, 2);
    squares_after += std::pow(after.readings[i].range_residual_m, 2);
  }
  EXPECT_LT(squares_after, squares_before);
}

// By the transform of its stop, a corrected point comes to lie on its landmark's surface, to within the noise.
TEST(DiagnosisMcap, ScansStandWhereTheTransformsPutThem) {
  const TemporaryFolder folder;
  const std::vector<Recording> recordings{eccentric("run")};
  const Recording& recording = recordings[0];
  const Diagnosis diagnosis = diagnose(recordings, quick());
  write_diagnosis_mcap(recordings, diagnosis, folder.file("d.mcap"));
  const WrittenMcap written(folder.file("d.mcap"));

  std::vector<Eigen::Vector2d> axes;
  for (const Json& entity : written.messages("/scene").front().json.at("entities")) {
    if (entity.at("cylinders").empty()) continue;
    const Json& cylinder = entity["cylinders"][0];
    axes.emplace_back(cylinder.at("pose").at("position").at("x"), cylinder["pose"]["position"]["y"]);
    EXPECT_NEAR(cylinder.at("size").at("x"), 2.0 * recording.landmarks[axes.size() - 1].radius_m, 1e-12);
  }
  ASSERT_EQ(axes.size(), recording.landmarks.size());
  const auto &clouds = written.messages("/scan_corrected"), &raw = written.messages("/scan"),
             &transforms = written.messages("/tf");
  ASSERT_EQ(clouds.size(), recording.stops.size());
  ASSERT_EQ(transforms.size(), recording.stops.size());
  ASSERT_EQ(written.messages("/stops").size(), recording.stops.size());
  std::size_t points = 0;
  for (std::size_t k = 0; k < clouds.size(); ++k) {
    const Json &at = transforms[k].json.at("translation"), &turn = transforms[k].json.at("rotation");
    EXPECT_EQ(transforms[k].json.at("child_frame_id"), clouds[k].json.at("frame_id"));
    const double heading = 2.0 * std::atan2(turn.at("z").get<double>(), turn.at("w").get<double>());
    for (const auto& point : points_of(clouds[k].json)) {
      const double x = at.at("x").get<double>() + point[0] * std::cos(heading) - point[1] * std::sin(heading),
                   y = at.at("y").get<double>() + point[0] * std::sin(heading) + point[1] * std::cos(heading);
      double nearest = 1e9;
      for (std::size_t l = 0; l < axes.size(); ++l)
        nearest = std::min(
            nearest, std::abs((axes[l] - Eigen::Vector2d(x, y)).norm() - recording.landmarks[l].radius_m));
      EXPECT_LT(nearest, 0.25);  // noise grows with the square of the distance: 4 sigma at 3 m
      ++points;
    }
    for (const auto& point : points_of(raw[k].json))
      EXPECT_NEAR(std::hypot(point[0], point[1]), point[3], 1e-5);
  }
  EXPECT_EQ(points, recording.readings.size());
}

TEST(DiagnosisMcap, RecordingsFollowEachOtherInFramesOfTheirOwn) {
  const TemporaryFolder folder;
  const std::vector<Recording> recordings{eccentric("one"), eccentric("two")};
  write_diagnosis_mcap(recordings, diagnose(recordings, quick()), folder.file("d.mcap"));
  const WrittenMcap written(folder.file("d.mcap"));
  EXPECT_TRUE(std::is_sorted(written.times().begin(), written.times().end()));
  double end_of_first = 0.0, begin_of_second = 1e300;
  for (const Sent& sent : written.messages("/residuals"))
    if (sent.json.at("recording") == 1)
      end_of_first = std::max(end_of_first, sent.time_s);
    else
      begin_of_second = std::min(begin_of_second, sent.time_s);
  EXPECT_NEAR(begin_of_second - end_of_first, 1.0, 1e-6);
  std::set<std::string> parents;
  for (const Sent& sent : written.messages("/tf")) parents.insert(sent.json.at("parent_frame_id"));
  EXPECT_EQ(parents, (std::set<std::string>{"recording_1", "recording_2"}));
}

TEST(DiagnosisMcap, PairsAreResidualsByRowWithTheirColumns) {
  const TemporaryFolder folder;
  Recording recording;
  recording.kind = RecordingKind::pairs;
  Random random(seed_from("diagnosis mcap pairs"));
  for (int i = 0; i < 300; ++i) {
    const double d = 0.5 + 0.01 * (i % 50) * 5;
    recording.pairs.true_m.push_back(d);
    recording.pairs.reading_m.push_back(0.05 + d + 0.005 * random.normal());
    recording.pairs.row.push_back(i + 2);
    recording.pairs.covariates["temperature_c"].push_back(i == 7 ? std::nan("") : 20.0 + 0.01 * i);
  }
  recording.counts.read = recording.counts.used = 300;
  const std::vector<Recording> recordings{recording};
  const Diagnosis diagnosis = diagnose(recordings, quick());
  ASSERT_EQ(diagnosis.verdict, Verdict::no_mismatch);
  write_diagnosis_mcap(recordings, diagnosis, folder.file("d.mcap"));
  const WrittenMcap written(folder.file("d.mcap"));
  for (const char* topic : {"/scene", "/tf", "/scan", "/scan_corrected", "/stops"})
    EXPECT_FALSE(written.has(topic)) << topic;
  const auto& residuals = written.messages("/residuals");
  ASSERT_EQ(residuals.size(), 300u);
  for (std::size_t i = 0; i < 300; ++i) {
    const Json& json = residuals[i].json;
    EXPECT_EQ(json.at("row"), i + 2);
    EXPECT_NEAR(residuals[i].time_s, 0.1 * static_cast<double>(i), 1e-9);
    EXPECT_FALSE(json.contains("time_s"));
    EXPECT_FALSE(json.contains("after"));  // nothing was found
    EXPECT_FALSE(json.at("before").contains("bearing_rad"));
    EXPECT_EQ(json.at("covariates").contains("temperature_c"), i != 7);  // what is not known has no member
    EXPECT_EQ(json.at("distance_m"), recording.pairs.true_m[i]);
  }
}

TEST(DiagnosisMcap, IsThereWholeOrNotAtAll) {
  const TemporaryFolder folder;
  const std::vector<Recording> recordings{eccentric("run")};
  const Diagnosis diagnosis = diagnose(recordings, quick());
  EXPECT_THROW(write_diagnosis_mcap(recordings, diagnosis, folder.file("none/d.mcap")), InputError);
  Diagnosis broken = diagnosis;
  broken.baseline.landmarks.clear();  // residuals of readings of landmarks that have no place
  EXPECT_THROW(write_diagnosis_mcap(recordings, broken, folder.file("d.mcap")), InputError);
  EXPECT_TRUE(std::filesystem::is_empty(std::filesystem::path(folder.file("x")).parent_path()));
}

}  // namespace
}  // namespace rangecal::ingest
