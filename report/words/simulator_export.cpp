// SPDX-License-Identifier: BSD-3-Clause
#include "simulator_export.hpp"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <numbers>
#include <optional>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/version.hpp"
#include "rangecal/problems/effects/effect.hpp"
#include "rangecal/solvers/correction/effect_correction.hpp"
#include "rangecal/solvers/correction/lookup_table.hpp"
#include "text.hpp"

namespace rangecal::app {
namespace {

constexpr int kPlaces = 1000;  ///< of the range of the fit at which sizes are looked for

/// "0.34 mm", "12 mm", "254 mm".
std::string millimetres(double metres) {
  const double size = 1e3 * metres;
  return std::abs(size) < 99.5 ? fmt::format("{:.2g} mm", size) : fmt::format("{:.0f} mm", size);
}

/// The sensor of a calibration as far as the distance alone says what it reads, and the effects that ask for more.
class ExportedSensor {
 public:
  explicit ExportedSensor(const Calibration& calibration) : given_(calibration), by_distance_(calibration) {
    for (const auto& [id, parameters] : calibration.effects) {
      const Effect* effect = find_effect(id);
      if (!effect) throw InputError("the calibration holds the effect " + id + ", which is in no catalogue");
      if (held_as_pose(id)) {
        by_distance_.effects.erase(id);
        continue;
      }
      Calibration alone = calibration;
      alone.effects = {{id, parameters}};
      alone.effects_covariance.reset();
      const EffectCorrector corrector(alone, columns_of(alone));
      if (!corrector.needs().empty() || !acts_on_range(alone, corrector)) {
        by_distance_.effects.erase(id);
        left_.push_back(describe_left(*effect, alone, corrector));
      }
    }
    by_distance_.effects_covariance.reset();
    corrector_.emplace(by_distance_, std::vector<std::string>{});
  }
  ExportedSensor(const ExportedSensor&) = delete;
  ExportedSensor& operator=(const ExportedSensor&) = delete;

  SensorReading operator()(double d) const {
    const EffectCorrector::Expected at = corrector_->at(d, {});
    return {at.mean_m, at.noise_m};
  }
  double low_m() const { return given_.range_min_m; }
  double high_m() const { return given_.range_max_m; }
  template <typename Visit>
  void over_range(const Visit& visit) const {
    for (int i = 0; i <= kPlaces; ++i) {
      const double d = low_m() + (high_m() - low_m()) * i / kPlaces;
      visit(d, (*this)(d));
    }
  }

  /// What no table of distances holds.
  std::vector<std::string> left() const {
    std::vector<std::string> out = left_;
    const std::string shapes = shapes_in_words(given_);
    if (!shapes.empty()) out.push_back("outliers: the noise is Gaussian in the simulator; " + shapes);
    if (given_.sigma_theta_rad)
      out.push_back(fmt::format("noise of the bearing: {:.3g} rad", given_.sigma_theta_rad->value));
    return out;
  }

 private:
  static bool held_as_pose(const std::string& id) { return id == "lever_arm" || id == "bearing_offset"; }
  static std::vector<std::string> columns_of(const Calibration& calibration) {
    std::vector<std::string> columns;
    for (const auto& [column, range] : calibration.effects_range) columns.push_back(column);
    return columns;
  }
  static bool acts_on_range(const Calibration& alone, const EffectCorrector& corrector) {
    for (int i = 0; i <= kPlaces; ++i) {
      const double d = alone.range_min_m + (alone.range_max_m - alone.range_min_m) * i / kPlaces,
                   f = alone.f(d), s = alone.noise.spread(d, f);
      const EffectCorrector::Expected at = corrector.at(d, {});
      if (at.mean_m != f || at.noise_m != s) return true;
    }
    return false;
  }

