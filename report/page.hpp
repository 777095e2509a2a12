// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace rangecal::report {

using Json = nlohmann::ordered_json;

/// Text as HTML: escaped, "+-", "->" and "chi-square" as signs.
std::string escaped(const std::string& text);

/// A number for a chart: to six significant digits, null where it is not finite.
Json number(double value);

/// A table of plain texts. Cells of numeric columns are set flush right; on a phone a `stacked` one is set as
/// blocks.
struct Table {
  struct Column {
    std::string title;
    bool numeric = false;
  };
  std::vector<Column> columns;
  std::vector<std::vector<std::string>> rows;
  bool stacked = false;
  std::string html() const;
};

/// A chart: a Vega-Lite template of specs/ with its placeholders filled. "${name}" as a whole string becomes
/// the value, inside a longer one its text; a member whose value is null is left out.
struct Chart {
  std::string id;                      ///< unique on the page
  std::string spec;                    ///< file of specs/, without ".json"
  std::map<std::string, Json> values;  ///< of the placeholders
  std::string title, caption;          ///< in words, below and above
  std::string shape = "plot";          ///< of page.css: plot, tall, short
};

/// One self-contained HTML file: sections of text, tables and charts, the data and the charting library in
/// it. It asks for nothing from the network.
class Page {
 public:
  Page(std::string title, const std::string& subtitle);

  /// What stands on top: a word ("good", "warn" or "bad" its colour) and the answer in one sentence.
  void verdict(const std::string& word, const std::string& colour, const std::string& sentence);
  struct Figure {
    std::string value, meaning;
  };
  /// A few numbers side by side.
  void figures(const std::vector<Figure>& figures);
  void section(const std::string& title, const std::string& lead = "");
  void heading(const std::string& title);
  void paragraph(const std::string& text);
  void list(const std::vector<std::string>& items);
  void table(const Table& table);
  /// Rows of objects that charts read by `name`.
  void dataset(const std::string& name, Json rows);
  /// One chart over the full width, or two side by side where there is room. Every dataset that a chart names
  /// must have been given before; throws std::logic_error otherwise.
  void charts(const std::vector<Chart>& charts);

  std::string html() const;
  /// What the page's script gets: members config, datasets and charts.
  Json data() const;

 private:
  std::string title_, body_;
  Json datasets_ = Json::object(), charts_ = Json::object();
};

}  // namespace rangecal::report
