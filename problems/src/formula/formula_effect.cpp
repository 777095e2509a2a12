// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/effects/formula_effect.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <map>
#include <numbers>
#include <optional>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "added_effects.hpp"
#include "formula/expression.hpp"
#include "formula/unit.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/core/yaml_reader.hpp"
#include "rangecal/problems/effects/central_difference.hpp"

namespace rangecal {
namespace {

using formula::Expression;
using formula::ExpressionError;
using formula::Unit;

/// What a reading is described by, with its unit, the covariate of docs/formats.md that it is, and where a trial has it.
struct Variable {
  const char* name;
  const char* unit;
  const char* covariate;
  double (*value)(const ReadingView<double>&);
  double low, high;
  bool whole = false;
};

constexpr std::array<Variable, 10> variables = {{
    {"b", "rad", "sensor_bearing", [](const ReadingView<double>& at) { return at.bearing; }, -3.1, 3.1},
    {"d", "m", "range", [](const ReadingView<double>& at) { return at.d; }, 0.2, 8.0},
    {"duration", "s", "time",
     [](const ReadingView<double>& at) { return at.context != nullptr ? at.context->duration_s : 0.0; },
     600.0, 600.0},
    {"f", "m", "range", [](const ReadingView<double>& at) { return at.f; }, 0.2, 8.0},
    {"heading", "rad", "heading", [](const ReadingView<double>& at) { return at.heading; }, -3.1, 3.1},
    {"landmark", "1", "landmark",
     [](const ReadingView<double>& at) { return static_cast<double>(at.landmark); }, 0.0, 8.0, true},
    {"radius", "m", "radius", [](const ReadingView<double>& at) { return at.radius; }, 0.02, 0.2},
    {"repeat", "1", "repeat", [](const ReadingView<double>& at) { return static_cast<double>(at.repeat); },
     0.0, 20.0, true},
    {"stop", "1", "stop", [](const ReadingView<double>& at) { return static_cast<double>(at.stop); }, 0.0,
     20.0, true},
    {"t", "s", "time", [](const ReadingView<double>& at) { return at.time_s; }, 0.0, 600.0},
}};

const Variable* variable_of(const std::string& name) {
  const auto found =
      std::find_if(variables.begin(), variables.end(), [&](const Variable& v) { return name == v.name; });
  return found == variables.end() ? nullptr : &*found;
}

/// Which number a formula gives.
enum class Gives { range, bearing, range_log_variance, bearing_log_variance, outlier_share };

struct GivenChannel {
  const char* name;
  Gives gives;
  EffectKind kind;
  const char* channel;  ///< of docs/formats.md
  const char* unit;
};

constexpr std::array<GivenChannel, 5> channels = {{
    {"range", Gives::range, EffectKind::mean, "range", "m"},
    {"bearing", Gives::bearing, EffectKind::mean, "bearing", "rad"},
    {"log_variance", Gives::range_log_variance, EffectKind::noise, "range_noise", "1"},
    {"bearing_log_variance", Gives::bearing_log_variance, EffectKind::noise, "bearing_noise", "1"},
    {"outlier_share", Gives::outlier_share, EffectKind::tail, "range_tail", "1"},
}};

/// One name of a formula: where its value comes from.
struct Slot {
  enum class From { variable, parameter, constant, column } from;
  int index = 0;  ///< into `variables`, or the parameters
  double value = 0.0;
  std::string name;
  Unit unit{"1"};
};

/// Outliers of an `outlier_share`.
struct Outliers {
  enum class Side { both, early, late } side = Side::both;
  int parameter = -1;  ///< whose value is their size [m]; -1: `size_m`
  double size_m = 0.0;
};

/// What a text states of a parameter beside its bounds.
struct StatedParameter {
  std::string name;  ///< in the formula
  Unit unit{"1"};
  int starts = 0;                    ///< how many a fit may start from; 0: by default
  std::optional<double> value = {};  ///< what was found
  double std_dev = 0.0;              ///< of that, 0 where it is not stated
  /// A fit starts at what was found alone.
  bool starts_at_value() const { return value && starts == 0; }
};

/// All that a text states.
struct Stated {
  std::string text;  ///< the whole of it
  GivenChannel channel = channels[0];
  bool before_curve = false;
  std::vector<StatedParameter> parameters;  ///< as info has them
  std::vector<Slot> slots;                  ///< one for each variable of the expression
  bool rest = false;  ///< a part does not vanish with the linear parameters: one that is not linear has it
  Outliers outliers;
  EffectInfo info;
};

constexpr std::size_t most_slots = 64;

/// The formula's value when the names have these values.
class FormulaEffect final : public Effect {
 public:
  FormulaEffect(Stated stated, Expression expression)
      : stated_(std::move(stated)), expression_(std::move(expression)) {}

