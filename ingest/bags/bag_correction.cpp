// SPDX-License-Identifier: BSD-3-Clause
#include "bags/bag_correction.hpp"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "bags/bag_copy.hpp"
#include "bags/message_source.hpp"
#include "bags/ros_messages.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/calibration_io.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/version.hpp"
#include "rangecal/solvers/correction/correction_table.hpp"

namespace rangecal::ingest {
namespace {

constexpr const char *kScanType = "sensor_msgs/LaserScan", *kRangeType = "sensor_msgs/Range";

/// Puts distances in the place of a message's readings.
class MessageCorrector {
 public:
  MessageCorrector(const Calibration& calibration, const std::string& name, bool clockwise, bool of_scans,
                   BagCorrected& counts)
      : clockwise_(clockwise), counts_(counts), corrector_(calibration, {"intensity"}) {
    for (const EffectCorrector::Need& need : corrector_.needs()) {
      if (need.column == "time_s")
        by_time_ = true;
      else if (need.column == "bearing_rad" && of_scans)
        by_bearing_ = true;
      else if (need.column == "intensity" && of_scans)
        by_intensity_ = true;
      else
        throw InputError(name, 0, "",
                         fmt::format("its effect {} needs {} to be undone, which {} does not hold",
                                     need.effect, need.column, of_scans ? kScanType : kRangeType));
      if (const auto fitted = calibration.effects_range.find(need.column);
          fitted != calibration.effects_range.end())
        fitted_.emplace_back(need.column, fitted->second);
    }
    table_.emplace(corrector_, by_bearing_);
  }

  std::span<const std::byte> scan(const BagMessage& message, Wire wire) {
    const LaserScanMessage found = read_laser_scan(message.bytes, wire);
    const double from = found.angle_min_rad, step = found.angle_increment_rad;
    if (by_bearing_ && !(std::isfinite(from) && std::isfinite(step) && step != 0.0 &&
                         std::abs(from) <= 4.0 * std::numbers::pi && std::abs(step) < 1.0))
      throw InputError("its angles make no sense, and an effect depends on the bearing");
    if (by_intensity_ && found.intensity.size() != found.range_m.size())
      throw InputError("it has no intensities, on which an effect depends");
    setting_.time_s = since_first(found.stamp_s, message);
    std::vector<float>& values = values_;
    values.resize(found.range_m.size());
    const double sign = clockwise_ ? -1.0 : 1.0;
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (by_bearing_) setting_.bearing_rad = wrap_angle(sign * (from + static_cast<double>(i) * step));
      if (by_intensity_) setting_.covariates = {found.intensity[i]};
      values[i] = distance(found.range_m[i], found.range_min_m, found.range_max_m);
    }
    return with(message.bytes, found.range_place, values);
  }

  std::span<const std::byte> range(const BagMessage& message, Wire wire) {
    const RangeMessage found = read_range(message.bytes, wire);
    setting_.time_s = since_first(found.stamp_s, message);
    const float value = distance(found.range_m, found.min_range_m, found.max_range_m);
    return with(message.bytes, found.range_place, {&value, 1});
  }

 private:
  double since_first(double header_s, const BagMessage& message) {
    if (!by_time_) return 0.0;
    const double now = header_s != 0.0 ? header_s : 1e-9 * static_cast<double>(message.log_time_ns);
    if (!first_time_s_) first_time_s_ = now;
    return now - *first_time_s_;
  }

