// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <yaml-cpp/yaml.h>

#include <initializer_list>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace rangecal {

/// A node of a YAML file that knows where it stands, so that every error names file, line and field. For the
/// modules that read YAML; not included by other public headers.
class YamlReader {
 public:
  /// Reads `path`; its top must be a map.
  static YamlReader open(const std::string& path);
  /// The same from text; `name` stands for the file in messages.
  static YamlReader parse(const std::string& text, const std::string& name);
  YamlReader(const YAML::Node& node, std::string file, std::string field, int line);

  /// Throws naming the first key that is not among `keys`, or stands twice. The node must be a map.
  void allow_only(std::initializer_list<const char*> keys) const;
  bool has(const char* key) const;
  YamlReader at(const char* key) const;   ///< throws if the key is missing
  std::vector<YamlReader> items() const;  ///< the node must be a list
  /// The keys of a map in the file's order, each with what it holds, which is said to stand at its key's line. Throws
  /// where a key is no text or stands twice.
  std::vector<std::pair<std::string, YamlReader>> entries() const;

  bool is_map() const { return node_.IsMap(); }
  bool is_list() const { return node_.IsSequence(); }
  const std::string& file() const { return file_; }
  const std::string& field() const { return field_; }
  int line() const { return line_; }

  std::string text() const;
  double number() const;                ///< finite, or .inf where the caller allows it
  double positive() const;              ///< finite and > 0
  double not_negative() const;          ///< finite and >= 0
  int whole(int at_least) const;        ///< whole number of at least `at_least`
  std::vector<double> numbers() const;  ///< a list of finite numbers
  std::map<std::string, std::string> texts()
      const;  ///< a map of any fields; what is no text as YAML on one line
  [[noreturn]] void fail(const std::string& what) const;

 private:
  YAML::Node node_;
  std::string file_, field_;
  int line_ = 0;
};

}  // namespace rangecal