  const EffectInfo& info() const override { return stated_.info; }
  const Stated& stated() const { return stated_; }

  std::string missing(const EffectContext& context) const override {
    const bool pairs = context.kind == RecordingKind::pairs;
    const Gives gives = stated_.channel.gives;
    if (pairs && (gives == Gives::bearing || gives == Gives::bearing_log_variance))
      return "stops (a recording of kind landmarks, pairs have none)";
    for (const Slot& slot : stated_.slots) {
      if (slot.from == Slot::From::column && column_of(context, slot) < 0) return "a column " + slot.name;
      if (slot.from != Slot::From::variable) continue;
      if ((slot.name == "t" || slot.name == "duration") && !(context.duration_s > 0.0))
        return "times (a column time_s)";
      if (slot.name == "heading" && pairs) return "stops (a recording of kind landmarks, pairs have none)";
    }
    return {};
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext&) const override {
    const std::vector<EffectParameter>& parameters = stated_.info.parameters;
    const auto nonlinear = std::count_if(parameters.begin(), parameters.end(),
                                         [](const EffectParameter& p) { return !p.linear && !p.discrete; });
    std::vector<std::vector<double>> axes;
    for (std::size_t i = 0; i < parameters.size(); ++i) {
      const EffectParameter& p = parameters[i];
      std::vector<double>& axis = axes.emplace_back();
      const StatedParameter& own = stated_.parameters[i];
      if (p.linear) {
        axis.push_back(0.0);
      } else if (own.starts_at_value()) {
        axis.push_back(std::clamp(*own.value, p.low, p.high));
      } else if (p.discrete) {
        for (double value = p.low; value <= p.high; value += 1.0) axis.push_back(value);
      } else {
        const int by_default = nonlinear == 1 ? 24 : nonlinear == 2 ? 8 : 4;
        axis = spaced(p.low, p.high, own.starts > 0 ? own.starts : by_default);
      }
    }
    return grid_of(axes);
  }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    switch (stated_.channel.gives) {
      case Gives::range: {
        if (!stated_.before_curve) return {.range = value(at, p)};
        const double change = at.before_curve(value(at, p));
        return {.range = change, .range_log_variance = at.spread_along(change)};
      }
      case Gives::bearing:
        return {.bearing = value(at, p)};
      case Gives::range_log_variance:
        return {.range_log_variance = value(at, p)};
      case Gives::bearing_log_variance:
        return {.bearing_log_variance = value(at, p)};
      case Gives::outlier_share:
        break;
    }
    return {};
  }

  /// Per unit of a linear parameter: the value at 1 of it, the other linear ones 0, less that at 0 of it too; before the curve,
  /// which bends it, a central difference.
  std::optional<ReadingChange<double>> slope(const ReadingView<double>& at, const double* p,
                                             int parameter) const override {
    const std::vector<EffectParameter>& parameters = stated_.info.parameters;
    const auto index = static_cast<std::size_t>(parameter);
    if (!parameters[index].linear) return std::nullopt;
    if (stated_.before_curve) return central_difference(*this, at, p, parameter);
    std::array<double, most_slots> unit;
    for (std::size_t i = 0; i < parameters.size(); ++i) unit[i] = parameters[i].linear ? 0.0 : p[i];
    const ReadingChange<double> of_others = stated_.rest ? reading(at, unit.data()) : ReadingChange<double>{};
    unit[index] = 1.0;
    ReadingChange<double> change = reading(at, unit.data());
    change.range -= of_others.range;
    change.bearing -= of_others.bearing;
    change.range_log_variance -= of_others.range_log_variance;
    change.bearing_log_variance -= of_others.bearing_log_variance;
    return change;
  }

  bool changes_with_distance() const override {
    return stated_.before_curve ||
           std::any_of(stated_.slots.begin(), stated_.slots.end(), [](const Slot& slot) {
             return slot.from == Slot::From::variable && (slot.name == "d" || slot.name == "f");
           });
  }

  bool differs_between_repeats() const override {
    return std::any_of(stated_.slots.begin(), stated_.slots.end(), [](const Slot& slot) {
      return slot.from == Slot::From::column ||
             (slot.from == Slot::From::variable && (slot.name == "t" || slot.name == "repeat"));
    });
  }

  Contamination contamination(const ReadingView<double>& at, const double* p) const override {
    if (stated_.channel.gives != Gives::outlier_share) return {};
    constexpr double most = 0.9;
    const double share = value(at, p);
    if (!(share > 0.0)) return {};
    const Outliers& outliers = stated_.outliers;
    const double size = outliers.parameter < 0 ? outliers.size_m : p[outliers.parameter];
    Contamination law{.share = std::min(share, most)};
    if (outliers.side == Outliers::Side::both) law.extra_sigma_m = size;
    if (outliers.side == Outliers::Side::late) law.mean_m = size;
    if (outliers.side == Outliers::Side::early) {
      law.mean_m = -size;
      law.end_m = std::fmax(at.f, 1e-3);
    }
    return law;
  }