  float distance(float reading_m, float low_m, float high_m) {
    ++counts_.readings;
    if (!std::isfinite(reading_m) || !(reading_m > 0.0f) || reading_m < low_m || reading_m > high_m) {
      ++counts_.kept;
      return reading_m;
    }
    const double y = reading_m;
    const bool tabled = !by_time_ && !by_intensity_;
    const CorrectionTable::Answer answer =
        tabled ? (*table_)(y, setting_.bearing_rad) : table_->exact(y, setting_);
    if (!fitted_.empty() && is_beyond()) ++counts_.extrapolated_column;
    counts_.ambiguous += (answer.flags & CorrectionTable::ambiguous) != 0;
    counts_.out_of_range += (answer.flags & CorrectionTable::out_of_range) != 0;
    counts_.extrapolated += (answer.flags & CorrectionTable::extrapolated) != 0;
    if (std::isnan(answer.distance_m)) {
      ++counts_.without_distance;
      return std::numeric_limits<float>::quiet_NaN();
    }
    ++counts_.corrected;
    return static_cast<float>(answer.distance_m);
  }

  /// Whether what an effect depends on lies outside the values over which it was fitted.
  bool is_beyond() const {
    return std::any_of(fitted_.begin(), fitted_.end(), [&](const auto& one) {
      const auto& [column, range] = one;
      if (column == "bearing_rad") return !is_on_arc(setting_.bearing_rad, range);
      const double value = column == "time_s" ? setting_.time_s : setting_.covariates.front();
      return value < range.first || value > range.second;
    });
  }

  std::span<const std::byte> with(std::span<const std::byte> bytes, const FloatPlace& place,
                                  std::span<const float> values) {
    out_.assign(bytes.begin(), bytes.end());
    put_floats(out_, place, values);
    return out_;
  }

  bool clockwise_;
  BagCorrected& counts_;
  EffectCorrector corrector_;
  bool by_time_ = false, by_bearing_ = false, by_intensity_ = false;
  std::vector<std::pair<std::string, std::pair<double, double>>> fitted_;  ///< columns that effects use
  std::optional<CorrectionTable> table_;
  ReadingSetting setting_;
  std::optional<double> first_time_s_;
  std::vector<float> values_;
  std::vector<std::byte> out_;
};

class BagCorrector {
 public:
  BagCorrector(const Calibration& calibration, std::string name, std::string in,
               const BagCorrectionOptions& options)
      : calibration_(calibration), name_(std::move(name)), in_(std::move(in)), options_(options) {
    std::error_code ignored;
    if (std::filesystem::is_directory(in_, ignored))
      fail("is a folder: correct its files one by one, and let `ros2 bag reindex` describe the new folder");
    const std::unique_ptr<MessageSource> source = open_bag(in_);
    choose_topic(source->topics(), source->losses());
    is_mcap_ = source->format().starts_with("MCAP");
    if (!is_mcap_ && !source->format().starts_with("SQLite"))
      fail("is a ROS 1 bag, which is read but not written: convert it to MCAP first");
  }

  BagCorrected correct(const std::string& out) {
    MessageCorrector corrector(calibration_, name_, options_.clockwise, counts_.type == kScanType, counts_);
    BagChange change;
    change.topic = counts_.topic, change.keep_raw = options_.keep_raw;
    change.change = [&](const BagMessage& message) -> std::optional<std::span<const std::byte>> {
      ++counts_.messages;
      try {
        const Wire wire = wire_of(message.topic);
        if (message.topic.type != counts_.type)
          throw InputError(fmt::format("it is of {}, others of {}", message.topic.type, counts_.type));
        return message.topic.type == kScanType ? corrector.scan(message, wire)
                                               : corrector.range(message, wire);
      } catch (const InputError& error) {
        if (counts_.left_out++ == 0) why_ = error.what();
        return std::nullopt;
      }
    };
    change.note = [&] {
      if (counts_.messages == counts_.left_out) fail_without();
      return note();
    };
    const BagCopied copied = is_mcap_ ? copy_mcap(in_, out, change, options_.progress)
                                      : copy_sqlite_bag(in_, out, change, options_.progress);
    counts_.format = copied.format;
    std::string what = copied.losses;
    if (counts_.left_out > 0)
      what += fmt::format("{}{} {} of {} cannot be used and {} left out (the first: {})",
                          what.empty() ? "" : "; ", counts_.left_out,
                          counts_.left_out == 1 ? "message" : "messages", counts_.topic,
                          counts_.left_out == 1 ? "is" : "are", why_);
    if (!what.empty()) counts_.warning = InputError(in_, 0, "", what).what();
    return counts_;
  }

