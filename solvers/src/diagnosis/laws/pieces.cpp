// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/laws/pieces.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>

#include "rangecal/problems/effects/formula_effect.hpp"

namespace rangecal::diagnosis {
namespace {

/// "/m" of "m", "/m*s" of "m/s".
std::string per_unit(std::string unit) {
  for (char& sign : unit) sign = sign == '/' ? '*' : sign == '*' ? '/' : sign;
  return "/" + unit;
}

/// Makes terms of one channel.
class Pieces {
 public:
  Pieces(const std::string& channel, int number)
      : number_(number),
        unit_(channel == "range"     ? "m"
              : channel == "bearing" ? "rad"
                                     : "1"),
        typical_(channel == "range"     ? 0.01
                 : channel == "bearing" ? 0.005
                                        : 0.5) {}

  std::vector<LawPiece> made;

  /// All along one variable, times a factor: its text ("d*"), what an amplitude's unit is multiplied by ("/m"), and its largest value.
  void along(const LawVariable& x, const std::string& factor, const std::string& per, double factor_size) {
    factor_ = factor;
    per_ = per;
    size_ = typical_ / factor_size;
    factor_words_ = factor.empty() ? "" : " times " + factor.substr(0, factor.size() - 1);
    if (x.is_angle) around(x);
    if (!x.goes_round()) over(x);
  }

  /// (x - x0)(y - y0), about the means: x alone, and y, are terms of their own.
  void product(const LawVariable& x, const LawVariable& y, const std::string& factor, const std::string& per,
               double factor_size) {
    const double size = typical_ / (factor_size * std::max(x.mean - x.low, x.high - x.mean) *
                                    std::max(y.mean - y.low, y.high - y.mean));
    const std::string unit = unit_ + per_unit(x.unit) + per_unit(y.unit) + per;
    LawPiece piece;
    const std::string a = named("a"), x0 = named("x"), y0 = named("y");
    piece.formula = fmt::format("{}{}*({} - {})*({} - {})", factor, a, x.name, x0, y.name, y0);
    piece.parameters = {{a, unit, size, -1e3 * size, 1e3 * size}};
    piece.constants = {{x0, x.unit, x.mean}, {y0, y.unit, y.mean}};
    finish(std::move(piece), {&x, &y}, factor, "the product of " + x.name + " and " + y.name);
  }

 private:
  std::string named(const char* letter) const { return fmt::format("{}{}", letter, number_); }

  LawParameter amplitude(const char* letter, const std::string& per = "", double over_size = 1.0) const {
    const double size = size_ / over_size;
    return {named(letter), unit_ + per_ + per, size, -1e3 * size, 1e3 * size};
  }

  void finish(LawPiece piece, const std::vector<const LawVariable*>& variables, const std::string& factor,
              const std::string& words) {
    if (!factor.empty()) piece.variables.emplace_back("d");
    for (const LawVariable* v : variables) piece.variables.push_back(v->name);
    piece.words = words;
    made.push_back(std::move(piece));
  }

  void add(const LawVariable& x, const std::string& shape, std::vector<LawParameter> parameters,
           std::vector<LawConstant> constants, const std::string& words) {
    LawPiece piece;
    piece.formula = factor_ + shape;
    piece.parameters = std::move(parameters);
    piece.constants = std::move(constants);
    finish(std::move(piece), {&x}, factor_, words + " along " + x.name + factor_words_);
  }

