// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/json_fields.hpp"

#include <algorithm>
#include <cmath>

#include "rangecal/core/json_numbers.hpp"

namespace rangecal {

std::string JsonFields::path_of(const std::string& name) const {
  return path_.empty() ? name : path_ + "." + name;
}

JsonFields JsonFields::at(const std::string& name) {
  if (writing()) return JsonFields((*written_)[name]);
  if (!read_->is_object()) fail("is not an object");
  named_.push_back(name);
  static const Read none;
  const auto found = read_->find(name);
  JsonFields field(found == read_->end() ? none : *found, path_of(name));
  field.missing_ = found == read_->end();
  return field;
}

JsonFields JsonFields::item(std::size_t index) {
  if (reading()) return JsonFields((*read_)[index], path_ + "[" + std::to_string(index) + "]");
  return JsonFields((*written_)[index]);  // makes room for it
}

std::size_t JsonFields::items() const {
  if (!read_->is_array()) fail("is not a list");
  return read_->size();
}

void JsonFields::numbers(const std::string& name, Eigen::VectorXd& values) {
  required(name, values);
  check(values.allFinite(), name, "is not finite");
}

bool JsonFields::has(const std::string& name) const {
  if (writing() || !read_->is_object()) return false;
  const auto found = read_->find(name);
  return found != read_->end() && !found->is_null();
}

std::size_t JsonFields::format(const std::vector<std::string>& versions) {
  std::string text = versions.front();
  required("format", text);
  const auto found = std::find(versions.begin(), versions.end(), text);
  check(found != versions.end(), "format", "is not " + versions.front());
  return static_cast<std::size_t>(found - versions.begin());
}

void JsonFields::check(bool good, const std::string& name, const std::string& what) const {
  if (reading() && !good) JsonFields(*read_, path_of(name)).fail(what);
}

void JsonFields::check(bool good, const std::string& what) const {
  if (reading() && !good) fail(what);
}

void JsonFields::fail(const std::string& what) const {
  throw InputError(path_.empty() ? what : "field '" + path_ + "': " + what);
}

void JsonFields::finish() {
  if (writing()) {
    if (written_->is_null()) *written_ = Written::object();
    return;
  }
  if (all_named_ || !read_->is_object()) return;  // not an object: a row
  for (const auto& [name, value] : read_->items()) {
    if (std::find(named_.begin(), named_.end(), name) != named_.end()) continue;
    std::string known;
    for (const std::string& one : named_) known += (known.empty() ? "" : ", ") + one;
    JsonFields(value, path_of(name)).fail("is unknown; known here: " + known);
  }
}

nlohmann::json parsed_json(const std::string& text) {
  try {
    return nlohmann::json::parse(text);
  } catch (const nlohmann::json::exception& error) {
    throw InputError("is not JSON: " + json_complaint(error));
  }
}

void JsonFields::convert(bool& value) {
  if (writing()) {
    *written_ = value;
    return;
  }
  if (!read_->is_boolean()) fail("is neither true nor false");
  value = read_->get<bool>();
}

void JsonFields::convert(double& value) {
  if (writing()) {
    *written_ = std::isfinite(value) ? Written(value) : Written(nullptr);
    return;
  }
  if (read_->is_null()) fail("is not finite");
  if (!read_->is_number()) fail("is not a number");
  value = read_->get<double>();
}

void JsonFields::convert(std::string& value) {
  if (writing()) {
    *written_ = value;
    return;
  }
  if (!read_->is_string()) fail("is not a text");
  value = read_->get<std::string>();
}

void JsonFields::convert(Written& value) {
  if (writing()) {
    *written_ = value;
  } else {
    value = Written(*read_);
  }
}

}  // namespace rangecal
