// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <string>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/recording.hpp"
#include "rangecal/core/recording_io.hpp"

namespace rangecal {
namespace {

TEST(Columns, NamesSayWhatIsMeasured) {
  const struct {
    const char *name, *role, *unit;
  } cases[] = {{"temperature_c", "temperature", "degC"},
               {"motor_temp", "temperature", ""},
               {"T_celsius", "temperature", "degC"},
               {"ambient_c", "temperature", "degC"},
               {"rx_power_dbm", "received_power", "dBm"},
               {"rx_minus_fp_db", "received_power", "dB"},
               {"RSSI", "received_power", ""},
               {"anchor_azimuth_rad", "azimuth", "rad"},
               {"elevation_rad", "elevation", "rad"},
               {"supply_v", "supply_voltage", "V"},
               {"battery_mv", "supply_voltage", "mV"},
               {"intensity", "intensity", ""},
               {"snr_db", "other", "dB"},
               {"dust_g", "other", "g"},
               {"height_m", "other", "m"},
               {"beams", "other", ""}};
  for (const auto& one : cases) {
    EXPECT_STREQ(to_string(column_by_name(one.name).role), one.role) << one.name;
    EXPECT_EQ(column_by_name(one.name).unit, one.unit) << one.name;
  }
}

Recording with_columns(const std::string& columns) {
  return parse_recording({{"recording.yaml", "format: rangecal/1\nkind: pairs\n" + columns},
                          {"pairs.csv", "true_m,reading_m,T1\n1,1.01,20\n2,2.02,21\n"}});
}

TEST(Columns, ARecordingSaysWhatItsNamesDoNot) {
  const Recording recording = with_columns("columns: {T1: {role: temperature, unit: degC}}\n");
  EXPECT_EQ(column_of(recording, "T1").role, ColumnRole::temperature);
  EXPECT_EQ(column_of(recording, "T1").unit, "degC");
  EXPECT_EQ(column_of(recording, "supply_v").role, ColumnRole::supply_voltage);
  EXPECT_EQ(column_of(with_columns(""), "T1").role, ColumnRole::other);
}

TEST(Columns, AnUnknownRoleIsRefusedByLineAndField) {
  try {
    with_columns("columns: {T1: {role: warmth}}\n");
    FAIL();
  } catch (const InputError& error) {
    const std::string what = error.what();
    EXPECT_NE(what.find("recording.yaml"), std::string::npos) << what;
    EXPECT_NE(what.find("'warmth', not one of received_power, temperature"), std::string::npos) << what;
  }
  EXPECT_THROW(with_columns("columns: {T1: {colour: red}}\n"), InputError);
}

}  // namespace
}  // namespace rangecal
