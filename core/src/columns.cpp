// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <array>
#include <cctype>
#include <string_view>

#include "rangecal/core/names.hpp"
#include "rangecal/core/recording.hpp"

namespace rangecal {
namespace {

constexpr auto role_names =
    names_of<ColumnRole>("role of a column", {{ColumnRole::received_power, "received_power"},
                                              {ColumnRole::temperature, "temperature"},
                                              {ColumnRole::azimuth, "azimuth"},
                                              {ColumnRole::elevation, "elevation"},
                                              {ColumnRole::supply_voltage, "supply_voltage"},
                                              {ColumnRole::intensity, "intensity"},
                                              {ColumnRole::other, "other"}});

/// A word that a name holds, or an ending that it has, and what it says of the role.
struct RoleWord {
  std::string_view word;
  ColumnRole role;
};
constexpr std::array role_words = {RoleWord{"temp", ColumnRole::temperature},
                                   RoleWord{"rssi", ColumnRole::received_power},
                                   RoleWord{"rx_power", ColumnRole::received_power},
                                   RoleWord{"received_power", ColumnRole::received_power},
                                   RoleWord{"rx_minus_fp", ColumnRole::received_power},
                                   RoleWord{"azimuth", ColumnRole::azimuth},
                                   RoleWord{"elevation", ColumnRole::elevation},
                                   RoleWord{"supply", ColumnRole::supply_voltage},
                                   RoleWord{"battery", ColumnRole::supply_voltage},
                                   RoleWord{"intensity", ColumnRole::intensity}};

/// The last part of a name, and the unit that it stands for.
struct UnitEnding {
  std::string_view ending;
  const char* unit;
  ColumnRole role;  ///< that it says where no word of the name says one
};
constexpr std::array unit_endings = {UnitEnding{"c", "degC", ColumnRole::temperature},
                                     UnitEnding{"degc", "degC", ColumnRole::temperature},
                                     UnitEnding{"celsius", "degC", ColumnRole::temperature},
                                     UnitEnding{"kelvin", "K", ColumnRole::temperature},
                                     UnitEnding{"dbm", "dBm", ColumnRole::received_power},
                                     UnitEnding{"db", "dB", ColumnRole::other},
                                     UnitEnding{"v", "V", ColumnRole::other},
                                     UnitEnding{"mv", "mV", ColumnRole::other},
                                     UnitEnding{"a", "A", ColumnRole::other},
                                     UnitEnding{"ma", "mA", ColumnRole::other},
                                     UnitEnding{"rad", "rad", ColumnRole::other},
                                     UnitEnding{"deg", "deg", ColumnRole::other},
                                     UnitEnding{"m", "m", ColumnRole::other},
                                     UnitEnding{"mm", "mm", ColumnRole::other},
                                     UnitEnding{"mps", "m/s", ColumnRole::other},
                                     UnitEnding{"s", "s", ColumnRole::other},
                                     UnitEnding{"g", "g", ColumnRole::other},
                                     UnitEnding{"kg", "kg", ColumnRole::other},
                                     UnitEnding{"hz", "Hz", ColumnRole::other},
                                     UnitEnding{"pa", "Pa", ColumnRole::other},
                                     UnitEnding{"hpa", "hPa", ColumnRole::other},
                                     UnitEnding{"lux", "lx", ColumnRole::other},
                                     UnitEnding{"percent", "%", ColumnRole::other},
                                     UnitEnding{"pct", "%", ColumnRole::other}};

}  // namespace

const char* to_string(ColumnRole role) { return role_names.name_of(role); }

ColumnRole column_role_from_string(const std::string& text) { return role_names.value_of(text); }

Column column_by_name(const std::string& name) {
  std::string lower = name;
  std::transform(lower.begin(), lower.end(), lower.begin(),
                 [](unsigned char letter) { return static_cast<char>(std::tolower(letter)); });
  const std::size_t underscore = lower.rfind('_');
  const std::string_view ending =
      underscore == std::string::npos ? "" : std::string_view(lower).substr(underscore + 1);
  const auto word = std::find_if(role_words.begin(), role_words.end(), [&](const RoleWord& known) {
    return lower.find(known.word) != std::string::npos;
  });
  const auto unit = std::find_if(unit_endings.begin(), unit_endings.end(),
                                 [&](const UnitEnding& known) { return ending == known.ending; });
  Column column;
  if (unit != unit_endings.end()) column = {unit->role, unit->unit};
  if (word != role_words.end()) column.role = word->role;
  return column;
}

Column column_of(const Recording& recording, const std::string& name) {
  const auto stated = recording.columns.find(name);
  return stated == recording.columns.end() ? column_by_name(name) : stated->second;
}

}  // namespace rangecal