  /// Settings over which an effect is looked at: angles all round, times and columns over what they were fitted on.
  static std::vector<ReadingSetting> settings_of(const Calibration& alone, const EffectCorrector& corrector) {
    std::vector<ReadingSetting> out(1);
    out.front().covariates.assign(columns_of(alone).size(), 0.0);
    const auto spread_over = [&](const std::vector<double>& values,
                                 const std::function<void(ReadingSetting&, double)>& set) {
      std::vector<ReadingSetting> more;
      for (const ReadingSetting& one : out)
        for (const double value : values) {
          more.push_back(one);
          set(more.back(), value);
        }
      if (!values.empty()) out = std::move(more);
    };
    const auto count_to = [](std::size_t count) {
      std::vector<double> numbers;
      for (std::size_t i = 0; i < std::min<std::size_t>(count, 200); ++i)
        numbers.push_back(static_cast<double>(i));
      return numbers;
    };
    std::vector<double> circle;
    for (int i = 0; i < 36; ++i) circle.push_back(-std::numbers::pi + 2.0 * std::numbers::pi * i / 36);
    const std::vector<std::string> columns = columns_of(alone);
    for (const EffectCorrector::Need& need : corrector.needs()) {
      const auto fitted = alone.effects_range.find(need.column);
      std::vector<double> values;
      if (fitted != alone.effects_range.end())
        for (int i = 0; i <= 10; ++i)
          values.push_back(fitted->second.first + 0.1 * i * (fitted->second.second - fitted->second.first));
      if (need.column == "bearing_rad") {
        spread_over(circle, [](ReadingSetting& s, double v) { s.bearing_rad = v; });
      } else if (need.column == "heading_rad") {
        spread_over(circle, [](ReadingSetting& s, double v) { s.heading_rad = v; });
      } else if (need.column == "time_s") {
        if (values.empty()) values = {0.0, 1.0, 10.0, 60.0, 600.0, 3600.0};
        spread_over(values, [](ReadingSetting& s, double v) { s.time_s = v; });
      } else if (need.column == "landmark") {
        spread_over(count_to(labels_of_landmarks(alone).size()),
                    [](ReadingSetting& s, double v) { s.landmark = static_cast<int>(v); });
      } else if (need.column == "stop") {
        spread_over(count_to(alone.stops.size()),
                    [](ReadingSetting& s, double v) { s.stop = static_cast<int>(v); });
      } else if (need.column == "radius_m") {
        spread_over({0.02, 0.05, 0.1}, [](ReadingSetting& s, double v) { s.radius_m = v; });
      } else if (need.column == "repeat") {
        spread_over({0.0, 1.0, 2.0, 5.0, 10.0},
                    [](ReadingSetting& s, double v) { s.repeat = static_cast<int>(v); });
      } else if (const auto column = std::find(columns.begin(), columns.end(), need.column);
                 column != columns.end()) {
        const auto place = static_cast<std::size_t>(column - columns.begin());
        spread_over(values, [place](ReadingSetting& s, double v) { s.covariates[place] = v; });
      } else {
        return {};
      }
    }
    return out;
  }

  static std::string describe_left(const Effect& effect, const Calibration& alone,
                                   const EffectCorrector& corrector) {
    std::string by, size;
    for (const EffectCorrector::Need& need : corrector.needs())
      by += (by.empty() ? " by " : ", ") + need.column;
    const std::vector<ReadingSetting> settings = settings_of(alone, corrector);
    double mean = 0.0, factor = 1.0;
    for (const ReadingSetting& setting : settings)
      for (int i = 0; i <= 40; ++i) {
        const double d = alone.range_min_m + (alone.range_max_m - alone.range_min_m) * i / 40, f = alone.f(d),
                     s = alone.noise.spread(d, f);
        const EffectCorrector::Expected at = corrector.at(d, setting);
        mean = std::max(mean, std::abs(at.mean_m - f));
        if (s > 0.0) factor = std::max({factor, at.noise_m / s, at.noise_m > 0.0 ? s / at.noise_m : 1.0});
      }
    if (mean > 0.0) size += fmt::format(", up to {} of the mean", millimetres(mean));
    if (factor > 1.0 + 1e-9) size += fmt::format(", noise by a factor of up to {:.3g}", factor);
    if (settings.empty()) size = ", of a size that the calibration alone does not tell";
    if (size.empty())
      size = ", which acts on the " + effect.info().channel + " and not on the mean of a range";
    return effect.info().id + by + size;
  }