  void over(const LawVariable& x) {
    const std::string a = named("a"), c = named("c"), k = named("k"), m = named("m"), w = named("w"),
                      T = named("T"), x0 = named("x");
    const double S = x.span(), most = std::max(std::abs(x.low), std::abs(x.high));
    const std::string per = per_unit(x.unit);
    add(x, fmt::format("{}*{}", a, x.name), {amplitude("a", per, most)}, {}, "a line");
    add(x, fmt::format("{}*{}^2", a, x.name), {amplitude("a", per + per, most * most)}, {}, "a square");
    if (x.name == "d") {
      add(x, fmt::format("{}*{}^3", a, x.name), {amplitude("a", per + per + per, most * most * most)}, {},
          "a cube");
      add(x, fmt::format("{}/{}", a, x.name), {amplitude("a", "*m", 1.0 / most)}, {}, "a reciprocal");
    }
    if (x.low > 0.0)
      add(x, fmt::format("{}*ln({}/{})", a, x.name, x0), {amplitude("a")},
          {{x0, x.unit, std::sqrt(x.low * x.high)}}, "a logarithm");
    const LawParameter middle{m, x.unit, nonzero(x.low + 0.5 * S, S), x.low, x.high, 16};
    add(x, fmt::format("{}*exp(-abs({} - {})/{})", a, x.name, x0, T),
        {amplitude("a"), {T, x.unit, 0.3 * S, S / 50.0, 3.0 * S, 8}}, {{x0, x.unit, x.low}}, "a decay");
    add(x, fmt::format("{}*exp(-(({} - {})/{})^2)", a, x.name, m, w),
        {amplitude("a"), middle, {w, x.unit, 0.1 * S, S / 50.0, 0.6 * S, 4}}, {}, "a bump");
    add(x, fmt::format("{}/(1 + exp(-({} - {})/{}))", a, x.name, m, w),
        {amplitude("a"), middle, {w, x.unit, 0.02 * S, S / 500.0, 0.15 * S, 2}}, {}, "an edge");
    add(x, fmt::format("{}*exp(-(({} - {})/{})^8)", a, x.name, m, w),
        {amplitude("a"), middle, {w, x.unit, 0.1 * S, S / 30.0, 0.5 * S, 3}}, {}, "a window");
    constexpr double turn = 2.0 * std::numbers::pi;
    add(x, fmt::format("({}*cos({}*{}) + {}*sin({}*{}))", a, k, x.name, c, k, x.name),
        {amplitude("a"),
         amplitude("c"),
         {k, "1" + per, 2.0 * turn / S, 0.5 * turn / S, 40.0 * turn / S, 160}},
        {}, "a wave");
  }

  void around(const LawVariable& b) {
    const std::string a = named("a"), c = named("c"), n = named("n"), m = named("m"), w = named("w");
    constexpr double pi = std::numbers::pi;
    add(b, fmt::format("({}*cos({}*{}) + {}*sin({}*{}))", a, n, b.name, c, n, b.name),
        {amplitude("a"), amplitude("c"), {n, "1", 1.0, 1.0, 32.0, 0, true}}, {}, "a ripple");
    const LawParameter middle{m, "rad", 0.5, -pi, pi, 20}, fine{m, "rad", 0.5, -pi, pi, 40};
    add(b, fmt::format("{}*exp((cos({} - {}) - 1)/{}^2)", a, b.name, m, w),
        {amplitude("a"), middle, {w, "rad", 0.4, 0.08, 1.6, 4}}, {}, "a bump");
    add(b, fmt::format("{}*exp(-((1 - cos({} - {}))/{})^4)", a, b.name, m, w),
        {amplitude("a"), fine, {w, "1", 0.1, 0.005, 1.2, 8}}, {}, "a sector");
  }

  static double nonzero(double value, double span) {
    return std::abs(value) > 1e-9 * span ? value : 1e-3 * span;
  }