  /// By values of the names in the order of the slots.
  double of(const std::vector<double>& values) const { return expression_(values); }

 private:
  static std::vector<double> spaced(double low, double high, int count) {
    std::vector<double> values;
    const bool geometric = low > 0.0 && high >= 10.0 * low;
    for (int i = 0; i < count; ++i) {
      const double share = count == 1 ? 0.5 : static_cast<double>(i) / (count - 1);
      values.push_back(geometric ? low * std::pow(high / low, share) : low + share * (high - low));
    }
    return values;
  }

  /// Where the context has the column; -1: nowhere.
  static std::ptrdiff_t column_of(const EffectContext& context, const Slot& slot) {
    const auto found = std::find(context.covariates.begin(), context.covariates.end(), slot.name);
    return found == context.covariates.end() ? -1 : found - context.covariates.begin();
  }

  double value(const ReadingView<double>& at, const double* p) const {
    std::array<double, most_slots> values;
    for (std::size_t i = 0; i < stated_.slots.size(); ++i) {
      const Slot& slot = stated_.slots[i];
      switch (slot.from) {
        case Slot::From::variable:
          values[i] = variables[static_cast<std::size_t>(slot.index)].value(at);
          break;
        case Slot::From::parameter:
          values[i] = p[slot.index];
          break;
        case Slot::From::constant:
          values[i] = slot.value;
          break;
        case Slot::From::column: {
          const std::ptrdiff_t column = at.context != nullptr ? column_of(*at.context, slot) : -1;
          if (column < 0 || at.covariate == nullptr || !std::isfinite(at.covariate[column])) return 0.0;
          values[i] = at.covariate[column];
          break;
        }
      }
    }
    return expression_.at(values.data());
  }

