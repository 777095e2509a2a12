// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

namespace rangecal::formula {

/// What is wrong with the text of an expression, and at which of its characters (from 1; 0: no one in particular).
class ExpressionError : public std::runtime_error {
 public:
  ExpressionError(const std::string& what, std::size_t at) : std::runtime_error(what), character(at) {}
  std::size_t character;
};

/// A formula of named variables: numbers, + - * / ^, comparisons (1 or 0), && ||, condition ? this : that, the constant pi,
/// and abs acos acosh asin asinh atan atan2 atanh cos cosh exp ln log10 log2 max min rint sign sin sinh sqrt tan tanh.
/// Evaluated by muParser; any number of threads may evaluate one expression.
class Expression {
 public:
  /// Throws ExpressionError where the text is no such formula, is longer than 2000 characters or nested deeper than 100.
  explicit Expression(const std::string& text);

  const std::string& text() const { return text_; }
  /// Those that it has, in alphabetical order.
  const std::vector<std::string>& variables() const { return variables_; }
  /// Its value, one value for each of the variables. What has none (0/0, sqrt(-1)) is NaN or infinite.
  double operator()(const std::vector<double>& values) const { return at(values.data()); }
  double at(const double* values) const;

 private:
  struct Compiled;
  Compiled& compiled() const;  ///< this thread's own

  std::string text_;
  std::vector<std::string> variables_;
  std::size_t number_;  ///< among all expressions of the program
};

}  // namespace rangecal::formula
