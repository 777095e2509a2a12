// SPDX-License-Identifier: BSD-3-Clause
#include "bags/ros_messages.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <utility>

#include "rangecal/core/errors.hpp"

namespace rangecal::ingest {
namespace {

/// The fields of a message, one after the other.
class MessageFields {
 public:
  MessageFields(std::span<const std::byte> bytes, Wire wire) : bytes_(bytes), wire_(wire) {
    if (wire == Wire::ros1) return;
    if (bytes.size() < 4) throw InputError("it has no CDR header");
    const auto kind = std::to_integer<unsigned>(bytes[0]) << 8 | std::to_integer<unsigned>(bytes[1]);
    if (kind == 0x28b5)
      throw InputError("it is compressed by itself (compression_mode: MESSAGE), which is not read");
    if (kind > 1) throw InputError(fmt::format("its CDR header is of kind {}, which is not read", kind));
    swapped_ = (kind == 1) != (std::endian::native == std::endian::little);
    bytes_ = bytes.subspan(4);
  }

  template <typename Number>
  Number number(const char* field) {
    align(sizeof(Number));
    return taken<Number>(take(sizeof(Number), field));
  }
  /// The length of a list of items of at least `item` bytes each, which the bytes that follow can hold.
  std::uint32_t length(std::size_t item, const char* field) {
    const auto count = number<std::uint32_t>(field);
    if (count > (bytes_.size() - at_) / item) ends_within(field);
    return count;
  }
  std::string text(const char* field) {
    const std::span<const std::byte> found = take(length(1, field), field);
    std::string out(reinterpret_cast<const char*>(found.data()), found.size());
    if (wire_ == Wire::cdr && !out.empty()) {
      if (out.back() != '\0') throw InputError(fmt::format("its field {} has no end", field));
      out.pop_back();
    }
    return out;
  }
  std::vector<float> floats(const char* field) {
    std::vector<float> out(length(sizeof(float), field));
    const std::span<const std::byte> found = take(out.size() * sizeof(float), field);
    if (!out.empty()) std::memcpy(out.data(), found.data(), found.size());
    if (swapped_)
      for (float& value : out) value = swapped(value);
    return out;
  }
  void skip_doubles(std::size_t count, const char* field) {
    align(sizeof(double));
    take(count * sizeof(double), field);
  }
  double stamp_s() {
    const auto seconds = number<std::int32_t>("header.stamp");
    const auto nanoseconds = number<std::uint32_t>("header.stamp");
    // ROS 1 counts seconds without a sign
    const double whole =
        wire_ == Wire::ros1 ? static_cast<double>(static_cast<std::uint32_t>(seconds)) : seconds;
    return whole + 1e-9 * nanoseconds;
  }
  /// The stamp of a std_msgs/Header, and its frame.
  std::pair<double, std::string> header() {
    if (wire_ == Wire::ros1) number<std::uint32_t>("header.seq");
    const double stamp = stamp_s();
    return {stamp, text("header.frame_id")};
  }
  Pose2 pose(const char* position, const char* orientation) {
    double p[3], q[4];
    for (double& value : p) value = number<double>(position);
    for (double& value : q) value = number<double>(orientation);
    const auto [x, y, z, w] = q;
    const double length = std::sqrt(x * x + y * y + z * z + w * w);
    if (!std::isfinite(p[0]) || !std::isfinite(p[1]))
      throw InputError(fmt::format("its {} is not finite", position));
    if (!(std::abs(length - 1.0) < 0.1))
      throw InputError(fmt::format("its {} is no quaternion of length 1", orientation));
    return {p[0], p[1], std::atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)};
  }
  /// Of so many floats that were read last.
  FloatPlace place_of_last(std::size_t count) const {
    return {(wire_ == Wire::cdr ? 4 : 0) + at_ - count * sizeof(float), swapped_};
  }
  void finish() const {
    if (bytes_.size() - at_ >= 8)
      throw InputError(fmt::format("{} bytes follow its last field", bytes_.size() - at_));
  }