  Stated stated_;
  Expression expression_;
};

// Reading the text.

bool is_name(const std::string& text) {
  if (text.empty() || text.size() > 40 || std::isdigit(static_cast<unsigned char>(text[0])) != 0)
    return false;
  return std::all_of(text.begin(), text.end(),
                     [](unsigned char c) { return std::isalnum(c) != 0 || c == '_'; });
}

Unit unit_in(const YamlReader& node) {
  try {
    return Unit(node.has("unit") ? node.at("unit").text() : "1");
  } catch (const std::invalid_argument& error) {
    node.at("unit").fail(error.what());
  }
}

bool is_function(const std::string& name) {
  for (const char* arguments : {"(1)", "(1, 1)"}) {
    try {
      if (Expression(name + arguments).variables().empty()) return true;
    } catch (const ExpressionError&) {  // no function, or one of other arguments
    }
  }
  return false;
}

/// A name that the formula may use and that nothing else has.
void require_free(const YamlReader& node, const std::string& name, const std::set<std::string>& taken) {
  if (!is_name(name))
    node.fail("'" + name.substr(0, 40) + "' is no name: letters, digits and _, not a digit first");
  if (variable_of(name) != nullptr || name == "pi" || taken.contains(name))
    node.fail("'" + name + "' has a meaning already");
  if (is_function(name)) node.fail("'" + name + "' is a function");
}

bool truth_of(const YamlReader& node) {
  const std::string text = node.text();
  if (text != "true" && text != "false") node.fail("'" + text.substr(0, 40) + "' is neither true nor false");
  return text == "true";
}

EffectParameter parameter_in(const YamlReader& node, const std::string& name, Stated& stated) {
  node.allow_only({"unit", "typical", "from", "to", "integer", "starts", "value", "std"});
  EffectParameter parameter;
  const Unit unit = unit_in(node);
  parameter.name = name + unit.ending();
  parameter.low = node.at("from").number();
  parameter.high = node.at("to").number();
  if (!(parameter.low < parameter.high) || !std::isfinite(parameter.high - parameter.low))
    node.fail("'from' is not below 'to'");
  parameter.discrete = node.has("integer") && truth_of(node.at("integer"));
  if (parameter.discrete) {
    constexpr double most = 1000.0;
    if (parameter.low != std::rint(parameter.low) || parameter.high != std::rint(parameter.high) ||
        parameter.high - parameter.low > most)
      node.fail("an integer goes from one whole number to another, at most a thousand above");
    if (!unit.dimensions().empty()) node.at("unit").fail("an integer is a number");
    parameter.linear = false;
    parameter.typical = parameter.low;
  }
  if (node.has("typical")) {
    parameter.typical = node.at("typical").number();
    if (parameter.typical < parameter.low || parameter.typical > parameter.high)
      node.at("typical").fail("is not between 'from' and 'to'");
  } else if (!parameter.discrete) {
    node.fail("field 'typical' is missing: the size that is often met");
  }
  if (!parameter.discrete && !(std::abs(parameter.typical) > 0.0)) node.at("typical").fail("is 0");
  StatedParameter own{name, unit};
  if (node.has("starts")) own.starts = node.at("starts").whole(1);
  if (node.has("value")) own.value = node.at("value").number();
  if (node.has("std")) own.std_dev = node.at("std").not_negative();
  stated.parameters.push_back(std::move(own));
  return parameter;
}

/// -1: it is none.
int number_of_parameter(const Stated& stated, const std::string& name) {
  const auto found = std::find_if(stated.parameters.begin(), stated.parameters.end(),
                                  [&](const StatedParameter& own) { return own.name == name; });
  return found == stated.parameters.end() ? -1 : static_cast<int>(found - stated.parameters.begin());
}

Outliers outliers_in(const YamlReader& node, const Stated& stated) {
  node.allow_only({"side", "size"});
  Outliers outliers;
  const std::string side = node.at("side").text();
  if (side == "early")
    outliers.side = Outliers::Side::early;
  else if (side == "late")
    outliers.side = Outliers::Side::late;
  else if (side != "both")
    node.at("side").fail("'" + side.substr(0, 40) + "' is none of both, early, late");
  const std::string size = node.at("size").text();
  outliers.parameter = number_of_parameter(stated, size);
  if (outliers.parameter >= 0) {
    if (!(stated.info.parameters[static_cast<std::size_t>(outliers.parameter)].low > 0.0))
      node.at("size").fail("the size of outliers is above 0: 'from' of " + size + " is not");
  } else {
    outliers.size_m = node.at("size").positive();
  }
  return outliers;
}

/// The unit of a covariate by its name; a number where that says none.
Unit unit_of_column(const std::string& name, const YamlReader* columns) {
  if (columns != nullptr && columns->has(name.c_str())) {
    const YamlReader own = columns->at(name.c_str());
    own.allow_only({"unit"});
    return unit_in(own);
  }
  return Unit(unit_of_column_in_formulas(name));
}

// What a formula has to hold, tried at points.

/// Values of the names at one point of their domains.
struct Point {
  std::vector<double> values;
};

class Trial {
 public:
  Trial(const FormulaEffect& effect, const YamlReader& node) : effect_(effect), node_(node) {
    Random random(seed_from("formula " + effect.stated().info.id));
    for (std::size_t i = 0; i < points; ++i) {
      Point& point = points_.emplace_back();
      for (const Slot& slot : effect.stated().slots) point.values.push_back(value_of(slot, random));
    }
  }

  /// Finds which parameters are linear, and throws for what is wrong with the formula.
  void judge(Stated& stated) const {
    require_finite();
    if (stated.channel.gives == Gives::outlier_share) {
      for (EffectParameter& p : stated.info.parameters) p.linear = false;
    } else {
      find_linear(stated);
      require_vanishing(stated);
    }
    require_units(stated);
  }

 private:
  static constexpr std::size_t points = 64;
  static constexpr double least = 1e-290;  ///< smaller numbers have few digits

  double value_of(const Slot& slot, Random& random) const {
    switch (slot.from) {
      case Slot::From::variable: {
        const Variable& v = variables[static_cast<std::size_t>(slot.index)];
        const double x = random.uniform(v.low, v.high);
        return v.whole ? std::floor(x) : x;
      }
      case Slot::From::parameter: {
        const EffectParameter& p = effect_.info().parameters[static_cast<std::size_t>(slot.index)];
        if (p.discrete)
          return p.low + static_cast<double>(random.index(static_cast<std::uint64_t>(p.high - p.low) + 1));
        const double size = std::abs(p.typical);
        return std::clamp(p.typical + random.uniform(-0.5, 0.5) * size, p.low, p.high);
      }
      case Slot::From::constant:
        return slot.value;
      case Slot::From::column:
        return random.uniform(1.0, 30.0);
    }
    return 0.0;
  }

  std::string in_words(const Point& point) const {
    std::string words;
    for (std::size_t i = 0; i < point.values.size(); ++i)
      words +=
          fmt::format("{}{} = {:.4g}", i == 0 ? "" : ", ", effect_.stated().slots[i].name, point.values[i]);
    return words;
  }

  void require_finite() const {
    for (const Point& point : points_)
      if (!std::isfinite(effect_.of(point.values)))
        node_.at("formula").fail("is no finite number at " + in_words(point));
  }