 private:
  void choose_topic(const std::vector<BagTopic>& topics, const std::string& losses) {
    const BagTopic* chosen = nullptr;
    std::vector<std::string> all, fitting;
    for (const BagTopic& topic : topics) {
      if (all.size() < 20) all.push_back(fmt::format("{} ({})", topic.name, topic.type));
      if (topic.name == options_.keep_raw && !options_.keep_raw.empty())
        fail("has a topic " + options_.keep_raw + " already: --keep-raw takes a new name");
      const bool fits = topic.type == kScanType || topic.type == kRangeType;
      if (options_.topic.empty() ? fits : topic.name == options_.topic) {
        if (fitting.empty() || fitting.back() != topic.name) fitting.push_back(topic.name);
        chosen = &topic;
      }
    }
    const std::string lost = losses.empty() ? "" : "; " + losses;
    if (!chosen)
      fail(fmt::format("holds no {}; its topics: {}{}",
                       options_.topic.empty() ? fmt::format("{} nor {}", kScanType, kRangeType)
                                              : "topic " + options_.topic,
                       all.empty() ? "none" : fmt::format("{}", fmt::join(all, ", ")), lost));
    if (fitting.size() > 1 && options_.topic.empty())
      fail(fmt::format("choose one of its topics by --topic: {}", fmt::join(fitting, ", ")));
    if (chosen->type != kScanType && chosen->type != kRangeType)
      fail(fmt::format("topic {} is of {}; corrected are {} and {}", chosen->name, chosen->type, kScanType,
                       kRangeType));
    counts_.topic = chosen->name, counts_.type = chosen->type;
  }

  static Wire wire_of(const BagTopic& topic) {
    if (topic.encoding == "cdr") return Wire::cdr;
    if (topic.encoding == "ros1") return Wire::ros1;
    throw InputError(fmt::format("it is encoded as '{}'; read are cdr (ROS 2) and ros1", topic.encoding));
  }

  /// Nothing of the topic could be corrected: no file is written.
  [[noreturn]] void fail_without() const {
    if (counts_.messages == 0) fail(fmt::format("holds no readable message of {}", counts_.topic));
    fail(fmt::format("no message of {} can be used ({} of them; the first: {})", counts_.topic,
                     counts_.messages, why_));
  }

  std::vector<std::pair<std::string, std::string>> note() const {
    std::string effects;
    for (const auto& [id, parameters] : calibration_.effects) effects += (effects.empty() ? "" : ", ") + id;
    return {
        {"topic", counts_.topic},
        {"raw_topic", options_.keep_raw},
        {"what",
         "each reading is the most likely distance behind it; what is no reading stays, NaN where no distance "
         "explains it"},
        {"program", "rangecal " + std::string(version())},
        {"calibration_file", std::filesystem::path(name_).filename().string()},
        {"effects", effects.empty() ? "none" : effects},
        {"clockwise", options_.clockwise ? "true" : "false"},
        {"readings", std::to_string(counts_.readings)},
        {"corrected", std::to_string(counts_.corrected)},
        {"without_distance", std::to_string(counts_.without_distance)},
        {"calibration", calibrations_to_json({calibration_})}};
  }

  [[noreturn]] void fail(const std::string& what) const { throw InputError(in_, 0, "", what); }

  const Calibration& calibration_;
  std::string name_, in_;
  const BagCorrectionOptions& options_;
  bool is_mcap_ = false;
  BagCorrected counts_;
  std::string why_;
};

}  // namespace

BagCorrected correct_bag(const Calibration& calibration, const std::string& name, const std::string& in,
                         const std::string& out, const BagCorrectionOptions& options) {
  return BagCorrector(calibration, name, in, options).correct(out);
}

}  // namespace rangecal::ingest
