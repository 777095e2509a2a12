// SPDX-License-Identifier: BSD-3-Clause
// V5. An antenna's delay depends on the direction in which it looks at the other one.
//
//   delta r = sum_h c_h cos h a + s_h sin h a,   h = 1, 2, 3     [m]
//     a azimuth [rad]: of known distances the direction in the sensor frame, or what a column holds of azimuth or elevation, at
//     this device or at the other
//
// Acts on the reading, after the curve; an empty field changes nothing. The first harmonic of an azimuth is also what a
// lever_arm that distances were not reduced for leaves. Source: range bias by the pose of ultra-wideband antennas: Zhao et
// al., IEEE RA-L 2021; here as a Fourier series of three harmonics.
#include <array>
#include <cmath>
#include <numbers>

#include "rangecal/core/recording.hpp"
#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

constexpr double quarter_turn = 0.5 * std::numbers::pi;  // to either side

class AntennaPattern final : public ColumnEffect {
 public:
  explicit AntennaPattern(const std::string& column = "")
      : ColumnEffect(
            {.id = "antenna_pattern",
             .number = "V5",
             .kind = EffectKind::mean,
             .channel = "range",
             .covariate = "sensor_bearing",
             .physics =
                 "The readings change with the direction in which the antenna looks at the other one: its delay "
                 "is not the same to all sides.",
             .formula =
                 "delta r = sum over h = 1, 2, 3 of c_h cos h a + s_h sin h a [m], a azimuth or elevation "
                 "[rad]; c_h, s_h [m]",
             .source =
                 "range bias by the pose of ultra-wideband antennas: Zhao et al., IEEE RA-L 2021; here as a "
                 "Fourier series of three harmonics",
             .visible_by = "turn the device at each distance, with a column of the direction",
             .settled_by = "turn the device on the spot by 360 degrees, distance and power unchanged",
             .parameters = {{.name = "cos_1_m", .typical = 0.05, .low = -2.0, .high = 2.0},
                            {.name = "sin_1_m", .typical = 0.05, .low = -2.0, .high = 2.0},
                            {.name = "cos_2_m", .typical = 0.05, .low = -2.0, .high = 2.0},
                            {.name = "sin_2_m", .typical = 0.05, .low = -2.0, .high = 2.0},
                            {.name = "cos_3_m", .typical = 0.05, .low = -2.0, .high = 2.0},
                            {.name = "sin_3_m", .typical = 0.05, .low = -2.0, .high = 2.0}}},
            "directions: a column bearing_rad of known distances, or one of azimuth or elevation", column),
        along_column_(!column.empty()),
        unit_rad_(column_by_name(column).unit == "deg" ? degree : 1.0) {}

  bool lies_along(ColumnRole role) const override {
    return role == ColumnRole::azimuth || role == ColumnRole::elevation;
  }
  std::unique_ptr<Effect> along(const std::string& column) const override {
    return std::make_unique<AntennaPattern>(column);
  }

  /// Of landmarks, direction and place are estimated from each other: theirs takes a column.
  std::string missing(const EffectContext& context) const override {
    const bool directions = context.kind == RecordingKind::pairs && context.largest_bearing_rad > 0.0;
    if (along_column_ || !directions) return ColumnEffect::missing(context);
    return context.largest_bearing_rad < quarter_turn
               ? "directions over half a turn: in a narrower sector any curve passes for "
                 "three harmonics"
               : "";
  }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    double sum = 0.0;
    for (int i = 0; i < 6; ++i) sum += p[i] * harmonic(at, i);
    return {.range = sum};
  }

  std::optional<ReadingChange<double>> slope(const ReadingView<double>& at, const double* /*p*/,
                                             int parameter) const override {
    return ReadingChange<double>{.range = harmonic(at, parameter)};
  }

  bool changes_with_distance() const override { return false; }

  std::vector<std::pair<std::string, double>> reported(const EffectContext&, const double* p) const override {
    std::vector<std::pair<std::string, double>> values;
    for (int h = 1; h <= 3; ++h) {
      const double c = p[2 * h - 2], s = p[2 * h - 1];
      values.emplace_back("amplitude_" + std::to_string(h) + "_m", std::hypot(c, s));
      values.emplace_back("peak_" + std::to_string(h) + "_rad", std::atan2(s, c) / h);
    }
    return values;
  }

 private:
  /// What parameter i multiplies: cos a, sin a, cos 2 a, ...
  double harmonic(const ReadingView<double>& at, int i) const {
    const double a = along_column_ ? value(at) * unit_rad_ : at.bearing, phase = (i / 2 + 1) * a;
    if (!std::isfinite(a)) return 0.0;
    return i % 2 == 0 ? std::cos(phase) : std::sin(phase);
  }

  bool along_column_;
  double unit_rad_;  ///< of the column, by the ending of its name
};

}  // namespace

std::unique_ptr<Effect> make_antenna_pattern() { return std::make_unique<AntennaPattern>(); }

}  // namespace rangecal::effects