  const Calibration& given_;
  Calibration by_distance_;
  std::optional<EffectCorrector> corrector_;
  std::vector<std::string> left_;
};

/// The name of a file as one line of ASCII, which a comment of any format can hold.
std::string printable_name(const std::string& path) {
  std::string name = std::filesystem::path(path).filename().string();
  for (char& c : name)
    if (c < 0x20 || c == 0x7f) c = '?';
  return name;
}

/// The head of a file, one line each.
std::vector<std::string> head(const SimulatorExport& options) {
  return {fmt::format("Made by rangecal {} export from {}", version(), printable_name(options.source))};
}

std::string as_xml_comment(const std::vector<std::string>& lines) {
  std::string out;
  for (std::string line : lines) {
    for (std::size_t at; (at = line.find("--")) != std::string::npos;) line.replace(at, 2, "- ");
    out += "  " + line + "\n";
  }
  return "<!--\n" + out + "-->\n";
}

std::vector<std::string> joined(std::vector<std::string> lines, const std::vector<std::string>& more) {
  lines.insert(lines.end(), more.begin(), more.end());
  return lines;
}

std::vector<std::string> not_held(const std::vector<std::string>& what) {
  std::vector<std::string> out;
  for (const std::string& one : what) out.push_back("Not held: " + one);
  return out;
}

struct SensorTable {
  LookupTable table;
  std::vector<std::string> notes;
};

SensorTable table_of(const Calibration& calibration, const SimulatorExport& options) {
  const ExportedSensor sensor(calibration);
  SensorTable out;
  out.table =
      fewest_rows([&](double d) { return sensor(d); }, sensor.low_m(), sensor.high_m(), options.tolerance_m);
  const double worst = std::max(out.table.mean_error_m, out.table.std_dev_error_m);
  out.notes = {fmt::format(
      "From {:.4g} to {:.4g} m the mean is off by up to {}, the standard deviation by up to {} ({} rows, the fewest on "
      "the curve for a tolerance of {})",
      sensor.low_m(), sensor.high_m(), millimetres(out.table.mean_error_m),
      millimetres(out.table.std_dev_error_m), out.table.rows.size(), millimetres(options.tolerance_m))};
  if (worst > options.tolerance_m) out.notes.push_back("The tolerance is not met where the curve jumps");
  out.notes.push_back("Not held: distances outside these, which read as the ends do");
  out.notes = joined(std::move(out.notes), not_held(sensor.left()));
  return out;
}

/// "x y z r p y" with the standard deviations of what is known of it, for the notes.
std::vector<std::string> pose_notes(const Calibration& calibration) {
  std::vector<std::string> out;
  const auto std_dev = [&](const std::string& name) -> std::optional<double> {
    const auto& known = calibration.effects_covariance;
    if (!known) return std::nullopt;
    const auto at = std::find(known->parameters.begin(), known->parameters.end(), name);
    if (at == known->parameters.end()) return std::nullopt;
    const Eigen::Index row = calibration.alpha.size() + (at - known->parameters.begin());
    const double variance = known->matrix(row, row);
    return variance > 0.0 ? std::optional(std::sqrt(variance)) : std::nullopt;
  };
  const auto say = [&](const char* effect, const char* parameter, const char* words, double scale,
                       const char* unit) {
    const auto found = calibration.effects.find(effect);
    if (found == calibration.effects.end()) return;
    const auto sd = std_dev(std::string(effect) + "." + parameter);
    out.push_back(fmt::format(
        "{}: {} {}", words,
        with_std(scale * found->second.at(parameter), sd ? std::optional(std::abs(scale) * *sd) : sd), unit));
  };
  say("lever_arm", "x_m", "Origin, forward (lever_arm)", 1e3, "mm");
  say("lever_arm", "y_m", "Origin, to the left (lever_arm)", 1e3, "mm");
  say("bearing_offset", "angle_rad", "Yaw (bearing_offset turned round)", -1.0, "rad");
  return out;
}

}  // namespace

ExportedText webots_sensor(const Calibration& calibration, const SimulatorExport& options) {
  const SensorTable found = table_of(calibration, options);
  ExportedText out;
  out.notes = found.notes;
  if (const auto pose = pose_notes(calibration); !pose.empty())
    out.notes =
        joined(std::move(out.notes),
               joined({"Not held: where the sensor sits: translation and rotation of the node"}, pose));
  for (const std::string& line : joined(head(options), out.notes)) out.text += "# " + line + "\n";
  out.text +=
      "# Columns: distance [m], reading [m], standard deviation of the noise / reading\nDistanceSensor {\n  type \"generic\"\n"
      "  numberOfRays 1\n  lookupTable [\n";
  for (const LookupTable::Row& row : found.table.rows)
    out.text += fmt::format("    {:.7g} {:.7g} {:.7g}\n", row.distance_m, row.mean_m, row.relative_std_dev);
  out.text += "  ]\n}\n";
  return out;
}

ExportedText table_csv(const Calibration& calibration, const SimulatorExport& options) {
  const SensorTable found = table_of(calibration, options);
  ExportedText out;
  out.notes = found.notes;
  out.text = "distance_m,reading_m,relative_std\n";
  for (const LookupTable::Row& row : found.table.rows)
    out.text += fmt::format("{:.7g},{:.7g},{:.7g}\n", row.distance_m, row.mean_m, row.relative_std_dev);
  return out;
}

ExportedText gazebo_sensor(const Calibration& calibration, const SimulatorExport& options) {
  const ExportedSensor sensor(calibration);
  double sum = 0.0, variance = 0.0, least = HUGE_VAL, most = 0.0;
  int count = 0;
  sensor.over_range([&](double d, const SensorReading& at) {
    sum += at.mean_m - d, variance += at.std_dev_m * at.std_dev_m;
    least = std::min(least, at.std_dev_m), most = std::max(most, at.std_dev_m);
    ++count;
  });
  const double mean = sum / count, std_dev = std::sqrt(variance / count);
  double square = 0.0, worst = 0.0, worst_at = 0.0;
  sensor.over_range([&](double d, const SensorReading& at) {
    const double error = at.mean_m - d - mean;
    square += error * error;
    if (std::abs(error) > std::abs(worst)) worst = error, worst_at = d;
  });
  ExportedText out;
  out.notes = {
      fmt::format("Not held: the curve. One mean for all distances leaves {} RMS, and {} at {:.4g} m",
                  millimetres(std::sqrt(square / count)), millimetres(worst), worst_at),
      fmt::format("Not held: how the noise grows. One standard deviation, {}, stands for {} to {}",
                  millimetres(std_dev), millimetres(least), millimetres(most))};
  out.notes = joined(std::move(out.notes), not_held(sensor.left()));
  const auto pose_words = pose_notes(calibration);
  out.notes = joined(
      std::move(out.notes),
      pose_words.empty()
          ? std::vector<std::string>{"The calibration says nothing of where the sensor sits: the pose is "
                                     "to be filled in"}
          : pose_words);
  const Pose2 pose = sensor_pose(calibration);
  out.text = "<?xml version=\"1.0\"?>\n" +
             as_xml_comment(joined(
                 joined(head(options), {"A sensor for a link of a model; its <scan> is to be filled in"}),
                 out.notes));
  out.text += fmt::format(
      "<sensor name=\"range_sensor\" type=\"gpu_lidar\">\n  <pose>{:.6g} {:.6g} 0 0 0 {:.6g}</pose>\n  <lidar>\n    <range>\n"
      "      <min>{:.6g}</min>\n      <max>{:.6g}</max>\n    </range>\n    <noise>\n      <type>gaussian</type>\n"
      "      <mean>{:.6g}</mean>\n      <stddev>{:.6g}</stddev>\n    </noise>\n  </lidar>\n</sensor>\n",
      pose.x_m, pose.y_m, pose.heading_rad, sensor.low_m(), sensor.high_m(), mean, std_dev);
  return out;
}

Pose2 sensor_pose(const Calibration& calibration) {
  Pose2 pose;
  if (const auto lever = calibration.effects.find("lever_arm"); lever != calibration.effects.end())
    pose.x_m = lever->second.at("x_m"), pose.y_m = lever->second.at("y_m");
  if (const auto offset = calibration.effects.find("bearing_offset"); offset != calibration.effects.end())
    pose.heading_rad = -offset->second.at("angle_rad");
  return pose;
}

ExportedText urdf_joint(const Calibration& calibration, const SimulatorExport& options) {
  ExportedText out;
  out.notes = pose_notes(calibration);
  if (out.notes.empty())
    throw NoAnswerError(
        options.source +
        ": holds neither lever_arm nor bearing_offset: 'diagnose --calibration' keeps them where it finds them");
  out.notes.push_back("Not held: height, roll and pitch, of which planar readings say nothing");
  const Pose2 pose = sensor_pose(calibration);
  out.text = "<?xml version=\"1.0\"?>\n" + as_xml_comment(joined(head(options), out.notes));
  out.text += fmt::format(
      "<joint name=\"range_sensor_joint\" type=\"fixed\">\n  <parent link=\"base_link\"/>\n  <child link=\"range_sensor\"/>\n"
      "  <origin xyz=\"{:.6g} {:.6g} 0\" rpy=\"0 0 {:.6g}\"/>\n</joint>\n",
      pose.x_m, pose.y_m, pose.heading_rad);
  return out;
}

std::vector<std::pair<std::string, std::string>> simulator_patch(const Diagnosis& diagnosis,
                                                                 const SimulatorExport& options) {
  if (diagnosis.final_effects.empty()) return {};
  const Calibration& corrected = diagnosis.corrected;
  std::vector<std::pair<std::string, std::string>> files;
  std::string check = head(options).front() + "\n\n" + diagnosis.sentence + "\n\n";
  const auto describe = [&](const char* name, const FitSummary& fit) {
    const std::string held =
        fit.heldout_nll ? fmt::format("{:.1f} nats", *fit.heldout_nll) : "none was held out";
    check += fmt::format("{:<34}{:>18}   {:>12}\n", name, held, millimetres(fit.rms_range_m) + " RMS");
  };
  check += fmt::format("{:<34}{:>18}   {:>12}\n", "", "held-out readings", "cell means");
  describe("the simulation as it is", diagnosis.before);
  describe("with the causes found", diagnosis.after);
  if (diagnosis.before.heldout_nll && diagnosis.after.heldout_nll)
    check += fmt::format(
        "gain {:.1f}{} nats: the negative log density of readings given the others, lower is better\n",
        *diagnosis.before.heldout_nll - *diagnosis.after.heldout_nll,
        diagnosis.after.heldout_std ? fmt::format(" +- {:.1f}", *diagnosis.after.heldout_std) : "");
  check += "\nThe second row has every cause in it; each file below says which of them it cannot hold.\n";
  if (std::find(diagnosis.final_effects.begin(), diagnosis.final_effects.end(), "generic") !=
      diagnosis.final_effects.end())
    check += "What has no name is in that row, and in none of the files.\n";
  const auto add = [&](const char* name, const ExportedText& made) {
    files.emplace_back(name, made.text);
    check += fmt::format("\n{}\n", name);
    for (const std::string& note : made.notes) check += "  " + note + "\n";
  };
  add("DistanceSensor.txt", webots_sensor(corrected, options));
  add("sensor.csv", table_csv(corrected, options));
  add("sensor.sdf", gazebo_sensor(corrected, options));
  if (!pose_notes(corrected).empty()) add("sensor.urdf", urdf_joint(corrected, options));
  files.emplace_back("check.txt", check);
  return files;
}

}  // namespace rangecal::app
