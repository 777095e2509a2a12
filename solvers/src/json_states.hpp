// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/json_fields.hpp"
#include "rangecal/core/json_numbers.hpp"
#include "rangecal/core/recording.hpp"
#include "rangecal/problems/noise_shape.hpp"

namespace rangecal {

/// What the states of what goes on later have in common.

/// A number, or "auto".
inline void order_field(JsonFields& json, std::optional<int>& order) {
  JsonFields::Written value = order ? JsonFields::Written(*order) : JsonFields::Written("auto");
  json.required("order", value);
  if (json.reading()) order.reset();
  if (json.reading() && value != "auto") order = whole_number(value, "order");
}

/// Null where nothing is forgotten.
inline void forget_field(JsonFields& json, double& forget) {
  std::optional<double> finite;
  if (std::isfinite(forget)) finite = forget;
  json.required("forget", finite);
  if (json.reading()) forget = finite.value_or(std::numeric_limits<double>::infinity());
}

inline void counts_field(JsonFields& json, Counts& counts) {
  json.object("counts", [&](JsonFields& of) {
    of.whole("read", counts.read);
    of.whole("used", counts.used);
    of.required("dropped", counts.dropped);
    for (const auto& [reason, count] : counts.dropped)
      of.check(count >= 0, "dropped." + reason, "is negative");
  });
}

/// A list of its family and all its parameters.
inline void fields(JsonFields& json, NoiseShapeParameters& shape) {
  std::string family = to_string(shape.shape);
  json.row(family, shape.nu, shape.outlier_share, shape.outlier_scale, shape.outlier_mean);
  if (json.reading()) shape.shape = noise_shape_from_string(family);
}

/// x, y, heading.
inline void pose_field(JsonFields& json, const std::string& name, Pose2& pose) {
  json.required(name, std::tie(pose.x_m, pose.y_m, pose.heading_rad));
}

/// `count` vectors or matrices, a list of `rows` x `columns` finite numbers for each, column by column.
template <typename Several>
void lists_field(JsonFields& json, const std::string& name, Several& several, std::size_t count,
                 Eigen::Index rows, Eigen::Index columns = 1) {
  std::vector<Eigen::VectorXd> lists;
  for (const auto& one : several) lists.emplace_back(one.reshaped());
  if (json.reading()) lists.clear();
  json.required(name, lists);
  if (json.writing()) return;
  json.check(lists.size() == count, name, "has not " + std::to_string(count) + " lists");
  if constexpr (requires { several.resize(count); }) several.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    json.check(lists[i].size() == rows * columns && lists[i].allFinite(),
               name + "[" + std::to_string(i) + "]",
               "is not " + std::to_string(rows * columns) + " finite numbers");
    several[i] = lists[i].reshaped(rows, columns);
  }
}

}  // namespace rangecal
