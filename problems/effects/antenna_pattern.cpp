// SPDX-License-Identifier: BSD-3-Clause
// V5. An antenna's delay depends on the direction in which it looks at the other one.
//
//   delta r = sum_h c_h cos h a + s_h sin h a,   h = 1 to 3, to 4 of directions that span 240 degrees, to 5 of 300     [m]
//     a azimuth [rad]: of known distances the direction in the sensor frame, or what a column holds of azimuth or elevation, at
//     this device or at the other
//
// Acts on the reading, after the curve; an empty field changes nothing. The first harmonic of an azimuth is also what a
// lever_arm that distances were not reduced for leaves. Source: range bias by the pose of ultra-wideband antennas: Zhao et
// al., IEEE RA-L 2021; here as a Fourier series.
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "rangecal/core/recording.hpp"
#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

constexpr std::array typical_m{0.05, 0.025, 0.017, 0.012, 0.01};  // by harmonic
constexpr int harmonics = static_cast<int>(typical_m.size());
constexpr double quarter_turn = 0.5 * std::numbers::pi;        // to either side
constexpr double sector_of_harmonic = std::numbers::pi / 3.0;  // h of them tell harmonic h from the others

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
                 "delta r = sum over h of c_h cos h a + s_h sin h a [m], a azimuth or elevation [rad]; c_h, s_h [m]; "
                 "h = 1 to 3, to 4 of directions that span 240 degrees, to 5 of 300",
             .source =
                 "range bias by the pose of ultra-wideband antennas: Zhao et al., IEEE RA-L 2021; here as a "
                 "Fourier series",
             .visible_by = "turn the device at each distance, with a column of the direction",
             .settled_by = "turn the device on the spot by 360 degrees, distance and power unchanged",
             .sizes_alike = true,
             .parameters = coefficients()},
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
               ? "directions over half a turn: in a narrower sector any curve passes for a pattern"
               : "";
  }

  std::pair<double, double> bounds(const EffectContext& context, std::size_t parameter) const override {
    if (static_cast<int>(parameter / 2) + 1 > harmonics_in(context)) return {0.0, 0.0};
    return Effect::bounds(context, parameter);
  }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    double sum = 0.0;
    for (int i = 0; i < 2 * harmonics; ++i) sum += p[i] * harmonic(at, i);
    return {.range = sum};
  }

  std::optional<ReadingChange<double>> slope(const ReadingView<double>& at, const double* /*p*/,
                                             int parameter) const override {
    return ReadingChange<double>{.range = harmonic(at, parameter)};
  }

  bool changes_with_distance() const override { return false; }

  std::vector<std::pair<std::string, double>> reported(const EffectContext& context,
                                                       const double* p) const override {
    std::vector<std::pair<std::string, double>> values;
    for (int h = 1; h <= harmonics_in(context); ++h) {
      const double c = p[2 * h - 2], s = p[2 * h - 1];
      values.emplace_back("amplitude_" + std::to_string(h) + "_m", std::hypot(c, s));
      values.emplace_back("peak_" + std::to_string(h) + "_rad", std::atan2(s, c) / h);
    }
    return values;
  }

 private:
  static std::vector<EffectParameter> coefficients() {
    std::vector<EffectParameter> all;
    for (int h = 1; h <= harmonics; ++h)
      for (const std::string part : {"cos", "sin"})
        all.push_back({.name = part + "_" + std::to_string(h) + "_m",
                       .typical = typical_m[static_cast<std::size_t>(h - 1)],
                       .low = -2.0,
                       .high = 2.0});
    return all;
  }

  /// Three, and up to five where the directions of a recording tell them apart.
  int harmonics_in(const EffectContext& context) const {
    constexpr int fewest = 3;
    if (along_column_ && context.columns.empty()) return harmonics;
    const double sector = along_column_
                              ? std::sqrt(12.0) * summary(context).std_dev * unit_rad_  // of even directions
                              : 2.0 * context.largest_bearing_rad;
    return std::clamp(static_cast<int>(sector / sector_of_harmonic), fewest, harmonics);
  }

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