  /// The value at a point where parameter j of `slots` has values[j] in place of its own.
  double at(const Point& point, const std::vector<std::size_t>& slots,
            const std::vector<double>& values) const {
    Point moved = point;
    for (std::size_t j = 0; j < slots.size(); ++j) moved.values[slots[j]] = values[j];
    return effect_.of(moved.values);
  }

  /// True if the value is affine in these parameters together: V(u) + V(v) = V(u + v) + V(0).
  bool affine_in(const std::vector<std::size_t>& slots) const {
    Random random(seed_from("formula affine", {slots.size()}));
    for (const Point& point : points_) {
      std::vector<double> u, v, sum;
      for (const std::size_t slot : slots) {
        const double size = std::abs(point.values[slot]);
        u.push_back(size * random.uniform(0.2, 1.0));
        v.push_back(-size * random.uniform(0.2, 1.0));
        sum.push_back(u.back() + v.back());
      }
      const double a = at(point, slots, u), b = at(point, slots, v), c = at(point, slots, sum),
                   zero = at(point, slots, std::vector<double>(slots.size(), 0.0));
      const double scale = std::abs(a) + std::abs(b) + std::abs(c) + std::abs(zero);
      if (!(std::abs(a + b - c - zero) <= 1e-9 * scale + least)) return false;
    }
    return true;
  }

  void find_linear(Stated& stated) const {
    std::vector<std::size_t> linear;
    for (std::size_t i = 0; i < stated.slots.size(); ++i) {
      if (stated.slots[i].from != Slot::From::parameter) continue;
      EffectParameter& p = stated.info.parameters[static_cast<std::size_t>(stated.slots[i].index)];
      std::vector<std::size_t> with = linear;
      with.push_back(i);
      p.linear = !p.discrete && p.low <= 0.0 && p.high >= 0.0 && affine_in(with);
      if (p.linear) linear = with;
    }
    for (std::size_t j = 0; j < stated.info.parameters.size(); ++j)
      if (const auto used = std::find_if(stated.slots.begin(), stated.slots.end(),
                                         [&](const Slot& slot) {
                                           return slot.from == Slot::From::parameter &&
                                                  slot.index == static_cast<int>(j);
                                         });
          used == stated.slots.end())
        node_.at("parameters").fail("the formula does not use '" + stated.parameters[j].name + "'");
  }

  /// What is left where the linear parameters are 0 has to be another parameter's, which it changes with.
  void require_vanishing(Stated& stated) const {
    std::vector<std::size_t> linear;
    std::vector<std::string> names;
    for (std::size_t i = 0; i < stated.slots.size(); ++i)
      if (stated.slots[i].from == Slot::From::parameter &&
          stated.info.parameters[static_cast<std::size_t>(stated.slots[i].index)].linear) {
        linear.push_back(i);
        names.push_back(stated.slots[i].name);
      }
    if (linear.empty()) return;
    const std::vector<double> zeros(linear.size(), 0.0);
    for (std::size_t k = 0; k < points; ++k) {
      const Point& point = points_[k];
      const double left = at(point, linear, zeros);
      if (!(std::abs(left) > 0.0)) continue;
      stated.rest = true;
      Point moved = point;  // to the parameters of another point
      for (std::size_t i = 0; i < stated.slots.size(); ++i)
        if (stated.slots[i].from == Slot::From::parameter)
          moved.values[i] = points_[(k + 1) % points].values[i];
      if (at(moved, linear, zeros) == left)
        node_.at("formula").fail(
            fmt::format("does not vanish where {} {} 0, at {}: a part of it belongs to no parameter",
                        fmt::join(names, ", "), names.size() == 1 ? "is" : "are", in_words(point)));
    }
  }

  /// In units of other sizes the names have other values, and the formula the value that its unit asks for.
  void require_units(const Stated& stated) const {
    const Unit result(stated.channel.unit);
    std::map<std::string, double> scale;
    for (const auto& [dimension, power] : result.dimensions()) scale[dimension] = 0.0;
    for (const Slot& slot : stated.slots)
      for (const auto& [dimension, power] : slot.unit.dimensions()) scale[dimension] = 0.0;
    for (auto& [dimension, changed] : scale) {
      std::map<std::string, double> one{{dimension, 1.37}};
      for (const Point& point : points_) {
        Point other = point;
        for (std::size_t i = 0; i < other.values.size(); ++i)
          other.values[i] *= stated.slots[i].unit.factor(one);
        const double before = effect_.of(point.values) * result.factor(one), after = effect_.of(other.values);
        if (std::abs(after - before) > 1e-6 * (std::abs(after) + std::abs(before)) + least)
          node_.at("formula").fail(fmt::format(
              "its units do not give {}: measured in another unit than {} it is another change (numbers with a unit belong "
              "into 'parameters' or 'constants'; arguments of functions are numbers)",
              result.text() == "1" ? "a number" : result.text(), dimension));
      }
    }
  }