  int number_;
  std::string unit_;
  double typical_;
  std::string factor_, per_, factor_words_;
  double size_ = 1.0;
};

}  // namespace

std::vector<LawVariable> law_variables(const Rows& rows) {
  std::vector<LawVariable> variables;
  const auto add = [&](LawVariable v, const std::vector<double>& values) {
    v.low = std::numeric_limits<double>::infinity();
    v.high = -v.low;
    std::set<double> distinct;
    double count = 0.0;
    for (const double x : values) {
      if (!std::isfinite(x)) continue;
      v.mean += (x - v.mean) / ++count;
      v.low = std::min(v.low, x);
      v.high = std::max(v.high, x);
      if (distinct.size() < LawVariable::fewest_values) distinct.insert(x);
    }
    v.varies = distinct.size() == LawVariable::fewest_values;
    if (count > 0.0) variables.push_back(std::move(v));
  };
  add({.name = "d", .unit = "m"}, rows.range_m);  // the readings stand for the distances
  if (rows.context.duration_s > 0.0) add({.name = "t", .unit = "s"}, rows.time_s);
  add({.name = "b", .unit = "rad", .is_angle = true}, rows.bearing_rad);
  const std::size_t columns = rows.context.covariates.size();
  for (std::size_t c = 0; c < columns; ++c) {
    const std::string& name = rows.context.covariates[c];
    if (!is_column_of_formulas(name)) continue;
    std::vector<double> values;
    for (std::size_t i = c; i < rows.covariates.size(); i += columns) values.push_back(rows.covariates[i]);
    const std::string unit = unit_of_column_in_formulas(name);
    add({.name = name, .unit = unit, .is_angle = unit == "rad", .column = static_cast<int>(c)}, values);
  }
  return variables;
}

std::vector<LawPiece> law_pieces(const Rows& rows, const std::string& channel, int number) {
  std::vector<LawVariable> variables = law_variables(rows);
  std::erase_if(variables, [](const LawVariable& v) { return !v.varies; });
  Pieces pieces(channel, number);
  double far = 1.0, near = 1.0;
  for (const LawVariable& v : variables)
    if (v.name == "d") far = v.high, near = v.low;
  struct Factor {
    const char *text, *per;
    double size;
  };
  std::vector<Factor> factors{{"", "", 1.0}};
  if (channel == "range") factors.insert(factors.end(), {{"d*", "/m", far}, {"d^2*", "/m^2", far * far}});
  if (channel == "bearing") factors.push_back({"1/d*", "*m", 1.0 / near});
  for (const LawVariable& x : variables)
    for (const Factor& factor : factors)
      if (x.name != "d" || factor.text[0] == '\0') pieces.along(x, factor.text, factor.per, factor.size);
  for (std::size_t i = 0; i < variables.size(); ++i)
    for (std::size_t j = i + 1; j < variables.size(); ++j) {
      const LawVariable &x = variables[i], &y = variables[j];
      if (x.name == "d" || x.goes_round() || y.goes_round() || x.name == "b" || y.name == "b") continue;
      for (const Factor& factor : factors) pieces.product(x, y, factor.text, factor.per, factor.size);
    }
  return std::move(pieces.made);
}

std::string law_text(const std::vector<LawPiece>& pieces, const std::string& id, const std::string& channel) {
  std::string formula, words, parameters, constants;
  for (const LawPiece& piece : pieces) {
    formula += (formula.empty() ? "" : " + ") + piece.formula;
    words += (words.empty() ? "" : ", and ") + piece.words;
    for (const LawParameter& p : piece.parameters) {
      parameters +=
          fmt::format("  {}: {{unit: \"{}\", from: {:.6g}, to: {:.6g}", p.name, p.unit, p.low, p.high);
      if (p.whole)
        parameters += ", integer: true";
      else
        parameters += fmt::format(", typical: {:.6g}", p.typical);
      if (p.starts > 0 && !p.value) parameters += fmt::format(", starts: {}", p.starts);
      if (p.value) parameters += fmt::format(", value: {:.9g}", *p.value);
      if (p.std_dev) parameters += fmt::format(", std: {:.3g}", *p.std_dev);
      parameters += "}\n";
    }
    for (const LawConstant& c : piece.constants)
      constants += fmt::format("  {}: {{unit: \"{}\", value: {:.9g}}}\n", c.name, c.unit, c.value);
  }
  const std::string given = channel == "range_noise"     ? "log_variance"
                            : channel == "bearing_noise" ? "bearing_log_variance"
                                                         : channel;
  return fmt::format(
      "effect: {}\nphysics: \"A law that was found, of unknown cause: {}.\"\nchannel: {}\nformula: \"{}\"\nparameters:\n{}{}{}"
      "source: \"found by rangecal diagnose --laws\"\nsettled_by: \"predict it in another recording of the sensor (rangecal predict)\"\n",
      id, words, given, formula, parameters, constants.empty() ? "" : "constants:\n", constants);
}

}  // namespace rangecal::diagnosis
