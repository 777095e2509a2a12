// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/yaml_reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <locale>
#include <set>
#include <sstream>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/utf8.hpp"

namespace rangecal {
namespace {

constexpr std::size_t kLargestFile = 4u << 20;  // of empty list items: 2.8 GB of memory

std::string shortened(const std::string& text) {
  return text.size() <= 40 ? text : text.substr(0, 40) + "...";
}

[[noreturn]] void fail_at(const std::string& file, int line, const std::string& field,
                          const std::string& what) {
  throw InputError(file, line, "", field.empty() ? what : "field '" + field + "': " + what);
}

/// A number with a decimal point, whatever the locale of the process: yaml-cpp reads by the global one. It knows .inf and .nan.
bool decoded(const YAML::Node& node, double& value) {
  std::istringstream stream(node.Scalar());
  stream.imbue(std::locale::classic());
  if (stream >> std::noskipws >> value && (stream >> std::ws).eof()) return true;
  return YAML::convert<double>::decode(node, value) && !std::isfinite(value);
}

}  // namespace

YamlReader YamlReader::open(const std::string& path) { return parse(read_file(path, kLargestFile), path); }

YamlReader YamlReader::parse(const std::string& text, const std::string& name) {
  if (text.size() > kLargestFile) throw InputError(name, 0, "", "is larger than 4 MB");
  if (const std::size_t bad = first_bad_byte(text); bad != std::string::npos)
    throw InputError(name,
                     1 + std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(bad), '\n'), "",
                     "is not UTF-8 text");
  YAML::Node top;
  try {
    top = YAML::Load(text);
  } catch (const YAML::Exception& error) {
    throw InputError(name, error.mark.line + 1, "", "is not YAML: " + error.msg);
  }
  if (!top.IsMap()) throw InputError(name, 1, "", "is not a map of keys to values");
  return YamlReader(top, name, "", 1);
}

YamlReader::YamlReader(const YAML::Node& node, std::string file, std::string field, int line)
    : node_(node), file_(std::move(file)), field_(std::move(field)), line_(line) {}

void YamlReader::fail(const std::string& what) const { fail_at(file_, line_, field_, what); }

void YamlReader::allow_only(std::initializer_list<const char*> keys) const {
  if (!node_.IsMap()) fail("is not a map of keys to values");
  std::set<std::string> seen;
  for (const auto& entry : node_) {
    if (!entry.first.IsScalar()) fail("a key is not a text");
    const std::string key = entry.first.Scalar();
    const int line = entry.first.Mark().line + 1;
    const std::string name = field_.empty() ? shortened(key) : field_ + "." + shortened(key);
    if (!seen.insert(key).second) fail_at(file_, line, name, "the key stands twice");
    bool known = false;
    std::string accepted;
    for (const char* candidate : keys) {
      known = known || key == candidate;
      accepted += (accepted.empty() ? "" : ", ") + std::string(candidate);
    }
    if (!known) fail_at(file_, line, name, "unknown key; known here: " + accepted);
  }
}

bool YamlReader::has(const char* key) const {
  if (!node_.IsMap()) fail("is not a map of keys to values");
  const YAML::Node child = node_[key];
  return child.IsDefined() && !child.IsNull();
}

YamlReader YamlReader::at(const char* key) const {
  const std::string name = field_.empty() ? key : field_ + "." + key;
  if (!has(key)) fail_at(file_, line_, name, "is missing");
  const YAML::Node child = node_[key];
  return YamlReader(child, file_, name, child.Mark().line + 1);
}

std::vector<YamlReader> YamlReader::items() const {
  if (!node_.IsSequence()) fail("is not a list");
  std::vector<YamlReader> items;
  for (const auto& entry : node_) {
    items.emplace_back(entry, file_, field_ + "[" + std::to_string(items.size()) + "]",
                       entry.Mark().line + 1);
  }
  return items;
}

std::vector<std::pair<std::string, YamlReader>> YamlReader::entries() const {
  if (!node_.IsMap()) fail("is not a map of keys to values");
  std::vector<std::pair<std::string, YamlReader>> entries;
  std::set<std::string> seen;
  for (const auto& entry : node_) {
    if (!entry.first.IsScalar()) fail("a key is not a text");
    const std::string key = entry.first.Scalar();
    const YamlReader value(entry.second, file_,
                           field_.empty() ? shortened(key) : field_ + "." + shortened(key),
                           entry.first.Mark().line + 1);
    if (!seen.insert(key).second) value.fail("the key stands twice");
    entries.emplace_back(key, value);
  }
  return entries;
}

std::string YamlReader::text() const {
  if (!node_.IsScalar()) fail("is not a text");
  return node_.Scalar();
}

double YamlReader::number() const {
  double value = 0.0;
  if (!node_.IsScalar()) fail("is not a number");
  if (!decoded(node_, value)) fail(fmt::format("'{}' is not a number", shortened(node_.Scalar())));
  if (std::isnan(value)) fail("is not a number");
  return value;
}

double YamlReader::positive() const {
  const double value = number();
  if (!(value > 0.0) || !std::isfinite(value))
    fail(fmt::format("'{}' is not a positive number", shortened(node_.Scalar())));
  return value;
}

double YamlReader::not_negative() const {
  const double value = number();
  if (!(value >= 0.0) || !std::isfinite(value))
    fail(fmt::format("'{}' is not a number of at least 0", shortened(node_.Scalar())));
  return value;
}

int YamlReader::whole(int at_least) const {
  const double value = number();
  if (value != std::floor(value) || value < at_least || value > std::numeric_limits<int>::max()) {
    fail(fmt::format("'{}' is not a whole number of at least {}", shortened(node_.Scalar()), at_least));
  }
  return static_cast<int>(value);
}

std::vector<double> YamlReader::numbers() const {
  std::vector<double> values;
  for (const YamlReader& item : items()) {
    const double value = item.number();
    if (!std::isfinite(value)) item.fail("is not finite");
    values.push_back(value);
  }
  return values;
}

std::map<std::string, std::string> YamlReader::texts() const {
  if (!node_.IsMap()) fail("is not a map of keys to values");
  std::map<std::string, std::string> texts;
  for (const auto& entry : node_) {
    if (!entry.first.IsScalar()) fail("a key is not a text");
    std::string& text = texts[entry.first.Scalar()];
    if (entry.second.IsScalar()) {
      text = entry.second.Scalar();
    } else if (!entry.second.IsNull()) {
      YAML::Emitter line;
      line.SetSeqFormat(YAML::Flow), line.SetMapFormat(YAML::Flow);
      line << entry.second;
      text = line.c_str();
    }
  }
  return texts;
}

}  // namespace rangecal