  const FormulaEffect& effect_;
  const YamlReader& node_;
  std::vector<Point> points_;
};

/// Where the mismatch shows: along the first of its variables that is no distance, else the distance.
std::string covariate_of(const std::vector<Slot>& slots) {
  std::string covariate = "constant";
  for (const Slot& slot : slots) {
    if (slot.from == Slot::From::column) return slot.name;
    if (slot.from != Slot::From::variable) continue;
    const std::string own = variables[static_cast<std::size_t>(slot.index)].covariate;
    if (covariate == "constant" || covariate == "range") covariate = own;
  }
  return covariate;
}

std::vector<Slot> slots_of(const Expression& expression, const Stated& stated,
                           const std::map<std::string, Slot>& constants, const YamlReader* columns) {
  std::vector<Slot> slots;
  for (const std::string& name : expression.variables()) {
    Slot slot;
    slot.name = name;
    const int parameter = number_of_parameter(stated, name);
    if (const Variable* variable = variable_of(name)) {
      slot.from = Slot::From::variable;
      slot.index = static_cast<int>(variable - variables.data());
      slot.unit = Unit(variable->unit);
    } else if (parameter >= 0) {
      slot.from = Slot::From::parameter;
      slot.index = parameter;
      slot.unit = stated.parameters[static_cast<std::size_t>(parameter)].unit;
    } else if (const auto constant = constants.find(name); constant != constants.end()) {
      slot = constant->second;
    } else {
      slot.from = Slot::From::column;
      slot.unit = unit_of_column(name, columns);
    }
    slots.push_back(std::move(slot));
  }
  return slots;
}

std::unique_ptr<FormulaEffect> formula_effect(const std::string& yaml, const std::string& file) {
  const YamlReader top = YamlReader::parse(yaml, file);
  top.allow_only({"effect", "physics", "channel", "acts", "formula", "parameters", "constants", "columns",
                  "outliers", "covariate", "source", "visible_by", "settled_by"});
  Stated stated;
  stated.text = yaml;
  EffectInfo& info = stated.info;
  info.id = top.at("effect").text();
  if (!is_name(info.id))
    top.at("effect").fail("'" + info.id.substr(0, 40) + "' is no name: letters, digits and _");
  info.physics = top.at("physics").text();
  info.formula = top.at("formula").text();
  info.source = top.has("source") ? top.at("source").text() : file;
  info.visible_by = top.has("visible_by") ? top.at("visible_by").text() : "";
  info.settled_by = top.at("settled_by").text();
  const std::string channel = top.at("channel").text();
  const auto known =
      std::find_if(channels.begin(), channels.end(), [&](const auto& c) { return channel == c.name; });
  if (known == channels.end())
    top.at("channel").fail("'" + channel.substr(0, 40) +
                           "' is none of range, bearing, log_variance, bearing_log_variance, outlier_share");
  stated.channel = *known;
  info.kind = known->kind;
  info.channel = known->channel;
  if (top.has("acts")) {
    const std::string acts = top.at("acts").text();
    if (acts != "reading" && acts != "distance")
      top.at("acts").fail("'" + acts.substr(0, 40) +
                          "' is neither reading (after the curve) nor distance (before it)");
    stated.before_curve = acts == "distance";
    if (stated.before_curve && stated.channel.gives != Gives::range)
      top.at("acts").fail("only a change of the range can act on the distance, before the curve");
    if (stated.before_curve) info.stage = Stage::path;
  }
  std::set<std::string> taken;
  for (const auto& [name, node] : top.at("parameters").entries()) {
    require_free(node, name, taken);
    taken.insert(name);
    info.parameters.push_back(parameter_in(node, name, stated));
  }
  if (info.parameters.empty()) top.at("parameters").fail("is empty: nothing could be fitted");
  std::map<std::string, Slot> constants;
  if (top.has("constants"))
    for (const auto& [name, node] : top.at("constants").entries()) {
      require_free(node, name, taken);
      taken.insert(name);
      node.allow_only({"unit", "value"});
      constants[name] = {Slot::From::constant, 0, node.at("value").number(), name, unit_in(node)};
    }
  const bool shares = stated.channel.gives == Gives::outlier_share;
  if (shares != top.has("outliers"))
    top.fail(shares ? "field 'outliers' is missing: {side: both|early|late, size: metres or a parameter}"
                    : "field 'outliers' belongs to channel outlier_share");
  if (shares) stated.outliers = outliers_in(top.at("outliers"), stated);
  std::optional<Expression> expression;
  try {
    expression.emplace(info.formula);
  } catch (const ExpressionError& error) {
    top.at("formula").fail(error.character > 0
                               ? fmt::format("{} (at its character {})", error.what(), error.character)
                               : std::string(error.what()));
  }
  if (expression->variables().size() > most_slots || info.parameters.size() > most_slots)
    top.at("formula").fail(fmt::format("has more than {} names", most_slots));
  std::optional<YamlReader> columns;
  if (top.has("columns")) columns = top.at("columns");
  stated.slots = slots_of(*expression, stated, constants, columns ? &*columns : nullptr);
  info.covariate = top.has("covariate") ? top.at("covariate").text() : covariate_of(stated.slots);
  const FormulaEffect draft(stated, *expression);
  Trial(draft, top).judge(stated);
  auto effect = std::make_unique<FormulaEffect>(std::move(stated), std::move(*expression));
  constexpr std::size_t most_starts = 5000;
  std::size_t starts = 1;
  for (std::size_t i = 0; i < effect->info().parameters.size(); ++i)
    if (const EffectParameter& p = effect->info().parameters[i];
        p.discrete && !effect->stated().parameters[i].starts_at_value())
      starts *= static_cast<std::size_t>(p.high - p.low) + 1;
  if (starts > most_starts || effect->start_grid({}).size() > most_starts)
    top.at("parameters")
        .fail(fmt::format("a fit would have more than {} starts: fewer integers, or fewer 'starts'",
                          most_starts));
  return effect;
}

std::unique_ptr<FormulaEffect> formula_effect_of_file(const std::string& path) {
  constexpr std::size_t largest = 1u << 20;
  return formula_effect(read_file(path, largest), path);
}

}  // namespace

