// SPDX-License-Identifier: BSD-3-Clause
#include "page.hpp"

#include <fmt/core.h>

#include <cmath>
#include <set>
#include <stdexcept>
#include <utility>

#include "assets.hpp"
#include "rangecal/core/version.hpp"

namespace rangecal::report {
namespace {

std::string replaced(std::string text, std::string_view from, std::string_view to) {
  for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size()))
    text.replace(at, from.size(), to);
  return text;
}

std::string asset(const std::string& name) {
  const auto found = assets().find(name);
  if (found == assets().end()) throw std::logic_error("the report has no file " + name);
  return std::string(found->second);
}

/// A text as HTML that shows it.
std::string word_for_word(std::string_view text) {
  std::string result;
  for (char c : text) {
    if (c == '&')
      result += "&amp;";
    else if (c == '<')
      result += "&lt;";
    else if (c == '>')
      result += "&gt;";
    else if (c == '"')
      result += "&quot;";
    else
      result += c;
  }
  return result;
}

/// JSON that may stand inside a script element.
std::string dumped(const Json& json) {
  return replaced(json.dump(-1, ' ', false, Json::error_handler_t::replace), "<", "\\u003c");
}

/// The template with its placeholders filled.
Json filled(const Json& part, const std::map<std::string, Json>& values) {
  if (part.is_object()) {
    Json result = Json::object();
    for (const auto& [key, value] : part.items()) {
      Json own = filled(value, values);
      if (!own.is_null() || value.is_null()) result[key] = std::move(own);
    }
    return result;
  }
  if (part.is_array()) {
    Json result = Json::array();
    for (const Json& value : part) result.push_back(filled(value, values));
    return result;
  }
  if (!part.is_string()) return part;
  std::string text = part.get<std::string>();
  for (std::size_t at = text.find("${"); at != std::string::npos; at = text.find("${", at)) {
    const std::size_t end = text.find('}', at);
    const std::string name = text.substr(at + 2, end - at - 2);
    const auto value = values.find(name);
    if (value == values.end()) throw std::logic_error("no value for the chart's " + name);
    if (at == 0 && end + 1 == text.size()) return value->second;
    const std::string own =
        value->second.is_string() ? value->second.get<std::string>() : value->second.dump();
    text.replace(at, end + 1 - at, own);
    at += own.size();
  }
  return text;
}

void collect_datasets(const Json& part, std::set<std::string>& names) {
  if (part.is_object())
    for (const auto& [key, value] : part.items()) {
      if (key == "data" && value.is_object() && value.contains("name"))
        names.insert(value.at("name").get<std::string>());
      collect_datasets(value, names);
    }
  if (part.is_array())
    for (const Json& value : part) collect_datasets(value, names);
}

}  // namespace

std::string escaped(const std::string& text) {
  std::string result = word_for_word(text);
  const std::pair<const char*, const char*> typeset[] = {
      {"+-", "±"}, {"-&gt;", "→"}, {"chi-square", "χ²"}, {" %", "\u00a0%"}};
  for (const auto& [plain, set] : typeset) result = replaced(std::move(result), plain, set);
  return result;
}

Json number(double value) {
  if (!std::isfinite(value)) return nullptr;
  if (value == 0.0) return 0.0;
  const double scale = std::pow(10.0, 5.0 - std::floor(std::log10(std::abs(value))));
  const double rounded = std::round(value * scale) / scale;
  return std::isfinite(rounded) ? rounded : value;
}

std::string Table::html() const {
  std::string text = fmt::format("<div class=\"scroll\"><table{}>", stacked ? " class=\"stack\"" : "");
  bool titled = false;
  for (const Column& column : columns) titled = titled || !column.title.empty();
  if (titled) {
    text += "<thead><tr>";
    for (const Column& column : columns)
      text += fmt::format("<th scope=\"col\"{}>{}</th>", column.numeric ? " class=\"number\"" : "",
                          escaped(column.title));
    text += "</tr></thead>";
  }
  text += "<tbody>";
  for (const std::vector<std::string>& row : rows) {
    text += "<tr>";
    for (std::size_t i = 0; i < row.size(); ++i) {
      if (i == 0)
        text += fmt::format("<th scope=\"row\">{}</th>", escaped(row[i]));
      else
        text += fmt::format("<td{} data-name=\"{}\">{}</td>", columns[i].numeric ? " class=\"number\"" : "",
                            escaped(columns[i].title), escaped(row[i]));
    }
    text += "</tr>";
  }
  return text + "</tbody></table></div>\n";
}

