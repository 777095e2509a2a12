// SPDX-License-Identifier: BSD-3-Clause
#include "formula/unit.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <stdexcept>
#include <utility>

namespace rangecal::formula {
namespace {

/// The dimension behind a symbol; "" for a number.
std::string dimension_of(const std::string& symbol) {
  if (symbol == "rad" || symbol == "1" || symbol == "%") return "";
  if (symbol == "degC") return "K";
  return symbol;
}

/// A factor of a unit's text: a symbol, and its power.
std::pair<std::string, int> factor_of(const std::string& text) {
  const std::size_t caret = text.find('^');
  const std::string symbol = text.substr(0, caret);
  const bool is_symbol = !symbol.empty() && std::all_of(symbol.begin(), symbol.end(), [](unsigned char c) {
    return std::isalpha(c) != 0 || c == '%' || c > 127;
  });
  if (!is_symbol && symbol != "1")
    throw std::invalid_argument("'" + text + "' is no unit: write m, rad, 1/m, m/K, m^2, or 1 for a number");
  if (caret == std::string::npos) return {symbol, 1};
  char* end = nullptr;
  const long power = std::strtol(text.c_str() + caret + 1, &end, 10);
  if (end == text.c_str() + caret + 1 || *end != '\0' || power == 0 || std::labs(power) > 9)
    throw std::invalid_argument("'" + text + "' has no power from -9 to 9, other than 0");
  return {symbol, static_cast<int>(power)};
}

}  // namespace

Unit::Unit(const std::string& text) : text_(text.empty() ? "1" : text) {
  std::size_t begin = 0;
  int sign = 1;
  while (begin <= text_.size()) {
    const std::size_t end = std::min(text_.find_first_of("*/", begin), text_.size());
    const auto [symbol, power] = factor_of(text_.substr(begin, end - begin));
    if (symbol != "1") symbols_[symbol] += sign * power;
    if (const std::string dimension = dimension_of(symbol); !dimension.empty())
      dimensions_[dimension] += sign * power;
    if (end == text_.size()) break;
    sign = text_[end] == '/' ? -1 : 1;
    begin = end + 1;
  }
  std::erase_if(dimensions_, [](const auto& dimension) { return dimension.second == 0; });
}

double Unit::factor(const std::map<std::string, double>& scale) const {
  double product = 1.0;
  for (const auto& [dimension, power] : dimensions_) {
    const auto found = scale.find(dimension);
    if (found != scale.end()) product *= std::pow(found->second, power);
  }
  return product;
}

std::string Unit::ending() const {
  std::string above, below;
  for (const auto& [symbol, power] : symbols_) {
    if (power == 0) continue;
    std::string word = symbol == "%" ? "percent" : symbol;
    std::transform(word.begin(), word.end(), word.begin(), [](unsigned char c) { return std::tolower(c); });
    if (std::abs(power) > 1) word += std::to_string(std::abs(power));
    (power > 0 ? above : below) += "_" + word;
  }
  return above + (below.empty() ? "" : "_per" + below);
}

}  // namespace rangecal::formula