std::unique_ptr<Effect> effect_from_formula(const std::string& yaml, const std::string& file) {
  return formula_effect(yaml, file);
}

std::unique_ptr<Effect> effect_from_file(const std::string& path) { return formula_effect_of_file(path); }

bool is_column_of_formulas(const std::string& name) {
  return is_name(name) && variable_of(name) == nullptr && name != "pi" && !is_function(name);
}

std::string unit_of_column_in_formulas(const std::string& name) {
  const std::string unit = column_by_name(name).unit;
  if (unit == "dBm") return "dB";
  if (unit == "degC") return "K";
  try {
    return Unit(unit).text();
  } catch (const std::invalid_argument&) {
    return "1";
  }
}

StatedValues stated_values(const Effect& effect) {
  const auto* by_formula = dynamic_cast<const FormulaEffect*>(&effect);
  if (by_formula == nullptr) return {};
  const Stated& stated = by_formula->stated();
  const auto count = static_cast<Eigen::Index>(stated.parameters.size());
  StatedValues values{Eigen::VectorXd(count), Eigen::VectorXd(count)};
  for (Eigen::Index i = 0; i < count; ++i) {
    const StatedParameter& own = stated.parameters[static_cast<std::size_t>(i)];
    if (!own.value) return {};
    values.value[i] = *own.value;
    values.std_dev[i] = own.std_dev;
  }
  return values;
}

std::vector<std::string> add_effects_by_formula(const std::string& folder) {
  namespace fs = std::filesystem;
  std::error_code error;
  std::vector<std::string> files;
  if (!fs::is_directory(folder, error)) throw InputError(folder, 0, "", "no such folder");
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error))
    if (entry.path().extension() == ".yaml" || entry.path().extension() == ".yml")
      files.push_back(entry.path().string());
  if (files.empty()) throw InputError(folder, 0, "", "holds no .yaml file of an effect");
  std::sort(files.begin(), files.end());
  std::vector<std::unique_ptr<FormulaEffect>> read;
  for (const std::string& file : files) {
    read.push_back(formula_effect_of_file(file));
    const std::string& id = read.back()->info().id;
    for (std::size_t i = 0; i + 1 < read.size(); ++i)
      if (read[i]->info().id == id)
        throw InputError(file, 0, "", "effect '" + id + "' is that of " + files[i] + " as well");
    const Effect* known = find_effect(id);
    const auto* by_formula = dynamic_cast<const FormulaEffect*>(known);
    if (known != nullptr && by_formula == nullptr)
      throw InputError(file, 0, "", "effect '" + id + "' is one of the catalogue: give it another name");
    if (by_formula != nullptr && by_formula->stated().text != read.back()->stated().text)
      throw InputError(file, 0, "", "effect '" + id + "' was added before with another text");
  }
  std::vector<std::string> ids;
  for (std::unique_ptr<FormulaEffect>& effect : read) {
    ids.push_back(effect->info().id);
    if (find_effect(ids.back()) == nullptr) add_effect(std::move(effect));
  }
  return ids;
}

