// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <limits>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

#include "rangecal/core/errors.hpp"

namespace rangecal {

class JsonFields;
template <typename Object>
concept HasFields = requires(JsonFields& json, Object& object) {
  fields(json, object);
};

/// The fields of a JSON object, listed once for both directions. A type has a function `fields`, in its own namespace, that
/// names each member with the variable behind it:
///
///   static void fields(JsonFields& json, LandmarkEstimate& landmark) {
///     json.optional("recording", landmark.recording);
///     json.required("landmark", landmark.label);
///     json.optional("x_m", landmark.position_m.x());
///     json.check(landmark.recording >= 0, "recording", "is negative");
///   }
///
/// `json_of(landmark)` writes the fields in this order; `read_json(json, landmark)` reads them back and throws InputError for
/// a field that is missing, of another type or not in the list, by its path: "field 'landmarks[2].x_m': is not a number".
/// What is kept in another form than it has in the file goes through a local variable, which the function sets before
/// the field and takes over after it. JsonFields itself changes nothing that it writes. A type has one list in the whole
/// program, since the linker keeps one: where it is written in another form, too, that is a type of its own.
///
/// Values: bool, whole numbers, double, text, optional and unique_ptr (null where there is none), vector, array, tuple of
/// references, map by text, Eigen vectors, and every type that has `fields`. A double that is not finite is written as null.
class JsonFields {
 public:
  using Written = nlohmann::ordered_json;  ///< in the order of the list
  using Read = nlohmann::json;

  explicit JsonFields(Written& json) : written_(&json) {}
  explicit JsonFields(const Read& json, std::string path = "") : read_(&json), path_(std::move(path)) {}

  bool reading() const { return read_ != nullptr; }
  bool writing() const { return written_ != nullptr; }

  /// There, and null only of an optional value.
  template <typename Value>
  void required(const std::string& name, Value&& value);
  /// Missing or null: the value stays as it is; a double becomes NaN.
  template <typename Value>
  void optional(const std::string& name, Value&& value);
  /// As `optional`, and not written where the value is empty.
  template <typename Value>
  void if_any(const std::string& name, Value& value) {
    const bool empty = [&] {
      if constexpr (requires { value.has_value(); })
        return !value.has_value();
      else
        return value.empty();
    }();
    if (reading() || !empty) optional(name, value);
  }
  /// An object whose members `list` names: list(JsonFields&).
  template <typename List>
  void object(const std::string& name, List list);
  /// An enumeration by its to_string; `parse` is the inverse.
  template <typename Enumeration, typename Parse>
  void word(const std::string& name, Enumeration& value, Parse parse);
  /// A whole number from `low` to `high`.
  template <std::integral Whole>
  void whole(const std::string& name, Whole& value, std::type_identity_t<Whole> low = 0,
             std::type_identity_t<Whole> high = std::numeric_limits<Whole>::max());
  /// Rows of a square matrix, from `least` to `most` of them. As with other values null is for an optional one, which may
  /// also be missing.
  template <typename Matrix>
  void square(const std::string& name, std::optional<Matrix>& matrix, Eigen::Index least, Eigen::Index most);
  template <typename Matrix>
  void square(const std::string& name, Matrix& matrix, Eigen::Index least, Eigen::Index most);
  template <typename Matrix>
  void square(const std::string& name, Matrix& matrix, Eigen::Index size) {
    square(name, matrix, size, size);
  }
  /// Finite numbers, any number of them.
  void numbers(const std::string& name, Eigen::VectorXd& values);
  /// `rows` x `columns` of them in one list, column by column.
  template <typename Derived>
  void numbers(const std::string& name, Eigen::PlainObjectBase<Derived>& values, Eigen::Index rows,
               Eigen::Index columns = 1);
  /// In place of named members: a list of these values.
  template <typename... Values>
  void row(Values&... values) {
    convert(std::tie(values...));
  }
  /// Every member that was not named so far.
  template <typename Value>
  void others(std::map<std::string, Value>& values);
  /// The name and version of the file's format, the current one first; those that are read, too, behind it. Returns which
  /// it is: 0 for the current one.
  std::size_t format(const std::vector<std::string>& versions);

  /// Is there, and not null; of what is written nothing is.
  bool has(const std::string& name) const;
  /// When reading: throws InputError for the field `name` (with dots and brackets of one further down) where it is not `good`.
  void check(bool good, const std::string& name, const std::string& what) const;
  /// The same for this object, list or value.
  void check(bool good, const std::string& what) const;
  [[noreturn]] void fail(const std::string& what) const;