 private:
  void align(std::size_t size) {
    if (wire_ == Wire::cdr) at_ = std::min((at_ + size - 1) / size * size, bytes_.size());
  }
  [[noreturn]] static void ends_within(const char* field) {
    throw InputError(fmt::format("it ends within its field {}", field));
  }
  std::span<const std::byte> take(std::size_t size, const char* field) {
    if (size > bytes_.size() - at_) ends_within(field);
    at_ += size;
    return bytes_.subspan(at_ - size, size);
  }
  template <typename Number>
  static Number swapped(Number value) {
    std::byte raw[sizeof(Number)];
    std::memcpy(raw, &value, sizeof(Number));
    std::reverse(raw, raw + sizeof(Number));
    std::memcpy(&value, raw, sizeof(Number));
    return value;
  }
  template <typename Number>
  Number taken(std::span<const std::byte> found) const {
    Number value;
    std::memcpy(&value, found.data(), sizeof(Number));
    return swapped_ ? swapped(value) : value;
  }

  std::span<const std::byte> bytes_;
  Wire wire_;
  std::size_t at_ = 0;
  bool swapped_ = std::endian::native != std::endian::little;
};

}  // namespace

void put_floats(std::span<std::byte> message, const FloatPlace& place, std::span<const float> values) {
  const std::span<std::byte> to = message.subspan(place.at, values.size_bytes());
  if (!to.empty()) std::memcpy(to.data(), values.data(), to.size());
  if (place.swapped)
    for (std::size_t at = 0; at < to.size(); at += sizeof(float))
      std::reverse(to.begin() + static_cast<std::ptrdiff_t>(at),
                   to.begin() + static_cast<std::ptrdiff_t>(at + sizeof(float)));
}

LaserScanMessage read_laser_scan(std::span<const std::byte> bytes, Wire wire) {
  MessageFields fields(bytes, wire);
  LaserScanMessage out;
  out.stamp_s = fields.header().first;
  out.angle_min_rad = fields.number<float>("angle_min"),
  out.angle_max_rad = fields.number<float>("angle_max");
  out.angle_increment_rad = fields.number<float>("angle_increment");
  fields.number<float>("time_increment"), fields.number<float>("scan_time");
  out.range_min_m = fields.number<float>("range_min"), out.range_max_m = fields.number<float>("range_max");
  out.range_m = fields.floats("ranges");
  out.range_place = fields.place_of_last(out.range_m.size());
  out.intensity = fields.floats("intensities");
  fields.finish();
  return out;
}

RangeMessage read_range(std::span<const std::byte> bytes, Wire wire) {
  MessageFields fields(bytes, wire);
  RangeMessage out;
  out.stamp_s = fields.header().first;
  out.radiation_type = fields.number<unsigned char>("radiation_type");
  out.field_of_view_rad = fields.number<float>("field_of_view");
  out.min_range_m = fields.number<float>("min_range"), out.max_range_m = fields.number<float>("max_range");
  out.range_m = fields.number<float>("range");
  out.range_place = fields.place_of_last(1);
  fields.finish();
  return out;
}

DatedPose read_odometry(std::span<const std::byte> bytes, Wire wire) {
  MessageFields fields(bytes, wire);
  DatedPose out;
  std::tie(out.stamp_s, out.parent) = fields.header();
  out.child = fields.text("child_frame_id");
  out.pose = fields.pose("pose.position", "pose.orientation");
  fields.skip_doubles(36, "pose.covariance"), fields.skip_doubles(6 + 36, "twist");
  fields.finish();
  return out;
}

DatedPose read_pose_stamped(std::span<const std::byte> bytes, Wire wire) {
  MessageFields fields(bytes, wire);
  DatedPose out;
  std::tie(out.stamp_s, out.parent) = fields.header();
  out.pose = fields.pose("pose.position", "pose.orientation");
  fields.finish();
  return out;
}

std::vector<DatedPose> read_transforms(std::span<const std::byte> bytes, Wire wire) {
  MessageFields fields(bytes, wire);
  std::vector<DatedPose> out(
      fields.length(64, "transforms"));  // two stamps' numbers, two texts, seven numbers
  for (DatedPose& one : out) {
    std::tie(one.stamp_s, one.parent) = fields.header();
    one.child = fields.text("child_frame_id");
    one.pose = fields.pose("translation", "rotation");
  }
  fields.finish();
  return out;
}

}  // namespace rangecal::ingest