void require_columns_of_formulas(std::span<const Recording> recordings) {
  for (const Effect* effect : added_effects()) {
    const auto* by_formula = dynamic_cast<const FormulaEffect*>(effect);
    if (by_formula == nullptr) continue;
    for (const Slot& slot : by_formula->stated().slots) {
      if (slot.from != Slot::From::column) continue;
      std::set<std::string> columns;
      for (const Recording& recording : recordings)
        for (const auto& [name, values] : covariates_of(recording)) columns.insert(name);
      if (columns.contains(slot.name)) continue;
      std::vector<std::string> known;
      for (const Variable& v : variables) known.emplace_back(v.name);
      throw InputError(fmt::format(
          "effect {}: '{}' is neither a parameter, nor one of {}, nor a column of the recordings{}",
          effect->info().id, slot.name, fmt::join(known, ", "),
          columns.empty() ? std::string(", which have none")
                          : fmt::format(" ({})", fmt::join(columns, ", "))));
    }
  }
}

namespace {

/// The unit of each of the words, "m^2" of "m2", with a sign before each but the first; empty where one is no unit.
std::string units_of_words(const std::string& words, char sign) {
  static const std::map<std::string, std::string> known = {
      {"m", "m"}, {"rad", "rad"}, {"s", "s"}, {"k", "K"}, {"db", "dB"}, {"v", "V"}, {"a", "A"}};
  std::string units, word;
  std::istringstream all(words);
  while (std::getline(all, word, '_')) {
    std::string power;
    while (!word.empty() && std::isdigit(static_cast<unsigned char>(word.back())) != 0)
      power = word.back() + power, word.pop_back();
    const auto unit = known.find(word);
    if (unit == known.end()) return {};
    if (!units.empty()) units += sign;
    units += unit->second + (power.empty() ? "" : "^" + power);
  }
  return units;
}

}  // namespace

ParameterName parameter_name(const std::string& full) {
  // Its last word, where that is a unit and not all of it.
  const auto split = [](const std::string& text) -> ParameterName {
    const std::size_t at = text.rfind('_');
    if (at == std::string::npos) return {text, ""};
    const std::string unit = units_of_words(text.substr(at + 1), '*');
    return unit.empty() ? ParameterName{text, ""} : ParameterName{text.substr(0, at), unit};
  };
  static const std::string per = "_per_";
  if (const std::size_t at = full.rfind(per); at != std::string::npos) {
    const std::string below = units_of_words(full.substr(at + per.size()), '/');
    const auto [name, above] = split(full.substr(0, at));
    if (!below.empty()) return {name, (above.empty() ? "1" : above) + "/" + below};
  }
  // A last k, db, v or a alone may be a word.
  const ParameterName own = split(full);
  const std::string first = own.unit.substr(0, own.unit.find('^'));
  return first == "m" || first == "rad" || first == "s" ? own : ParameterName{full, "1"};
}

std::string as_formula(const Effect& effect) {
  if (const auto* by_formula = dynamic_cast<const FormulaEffect*>(&effect)) return by_formula->stated().text;
  const EffectInfo& info = effect.info();
  if (info.expression.empty()) return {};
  const auto channel = std::find_if(channels.begin(), channels.end(),
                                    [&](const auto& c) { return info.channel == c.channel; });
  if (channel == channels.end()) return {};
  const auto quoted = [](const std::string& text) {
    std::string words = "\"";
    for (const char c : text) words += (c == '"' || c == '\\') ? std::string("\\") + c : std::string(1, c);
    return words + "\"";
  };
  std::string text =
      fmt::format("effect: my_{}\nphysics: {}\nchannel: {}\n", info.id, quoted(info.physics), channel->name);
  if (info.before_curve) text += "acts: distance\n";
  text += fmt::format("formula: {}\nparameters:\n", quoted(info.expression));
  EffectContext usual;
  usual.range_min_m = 0.3;
  usual.range_max_m = 6.0;
  usual.duration_s = 3600.0;
  const std::vector<Eigen::VectorXd> grid = effect.start_grid(usual);
  for (std::size_t i = 0; i < info.parameters.size(); ++i) {
    const EffectParameter& p = info.parameters[i];
    const ParameterName name = parameter_name(p.name);
    std::set<double> starts;
    for (const Eigen::VectorXd& start : grid) starts.insert(start[static_cast<Eigen::Index>(i)]);
    text += fmt::format("  {}{}: {{unit: \"{}\", typical: {:g}, from: {:g}, to: {:g}{}}}\n", name.name,
                        is_function(name.name) ? "_" : "", name.unit, p.typical, p.low, p.high,
                        starts.size() > 1 ? fmt::format(", starts: {}", starts.size()) : std::string());
  }
  return text + fmt::format("source: {}\nvisible_by: {}\nsettled_by: {}\n", quoted(info.source),
                            quoted(info.visible_by), quoted(info.settled_by));
}

}  // namespace rangecal