Page::Page(std::string title, const std::string& subtitle) : title_(std::move(title)) {
  body_ = fmt::format("<h1>{}</h1>\n<p class=\"subtitle\">{}</p>\n", escaped(title_), escaped(subtitle));
  body_ += "<noscript>The charts need JavaScript; the tables do not.</noscript>\n";
}

void Page::verdict(const std::string& word, const std::string& colour, const std::string& sentence) {
  body_ += fmt::format("<span class=\"badge {}\">{}</span>\n<p class=\"verdict\">{}</p>\n", colour,
                       escaped(word), escaped(sentence));
}

void Page::figures(const std::vector<Figure>& figures) {
  body_ += "<ul class=\"figures\">";
  for (const Figure& figure : figures)
    body_ += fmt::format("<li><b>{}</b><span>{}</span></li>", escaped(figure.value), escaped(figure.meaning));
  body_ += "</ul>\n";
}

void Page::section(const std::string& title, const std::string& lead) {
  body_ += fmt::format("<h2>{}</h2>\n", escaped(title));
  if (!lead.empty()) body_ += fmt::format("<p class=\"lead\">{}</p>\n", escaped(lead));
}

void Page::heading(const std::string& title) { body_ += fmt::format("<h3>{}</h3>\n", escaped(title)); }

void Page::paragraph(const std::string& text) { body_ += fmt::format("<p>{}</p>\n", escaped(text)); }

void Page::list(const std::vector<std::string>& items) {
  body_ += "<ul class=\"plain\">";
  for (const std::string& item : items) body_ += fmt::format("<li>{}</li>", escaped(item));
  body_ += "</ul>\n";
}

void Page::table(const Table& table) { body_ += table.html(); }

void Page::dataset(const std::string& name, Json rows) { datasets_[name] = std::move(rows); }

void Page::charts(const std::vector<Chart>& charts) {
  body_ += fmt::format("<div class=\"charts{}\">", charts.size() > 1 ? " two" : "");
  for (const Chart& chart : charts) {
    const Json spec = filled(Json::parse(asset(chart.spec + ".json")), chart.values);
    std::set<std::string> names;
    collect_datasets(spec, names);
    for (const std::string& name : names)
      if (!datasets_.contains(name)) throw std::logic_error("chart " + chart.id + " has no data " + name);
    charts_[chart.id] = {{"spec", spec}, {"datasets", names}};
    body_ += fmt::format(
        "<figure><h3>{}</h3><div class=\"chart {}\" data-chart=\"{}\" role=\"img\" aria-label=\"{}\"></div>",
        escaped(chart.title), chart.shape, escaped(chart.id), escaped(chart.title));
    if (!chart.caption.empty()) body_ += fmt::format("<figcaption>{}</figcaption>", escaped(chart.caption));
    body_ += "</figure>\n";
  }
  body_ += "</div>\n";
}

Json Page::data() const {
  return {{"config", Json::parse(asset("config.json"))}, {"datasets", datasets_}, {"charts", charts_}};
}

std::string Page::html() const {
  std::string libraries, notices;
  if (!charts_.empty()) {
    for (const char* name : {"vega.js", "vega-lite.js", "vega-embed.js"})
      libraries += "<script>" + replaced(asset(name), "</script", "<\\/script") + "</script>\n";
    notices = "<details><summary>Licences of the charting library in this page</summary><pre>" +
              word_for_word(asset("notices.txt")) + "</pre></details>";
  }
  std::string page = asset("page.html");
  const std::vector<std::pair<std::string, std::string>> parts{
      {"{{title}}", escaped(title_)},
      {"{{css}}", asset("page.css")},
      {"{{body}}", body_},
      {"{{footer}}", escaped(fmt::format("rangecal {}", version())) + notices},
      {"{{data}}", dumped(data())},
      {"{{libraries}}", libraries},
      {"{{script}}", asset("page.js")}};
  std::string result;
  std::size_t at = 0;
  for (const auto& [name, text] : parts) {  // in their order on the page, each once
    const std::size_t next = page.find(name, at);
    if (next == std::string::npos) throw std::logic_error("page.html lacks " + name);
    result.append(page, at, next - at).append(text);
    at = next + name.size();
  }
  return result.append(page, at, std::string::npos);
}

}  // namespace rangecal::report