  /// The value that stands here.
  void convert(bool& value);
  void convert(double& value);
  void convert(std::string& value);
  void convert(Written& value);  ///< as it is
  template <std::integral Whole>
  void convert(Whole& value);
  template <typename Value>
  void convert(std::optional<Value>& value);
  template <typename Value>
  void convert(std::unique_ptr<Value>& value);
  template <typename Value>
  void convert(std::vector<Value>& values);
  template <typename Value, std::size_t size>
  void convert(std::array<Value, size>& values);
  template <typename... Values>
  void convert(const std::tuple<Values&...>& values);
  template <typename Value>
  void convert(std::map<std::string, Value>& values);
  template <int size>
  void convert(Eigen::Matrix<double, size, 1>& values);
  template <HasFields Object>
  void convert(Object& object) {
    fields(*this, object);
    finish();
  }

 private:
  JsonFields at(const std::string& name);
  JsonFields item(std::size_t index);
  std::size_t items() const;  ///< of the list; throws where it is none
  bool is_null() const { return reading() && read_->is_null(); }
  std::string path_of(const std::string& name) const;
  void finish();  ///< refuses members that were not named

  Written* written_ = nullptr;
  const Read* read_ = nullptr;
  bool missing_ = false;
  std::string path_;
  std::vector<std::string> named_;
  bool all_named_ = false;
};

/// The JSON of a value. By copy: a list of fields may change what it passes.
template <typename Value>
nlohmann::ordered_json json_of(Value value) {
  nlohmann::ordered_json json;
  JsonFields(json).convert(value);
  return json;
}

/// Throws InputError naming the field.
template <typename Value>
void read_json(const nlohmann::json& json, Value& value) {
  JsonFields(json).convert(value);
}

/// Throws InputError for a text that is no JSON.
nlohmann::json parsed_json(const std::string& text);

/// read_json of a text, which is `file` in errors.
template <typename Value>
void read_json(const std::string& text, const std::string& file, Value& value) {
  try {
    read_json(parsed_json(text), value);
  } catch (const InputError& error) {
    throw InputError(file, 0, "", error.what());
  }
}

template <typename Value>
void JsonFields::required(const std::string& name, Value&& value) {
  JsonFields field = at(name);
  constexpr bool may_be_null = requires { value.reset(); }
  || std::is_same_v<Value, Written&>;
  if (field.missing_ || (!may_be_null && field.is_null())) field.fail("is missing");
  field.convert(value);
}

template <typename Value>
void JsonFields::optional(const std::string& name, Value&& value) {
  JsonFields field = at(name);
  if (!field.is_null())
    field.convert(value);
  else if constexpr (std::is_same_v<Value, double&>)
    value = std::numeric_limits<double>::quiet_NaN();
}

template <typename List>
void JsonFields::object(const std::string& name, List list) {
  JsonFields field = at(name);
  if (field.is_null()) field.fail("is missing");
  list(field);
  field.finish();
}

template <typename Enumeration, typename Parse>
void JsonFields::word(const std::string& name, Enumeration& value, Parse parse) {
  std::string text = to_string(value);
  required(name, text);
  try {
    if (reading()) value = parse(text);
  } catch (const InputError& error) {
    check(false, name, error.what());
  }
}

template <std::integral Whole>
void JsonFields::whole(const std::string& name, Whole& value, std::type_identity_t<Whole> low,
                       std::type_identity_t<Whole> high) {
  required(name, value);
  check(low <= value && value <= high, name,
        "is not a whole number from " + std::to_string(low) + " to " + std::to_string(high));
}

template <typename Matrix>
void JsonFields::square(const std::string& name, std::optional<Matrix>& matrix, Eigen::Index least,
                        Eigen::Index most) {
  std::optional<std::vector<Eigen::VectorXd>> rows;
  if (matrix) {
    rows.emplace();
    for (Eigen::Index i = 0; i < matrix->rows(); ++i) rows->push_back(matrix->row(i).transpose());
  }
  optional(name, rows);
  if (writing() || !rows) return;
  const auto size = static_cast<Eigen::Index>(rows->size());
  check(least <= size && size <= most, name,
        least == most ? "is not " + std::to_string(least) + " rows"
                      : "has " + std::to_string(size) + " rows, not " + std::to_string(least) + " to " +
                            std::to_string(most));
  for (std::size_t i = 0; i < rows->size(); ++i)
    check((*rows)[i].size() == size, name + "[" + std::to_string(i) + "]",
          "is not " + std::to_string(size) + " numbers");
  matrix.emplace(Matrix::Zero(size, size));
  for (Eigen::Index i = 0; i < size; ++i) matrix->row(i) = (*rows)[static_cast<std::size_t>(i)].transpose();
}

template <typename Matrix>
void JsonFields::square(const std::string& name, Matrix& matrix, Eigen::Index least, Eigen::Index most) {
  std::optional<Matrix> rows;
  if (writing()) rows = matrix;
  square(name, rows, least, most);
  check(rows.has_value(), name, "is missing");
  if (reading()) matrix = *rows;
}

template <typename Derived>
void JsonFields::numbers(const std::string& name, Eigen::PlainObjectBase<Derived>& values, Eigen::Index rows,
                         Eigen::Index columns) {
  Eigen::VectorXd list = values.reshaped();
  numbers(name, list);
  check(list.size() == rows * columns, name, "has not " + std::to_string(rows * columns) + " numbers");
  if (reading()) values = list.reshaped(rows, columns);
}

template <typename Value>
void JsonFields::others(std::map<std::string, Value>& values) {
  if (writing()) {
    for (auto& [name, value] : values) at(name).convert(value);
    return;
  }
  for (const auto& [name, value] : read_->items())
    if (std::find(named_.begin(), named_.end(), name) == named_.end())
      JsonFields(value, path_of(name)).convert(values[name]);
  all_named_ = true;
}

template <std::integral Whole>
void JsonFields::convert(Whole& value) {
  if (writing()) {
    *written_ = value;
    return;
  }
  const double number = read_->is_number() ? read_->get<double>() : 0.5;
  // as doubles the limits are powers of two: the upper one is beyond the last whole number, hence <
  constexpr double end = 2.0 * static_cast<double>(std::numeric_limits<Whole>::max() / 2 + 1);
  constexpr double low = static_cast<double>(std::numeric_limits<Whole>::min());
  if (number != std::floor(number) || number < low || !(number < end)) fail("is not a whole number");
  value = read_->is_number_float() ? static_cast<Whole>(number) : read_->get<Whole>();
}

template <typename Value>
void JsonFields::convert(std::optional<Value>& value) {
  if (reading()) value.reset();
  if (is_null() || (writing() && !value)) return;
  if (reading()) value.emplace();
  convert(*value);
}

template <typename Value>
void JsonFields::convert(std::unique_ptr<Value>& value) {
  if (reading()) value.reset();
  if (is_null() || (writing() && !value)) return;
  if (reading()) value = std::make_unique<Value>();
  convert(*value);
}

template <typename Value>
void JsonFields::convert(std::vector<Value>& values) {
  if (writing()) {
    *written_ = Written::array();
    for (std::size_t i = 0; i < values.size(); ++i) item(i).convert(values[i]);
    return;
  }
  values.clear();
  for (std::size_t i = 0; i < items(); ++i) item(i).convert(values.emplace_back());
}

template <typename Value, std::size_t size>
void JsonFields::convert(std::array<Value, size>& values) {
  std::apply([&](auto&... each) { row(each...); }, values);
}

template <typename... Values>
void JsonFields::convert(const std::tuple<Values&...>& values) {
  if (reading() && items() != sizeof...(Values))
    fail("is not " + std::to_string(sizeof...(Values)) + " values");
  std::size_t i = 0;
  std::apply([&](auto&... each) { (item(i++).convert(each), ...); }, values);
}

template <typename Value>
void JsonFields::convert(std::map<std::string, Value>& values) {
  if (writing()) {
    *written_ = Written::object();
  } else {
    if (!read_->is_object()) fail("is not an object");
    values.clear();
  }
  others(values);
}

template <int size>
void JsonFields::convert(Eigen::Matrix<double, size, 1>& values) {
  std::vector<std::optional<double>> list(values.begin(), values.end());
  convert(list);
  const auto count = static_cast<Eigen::Index>(list.size());
  if (size != Eigen::Dynamic && count != size) fail("is not " + std::to_string(size) + " numbers");
  values.resize(count);
  for (Eigen::Index i = 0; i < count; ++i)
    values[i] = list[static_cast<std::size_t>(i)].value_or(std::numeric_limits<double>::quiet_NaN());
}

}  // namespace rangecal
