// SPDX-License-Identifier: BSD-3-Clause
#include "formula/expression.hpp"

#include <fmt/format.h>
#include <muParser.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <string_view>

namespace rangecal::formula {
namespace {

constexpr std::size_t longest = 2000, deepest = 100;
constexpr std::string_view signs = "_+-*/^().,?:<>=!&| \t\n";

/// Throws for characters that no formula has, for assignments, which the parser would carry out, and for what is too long or
/// nested too deep for it.
void check(const std::string& text) {
  if (text.size() > longest)
    throw ExpressionError(fmt::format("is longer than {} characters", longest), longest + 1);
  if (text.find_first_not_of(" \t\n") == std::string::npos) throw ExpressionError("is empty", 0);
  std::size_t depth = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    const auto byte = static_cast<unsigned char>(c);
    if (byte > 127 || (std::isalnum(byte) == 0 && signs.find(c) == std::string_view::npos))
      throw ExpressionError(byte > 127 ? std::string("a letter or sign that is not ASCII")
                                       : fmt::format("'{}' has no meaning in a formula", c),
                            i + 1);
    depth += c == '(';
    if (depth > deepest)
      throw ExpressionError(fmt::format("brackets are nested deeper than {}", deepest), i + 1);
    if (c == ')' && depth > 0) --depth;
    if (c != '=') continue;
    const bool compares = (i + 1 < text.size() && text[i + 1] == '=') ||
                          (i > 0 && std::string_view("<>!=").find(text[i - 1]) != std::string_view::npos);
    if (!compares) throw ExpressionError("'=' assigns a value; write == to compare", i + 1);
  }
}

mu::Parser parser_of(const std::string& text) {
  mu::Parser parser;
  parser.ClearConst();
  parser.DefineConst("pi", std::numbers::pi);
  parser.SetExpr(text);
  return parser;
}

/// What the parser said, in words.
[[noreturn]] void fail(const mu::ParserError& error, std::size_t length) {
  std::string what = error.GetMsg();
  if (!what.empty()) what[0] = static_cast<char>(std::tolower(static_cast<unsigned char>(what[0])));
  while (!what.empty() && (what.back() == '.' || what.back() == '\n')) what.pop_back();
  const bool known = error.GetPos() >= 0 && what.find("position") == std::string::npos;
  throw ExpressionError(what, known ? std::min(static_cast<std::size_t>(error.GetPos()), length) + 1 : 0);
}

std::size_t next_number() {
  static std::atomic<std::size_t> next{0};
  return next++;
}

}  // namespace

/// A parser with its variables' values beside it.
struct Expression::Compiled {
  explicit Compiled(const Expression& expression)
      : values(expression.variables_.size()), parser(parser_of(expression.text_)) {
    for (std::size_t i = 0; i < values.size(); ++i) parser.DefineVar(expression.variables_[i], &values[i]);
  }
  std::vector<double> values;
  mu::Parser parser;
};

Expression::Expression(const std::string& text) : text_(text), number_(next_number()) {
  check(text);
  try {
    const mu::Parser parser = parser_of(text);
    for (const auto& [name, unused] : parser.GetUsedVar()) variables_.push_back(name);
    Compiled trial(*this);
    std::fill(trial.values.begin(), trial.values.end(), 0.5);
    int results = 0;
    trial.parser.Eval(results);
    if (results != 1) throw ExpressionError("holds several formulas, separated by commas", 0);
  } catch (const mu::ParserError& error) {
    fail(error, text.size());
  }
}

Expression::Compiled& Expression::compiled() const {
  thread_local std::vector<std::unique_ptr<Compiled>> of_number;
  if (number_ >= of_number.size()) of_number.resize(number_ + 1);
  if (!of_number[number_]) of_number[number_] = std::make_unique<Compiled>(*this);
  return *of_number[number_];
}

double Expression::at(const double* values) const {
  Compiled& own = compiled();
  std::copy(values, values + own.values.size(), own.values.begin());
  try {
    return own.parser.Eval();
  } catch (const mu::ParserError&) {  // of a value outside of a function's domain
    return std::numeric_limits<double>::quiet_NaN();
  }
}

}  // namespace rangecal::formula
